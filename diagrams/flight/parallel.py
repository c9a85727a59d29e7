"""Does independent pieces of work with processes of this machine or with a Dask cluster."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import logging
import os
import tempfile
import typing
import warnings
from collections.abc import Callable, Generator, Sequence
from uuid import uuid4

import numba

from proxops.diagrams.flight.main_guard import check_main_guard
from proxops.systems.common import InputError, Progress, one_thread, part_of, silent

if typing.TYPE_CHECKING:
    from dask.distributed import Client

# A process is replaced after this many pieces of work, because the memory of Drake's diagrams with
# Python systems, about 2 MB each, is never freed.
_PIECES_PER_PROCESS = 150
# The work is given up when one piece has ended this many workers.
_LIVES = 4
_THIS_MACHINE = "127.0.0.1"


class Named(typing.Protocol):
    """A piece of work; it is sent to the workers, so it must pickle."""

    @property
    def name(self) -> str:
        """Name of the piece; no other piece has it."""
        ...


Work = typing.TypeVar("Work", bound=Named)
Result = typing.TypeVar("Result")


@dc.dataclass(frozen=True)
class Workers:
    """Where independent pieces of work are done, and where their progress is reported."""

    processes: int | None = None
    """Number of processes on this machine; None: one for each core. With 1, a small amount of work
    is done in this process, and no other is started."""
    scheduler: str | None = None
    """Address of a Dask scheduler; its workers then do the work. They need proxops, and the folders
    of this machine under the same paths. Each worker should have one thread."""
    progress: Progress = silent
    _processes: _Processes | None = dc.field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Raises `InputError` if `processes` is below 1, or there is a scheduler too."""
        if self.processes is not None and self.processes < 1:
            raise InputError(f"Workers needs at least 1 process, got {self.processes}")
        if self.processes is not None and self.scheduler is not None:
            raise InputError(
                f"Workers takes a number of processes ({self.processes}) or a scheduler "
                f"({self.scheduler}), not both: the scheduler has workers of its own"
            )

    def results(
        self, pieces: Sequence[Work], task: Callable[[Work], Result]
    ) -> Generator[tuple[str, Result]]:
        """Gives the name and the result of each piece of work as it ends; reports no progress.

        Args:
          pieces: are sent to the workers, so they must pickle.
          task: a function of a module.

        Raises:
          InputError: no scheduler answers, a piece of work repeatedly ended its process, or the
            script that is running needs `if __name__ == "__main__":`.
        """
        if not pieces:
            return  # A cluster would be asked, or started, for nothing.
        processes = min(self.processes or os.cpu_count() or 1, len(pieces))
        if self.scheduler is not None:
            with _cluster(self.scheduler) as client:
                yield from _distributed(client, pieces, task)
        elif processes <= 1 and len(pieces) <= _PIECES_PER_PROCESS:
            for piece in pieces:
                yield piece.name, task(piece)
        elif self._processes is not None:
            yield from self._processes.results(pieces, task)
        else:
            with contextlib.closing(_Processes(processes)) as started:
                yield from started.results(pieces, task)

    @contextlib.contextmanager
    def kept(self) -> Generator[Workers]:
        """Gives the same workers; processes that they start on this machine are kept.

        To start them takes seconds. They start with the first work that needs them, do all work of
        the block, and end with it.
        """
        if self.scheduler is not None or self._processes is not None:
            yield self
            return
        with contextlib.closing(_Processes(self.processes or os.cpu_count() or 1)) as started:
            yield dc.replace(self, _processes=started)

    def part(self, start: float, end: float) -> Workers:
        """Gives the same workers for a part of the work, from share `start` to share `end`."""
        return dc.replace(self, progress=part_of(self.progress, start, end))

    def reporting(self, progress: Progress) -> Workers:
        """Gives the same workers with another `progress`."""
        return dc.replace(self, progress=progress)


