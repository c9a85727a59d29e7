"""Descents to a site of Bennu and away again, on a navigated state with a bias and noise.

    python benchmarks/touch.py --flights 40

Each flies from 125 m, 15 m aside, with the spacecraft as a point that holds its attitude, to half a
metre over the ground, and from there on in the contact plant. Errors: `_draw` and `GAIN`.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import (
    load_body,
    load_scenario,
    load_spacecraft,
    site_world,
    touch_craft,
)
from proxops.systems.common import generator
from proxops.systems.touch import (
    Arm,
    DescentGuidance,
    Site,
    SiteLimits,
    best_sites,
    fly_contact,
    make_contact_plant,
    map_sites,
    patch_of,
    use_of_limits,
)
from proxops.systems.vehicle import runge_kutta_step

DOWN = np.array([0.0, 0.0, -1.0])
# From the centre of mass to the head's surface; where the contact plant takes over; how far the
# ground is taken along about the site, in m; control periods in s.
HEAD, OVER, PATCH = 3.0, 0.5, 30.0
FAR_PERIOD, NEAR_PERIOD, NEAR = 10.0, 1.0, 7.0
# Of the filter through which a white error of 0.5 m and 1 cm/s goes at each step.
GAIN = 0.2


class Errors(NamedTuple):
    """What differs in one descent."""

    bias: np.ndarray
    thrust: float
    gravity: float
    tilt: np.ndarray
    rate: np.ndarray


def _draw(seed: int, index: int, bias: float, speed_bias: float) -> Errors:
    """Draws biases in m and m/s, 1 % of thrust and gravity, 0.1 degrees and as much a 10 s."""
    rng = generator(seed, index)
    offset = np.concatenate([rng.normal(0.0, bias, 3), rng.normal(0.0, speed_bias, 3)])
    thrust, gravity = 1.0 + rng.normal(0.0, 0.01, 2)
    return Errors(
        offset,
        thrust,
        gravity,
        rng.normal(0.0, np.radians(0.1), 3),
        rng.normal(0.0, np.radians(0.01), 3),
    )


def descend(guidance: DescentGuidance, errors: Errors, seed: int):
    """Flies to half a metre over the ground: state, Δv, room in the corridor, times of steps."""
    rng, site, normal = np.random.default_rng(seed), guidance.site, guidance.site.normal
    aside = np.cross(normal, [0.0, 0.0, 1.0])
    state = np.r_[guidance.home + 15.0 * aside / np.linalg.norm(aside), np.zeros(3)]
    now, delta_v, room, took = 0.0, 0.0, np.inf, []
    noise = np.zeros(6)
    spin = guidance.spin.angular_velocity(0.0)
    while guidance.height(state) > OVER:
        white = np.concatenate([rng.normal(0.0, 0.5, 3), rng.normal(0.0, 0.01, 3)])
        noise += GAIN * (white - noise)
        navigated = state + errors.bias + noise
        began = time.perf_counter()
        force = errors.thrust * guidance.force(now, navigated)
        took.append(time.perf_counter() - began)
        step = NEAR_PERIOD if guidance.height(navigated) < NEAR else FAR_PERIOD

        def rates(s: np.ndarray, force: np.ndarray = force) -> np.ndarray:
            pull = errors.gravity * guidance.field.evaluate(s[None, :3]).acceleration[0]
            turned = 2.0 * np.cross(spin, s[3:]) + np.cross(spin, np.cross(spin, s[:3]))
            return np.r_[s[3:], pull - turned + force / guidance.mass]

        state = runge_kutta_step(rates, state, step)
        now += step
        delta_v += float(np.linalg.norm(force)) / guidance.mass * step
        height = guidance.height(state)
        off = np.linalg.norm(state[:3] - site.position - height * normal)
        room = min(room, np.tan(np.radians(guidance.descent.cone_deg)) * height + 2.0 - off)
        if now > 2.0 * guidance.duration:
            raise RuntimeError("it does not come down")
    return state, delta_v, room, took


def main() -> None:
    """Flies and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--bias", type=float, default=0.5, help="m, 1 sigma per axis")
    parser.add_argument("--speed-bias", type=float, default=0.0, help="m/s, likewise")
    parser.add_argument("--step", type=float, default=0.01, help="s, of the contact plant")
    asked = parser.parse_args()
    scenario, body = load_scenario("bennu"), load_body("bennu")
    limits, world = SiteLimits(), site_world(scenario, body)
    sites, _ = map_sites(body.shape, limits, world)
    use = use_of_limits(sites, limits, scenario.spacecraft.thrust_limit_n)
    best = int(best_sites(sites, use, 1, 1.0)[0])
    normal, place = sites.normals[best], sites.positions[best]
    arm = Arm((HEAD - 0.16) * DOWN, DOWN)
    craft = touch_craft(load_spacecraft("osiris_rex"), arm)
    site = Site(place + HEAD * normal, normal)
    guidance = DescentGuidance(
        body.exact_field, body.spin, craft.mass, scenario.spacecraft.thrust_limit_n, site
    )
    diagram = make_contact_plant(
        patch_of(body.shape, place, PATCH), body.exact_field, body.spin, craft, step=asked.step
    )
    # S's z along the normal.
    upright = Rotation.align_vectors([normal], [-DOWN])[0]
    rows, failed, times, began = [], 0, [], time.process_time()
    for index in range(asked.flights):
        errors = _draw(asked.seed, index, asked.bias, asked.speed_bias)
        state, delta_v, room, took = descend(guidance, errors, asked.seed + index)
        times += took
        attitude = upright * Rotation.from_rotvec(errors.tilt)
        rate = attitude.inv().apply(np.array(body.spin.angular_velocity(0.0))) + errors.rate
        touch = fly_contact(
            diagram,
            guidance,
            craft,
            (state, attitude.as_quat(scalar_first=True), rate),
            upright.as_quat(scalar_first=True),
            errors.bias,
        )
        if touch is None:
            failed += 1
            continue
        along = touch.state[3:] @ normal
        height = guidance.height(touch.state)
        rows.append(
            [
                np.linalg.norm(touch.state[:3] - site.position - height * normal),
                -100.0 * along,
                100.0 * np.linalg.norm(touch.state[3:] - along * normal),
                np.degrees(touch.tilt),
                delta_v + touch.impulse / craft.mass,
                room,
                touch.peak,
                touch.duration,
                100.0 * touch.stroke,
                touch.parts,
                touch.touches,
                100.0 * touch.speed,
                np.degrees(touch.rate),
            ]
        )
    names = (
        "miss (m)", "down (cm/s)", "across (cm/s)", "tilt (deg)", "delta-v (m/s)",
        "least room in the corridor (m)", "peak force (N)", "contact (s)", "stroke (cm)",
        "force on bus and panels (N)", "second touches", "away (cm/s)", "rate at +10 s (deg/s)",
    )  # fmt: skip
    where = f"{sites.latitudes[best]:.2f},{sites.longitudes[best]:.2f}"
    biases = f"biases {asked.bias} m, {asked.speed_bias} m/s"
    print(f"site {where}, seed {asked.seed}, {biases}, steps of {asked.step} s:")
    print(f"{len(rows)} of {asked.flights} touched and came away, {failed} did not")
    print(f"| {'':31} | least | median | 95 % | greatest |")
    for name, column in zip(names, np.array(rows).T, strict=True):
        figures = [column.min(), *np.percentile(column, [50, 95]), column.max()]
        print(f"| {name:31} | " + " | ".join(f"{x:.3g}" for x in figures) + " |")
    print(f"guidance {1e3 * np.median(times):.2f} ms a step, {1e3 * max(times[1:]):.2f} at most")
    print(f"{(time.process_time() - began) / asked.flights:.1f} s of processor a flight")


if __name__ == "__main__":
    main()
