"""Worlds in which one dispersed quantity alone is far from what is believed."""

from __future__ import annotations

import dataclasses as dc
import math
import typing
from collections.abc import Sequence

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.dispersions import Dispersion
from proxops.diagrams.scenario.distributions import Fixed
from proxops.diagrams.scenario.drawn_world import world_of
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.truth_config import PARTS
from proxops.diagrams.scenario.typed_yaml import is_number

# A fixed value of these is worse if it is smaller.
_SMALLER_IS_WORSE = ("truth.specific_impulse_s",)


@dc.dataclass(frozen=True)
class Quantity:
    """One dispersed quantity."""

    main: Dispersion
    """What is set far out."""
    parts: tuple[Dispersion, ...] = ()
    """Values that mean something only together with the first; they are drawn as usual."""

    @property
    def has_multiples(self) -> bool:
        """Whether a multiple of the bound is another value: not so of a name or a choice."""
        once, twice = (self._value(1.0, multiple) for multiple in (1.0, 2.0))
        return once != twice

    def is_clipped(self, scenario: Scenario, body: Body, multiple: float) -> bool:
        """Tells whether a value this far out is beyond what the scenario permits."""
        limits = self.main.limits
        ends = [
            self.main.in_its_unit(self._value(uniform, multiple), scenario, body)
            for uniform in (0.0, 1.0)
        ]
        return limits is not None and any(
            is_number(end) and not limits[0] <= end <= limits[1] for end in ends
        )

    def far_out(
        self, uniform: float, multiple: float, scenario: Scenario, body: Body
    ) -> typing.Any:
        """Gives the value, or one number of a list, within what the scenario permits."""
        value = self.main.in_its_unit(self._value(uniform, multiple), scenario, body)
        limits = self.main.limits
        if limits is None or not is_number(value):
            return value
        return min(max(value, limits[0]), limits[1])

    def _value(self, uniform: float, multiple: float) -> typing.Any:
        distribution = self.main.distribution
        if self.main.key in _SMALLER_IS_WORSE and isinstance(distribution, Fixed):
            multiple = 1.0 / multiple
        return distribution.far_out(uniform, multiple / math.sqrt(self.main.size or 1))


def quantities(dispersions: Sequence[Dispersion]) -> list[Quantity]:
    """Gives the dispersed quantities, in order; keys that only mean something together are one."""
    keys = {each.key for each in dispersions}
    parts: dict[str, list[Dispersion]] = {key: [] for key in keys}
    mains = []
    for each in dispersions:
        whole = PARTS.get(each.key)
        if whole in keys:
            parts[typing.cast(str, whole)].append(each)
        else:
            mains.append(each)
    return [Quantity(each, tuple(parts[each.key])) for each in mains]


def far_out_world(scenario: Scenario, body: Body, quantity: Quantity, multiple: float) -> Scenario:
    """Gives the world of a scenario's flight in which one quantity alone is far out.

    A value that is normal is `multiple` times three standard deviations from its mean, on a random
    side. Of a list, the norm of the deviation is that: each of its n numbers is off by the share
    1/sqrt(n), on a side of its own. For other distributions see their `far_out`. The sides depend
    on seed and number of the transit and on the key alone. A value beyond what the scenario permits
    is set to the limit.

    Args:
      scenario: the scenario; its transit gives seed and number.
      body: the body of the scenario.
      quantity: what is far out.
      multiple: of three standard deviations.

    Returns:
      The scenario with the values, with their keys in `dispersed`.

    Raises:
      InputError: the values do not fit the scenario.
    """

    def value(each: Dispersion, uniform: float) -> typing.Any:
        if each is quantity.main:
            return quantity.far_out(uniform, multiple, scenario, body)
        return each.in_its_unit(each.distribution.value(uniform), scenario, body)

    together = [quantity.main, *quantity.parts]
    world = world_of(scenario, body, together, value)
    world.dispersed = [each.key for each in together]
    check_scenario(world, f"{quantity.main.key} x {multiple:g}, transit {scenario.transit.index}")
    return world
