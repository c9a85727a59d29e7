"""Stages of a long piece of work, with records of their inputs and results."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import time
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from proxops.systems.common import InputError, Progress, make_folder, write_json, write_whole

# Digits of the inputs' hash in the names of folders.
_DIGITS = 8
# The wall time of a stage that goes on is kept this often (s).
_KEPT_EVERY_S = 5.0


@dc.dataclass(frozen=True)
class Stage:
    """A stage that has ended."""

    name: str
    folder: Path
    result: dict[str, Any]
    """The result as JSON holds it."""
    wall_s: float
    """Wall time in s of all its runs. Of a run that was killed, the time up to its last report of
    progress counts."""
    skipped: bool
    """Whether it had ended before, with the same inputs."""
    version: str
    """The version of proxops that ran it."""


class Stages:
    """Runs each stage once; a stage that has ended with the same inputs is not run again.

    A stage has the folder `out`/NAME-HASH. The hash is that of its inputs and of the version of
    proxops: a stage that was interrupted finds its files again, and a stage with other inputs gets
    another folder. When it ends, `out`/stages/NAME-HASH.json holds its inputs and its result.
    """

    def __init__(self, out: Path, tell: Callable[[str, float, str], Any] | None = None):
        """Takes the folder, and `tell`, which gets a stage's name, the share done and a text."""
        # All that `run` returned, in this order.
        self.over: list[Stage] = []
        self._out = out
        self._records = out / "stages"
        self._tell = tell or (lambda name, done, text: None)

    def run(
        self,
        name: str,
        inputs: Mapping[str, Any],
        work: Callable[[Path, Progress], dict[str, Any]],
    ) -> Stage:
        """Returns a stage, which is run only if its result is not known.

        Args:
          inputs: everything that the result depends on, as JSON: settings, results of other stages.
          work: takes the stage's folder and its progress, and returns a result that JSON can hold.

        Raises:
          InputError: the record of the stage is damaged, or cannot be written; or what `work`
            raises.
        """
        known, label = _identified(name, inputs)
        folder, record = self._out / label, self._records / f"{label}.json"
        make_folder(self._records)
        if self._has(record):
            stage = self._read(name, record)
        else:
            make_folder(folder)
            self._tell(name, 0.0, "")
            watch = _Watch(folder / ".wall_s")

            def told(done: float, text: str) -> None:
                watch.look()
                self._tell(name, done, text)

            try:
                result = work(folder, told)
            finally:
                wall = watch.stopped()
            content = {"inputs": known, "result": result, "wall_s": wall}
            write_json(record, content, indent=1)
            stage = dc.replace(self._read(name, record), skipped=False)
        self._tell(name, 1.0, "")
        self.over.append(stage)
        return stage

    def ended(self, name: str, inputs: Mapping[str, Any]) -> Stage | None:
        """Returns the stage of a name with these inputs that this version ran; None if none ended.

        Raises:
          InputError: the record of the stage is damaged.
        """
        record = self._records / f"{_identified(name, inputs)[1]}.json"
        return self._read(name, record) if self._has(record) else None

    def latest(self, name: str, *, any_version: bool = False) -> Stage | None:
        """Returns the stage of a name that ended last, with any inputs; None if there is none.

        Args:
          any_version: whether a stage of another version of proxops counts, too.

        Raises:
          InputError: the record of the stage is damaged.
        """
        records = [
            record
            for record in self._records.glob(f"{name}-{'[0-9a-f]' * _DIGITS}.json")
            if self._has(record) and (any_version or _is_of_this_version(record))
        ]
        if not records:
            return None
        return self._read(name, max(records, key=lambda record: record.stat().st_mtime_ns))

    def _has(self, record: Path) -> bool:
        """Whether there are a record and the folder of its stage."""
        return record.is_file() and (self._out / record.stem).is_dir()

    def _read(self, name: str, record: Path) -> Stage:
        try:
            content = json.loads(record.read_text())
            result, wall = dict(content["result"]), float(content["wall_s"])
            version = str(content["inputs"]["proxops"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{record} is not the record of a stage: remove it and run again"
            ) from error
        return Stage(name, self._out / record.stem, result, wall, True, version)


class _Watch:
    """Measures the wall time of a stage over all runs that it takes; a file keeps the sum."""

    def __init__(self, path: Path):
        self._path = path
        self._started = self._kept = time.monotonic()
        try:
            self._before = float(path.read_text())
        except (OSError, ValueError):
            self._before = 0.0

    def look(self) -> None:
        """Keeps the time in the file, now and then."""
        if time.monotonic() - self._kept >= _KEPT_EVERY_S:
            self.stopped()

    def stopped(self) -> float:
        """Keeps the time in the file, and gives it in s."""
        self._kept = time.monotonic()
        total = self._before + self._kept - self._started
        write_whole(self._path, lambda path: path.write_text(repr(total)))
        return total


def _identified(name: str, inputs: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Inputs with this version of proxops, as JSON holds them, and the name of their folder."""
    known = json.loads(json.dumps({**inputs, "proxops": metadata.version("proxops")}))
    digest = hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()
    return known, f"{name}-{digest[:_DIGITS]}"


def _is_of_this_version(record: Path) -> bool:
    try:
        return json.loads(record.read_text())["inputs"]["proxops"] == metadata.version("proxops")
    except (OSError, ValueError, KeyError, TypeError):
        return False
