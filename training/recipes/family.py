"""A family of generated bodies, each with a spacecraft of its own, and the expert's plans there."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np

from proxops.diagrams.flight import Workers
from proxops.diagrams.new_body import (
    hover_map,
    scaled_scenario,
    scenario_in_proportion,
    write_generated_body,
)
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    change_scenario,
    dump_scenario,
)
from proxops.systems.common import derived_seed, generator, write_whole
from proxops.training.data import Labels, joined_labels, kept_labels, portions_of

_STREAM = 8


class SpacecraftNumbers(NamedTuple):
    """What a spacecraft can do at a body, without units.

    With L the longest semi-axis of the keep-out ellipsoid, and a the thrust limit per axis over the
    mass.
    """

    hover_share: float
    """Greatest force per axis that hovering over the keep-out ellipsoid takes, over the thrust
    limit; the end clearance is added to each semi-axis."""
    speed: float
    """Speed limit over sqrt(L a)."""
    period: float
    """Control period over sqrt(L / a)."""
    pace: float
    """Nominal acceleration of the MPC over a."""


# Kleopatra's numbers are 0.33, 0.404, 0.00707 and 0.43. Members have any hover share: what is hard
# is hovering, so it is drawn uniformly. They have the 2.5th part to 2.5 times Kleopatra's speed, a
# third to three times its period, and a quarter to 1.4 times its pace, log-uniform. Where hovering
# takes much, `scaled_scenario` gives more thrust, and so a slower pace.
RANGES: tuple[SpacecraftNumbers, SpacecraftNumbers] = (
    SpacecraftNumbers(0.02, 0.404 / 2.5, 0.00707 / 3.0, 0.107),
    SpacecraftNumbers(0.8, 0.404 * 2.5, 0.00707 * 3.0, 0.6),
)
"""The least and the greatest numbers of a family's members."""


def write_family(folder: Path, seed: int, count: int) -> list[Path]:
    """Writes the members 0 ... count - 1 of a family; gives the paths of their scenarios.

    Each member has a folder SEED-NUMBER with body.obj, body.yaml and scenario.yaml. It is a
    function of seed and number alone. Members that this version has written are not written again.

    Args:
      folder: of the family.
      seed: of bodies and spacecraft.
      count: number of members.
    """
    paths = []
    for number in range(count):
        path = folder / f"{seed}-{number:05d}" / "scenario.yaml"
        first_line = f"# proxops {metadata.version('proxops')}, family {seed}, member {number}"
        if not _begins_with(path, first_line):
            _write_member(path, seed, number, first_line)
        paths.append(path)
    return paths


def member_scenario(body: Body, body_path: str, numbers: SpacecraftNumbers) -> Scenario:
    """A scenario at a body with a spacecraft of the given numbers.

    Lengths are those of `scaled_scenario`. Times are in proportion to sqrt(length / acceleration),
    with the nominal acceleration. The deadline is later for a spacecraft that is slower than
    Kleopatra's in this proportion.

    Raises:
      InputError: a value is beyond its limits.
    """
    given = Scenario()
    similar = scaled_scenario(body, body_path)
    mass = similar.spacecraft.mass_kg
    length = similar.transit.cube_m / given.transit.cube_m
    hover = hover_map(body, mass, grow=similar.transit.end_clearance_m).forces.max()
    thrust = float(hover) / numbers.hover_share
    acceleration, longest = thrust / mass, float(body.keep_out_semi_axes.max())
    usual, nominal = given.mpc.nominal_acceleration_m_s2, numbers.pace * acceleration
    time = float(np.sqrt(length * usual / nominal))
    speed = numbers.speed * np.sqrt(longest * acceleration)
    later = max(1.0, given.spacecraft.speed_limit_m_s * length / time / speed)
    changes = {
        "spacecraft.thrust_limit_n": thrust,
        "spacecraft.speed_limit_m_s": speed,
        "control_period_s": numbers.period * np.sqrt(longest / acceleration),
        "mpc.nominal_acceleration_m_s2": nominal,
        "arrival.deadline_s": given.arrival.deadline_s * time * later,
    }
    scenario = scenario_in_proportion(body_path, mass, thrust, length, time)
    return change_scenario(scenario, {key: float(f"{v:.4g}") for key, v in changes.items()})


def _drawn_numbers(seed: int, number: int) -> SpacecraftNumbers:
    low, high = (np.array(each) for each in RANGES)
    shares = generator(derived_seed(seed, _STREAM), number).random(len(low))
    hover_share = low[0] + shares[0] * (high[0] - low[0])
    _, speed, period, pace = (float(each) for each in low * (high / low) ** shares)
    return SpacecraftNumbers(float(hover_share), speed, period, pace)


def _write_member(path: Path, seed: int, number: int, first_line: str) -> None:
    """Writes the files of a member, its scenario last."""
    body = write_generated_body(path.parent, seed, number)
    scenario = member_scenario(body, "body.yaml", _drawn_numbers(seed, number))
    content = f"{first_line}\n{dump_scenario(scenario)}"
    write_whole(path, lambda name: name.write_text(content, encoding="utf-8"))


def _begins_with(path: Path, line: str) -> bool:
    if not path.is_file():
        return False
    with path.open(encoding="utf-8") as file:
        return file.readline().rstrip("\n") == line


def family_plans(
    scenarios: Sequence[Scenario],
    transits_each: int,
    seed: int,
    folder: Path,
    workers: Workers = Workers(),
) -> Labels:
    """States, goals and forces as of `expert_plans`, and the number of the scenario of each.

    Every scenario has transits of its own, drawn from the seed and the scenario's number. Plans are
    kept in the folder, in portions, and are not computed again, also if scenarios are added.

    Args:
      scenarios: in a fixed order.
      transits_each: number of transits of each.
      seed: of the transits.
      folder: for the plans.
      workers: compute the plans, and report how many transits are ready.

    Returns:
      `state` (N, 6), `goal` (N, 3) and `force` (N, 3) in K and SI, and `member` (N,), int: the
      index in `scenarios`.

    Raises:
      InputError: a file in the folder is damaged or holds other plans.
    """
    portions, members = [], []
    for number, scenario in enumerate(scenarios):
        own = portions_of(
            scenario, derived_seed(seed, number), transits_each, f"member-{number:05d}"
        )
        portions += own
        members += [number] * len(own)
    parts = kept_labels(portions, folder, workers, "plans of transits")
    for member, part in zip(members, parts, strict=True):
        part["member"] = np.full(len(part["state"]), member)
    return joined_labels(parts)
