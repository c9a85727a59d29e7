"""Backup braking against closed forms, and against flights by an independent integration.

Eq. 23 to 27 of docs/method/equations.md.
"""

from functools import cache

import numpy as np
import pytest
from braking_ball import BALL, MASS, PUSH, RADIUS, THRUST, ball_field, no_gravity
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from short_flights import kleopatra

from proxops.diagrams.flight.scenario_systems import bounded_backup
from proxops.diagrams.logs.flight_summary import dense_positions
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import AssuranceBounds, BackupBraking, FlightLimits, InterventionReason
from proxops.systems.gravity.gravity_field import GRAVITATIONAL_CONSTANT
from proxops.systems.shapes.ellipsoid import clearances
from proxops.systems.vehicle.state_prediction import predicted_state


@cache
def kleopatras() -> BackupBraking:
    return bounded_backup(load_scenario(), kleopatra(), AssuranceBounds())


def step(state: np.ndarray, force: np.ndarray) -> np.ndarray:
    body = kleopatra()
    return predicted_state(state, force, 10.0, body.gravity_field, MASS, body.spin_rate)


def least_clearance(states: list[np.ndarray]) -> float:
    path = dense_positions(10.0 * np.arange(len(states)), np.array(states))
    return float(clearances(kleopatra().keep_out_semi_axes, path).min())


# Anywhere from the ellipsoid on to the cube's corners, half of them within some kilometres.
AWAY = st.one_of(st.floats(1.002, 1.1), st.floats(1.1, 4.0))
UNIT = arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)).filter(
    lambda vector: np.linalg.norm(vector) > 0.1
)


@st.composite
def states(draw: st.DrawFn) -> np.ndarray:
    direction = draw(UNIT)
    position = draw(AWAY) * direction / np.linalg.norm(direction) * kleopatra().keep_out_semi_axes
    velocity = draw(arrays(np.float64, 3, elements=st.floats(-40.0, 40.0)))
    return np.concatenate([position, velocity])


FORCES = arrays(np.float64, 3, elements=st.floats(-THRUST, THRUST))


@pytest.mark.parametrize("speed", [3.0, 15.0, 40.0])
@pytest.mark.parametrize("height", [100.0, 2e3, 12e3])
def test_stops_within_the_closed_form_in_empty_space(speed: float, height: float) -> None:
    backup = BackupBraking(no_gravity(), 0.0, BALL)
    for axis in range(3):
        state = np.zeros(6)
        state[axis], state[3 + axis] = -(RADIUS + height), speed
        expected = height - speed**2 / (2.0 * PUSH)
        # A lower bound: by what a path may bend between steps, and a thousandth of the thrust.
        slack = PUSH * 10.0**2 / 8.0 + 1.1e-3 * speed**2 / (2.0 * PUSH)
        assert expected - slack - 1e-6 <= backup.backup_margin(state) <= expected + 1e-6


@pytest.mark.parametrize("lowest", [RADIUS + 50.0, RADIUS + 5e3])
def test_stops_where_energy_says_over_a_point_mass(lowest: float) -> None:
    field, speed = ball_field(2e18, 30e3), 30.0
    mu = GRAVITATIONAL_CONSTANT * field.mass
    # v^2 / 2 = a (r - lowest) - mu (1 / lowest - 1 / r): a quadratic in r.
    level = 0.5 * speed**2 + PUSH * lowest + mu / lowest
    start = (level + np.sqrt(level**2 - 4.0 * PUSH * mu)) / (2.0 * PUSH)
    margin = BackupBraking(field, 0.0, BALL).backup_margin(np.array([0, start, 0, 0, -speed, 0]))
    assert lowest - RADIUS - 100.0 < margin <= lowest - RADIUS + 0.1


def test_diagonal_brakes_with_all_axes() -> None:
    """The box of thrust reaches further along its diagonal: by the root of 3."""
    backup = BackupBraking(no_gravity(), 0.0, BALL)
    diagonal = np.ones(3) / np.sqrt(3.0)
    state = np.concatenate([(RADIUS + 10e3) * diagonal, -30.0 * diagonal])
    expected = 10e3 - 30.0**2 / (2.0 * np.sqrt(3.0) * PUSH)
    assert expected - 8.0 < backup.backup_margin(state) <= expected


@pytest.mark.slow
@settings(max_examples=8)
@given(states())
def test_backup_from_admitted_states_stays_out(state: np.ndarray) -> None:
    """With polyhedral gravity, by RK4: to the end of what was promised, and well after it."""
    backup = kleopatras()
    assume(backup.admitted(state))
    flown = [state]
    for _ in range(200):
        flown.append(step(flown[-1], backup.force(flown[-1])))
    assert least_clearance(flown) >= 0.0
    normals = np.array(flown)[:, :3] / backup.limits.keep_out_semi_axes**2
    outward = np.einsum("ni,ni->n", normals, np.array(flown)[:, 3:])
    # Once outwards, always outwards.
    first = int(np.argmax(outward > 0.5 * np.linalg.norm(normals, axis=1)))
    assert (outward[first:] > 0.0).all()


