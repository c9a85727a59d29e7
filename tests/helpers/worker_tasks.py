"""Tasks for other processes, which import them from here."""

import os
import signal
import time

from proxops.diagrams.flight import Flight


def process_of(piece: Flight) -> int:
    time.sleep(1.0)  # So that each process has something to do.
    return os.getpid()


def kills_its_process(piece: Flight) -> str:
    """It does for the first transit."""
    if piece.scenario.transit.index == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return piece.controller