class _Processes:
    """Processes of this machine; they start with the first work, and end with `close`."""

    def __init__(self, count: int):
        self._count = count
        # What more they may do before they are replaced.
        self._room = 0
        self._started = contextlib.ExitStack()
        self._client: Client | None = None

    def results(
        self, pieces: Sequence[Work], task: Callable[[Work], Result]
    ) -> Generator[tuple[str, Result]]:
        """Does what `Workers.results` does."""
        while pieces:
            if self._client is None or not self._room:
                self.close()
                self._client = self._started.enter_context(_local_cluster(self._count))
                self._room = self._count * _PIECES_PER_PROCESS
            batch, pieces = pieces[: self._room], pieces[self._room :]
            self._room -= len(batch)
            yield from _distributed(self._client, batch, task)

    def close(self) -> None:
        """Ends the processes; without any it does nothing."""
        self._client = None
        self._started.close()


def _distributed(
    client: Client, pieces: Sequence[Work], task: Callable[[Work], Result]
) -> Generator[tuple[str, Result]]:
    """Does what `Workers.results` does, by the workers of a Dask cluster."""
    # Dask is slow to import.
    from dask.distributed import KilledWorker, as_completed

    futures = [
        # The keys are unique, because others may use the scheduler for work of the same names.
        client.submit(_on_one_thread, task, piece, key=f"{piece.name}-{uuid4().hex}", pure=False)
        for piece in pieces
    ]
    names = {future.key: piece.name for future, piece in zip(futures, pieces, strict=True)}
    done = as_completed(futures)
    del futures
    for future in done:
        try:
            result = future.result()
        except KilledWorker as error:
            raise InputError(
                f"{names[future.key]} ended {_LIVES} worker processes one after the "
                "other: is there enough memory? Run again with fewer workers to go on"
            ) from error
        yield names[future.key], result
        future.release()


@contextlib.contextmanager
def _cluster(scheduler: str) -> Generator[Client]:
    """A client of the scheduler at an address."""
    from dask.distributed import Client

    usual = _default_client()
    try:
        client = Client(scheduler, timeout="10s")
    # Dask raises the last two where certificates are missing or encryption is required.
    except (OSError, ValueError, TimeoutError, TypeError, RuntimeError) as error:
        failed = _default_client()
        if failed is not None and failed is not usual:
            # Else it stays the default, whom xarray asks for the locks of its files.
            with contextlib.suppress(TimeoutError):
                failed.close(timeout=0.1)
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    with client:
        if not client.nthreads():
            warnings.warn(
                f"the scheduler at {scheduler} has no workers yet; the work begins when they "
                "are there",
                stacklevel=1,
            )
        yield client


def _default_client() -> Client | None:
    """The client that Dask uses where none is named."""
    from dask.distributed import default_client

    try:
        return default_client()
    except ValueError:
        return None


@contextlib.contextmanager
def _local_cluster(processes: int) -> Generator[Client]:
    """A client of worker processes of this machine, which end with the block."""
    check_main_guard()
    import dask.config
    from dask.distributed import Client, LocalCluster

    settings = {
        "distributed.worker.multiprocessing-method": "spawn",
        # Otherwise Dask would set these variables in this process's environment too.
        "distributed.nanny.pre-spawn-environ": {},
        # A worker that is killed is replaced, and its work is done again.
        "distributed.scheduler.allowed-failures": _LIVES - 1,
        # Dask looks at its workers' stacks a hundred times a second, and at their load as often.
        "distributed.worker.profile.enabled": False,
        "distributed.worker.memory.monitor-interval": "1s",
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "10s",
        # A user's settings for a cluster don't count here: it has no certificates.
        "distributed.comm.require-encryption": False,
    }
    with (
        # Workers import from this folder. Dask's own has a known name in a folder of all users.
        tempfile.TemporaryDirectory(prefix="proxops-", ignore_cleanup_errors=True) as private,
        dask.config.set(settings | {"temporary-directory": private}),
        LocalCluster(
            n_workers=processes,
            threads_per_worker=1,
            processes=True,
            # Only this machine can reach it. It takes any free port, because several may run.
            host=_THIS_MACHINE,
            protocol="tcp://",
            dashboard_address=f"{_THIS_MACHINE}:0",
            silence_logs=logging.CRITICAL,
            # Ctrl-C reaches all processes of a terminal; the workers end when this one does.
            preload=["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _on_one_thread(task: Callable[[Work], Result], piece: Work) -> Result:
    """Does a piece of work on one thread, because other workers use the other cores."""
    import dask.config

    numba.set_num_threads(1)
    # Otherwise xarray would write its files under locks that all workers share.
    with dask.config.set(scheduler="synchronous"), one_thread():
        return task(piece)
