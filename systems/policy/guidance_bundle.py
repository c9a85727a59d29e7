"""`GuidanceBundle`: a folder with a guidance network and the family that it was trained for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from proxops.systems.common import BundleKind, InputError, read_bundle
from proxops.systems.policy.guidance_network import GuidanceNetwork

GUIDANCE_FORMAT = "proxops guidance 2"
GUIDANCE_FILE, WEIGHTS_FILE = "guidance.json", "weights.npz"
_KIND = BundleKind(
    noun="guidance",
    file=GUIDANCE_FILE,
    format=GUIDANCE_FORMAT,
    keys={
        "recipe": str, "ranges": dict, "data_sha256": str, "metrics": dict, "model_sha256": str,
        "kernel_difference": float, "versions": dict,
    },
    command="proxops train --recipe any-body",
    model=WEIGHTS_FILE,
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
    network: GuidanceNetwork = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> GuidanceBundle:
        """Reads a bundle's folder.

        Raises:
          InputError: there is no bundle, it has another format, or it is damaged; the message says
            which.
        """
        folder = Path(path)
        content, sha256, weights = read_bundle(folder, _KIND)
        try:
            ranges = {
                name: (float(low), float(high)) for name, (low, high) in content["ranges"].items()
            }
        except (TypeError, ValueError) as error:
            raise InputError(f"{folder / GUIDANCE_FILE} is damaged: ranges are no pairs") from error
        if not all(math.isfinite(low) and low <= high < math.inf for low, high in ranges.values()):
            raise InputError(f"{folder / GUIDANCE_FILE} is damaged: a range is empty")
        try:
            network = GuidanceNetwork.from_bytes(weights)
        except InputError as error:
            raise InputError(f"{folder} is no guidance: {error}") from error
        return cls(folder, content["recipe"], ranges, sha256, network)

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
