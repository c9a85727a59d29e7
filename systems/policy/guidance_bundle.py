"""`GuidanceBundle`: a folder with a guidance network and the family that it was trained for."""

from __future__ import annotations

import math
import typing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from proxops.systems.common import BundleKind, InputError, read_bundle
from proxops.systems.policy.surroundings import INPUTS

if typing.TYPE_CHECKING:
    import onnxruntime as ort

GUIDANCE_FORMAT = "proxops guidance 1"
GUIDANCE_FILE = "guidance.json"
GUIDANCE_INPUT, GUIDANCE_OUTPUT = "given", "force"
"""Names of the network's input, one row of `Surroundings.inputs`, and of its output, the force
(3) over the thrust limit; both are float32."""
_KIND = BundleKind(
    noun="guidance",
    file=GUIDANCE_FILE,
    format=GUIDANCE_FORMAT,
    keys={
        "recipe": str, "ranges": dict, "data_sha256": str, "metrics": dict, "model_sha256": str,
        "onnx_difference": float, "versions": dict,
    },
    command="proxops train --recipe any-body",
)  # fmt: skip


@dataclass(frozen=True)
class GuidanceBundle:
    """A guidance that was read from its folder."""

    path: Path
    recipe: str
    """Name of the training recipe."""
    ranges: dict[str, tuple[float, float]]
    """Least and greatest value of each of `Surroundings.numbers` in the family."""
    sha256: str
    """Hash of `guidance.json`, which holds the network's hash. It identifies the bundle."""
    session: ort.InferenceSession = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> GuidanceBundle:
        """Reads a bundle's folder.

        Raises:
          InputError: there is no bundle, it has another format, or it is damaged; the message says
            which.
        """
        folder = Path(path)
        content, sha256, session = read_bundle(folder, _KIND)
        try:
            ranges = {
                name: (float(low), float(high)) for name, (low, high) in content["ranges"].items()
            }
        except (TypeError, ValueError) as error:
            raise InputError(f"{folder / GUIDANCE_FILE} is damaged: ranges are no pairs") from error
        if not all(math.isfinite(low) and low <= high < math.inf for low, high in ranges.values()):
            raise InputError(f"{folder / GUIDANCE_FILE} is damaged: a range is empty")
        try:
            check_guidance_network(session)
        except InputError as error:
            raise InputError(f"{folder} is no guidance: {error}") from error
        return cls(folder, content["recipe"], ranges, sha256, session)

    def beyond(self, numbers: dict[str, float]) -> list[str]:
        """Says which of `Surroundings.numbers` lie outside the family, each with its range."""
        found = []
        for name, (low, high) in self.ranges.items():
            value = numbers.get(name, math.nan)
            # The ends of a range are rounded in the file.
            slack = 1e-6 * max(abs(low), abs(high))
            if not low - slack <= value <= high + slack:
                found.append(f"{name} is {value:.3g}, and it learned {low:.3g} to {high:.3g}")
        return found


def check_guidance_network(session: ort.InferenceSession) -> None:
    """Raises `InputError` if a network's input and output are not those of a guidance."""
    for kind, name, size, values in (
        ("input", GUIDANCE_INPUT, INPUTS, session.get_inputs()),
        ("output", GUIDANCE_OUTPUT, 3, session.get_outputs()),
    ):
        wanted = [(name, "tensor(float)", [1, size])]
        got = [(value.name, value.type, list(value.shape)) for value in values]
        if got != wanted:
            raise InputError(f"the network's {kind} is {got}, not {wanted}")


def run_guidance(session: ort.InferenceSession, given: np.ndarray) -> np.ndarray:
    """Runs the network on one row (1, 22): the force (3,) over the thrust limit, float64."""
    [force] = session.run([GUIDANCE_OUTPUT], {GUIDANCE_INPUT: given})
    return np.asarray(force, dtype=np.float64)[0]
