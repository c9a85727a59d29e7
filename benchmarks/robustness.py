"""Shows what a controller withstands: one dispersed quantity at a time, and all of them together.

Every variant flies the transits of one seed to the same goals, with the same noise. In a line such
as `truth.gravity x 2`, that quantity alone is off, by twice its three standard deviations, on a
side that is drawn for each flight; of three axes, the norm is off by that. A value beyond what a
scenario permits is set to its limit, and the line says so. In the last three lines the flight
starts where no transit of the set starts. Flights are kept in the folder of `--out`: run the
command again to finish what was interrupted, or to add transits.

    python benchmarks/robustness.py [--controller policy] [--dispersions after_survey]
        [--only truth.gravity "truth.mass x 3" …] [--set gravity=table …] [--transits 40]
        [--seed 10001] [--workers N] [--out out/robustness] [--markdown table.md]

`--controller` takes the names that `proxops evaluate` takes: `policy:out/mine/bundle`, or `mpc` for
the expert under the same conditions. The navigation is told the dispersions, in every line the
same: it does not know which quantity is off, nor how far. Only where all are off together, and with
the paper's disturbance, is it told of those instead. `--only` takes quantities and whole lines.
Give each controller and each name of dispersions a folder of its own.
"""

import dataclasses
import difflib
import functools
import math
import typing
from collections.abc import Callable, Sequence

import numpy as np
from _campaign import campaign_parser, fly_with_bar, show

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import (
    Body,
    Dispersion,
    Scenario,
    Transit,
    check_scenario,
    draw_world,
    hover_force,
    load_body,
    load_dispersions,
    load_scenario,
)
from proxops.diagrams.scenario.dispersions import Dispersions
from proxops.diagrams.scenario.distributions import (
    Choice,
    Fixed,
    HalfNormal,
    LogUniform,
    Normal,
    Uniform,
)
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.world import world_of
from proxops.studies.campaigns import Variant
from proxops.systems.common import InputError, derived_seed, generator
from proxops.systems.shapes import clearances

NOMINAL = "nominal"
# Multiples of three standard deviations.
MULTIPLES = (1, 2, 3)
TOGETHER: dict[str, dict] = {
    "all of after_survey": {"dispersions": "after_survey"},
    "all of before_survey": {"dispersions": "before_survey"},
    "the paper's disturbance": {"disturbance": {}},
}
CLIPPED = " (at its limit)"
OUTSIDE, INSIDE_MARGIN, MOVING = "start outside the cube", "start inside the margin", "start moving"
HEADINGS = (
    "success", "success (2 km)", "collisions", "keep-out violations", "unflyable",
    "end error, median (m)", "p95 (m)", "Δv, median (m/s)",
)  # fmt: skip

# Starts outside the cube: from the origin, in m.
NEAREST, FURTHEST = 190e3, 220e3
# Starts inside the margin, from the ellipsoid, in m: from rest there is time to act.
LEAST_CLEARANCE, GREATEST_CLEARANCE = 300.0, 3e3
SPEED = 20.0
# Share of the thrust limit that must suffice to stop before the ellipsoid.
BRAKING_SHARE = 0.5
ATTEMPTS = 10_000
# A fixed value of these is worse if it is smaller.
SMALLER_IS_WORSE = ("truth.specific_impulse_s",)

Start = tuple[np.ndarray, np.ndarray]
"""Position (3,) in m and velocity (3,) in m/s, in K."""


def outside_cube(transit: Transit, scenario: Scenario, body: Body) -> Start:
    """At rest, 190 to 220 km out on that half of an axis which the goal is furthest along."""
    axis = np.argmax(np.abs(transit.goal))
    place = np.zeros(3)
    distance = _random(OUTSIDE, transit).uniform(NEAREST, FURTHEST)
    place[axis] = np.copysign(distance, transit.goal[axis])
    return place, np.zeros(3)


def inside_margin(transit: Transit, scenario: Scenario, body: Body) -> Start:
    """At rest, 0.3 to 3 km from the keep-out ellipsoid, as far from the goal as transits are."""
    random, axes, rules = _random(INSIDE_MARGIN, transit), body.keep_out_semi_axes, scenario.transit
    # A goal in a corner of the cube may be further from all of the ellipsoid than transits are.
    nearest = float(clearances(axes, transit.goal[None])[0])
    furthest = max(rules.max_distance_m, nearest + rules.min_distance_m)
    for _ in range(ATTEMPTS):
        way = random.standard_normal(3)
        surface = axes * way / np.linalg.norm(way)
        normal = surface / axes**2 / np.linalg.norm(surface / axes**2)
        place = surface + random.uniform(LEAST_CLEARANCE, GREATEST_CLEARANCE) * normal
        distance = float(np.linalg.norm(place - transit.goal))
        if not rules.min_distance_m <= distance <= furthest:
            continue
        limit = rules.max_hover_share * scenario.spacecraft.thrust_limit_n
        if hover_force(place[None], scenario.spacecraft.mass_kg, body)[0] <= limit:
            return place, np.zeros(3)
    raise InputError(f"no start inside the margin for transit {transit.index}")


