"""Many flights: the same however they are shared out, and never flown twice."""

import contextlib
import dataclasses as dc
import errno
import json
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
from operator import attrgetter
from pathlib import Path
from typing import Any

import psutil
import pytest
from short_flights import BRIEF, short_scenario
from worker_tasks import exceeds_bounds, kills_its_process, process_of

from proxops.assets import ASSETS
from proxops.diagrams.flight import Workers, campaign
from proxops.diagrams.flight.campaign import Flight, fly_many, run_campaign, transit_flights
from proxops.diagrams.flight.origin import Provenance
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario import Scenario, change_scenario
from proxops.systems import InputError

WALL_TIMES = {"wall_s", "control_ms_median", "control_ms_p99", "control_ms_mean"}


def brief() -> Scenario:
    return short_scenario(**BRIEF)


def flights(count: int = 3, controller: str = "mpc") -> list[Flight]:
    return transit_flights(brief(), controller, 10000, count)


def without_wall_times(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{k: v for k, v in row.items() if k not in WALL_TIMES} for row in rows]


def visible(folder: Path) -> list[str]:
    """Names of the files that are not hidden: locks and halves are."""
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the flights flown in this process."""
    names = []
    fly_one = campaign._fly_one

    def told(flight: Flight, **options: Any) -> campaign.Row | None:
        names.append(flight.name)
        return fly_one(flight, **options)

    monkeypatch.setattr(campaign, "_fly_one", told)
    return names


def test_flights_are_the_set_s_transits() -> None:
    made = flights(12)
    assert len({flight.name for flight in made}) == 12
    ends = [(each.scenario.transit.seed, each.scenario.transit.index) for each in made]
    assert ends == [(10000, index) for index in range(12)]
    assert flights(3) == made[:3]
    assert pickle.loads(pickle.dumps(made)) == made  # So workers can get them.


@pytest.mark.parametrize("part", ["controller", "its file", "mesh", "map", "dispersions", "bounds"])
def test_flights_know_the_files_that_they_depend_on(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same files give the same flights; where one was edited, another provenance."""
    monkeypatch.chdir(tmp_path)
    name = f"edited_{part.replace(' ', '_')}"
    module = Path(f"{name}.py")
    module.write_text("FILES = ['net.pt']\n\n\ndef make(scenario, body):\n    return None\n")
    Path("net.pt").write_text("weights")
    shutil.copy(ASSETS / "kleopatra" / "kleopatra.obj", "rock.obj")
    Path("map.obj").write_text("# only its content counts\n")
    Path("mine.yaml").write_text("truth.gravity: {normal: 1.0, three_sigma: 0.01}\n")
    changes = {
        "mesh": {"truth.mesh": "rock.obj"},
        "map": {"navigation": {"_tag": "!LidarNavigation", "map": "map.obj"}},
        "dispersions": {"dispersions": "mine.yaml"},
        "bounds": {"assurance": {"bounds": "mine.yaml"}},
    }
    scenario = change_scenario(brief(), changes.get(part, {}))

    def made() -> Flight:
        [flight] = transit_flights(scenario, f"{name}:make", 1, 1)
        return flight

    first = made()
    assert made() == first
    edited = {"controller": module, "its file": "net.pt", "mesh": "rock.obj", "map": "map.obj"}
    path = Path(edited.get(part, "mine.yaml"))
    path.write_text(path.read_text().replace("0.01", "0.02") + "# edited\n")
    assert made().provenance != first.provenance


def test_files_of_a_controller_that_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for text, complaint in (
        ("FILES = ['net.pt']\n", r"net\.pt, one of its FILES, does not exist"),
        ("FILES = names()\n", r"NameError.* \(controller_with_files\.py, line 1\)"),
        ("FILES = 'net.pt'\n", "a list of texts"),
    ):
        Path("controller_with_files.py").write_text(text)
        with pytest.raises(InputError, match=complaint):
            transit_flights(brief(), "controller_with_files:make", 1, 1)


def test_one_worker(tmp_path: Path, flown: list[str]) -> None:
    told = []
    workers = Workers(1, progress=lambda *now: told.append(now))
    rows = run_campaign(flights(), tmp_path, workers=workers)
    assert [row["transit"] for row in rows] == [0, 1, 2]
    failures = [sum(not row["success"] for row in rows[:k]) for k in range(4)]
    assert told == [(k / 3, f"{k} of 3 flights, {failures[k]} without success") for k in range(4)]
    assert flown == [flight.name for flight in flights()]
    assert visible(tmp_path) == [f"{name}.json" for name in flown]
    assert json.loads((tmp_path / f"{flown[1]}.json").read_text())["summary"] == rows[1]


