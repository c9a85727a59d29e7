"""Does independent pieces of work with processes of this machine or with a Dask cluster."""

from __future__ import annotations

import collections
import contextlib
import dataclasses as dc
import gc
import multiprocessing
import os
import pickle
import signal
import traceback
import typing
import warnings
from collections.abc import Callable, Generator, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from uuid import uuid4

from proxops.diagrams.flight.main_guard import check_main_guard
from proxops.systems.common import InputError, Progress, needed, one_thread, part_of, silent

if typing.TYPE_CHECKING:
    from dask.distributed import Client

# A process is replaced after this many pieces of work, because the memory of Drake's diagrams with
# Python systems, about 2 MB each, is never freed.
_PIECES_PER_PROCESS = 150
# The work is given up when one piece has ended this many processes.
_LIVES = 4


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
          InputError: no scheduler answers, or the extra `cluster` is missing; a piece of work
            repeatedly ended its process; or the script that is running needs
            `if __name__ == "__main__":`.
        """
        if not pieces:
            return  # A cluster would be asked, or processes started, for nothing.
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


# `concurrent.futures` does not say which piece of work ended a process, leaves processes behind
# when this one is killed, and may hang with `max_tasks_per_child` (python/cpython#115634).
class _Processes:
    """Processes of this machine; they start when work needs them, and end with `close`."""

    def __init__(self, count: int):
        self._count = count
        self._idle: list[_Process] = []

    def results(
        self, pieces: Sequence[Work], task: Callable[[Work], Result]
    ) -> Generator[tuple[str, Result]]:
        """Does what `Workers.results` does."""
        check_main_guard()
        waiting, deaths = collections.deque(pieces), collections.Counter[str]()
        busy: dict[object, tuple[_Process, Work]] = {}
        try:
            while waiting or busy:
                while waiting and len(busy) < self._count:
                    process = self._idle.pop() if self._idle else _Process()
                    piece = waiting.popleft()
                    busy[process.connection] = process, piece
                    process.give(task, piece)
                for connection in wait([process.connection for process, _ in busy.values()]):
                    process, piece = busy.pop(connection)
                    try:
                        done, result = process.take()
                    except (EOFError, OSError) as error:  # The process has ended.
                        process.end()
                        deaths[piece.name] += 1
                        if deaths[piece.name] == _LIVES:
                            raise InputError(_fatal(piece)) from error
                        waiting.append(piece)
                        continue
                    if process.pieces < _PIECES_PER_PROCESS:
                        self._idle.append(process)
                    else:
                        process.end()
                    if not done:
                        raise result
                    yield piece.name, result
        finally:  # After an error or Ctrl-C, or if nobody wants the rest, some are at work.
            for process, _ in busy.values():
                process.end()

    def close(self) -> None:
        """Ends the processes; without any it does nothing."""
        while self._idle:
            self._idle.pop().end()


class _Process:
    """A process of this machine that does one piece of work after the other."""

    def __init__(self):
        """Starts it."""
        spawn = multiprocessing.get_context("spawn")
        self.connection, its_end = spawn.Pipe()
        self.pieces = 0
        self._process = spawn.Process(target=_serve, args=(its_end,), daemon=True)
        resource_tracker.ensure_running()  # Else it would start below, and unblock the signal.
        # Ctrl-C reaches all processes of a terminal. A process inherits that it is blocked: this
        # one ends the others.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        its_end.close()

    def give(self, task: Callable[[Work], object], piece: Work) -> None:
        """Gives it a piece of work; it has none."""
        self.pieces += 1
        message = pickle.dumps((task, piece))
        with contextlib.suppress(OSError):  # `take` then tells that it has ended.
            self.connection.send_bytes(message)

    def take(self) -> tuple[bool, typing.Any]:
        """Waits for its piece of work; gives True and the result, or False and an exception.

        Raises:
          EOFError, OSError: the process has ended.
        """
        return pickle.loads(self.connection.recv_bytes())

    def end(self) -> None:
        """Ends it at once, whatever it does."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Connection) -> None:
    """Does pieces of work until the process at the other end closes the connection, or ends."""
    gc.freeze()  # Nothing that was imported is garbage; to look for it in each flight takes time.
    # Who draws the flights is told it, before any is given to a worker.
    warnings.filterwarnings("ignore", ".* may exceed assurance.bounds")
    with contextlib.suppress(EOFError, OSError):
        while True:
            message = connection.recv_bytes()
            try:
                answer = pickle.dumps((True, _on_one_thread(*pickle.loads(message))))
            except Exception as error:
                error.add_note(traceback.format_exc())
                answer = pickle.dumps((False, error))
            connection.send_bytes(answer)


def _on_one_thread(task: Callable[[Work], Result], piece: Work) -> Result:
    """Does a piece of work on one thread, because other processes use the other cores."""
    with one_thread():
        return task(piece)


def _fatal(piece: Named) -> str:
    return (
        f"{piece.name} ended {_LIVES} worker processes one after the other: is there enough "
        "memory? Run again with fewer workers to go on"
    )


def _distributed(
    client: Client, pieces: Sequence[Work], task: Callable[[Work], Result]
) -> Generator[tuple[str, Result]]:
    """Does what `Workers.results` does, by the workers of a Dask cluster."""
    from dask.distributed import KilledWorker, as_completed

    futures = [
        # The keys are unique, because others may use the scheduler for work of the same names.
        client.submit(_on_cluster, task, piece, key=f"{piece.name}-{uuid4().hex}", pure=False)
        for piece in pieces
    ]
    by_key = {future.key: piece for future, piece in zip(futures, pieces, strict=True)}
    done = as_completed(futures, loop=client.loop)
    del futures
    for future in done:
        piece = by_key[future.key]
        try:
            result = future.result()
        except KilledWorker as error:
            raise InputError(_fatal(piece)) from error
        yield piece.name, result
        future.release()


def _on_cluster(task: Callable[[Work], Result], piece: Work) -> Result:
    import dask.config

    # Otherwise xarray would write its files under locks that all workers share.
    with dask.config.set(scheduler="synchronous"):
        return _on_one_thread(task, piece)


@contextlib.contextmanager
def _cluster(scheduler: str) -> Generator[Client]:
    """A client of the scheduler at an address."""
    distributed = needed("dask.distributed", "cluster")
    try:
        # As the default client, xarray would ask it for the locks of its files.
        client = distributed.Client(scheduler, timeout="10s", set_as_default=False)
    # Dask raises the last two where certificates are missing or encryption is required.
    except (OSError, ValueError, TimeoutError, TypeError, RuntimeError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    with client:
        if not client.nthreads():
            warnings.warn(
                f"the scheduler at {scheduler} has no workers yet; the work begins when they "
                "are there",
                stacklevel=1,
            )
        yield client