def moving(transit: Transit, scenario: Scenario, body: Body) -> Start:
    """Where the transit starts, at 20 m/s in any direction from which it can still stop."""
    random, craft = _random(MOVING, transit), scenario.spacecraft
    braking = BRAKING_SHARE * craft.thrust_limit_n / craft.mass_kg
    for _ in range(ATTEMPTS):
        way = random.standard_normal(3)
        way /= np.linalg.norm(way)
        # Straight on until it stands.
        stop = transit.start + np.linspace(0.0, SPEED**2 / (2.0 * braking), 50)[:, None] * way
        if clearances(body.keep_out_semi_axes, stop).min() > 0.0:
            return transit.start, SPEED * way
    raise InputError(f"no way to move from the start of transit {transit.index}")


STARTS: dict[str, Callable[[Transit, Scenario, Body], Start]] = {
    OUTSIDE: outside_cube,
    INSIDE_MARGIN: inside_margin,
    MOVING: moving,
}


def as_believed(scenario: Scenario, body: Body, dispersions: str) -> Scenario:
    """The scenario as it is, but for its navigation, which is told the dispersions."""
    drawn = draw_world(dataclasses.replace(scenario, dispersions=dispersions), body)
    return dataclasses.replace(scenario, navigation=drawn.navigation)