def test_a_flight_that_another_process_flies_is_left_for_last(
    tmp_path: Path, flown: list[str]
) -> None:
    [first, *others] = [flight.name for flight in flights()]
    # The other process flies the first transit, that is, it locks it, until the last is there.
    code = (
        "import sys, time, pathlib\n"
        "from proxops.diagrams.flight.campaign import _locked\n"
        "folder, held, last = pathlib.Path(sys.argv[1]), *sys.argv[2:]\n"
        "with _locked(folder, held, True):\n"
        "    print('locked', flush=True)\n"
        "    while not (folder / f'{last}.json').exists(): time.sleep(0.01)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path), first, others[-1]]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        rows = run_campaign(flights(), tmp_path, workers=Workers(1))
    assert flown == [first, *others, first]
    assert [row["transit"] for row in rows] == [0, 1, 2]


@pytest.mark.slow
def test_two_workers_give_the_same_rows(tmp_path: Path) -> None:
    alone = run_campaign(flights(4), tmp_path / "alone", workers=Workers(1))
    together = run_campaign(flights(4), tmp_path / "together", workers=Workers(2), keep_logs=True)
    assert without_wall_times(together) == without_wall_times(alone)
    assert len(list((tmp_path / "together").glob("*.json"))) == 4
    for path in (tmp_path / "together").glob("*.nc"):
        assert FlightLog.load(path).dataset.attrs["controller"] == "mpc"


def test_resumes(tmp_path: Path, flown: list[str]) -> None:
    first = run_campaign(flights(2), tmp_path, workers=Workers(1))
    told = []
    workers = Workers(1, progress=lambda done, text: told.append(done))
    assert run_campaign(flights(2), tmp_path, workers=workers) == first
    assert len(flown) == 2
    assert told == [1.0]
    # Logs that are wanted later are flown for.
    run_campaign(flights(1), tmp_path, workers=Workers(1), keep_logs=True)
    run_campaign(flights(1), tmp_path, workers=Workers(1), keep_logs=True)
    assert flown == [flight.name for flight in [*flights(2), *flights(1)]]
    assert FlightLog.load(tmp_path / f"{flown[0]}.nc").scenario == flights(1)[0].scenario


def test_some_logs_stay(tmp_path: Path, flown: list[str]) -> None:
    def first_and_last(rows):
        return {min(rows), max(rows)}

    names = [flight.name for flight in flights(4)]
    for count in (3, 4, 4):
        run_campaign(flights(count), tmp_path, workers=Workers(1), keep_logs=first_and_last)
    assert flown == names  # None is flown again because its log is gone.
    kept = {path.stem for path in tmp_path.glob("*.nc")}
    assert kept == {names[0], names[2], names[3]}  # Those of a run before are not touched.


def test_a_sweep(tmp_path: Path, flown: list[str]) -> None:
    short = flights(1)[0].scenario
    heavy = {
        f"{mass} kg": change_scenario(short, {"spacecraft.mass_kg": mass}) for mass in (90, 99)
    }
    for folder in (None, tmp_path, tmp_path):
        rows = fly_many(heavy, "mpc", folder, workers=Workers(1))
        assert [*rows] == ["90 kg", "99 kg"]
        assert rows["90 kg"]["delta_v_m_s"] != rows["99 kg"]["delta_v_m_s"]
    assert flown == 2 * ["90 kg", "99 kg"]  # Those in the folder are not flown again.
    with pytest.raises(InputError, match="is no name of a file"):
        fly_many({"a/b": short})


def test_unfinished_files_are_ignored(tmp_path: Path, flown: list[str]) -> None:
    name = flights(1)[0].name
    (tmp_path / f".{name}.json.abc.part").write_text('{"flight": {"na')
    (tmp_path / f".{name}.nc.abc.part").write_bytes(b"\x89HDF")
    (tmp_path / f"{name}.nc").write_bytes(b"a log without a summary: overwritten")
    [row] = run_campaign(flights(1), tmp_path, workers=Workers(1), keep_logs=True)
    assert row["steps"] == 15
    assert flown == [name]
    assert FlightLog.load(tmp_path / f"{name}.nc").summary == row


def test_a_scheduler_takes_an_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    with pytest.raises(
        InputError, match=r"dask is not installed: pip install 'proxops\[cluster\]'"
    ):
        list(Workers(scheduler="tcp://127.0.0.1:9").results(flights(1), process_of))


def test_campaigns_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = flights(1)[0].name

    def refused(made: list[Flight], words: str) -> None:
        with pytest.raises(InputError, match=words):
            run_campaign(made, tmp_path, workers=Workers(1))

    other = [dc.replace(each, provenance=Provenance("99", "0")) for each in flights(1)]
    refused(other, r"a worker has proxops .* campaign is of proxops")
    # A refusal comes through a worker as what it is.
    made = flights(1, "json:no_such_factory")
    refused(made, f"flight {made[0].name}: .*no function 'no_such_factory'")
    assert visible(tmp_path) == []
    (tmp_path / f"{name}.json").write_text('{"flight": 3}')
    refused(flights(1), name)
    (tmp_path / f"{name}.json").unlink()
    run_campaign(flights(1, "zero"), tmp_path, workers=Workers(1))
    heavy = short_scenario(**BRIEF, spacecraft__mass_kg=120.0)
    refused(
        transit_flights(heavy, "zero", 10000, 1),
        r"another scenario, such as .*: give another output",
    )

    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(campaign.fcntl, "lockf", no_locks)
    refused(flights(1), "without locks")


@pytest.mark.slow
def test_processes_of_this_machine_listen_to_nobody() -> None:
    """Whoever could reach one might run code."""
    with contextlib.closing(Workers(2).results(flights(4), attrgetter("name"))) as results:
        next(results)
        this = psutil.Process()
        listening = [
            connection.laddr
            for process in [this, *this.children(recursive=True)]
            for connection in process.net_connections(kind="inet")
            if connection.status == psutil.CONN_LISTEN
        ]
        assert len(this.children()) >= 2
    assert listening == []


@pytest.mark.slow
def test_a_piece_that_ends_its_processes_is_named() -> None:
    """The others are done: their processes go on, and the work is given up at its fourth death."""
    made, done = flights(5), []
    results = Workers(2).results(made, kills_its_process)
    with pytest.raises(InputError, match=f"{made[0].name} ended 4 worker .* fewer workers"):
        done.extend(name for name, _ in results)
    assert sorted(done) == [flight.name for flight in made[1:]]
    assert not [child for child in psutil.Process().children() if "spawn_main" in command_of(child)]


@pytest.mark.slow
def test_workers_do_not_repeat_what_the_draw_of_their_flights_told(
    capfd: pytest.CaptureFixture[str],
) -> None:
    list(Workers(2).results(flights(2), exceeds_bounds))
    told = capfd.readouterr().err
    assert "something else" in told
    assert "assurance.bounds" not in told


def command_of(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline())
    except psutil.NoSuchProcess:  # It has ended meanwhile, such as one that asks for a version.
        return ""


INTERRUPTED = """
import time
from collections import namedtuple
from proxops.diagrams.flight import Workers

Piece = namedtuple("Piece", "name")

def work(piece):
    print(piece.name, flush=True)
    time.sleep(60.0)

if __name__ == "__main__":
    list(Workers(2).results([Piece("a"), Piece("b")], work))
"""


@pytest.mark.slow
@pytest.mark.parametrize("begun", [False, True])
def test_ctrl_c_ends_the_processes(tmp_path: Path, begun: bool) -> None:
    """Also while they start; only this process says so."""
    (tmp_path / "work.py").write_text(INTERRUPTED)
    command = [sys.executable, "work.py"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        if begun:
            assert {process.stdout.readline() for _ in "ab"} == {"a\n", "b\n"}
        else:
            parent = psutil.Process(process.pid)
            while len([c for c in parent.children() if "spawn_main" in command_of(c)]) < 2:
                time.sleep(0.01)
        workers = psutil.Process(process.pid).children()
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=20.0)
    assert process.returncode == -signal.SIGINT
    assert errors.count("Traceback") == 1
    assert errors.endswith("KeyboardInterrupt\n")
    _, left = psutil.wait_procs(workers, timeout=5.0)
    assert left == []


CAMPAIGN = """
import pickle
import sys
from pathlib import Path
from proxops.diagrams.flight import Workers, run_campaign

if __name__ == "__main__":
    flights = pickle.loads(Path(sys.argv[1]).read_bytes())
    run_campaign(flights, Path(sys.argv[2]), workers=Workers(int(sys.argv[3])), keep_logs=True)
"""


def alive(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def killed_campaign(folder: Path, made: list[Flight], workers: int, finished: int) -> None:
    """Starts a campaign and kills it a moment after some flights are over; none of it is left."""
    (folder / "flights").write_bytes(pickle.dumps(made))
    (folder / "campaign.py").write_text(CAMPAIGN)
    out = folder / "out"
    command = [sys.executable, "campaign.py", "flights", "out", str(workers)]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL) as process:
        until = time.monotonic() + 60.0
        while len(list(out.glob("*.json"))) < finished:
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.005)
        time.sleep(random.Random(finished).uniform(0.0, 0.15))
        orphans = psutil.Process(process.pid).children(recursive=True)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    while any(map(alive, orphans)):  # Its workers notice, and end.
        assert time.monotonic() < until
        time.sleep(0.005)


def finish(folder: Path, made: list[Flight], flown: list[str]) -> None:
    """Runs the rest in this process; nothing that was over is touched."""
    out = folder / "out"
    before = {path: path.stat().st_mtime_ns for path in out.glob("*.json")}
    before |= {path: path.stat().st_mtime_ns for path in out.glob("*.nc")}
    over = {path.stem for path in before if path.suffix == ".json"}
    assert 0 < len(over) < len(made)
    for name in over:  # What is there is whole.
        assert FlightLog.load(out / f"{name}.nc").summary["steps"] == 15
    rows = run_campaign(made, out, workers=Workers(1), keep_logs=True)
    assert [row["transit"] for row in rows] == list(range(len(made)))
    assert set(flown) == {flight.name for flight in made} - over
    for path, time_ns in before.items():
        if path.stem in over:
            assert path.stat().st_mtime_ns == time_ns
    assert without_wall_times(rows) == without_wall_times(
        run_campaign(made, folder / "reference", workers=Workers(1))
    )


@pytest.mark.slow
def test_killed_with_workers_and_run_again(tmp_path: Path, flown: list[str]) -> None:
    made = flights(10)
    killed_campaign(tmp_path, made, workers=2, finished=3)
    finish(tmp_path, made, flown)
