"""Stages of a long study: each is worked on once, and goes on after an interruption."""

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

Work = Callable[[Path, Progress], Mapping[str, Any]]
"""Does the work of a stage in its folder, and returns a result that JSON can hold."""


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
        self._tell = tell or (lambda name, done, text: None)

    def run(self, name: str, inputs: Mapping[str, Any], work: Work) -> Stage:
        """Returns a stage, which is run only if its result is not known.

        Args:
          inputs: everything that the result depends on, as JSON: settings, results of other stages.
          work: see `Work`.

        Raises:
          InputError: the record of the stage is damaged, or cannot be written; or what `work`
            raises.
        """
        known, label = _identified(name, inputs)
        stage = self._read(self._record(label), name)
        if stage is None:
            self._tell(name, 0.0, "")
            result, wall = self._worked(name, self._out / label, work)
            make_folder(self._record(label).parent)
            content = {"inputs": known, "result": result, "wall_s": wall}
            write_json(self._record(label), content, indent=1)
            # As JSON holds it: so that it is the same when it is read again.
            result = json.loads(json.dumps(result))
            stage = Stage(name, self._out / label, result, wall, False, known["proxops"])
        self._tell(name, 1.0, "")
        self.over.append(stage)
        return stage

    def ended(self, name: str, inputs: Mapping[str, Any]) -> Stage | None:
        """Returns the stage of a name with these inputs that this version ran; None if none ended.

        Raises:
          InputError: the record of the stage is damaged.
        """
        return self._read(self._record(_identified(name, inputs)[1]), name)

    def latest(self, name: str, *, any_version: bool = False) -> Stage | None:
        """Returns the stage of a name that ended last, with any inputs; None if there is none.

        Args:
          any_version: whether a stage of another version of proxops counts, too.

        Raises:
          InputError: the record of a stage of this name is damaged.
        """
        records = self._record(f"{name}-{'[0-9a-f]' * _DIGITS}")
        newest = sorted(
            records.parent.glob(records.name), key=lambda path: -path.stat().st_mtime_ns
        )
        stages = (self._read(record, name) for record in newest)
        wanted = metadata.version("proxops")
        return next((each for each in stages if each and (any_version or each.version == wanted)),
                    None)  # fmt: skip

    def _record(self, label: str) -> Path:
        return self._out / "stages" / f"{label}.json"

    def _read(self, record: Path, name: str) -> Stage | None:
        """The stage of a record; None where the record or the folder of the stage is missing."""
        folder = self._out / record.stem
        if not (record.is_file() and folder.is_dir()):
            return None
        try:
            content = json.loads(record.read_text())
            result, wall = dict(content["result"]), float(content["wall_s"])
            version = str(content["inputs"]["proxops"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{record} is not the record of a stage: remove it and run again"
            ) from error
        return Stage(name, folder, result, wall, True, version)

    def _worked(self, name: str, folder: Path, work: Work) -> tuple[Mapping[str, Any], float]:
        """The result, and the wall time in s of all runs; a file keeps the time between them."""
        make_folder(folder)
        path = folder / ".wall_s"
        before = float(path.read_text()) if path.is_file() else 0.0
        started = kept = time.monotonic()

        def total() -> float:
            nonlocal kept
            kept = time.monotonic()
            wall = before + kept - started
            write_whole(path, lambda part: part.write_text(repr(wall)))
            return wall

        def tell(done: float, text: str) -> None:
            if time.monotonic() - kept >= _KEPT_EVERY_S:
                total()
            self._tell(name, done, text)

        try:
            result = work(folder, tell)
        finally:
            wall = total()
        return result, wall


def _identified(name: str, inputs: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Inputs with this version of proxops, as JSON holds them, and the name of their folder."""
    known = json.loads(json.dumps({**inputs, "proxops": metadata.version("proxops")}))
    digest = hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()
    return known, f"{name}-{digest[:_DIGITS]}"
