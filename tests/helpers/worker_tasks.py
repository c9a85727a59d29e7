"""Tasks for other processes, which import them from here."""

import os
import signal
import time
import warnings

from proxops.diagrams.flight import Flight


def process_of(piece: Flight) -> int:
    time.sleep(1.0)  # So that each process has something to do.
    return os.getpid()


def kills_its_process(piece: Flight) -> str:
    """It does for the first transit."""
    if piece.scenario.transit.index == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return piece.controller


def exceeds_bounds(flight: Flight) -> None:
    """Warns as the draw of a flight does whose bounds are exceeded, and of something else."""
    warnings.warn("the scenario may exceed assurance.bounds, so there", stacklevel=1)
    warnings.warn("something else", stacklevel=1)