@settings(max_examples=40)
@given(states(), FORCES)
def test_what_is_assured_keeps_the_state_admitted(state: np.ndarray, command: np.ndarray) -> None:
    backup = kleopatras()
    assume(backup.admitted(state))
    force, reason, _ = backup.assure(state, command)
    after = step(state, force)
    assert np.abs(force).max() <= THRUST
    # By another gravity and another integration.
    assert backup.backup_margin(after) > -0.5
    assert least_clearance([state, after]) > 0.0
    if reason != InterventionReason.BACKUP:
        assert np.abs(after[3:]).max() < 40.0 + 1e-3
    if reason == InterventionReason.NONE:
        assert force.tobytes() == command.tobytes()
        unchanged = step(state, command)
        assert backup.backup_margin(unchanged) > -0.5
    else:
        assert (force != command).any()


def test_at_the_border_what_is_assured_keeps_the_state_admitted() -> None:
    """Commands straight at the body, where they have to be changed."""
    backup, random, changed = kleopatras(), np.random.default_rng(11), 0
    while changed < 20:
        state = np.concatenate([random.normal(size=3), random.uniform(-40.0, 40.0, 3)])
        state[:3] *= 1.03 * kleopatra().keep_out_semi_axes / np.linalg.norm(state[:3])
        if not backup.admitted(state):
            continue
        force, reason, _ = backup.assure(state, -THRUST * np.sign(state[:3]))
        changed += reason == InterventionReason.KEEP_OUT
        after = step(state, force)
        assert backup.backup_margin(after) > -0.5
        assert least_clearance([state, after]) > 0.0


@pytest.mark.slow
def test_the_change_is_nearly_the_least() -> None:
    """Among thousands of nearer forces almost none is safe, and none is much nearer."""
    backup, random = kleopatras(), np.random.default_rng(3)
    ratios = []
    while len(ratios) < 15:
        state = np.concatenate([random.normal(size=3), random.uniform(-40.0, 40.0, 3)])
        state[:3] *= 1.03 * kleopatra().keep_out_semi_axes / np.linalg.norm(state[:3])
        command = -THRUST * np.sign(state[:3])
        force, reason, _ = backup.assure(state, command)
        if not backup.admitted(state) or reason != InterventionReason.KEEP_OUT:
            continue
        ours = least = float(np.linalg.norm(force - command))
        for _ in range(300):
            way = random.normal(size=3)
            way *= least * random.random() ** (1.0 / 3.0) / np.linalg.norm(way)
            nearer = np.clip(command + way, -THRUST, THRUST)
            if backup.assure(state, nearer).reason == InterventionReason.NONE:
                least = float(np.linalg.norm(nearer - command))
        ratios.append(least / ours)
    assert np.median(ratios) > 0.95
    assert min(ratios) > 0.5


def test_speed_limit_by_the_least_change() -> None:
    backup = kleopatras()
    state = np.array([0.0, 160e3, 60e3, 20.0, 0.0, 39.9])
    force, reason, _ = backup.assure(state, np.array([3.0, 2.0, 7.0]))
    assert reason == InterventionReason.SPEED_LIMIT
    # Coriolis mixes x and y; z is on its own.
    assert force[:2].tobytes() == np.array([3.0, 2.0]).tobytes()
    assert force[2] < 7.0
    assert 39.98 < step(state, force)[5] < 40.0
    # Beyond the limit thrust does what it can, and keeping out comes first.
    fast = np.array([0.0, 160e3, 60e3, 0.0, 0.0, 50.0])
    assert backup.assure(fast, np.zeros(3)).force[2] == -THRUST


def test_where_nothing_is_safe_the_backup_flies() -> None:
    backup = kleopatras()
    for state in ([141e3, 0.0, 0.0, -40.0, 0.0, 0.0], [100e3, 10e3, 0.0, 0.0, 0.0, 0.0]):
        assert not backup.admitted(np.array(state))
        force, reason, _ = backup.assure(np.array(state), np.array([-7.0, 0.0, 0.0]))
        assert reason == InterventionReason.BACKUP
        assert force == pytest.approx(backup.force(np.array(state)), rel=1e-12)
        assert force[0] == THRUST


@pytest.mark.parametrize("scale", [1.0 / 400.0, 7.0])
def test_nothing_is_made_for_one_size_of_body(scale: float) -> None:
    """With all lengths scaled at one density, and so all accelerations, all is as it was."""
    axes, state = np.array([80e3, 60e3, 50e3]), np.array([24.3e3, 36.4e3, 37.6e3, 9, -12, -4])
    found = []
    for s in (1.0, scale):
        limits = FlightLimits(MASS, s * THRUST, s * 40.0, s * axes)
        bounds = AssuranceBounds(position_m=s * 100.0)
        backup = BackupBraking(ball_field(s**3 * 2e18, s * 30e3), 3e-4, limits, bounds)
        force, reason, _ = backup.assure(s * state, s * np.array([-3.0, -7.0, -7.0]))
        found.append((backup.backup_margin(s * state) / s, *force / s, reason))
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[0][-1] == InterventionReason.KEEP_OUT