def is_number(value: typing.Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclasses.dataclass(frozen=True)
class Quantity:
    """What is set far out, and values that mean something only with it, which are drawn."""

    main: Dispersion
    parts: tuple[Dispersion, ...] = ()

    @property
    def has_multiples(self) -> bool:
        """Whether a multiple of the bound is another value: not so of a name or a choice."""
        return self._value(1.0, 1.0) != self._value(1.0, 2.0)

    def is_clipped(self, scenario: Scenario, body: Body, multiple: float) -> bool:
        """Whether a value this far out is beyond what the scenario permits."""
        ends = [self.main.in_its_unit(self._value(u, multiple), scenario, body) for u in (0.0, 1.0)]
        return ends != [self.far_out(u, multiple, scenario, body) for u in (0.0, 1.0)]

    def far_out(self, uniform: float, multiple: float, scenario: Scenario, body: Body):
        """The value, or one number of a list, within what the scenario permits."""
        value = self.main.in_its_unit(self._value(uniform, multiple), scenario, body)
        limits = self.main.limits
        if limits is None or not is_number(value):
            return value
        return min(max(value, limits[0]), limits[1])

    def _value(self, uniform: float, multiple: float) -> typing.Any:
        multiple /= math.sqrt(self.main.size or 1)
        match self.main.distribution:
            case Normal(mean, three_sigma):
                return mean + math.copysign(multiple * three_sigma, uniform - 0.5)
            case HalfNormal(least, three_sigma):
                return least + multiple * three_sigma
            case Uniform(low, high):
                return low + multiple * (high - low)
            case LogUniform(low, high):
                return math.sqrt(low * high) * math.sqrt(high / low) ** multiple
            case Choice(values):
                return values[-1]
            case Fixed(same) if not is_number(same):
                return same
            case Fixed(same):
                return same / multiple if self.main.key in SMALLER_IS_WORSE else multiple * same


def quantities(dispersions: Sequence[Dispersion]) -> list[Quantity]:
    """The dispersed quantities; keys that only mean something together are one."""
    whole = {each.key: QUANTITY[each.key].needs for each in dispersions}
    return [
        Quantity(main, tuple(each for each in dispersions if whole[each.key] == main.key))
        for main in dispersions
        if whole[main.key] not in whole
    ]


def far_out_world(scenario: Scenario, body: Body, quantity: Quantity, multiple: float) -> Scenario:
    """The world of a scenario's flight in which one quantity alone is far out.

    A value that is normal is `multiple` times three standard deviations from its mean, on a random
    side. Of a list, the norm of the deviation is that: each of its n numbers is off by the share
    1/sqrt(n), on a side of its own. The sides depend on seed and number of the transit and on the
    key alone.
    """

    def value(each: Dispersion, uniform: float) -> typing.Any:
        if each is quantity.main:
            return quantity.far_out(uniform, multiple, scenario, body)
        return each.in_its_unit(each.distribution.value(uniform), scenario, body)

    together = [quantity.main, *quantity.parts]
    world = world_of(Dispersions(scenario, body, together), value)
    world.dispersed = [each.key for each in together]
    check_scenario(world, f"{quantity.main.key} x {multiple:g}, transit {scenario.transit.index}")
    return world


def one_off(
    scenario: Scenario, body: Body, dispersions: str, quantity: Quantity, multiple: int
) -> Scenario:
    """As `as_believed`, but in the world of `far_out_world`."""
    return far_out_world(as_believed(scenario, body, dispersions), body, quantity, multiple)


def variants(controller: str, dispersions: str, scenario: Scenario) -> dict[str, list[Variant]]:
    """All lines of the table in order, by the quantity or the conditions that they show.

    Raises:
      InputError: see `load_dispersions`.
    """
    body = load_body(scenario.body)
    nominal = functools.partial(as_believed, dispersions=dispersions)
    lines = {NOMINAL: [Variant(NOMINAL, controller, world=nominal)]}
    for quantity in quantities(load_dispersions(dispersions)):
        key = quantity.main.key
        lines[key] = []
        for multiple in MULTIPLES if quantity.has_multiples else MULTIPLES[:1]:
            clipped = CLIPPED if quantity.is_clipped(scenario, body, multiple) else ""
            world = functools.partial(
                one_off, dispersions=dispersions, quantity=quantity, multiple=multiple
            )
            name = f"{key} x {multiple}{clipped}"
            lines[key].append(Variant(name, controller, world=world))
    for name, changes in TOGETHER.items():
        lines[name] = [Variant(name, controller, changes)]
    for name, start in STARTS.items():
        lines[name] = [Variant(name, controller, start=start, world=nominal)]
    return lines


def chosen(lines: dict[str, list[Variant]], only: Sequence[str] | None) -> list[Variant]:
    """The lines that are asked for, in the order of the table; None: all of them.

    Raises:
      InputError: there is no such quantity or line.
    """
    every = [each for group in lines.values() for each in group]
    names = [*lines, *(each.name for each in every)]
    for name in only or ():
        if name not in names:
            [near] = difflib.get_close_matches(name, names, n=1, cutoff=0.0)
            raise InputError(f"--only: there is no line {name!r}; the nearest is {near!r}")
    return [
        each
        for key, group in lines.items()
        for each in group
        if only is None or key in only or each.name in only
    ]


def _random(variant: str, transit: Transit) -> np.random.Generator:
    """Random numbers for one start; they depend on variant, seed and number of the transit."""
    stream = list(STARTS).index(variant)
    return generator(derived_seed(transit.seed, 1 + stream), transit.index)


def figures(rows: Sequence[Row]) -> list[str]:
    """One line of the table; Δv is of the flights that succeeded.

    A world that cannot be flown is counted in its column, and in no other.
    """
    flown = [row for row in rows if "unflyable" not in row]
    errors = [row["terminal_position_error_m"] for row in flown]
    spent = [row["delta_v_m_s"] for row in flown if row["success"]]
    return [
        f"{sum(row['success'] for row in flown)}/{len(flown)}",
        f"{sum(row['success_2km'] for row in flown)}/{len(flown)}",
        str(sum(row["collided"] for row in flown)),
        str(sum(row["keep_out_violations"] for row in flown)),
        str(len(rows) - len(flown)),
        f"{np.median(errors):.1f}" if errors else "–",
        f"{np.percentile(errors, 95):.1f}" if errors else "–",
        f"{np.median(spent):.1f}" if spent else "–",
    ]


def main() -> None:
    parser = campaign_parser(__doc__, "out/robustness", transits=40, seed=10001)
    parser.add_argument("--controller", default="policy")
    parser.add_argument(
        "--dispersions", default="after_survey", help="a name that ships, or a YAML file"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument(
        "--only", nargs="+", metavar="LINE", help="quantities or lines; default: all"
    )
    asked = parser.parse_args()
    scenario = load_scenario(None, ["log_ranges=false", *asked.set])
    try:
        wanted = chosen(variants(asked.controller, asked.dispersions, scenario), asked.only)
    except InputError as error:
        raise SystemExit(str(error)) from error
    rows = fly_with_bar(wanted, scenario, asked)
    lines = {name: figures(flown) for name, flown in rows.items()}
    title = (
        f"{asked.controller}, {asked.transits} transits of seed {asked.seed}, "
        f"one quantity at a time of {asked.dispersions}"
    )
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
