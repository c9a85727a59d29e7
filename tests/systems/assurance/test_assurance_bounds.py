"""Declared errors: closed forms of the worst case, flights in worlds within the box, refusals."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from braking_ball import BALL, MASS, PUSH, RADIUS, THRUST, ball_field, no_gravity
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from plain_motion import moved
from scripts import load_script
from short_flights import kleopatra

from proxops.diagrams.flight.scenario_systems import bounded_backup
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import (
    AssuranceBounds,
    BackupBraking,
    GravityField,
    InputError,
    InterventionReason,
)
from proxops.systems.assurance import _braking_kernel as kernel
from proxops.systems.gravity.gravity_field import GRAVITATIONAL_CONSTANT
from proxops.systems.shapes.ellipsoid import clearances

worst = load_script("benchmarks/_adversaries.py")

AFTER = AssuranceBounds(0.0015, 0.05, 1.0, 0.02, 3e-4, 120.0, 0.3)
BEFORE = AssuranceBounds(0.11, 0.05, 1.0, 0.03, 3e-3, 300.0, 0.5)
LATE = dataclasses.replace(AFTER, surface_m=150.0, delay_s=3.0)


def kleopatras(bounds: AssuranceBounds) -> BackupBraking:
    return _kleopatras(*dataclasses.astuple(bounds))


@cache
def _kleopatras(*bounds: float) -> BackupBraking:
    return bounded_backup(load_scenario(), kleopatra(), AssuranceBounds(*bounds))


def inwards(height: float, speed: float) -> np.ndarray:
    return np.array([RADIUS + height, 0.0, 0.0, -speed, 0.0, 0.0])


@pytest.mark.parametrize(
    "bounds",
    [
        AssuranceBounds(thrust=0.1),
        AssuranceBounds(mass=0.1),
        AssuranceBounds(acceleration_m_s2=7e-3),
        AssuranceBounds(velocity_m_s=1.0),
        AssuranceBounds(surface_m=250.0),
        AFTER,
        BEFORE,
    ],
)
def test_the_margin_is_that_of_the_worst_case_in_empty_space(bounds: AssuranceBounds) -> None:
    """A stop along an axis has a closed form. The margin may be less, but hardly."""
    speed, height = 20.0, 6e3
    weakest = PUSH * ((1.0 - bounds.thrust) / (1.0 + bounds.mass)) - bounds.acceleration_m_s2
    start = height - bounds.position_m - bounds.surface_m
    expected = start - (speed + bounds.velocity_m_s) ** 2 / (2.0 * weakest)
    # Thrust that is turned pushes sideways; along the axis of a stop it takes 1 - cos of the rest.
    turned = PUSH * bounds.across / weakest
    found = BackupBraking(no_gravity(), 0.0, BALL, bounds).backup_margin(inwards(height, speed))
    slack = PUSH * 10.0**2 / 8.0 + (2e-3 + 1.2 * turned) * (height - expected)
    assert expected - slack <= found <= expected


def test_stronger_gravity_is_counted_over_a_point_mass() -> None:
    """The worst case is a stop over a point mass that is heavier: energy says where it ends."""
    share, lowest, speed = 0.2, RADIUS + 2e3, 20.0
    field = ball_field(1e18, 24e3)
    mu = GRAVITATIONAL_CONSTANT * field.mass * (1.0 + share)
    level = 0.5 * speed**2 + PUSH * lowest + mu / lowest
    start = (level + np.sqrt(level**2 - 4.0 * PUSH * mu)) / (2.0 * PUSH)
    backup = BackupBraking(field, 0.0, BALL, AssuranceBounds(gravity=share))
    margin = backup.backup_margin(np.array([0, start, 0, 0, -speed, 0]))
    # Its own tube, of both signs, makes it somewhat worse.
    assert lowest - RADIUS - 250.0 < margin <= lowest - RADIUS
    believed = BackupBraking(field, 0.0, BALL).backup_margin(np.array([0, start, 0, 0, -speed, 0]))
    assert believed > margin + 400.0


def test_errors_of_the_step_replace_the_box() -> None:
    state, force = np.array([0.0, 0.0, 66.1e3, 0.0, 0.0, -8.0]), np.array([0.0, 0.0, -7.0])
    box = dataclasses.replace(AFTER, position_m=0.0, velocity_m_s=0.0)
    loose, tight = kleopatras(box), kleopatras(AFTER)
    told = loose.assure(state, force, AFTER.position_m, AFTER.velocity_m_s)
    expected = tight.assure(state, force)
    assert told.reason == expected.reason == InterventionReason.KEEP_OUT
    assert np.array_equal(told.force, expected.force)
    assert not np.array_equal(loose.assure(state, force).force, told.force)
    for errors in ((-1.0, 0.1), (np.nan, 0.1), (1.0, np.inf)):
        with pytest.raises(InputError, match="must be finite and not negative"):
            loose.assure(state, force, *errors)


@pytest.mark.parametrize("settled", [12.0, np.inf])
@pytest.mark.parametrize("hold", [0.0, 0.4, 1.0])
def test_the_wish_never_falls_with_the_normal_and_never_rises_with_speed(
    hold: float, settled: float
) -> None:
    """The tube's ends are those of its intervals because of this."""
    world = kleopatras(BEFORE).world
    normals, speeds = np.linspace(-1.0, 1.0, 81), np.linspace(-45.0, 45.0, 181)
    wish = np.array([[kernel._wanted(n, v, hold, settled, world) for v in speeds] for n in normals])
    assert (np.diff(wish, axis=0) >= -1e-12).all()
    assert (np.diff(wish, axis=1) <= 1e-12).all()
    # A period of it does not turn the order of speeds round.
    assert (np.diff(speeds + 10.0 * wish, axis=1) >= -1e-9).all()


