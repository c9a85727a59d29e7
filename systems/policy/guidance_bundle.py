"""`GuidanceBundle`: a folder with a guidance network and the family that it was trained for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from proxops.systems.common import BundleKind, InputError, Vector3
from proxops.systems.policy.descent_network import DESCENT_BUNDLE, DescentBundle
from proxops.systems.policy.guidance_network import GuidanceNetwork
from proxops.systems.policy.policy_bundle import PolicyBundle
from proxops.systems.policy.surroundings import NUMBERS, Surroundings

GUIDANCE_BUNDLE = BundleKind(
    noun="guidance",
    file="guidance.json",
    format="proxops guidance 3",
    keys={
        "recipe": str, "ranges": dict, "data_sha256": str, "metrics": dict,
        "kernel_difference": float,
    },
    command="proxops train --recipe any-body",
    model="weights.npz",
)  # fmt: skip

# How far below and above its range a number may be, as factors of the range's ends. The network is
# told the end then. Weaker gravity, a slower spin, a higher speed limit and a shorter period ask
# for no more thrust; an ellipsoid that is a little flatter is flown around as the flattest that it
# learned. A force that is held longer comes late, by half of the period in the mean. At a pace that
# it did not learn it takes another time than the expert would.
_BEYOND = {
    "semi_axis_y": (0.9, 1.0),
    "semi_axis_z": (0.9, 1.0),
    "gravity": (0.0, 1.0),
    "spin": (0.0, 1.0),
    "speed_limit": (1.0, math.inf),
    "period": (0.0, 4.5),
    "pace": (0.0, math.inf),
}
# By which share of themselves semi-axes are told longer, so that an ellipsoid is in the family.
_LENGTHENED = 0.02


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
        content, sha256, weights = GUIDANCE_BUNDLE.read(folder)
        try:
            ranges = {
                name: (float(low), float(high)) for name, (low, high) in content["ranges"].items()
            }
        except (TypeError, ValueError, OverflowError):
            ranges = {}
        sound = all(math.isfinite(low) and low <= high < math.inf for low, high in ranges.values())
        if not sound or set(ranges) != set(NUMBERS):
            raise InputError(
                f"{folder / GUIDANCE_BUNDLE.file} is damaged: its ranges are not a least and a "
                f"greatest number each for {', '.join(NUMBERS)}"
            )
        try:
            network = GuidanceNetwork.from_bytes(weights)
        except InputError as error:
            raise InputError(f"{folder} is no guidance: {error}") from error
        return cls(folder, content["recipe"], ranges, sha256, network)

    def fitted(self, around: Surroundings) -> Surroundings:
        """Gives surroundings as the network is told them: within what it learned.

        If the speed limit is low for the thrust, it flies with a part of the thrust: with the
        acceleration for which the speed limit is the least that it learned. The network sees K
        turned so that the body is longest along x; z stays, unless the body is longest along it.
        An ellipsoid that is a little rounder or flatter than those that it learned is told longer.
        """
        around = replace(around, order=_seen_from(around.semi_axes, 1e-6))
        if any(name.startswith("semi_axis") for name in self.beyond(around.numbers())):
            short = self.semi_axes_short(around)
            if (short <= _LENGTHENED * around.semi_axes).all():
                around = replace(around, semi_axes=around.semi_axes + short)
        share = around.numbers()["speed_limit"] / self.ranges["speed_limit"][0]
        return replace(
            around, acceleration=around.acceleration * min(1.0, share) ** 2, ranges=self.ranges
        )

    def thrust_short(self, numbers: dict[str, float]) -> float:
        """By which factor thrust falls short of gravity and spin, by `Surroundings.numbers`.

        Gravity is told over the thrust's acceleration, and spin over the root of it.
        """
        gravity, spin = (numbers[name] / self.ranges[name][1] for name in ("gravity", "spin"))
        return max(gravity, spin**2)

    def semi_axes_short(self, around: Surroundings) -> Vector3:
        """By how much in m each semi-axis (3,) in K falls short of those that are flown.

        Those across z must be long against that along z, and none may be far shorter than another.
        """
        order = list(around.order)
        axes = around.semi_axes[order]
        share = around.length / axes.max()
        least, greatest = np.transpose([self._flown(name) for name in NUMBERS[:3]])
        longest = np.max(axes / np.minimum(share * greatest, 1.0))
        wanted = np.maximum(axes, share * longest * least)
        wanted[0] = longest
        short = np.empty(3)
        short[order] = wanted - axes
        return short

    def period_flown(self, around: Surroundings) -> float:
        """The longest control period in s that is flown."""
        return self._flown("period")[1] * around.time

    def _flown(self, name: str) -> tuple[float, float]:
        """Least and greatest value of one of `Surroundings.numbers` that is flown."""
        (least, greatest), (below, above) = self.ranges[name], _BEYOND.get(name, (1.0, 1.0))
        return below * least, above * greatest

    def beyond(self, numbers: dict[str, float]) -> dict[str, str]:
        """Says which of `Surroundings.numbers` are too far outside the family to fly there.

        Each comes, by its name, with the least and the greatest value that is flown.
        """
        found = {}
        for name, (least, greatest) in self.ranges.items():
            value, (low, high) = numbers.get(name, math.nan), self._flown(name)
            # The ends of a range are rounded in the file.
            slack = 1e-6 * max(abs(least), abs(greatest))
            if not low - slack <= value <= high + slack:
                found[name] = f"{name} is {value:.3g}, and it flies {low:.3g} to {high:.3g}"
        return found


def load_policy(folder: Path) -> PolicyBundle | GuidanceBundle | DescentBundle:
    """Reads the bundle of a policy of any kind.

    Raises:
      InputError: see `PolicyBundle.load`.
    """
    for kind, loaded in ((GUIDANCE_BUNDLE, GuidanceBundle), (DESCENT_BUNDLE, DescentBundle)):
        if (folder / kind.file).exists():
            return loaded.load(folder)
    return PolicyBundle.load(folder)


def _seen_from(semi_axes: Vector3, equal: float) -> tuple[int, int, int]:
    """The axes of K in the order in which a network sees them: see `Surroundings.order`.

    `equal` is a share by which lengths may differ that count as one.
    """
    x, y, z = semi_axes.tolist()
    if z > (1.0 + equal) * max(x, y):
        return (2, 0, 1) if y <= x else (2, 1, 0)
    return (1, 0, 2) if x < (1.0 - equal) * y else (0, 1, 2)
