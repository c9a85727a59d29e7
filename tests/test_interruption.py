"""Ctrl-C acts, whenever it comes, and not in the midst of a file."""

import os
import random
import signal
import threading
import time
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.systems.common.interruption import interruption_waits


@pytest.fixture(autouse=True)
def handler() -> Generator[None]:
    """Python's own, even where the tests run in the background of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def interrupted(lines: list[str], times: int = 1) -> None:
    with interruption_waits():
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)
        lines.append("the rest")


def test_acts_once_at_the_end_of_the_block() -> None:
    lines: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        interrupted(lines, times=2)
    assert lines == ["the rest"]


def test_acts_at_the_end_of_the_outer_block() -> None:
    lines: list[str] = []

    def nested() -> None:
        with interruption_waits():
            interrupted(lines)
            lines.append("the rest of the outer block")

    with pytest.raises(KeyboardInterrupt):
        nested()
    assert lines == ["the rest", "the rest of the outer block"]


def test_acts_after_an_error_too() -> None:
    def fails() -> None:
        with interruption_waits():
            signal.raise_signal(signal.SIGINT)
            raise KeyError

    with pytest.raises(KeyboardInterrupt):
        fails()


def test_ignored_stays_ignored() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interruption_waits():
        signal.raise_signal(signal.SIGINT)
    assert signal.signal(signal.SIGINT, signal.default_int_handler) is signal.SIG_IGN


def test_does_nothing_in_another_thread() -> None:
    found = []

    def look() -> None:
        with interruption_waits():
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [signal.default_int_handler]


@pytest.mark.parametrize("what", ["write", "read"])
def test_is_never_lost_at_a_log(tmp_path: Path, what: str) -> None:
    log, path = synthetic_log(steps=20), tmp_path / "flight.nc"
    log.to_netcdf(path)
    work: Callable[[], object]
    work = (lambda: log.to_netcdf(path)) if what == "write" else (lambda: FlightLog.load(path))
    begun = time.perf_counter()
    work()
    seconds = time.perf_counter() - begun

    def work_on(interrupt: threading.Timer) -> None:
        interrupt.start()
        until = time.monotonic() + 20.0
        while time.monotonic() < until:
            work()

    chance = random.Random(0)
    for _ in range(10):
        wait = chance.uniform(0.0, seconds)
        interrupt = threading.Timer(wait, os.kill, (os.getpid(), signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            work_on(interrupt)
        interrupt.join()
        FlightLog.load(path)