UNIT = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda u: u @ u > 0.01)


@settings(max_examples=8)
@given(
    UNIT,
    st.floats(1.01, 1.3),
    st.tuples(*[st.floats(-40.0, 40.0)] * 3),
    st.sampled_from(worst.TRUTHS[1:]),
    st.sampled_from(worst.STATE_ERRORS[1:]),
    st.sampled_from([AFTER, BEFORE, LATE]),
    st.integers(0, 1000),
)
def test_the_backup_keeps_out_in_every_world_of_the_box(
    direction, level, velocity, truth, errors, bounds, seed
) -> None:
    """What is promised of an admitted belief, by another gravity and another integration."""
    backup, axes = kleopatras(bounds), kleopatra().keep_out_semi_axes
    position = level * direction / np.linalg.norm(direction) * axes
    believed = np.concatenate([position, velocity])
    assume(backup.admitted(believed))
    world = worst.Truth(truth, bounds, axes, np.random.default_rng(seed))
    error_of = worst.StateErrors(errors, bounds, axes, np.random.default_rng(seed + 1), 150)
    state = believed - error_of(believed)
    outward, last = [], np.zeros(3)
    for _ in range(150):
        force = backup.force(state + error_of(state))
        acting, other = world.act(state, force)
        push = acting / (world.mass * MASS) + other
        # The force that was chosen acts late; until then that of the period before does.
        for length, acts in ((bounds.delay_s, last), (10.0 - bounds.delay_s, push)):
            state = (
                worst.moved(state, acts, length, kleopatra(), world.gravity) if length else state
            )
            assert clearances(axes, state[None, :3])[0] > bounds.surface_m
        last = push
        normal = state[:3] / axes**2
        outward.append(float(state[3:] @ normal / np.linalg.norm(normal)))
    # Once it moves outwards fast enough for the law to brake sideways, it never stops to.
    fast = np.array(outward) > backup.outward_speed + 2.0 * bounds.velocity_m_s
    if fast.any():
        assert min(outward[int(fast.argmax()) :]) > 0.0


@pytest.mark.parametrize(("bounds", "seed"), [(AFTER, 1022), (BEFORE, 1022), (BEFORE, 1047)])
def test_adversaries_are_kept_out_within_the_box(bounds: AssuranceBounds, seed: int) -> None:
    settings = {"truth": "hurting", "state_errors": "flattering", "steps": 100}
    flight = worst.adversarial_flight(
        load_scenario(), kleopatra(), "sign flipped", seed, backup=kleopatras(bounds), **settings
    )
    assert flight.clearance > 0.0
    assert flight.speed < 40.0
    assert np.abs(flight.states[:-1, :3] - flight.believed[:, :3]).max() > 0.5 * bounds.position_m


def test_the_same_worlds_do_harm_where_no_error_is_believed() -> None:
    backup, axes = kleopatras(AssuranceBounds()), kleopatra().keep_out_semi_axes
    state = np.array([0.0, 0.0, 69.5e3, 0.0, 0.0, -20.0])
    assert backup.admitted(state)
    assert not kleopatras(BEFORE).admitted(state)
    world = worst.Truth("hurting", BEFORE, axes, np.random.default_rng(1))
    least = np.inf
    for _ in range(150):
        force = backup.assure(state, np.array([0.0, 0.0, -THRUST])).force
        acting, other = world.act(state, force)
        push = acting / (world.mass * MASS) + other
        state = worst.moved(state, push, 10.0, kleopatra(), world.gravity)
        least = min(least, float(clearances(axes, state[None, :3])[0]))
    assert least < -100.0


def test_motion_of_adversaries_is_that_of_an_integrator() -> None:
    body, random = kleopatra(), np.random.default_rng(3)
    heavier = GravityField(body.shape, mass=1.1 * body.gravity_field.mass)
    for _ in range(20):
        direction = random.normal(size=3) * body.keep_out_semi_axes
        position = direction / np.linalg.norm(direction / body.keep_out_semi_axes)
        state = np.concatenate([position, random.uniform(-40.0, 40.0, 3)])
        push = random.uniform(-0.07, 0.07, 3)
        end = moved(heavier, body.spin_rate, state, push, 10.0)
        np.testing.assert_allclose(
            worst.moved(state, push, 10.0, body, 1.1), end, rtol=0.0, atol=1e-3
        )


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("gravity", -1e-9, "gravity must not be negative"),
        ("surface_m", np.nan, "surface_m must not be negative"),
        ("mass", 1.0, "mass must be below 1"),
        ("thrust_direction_deg", 90.0, "must be below 90 degrees"),
        ("delay_s", 10.5, "up to the control period, 10 s"),
    ],
)
def test_bad_bounds_are_refused(name: str, value: float, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        kleopatras(AssuranceBounds(**{name: value}))


def test_a_box_that_cannot_be_certified_says_where_and_why() -> None:
    with pytest.raises(InputError) as refused:
        kleopatras(dataclasses.replace(BEFORE, gravity=0.99))
    message = str(refused.value)
    assert "does not hold 100 kg at (" in message
    assert "N are missing" in message
    assert "tighten assurance.bounds.gravity first" in message
    with pytest.raises(InputError, match=r"tighten assurance\.bounds\.velocity"):
        kleopatras(dataclasses.replace(BEFORE, velocity_m_s=5.0))
