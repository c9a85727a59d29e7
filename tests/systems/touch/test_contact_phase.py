"""The touch and the way off, over flat ground."""

import numpy as np
import pytest
import trimesh
from even_field import EvenField

from proxops.systems.rotation import SteadySpin
from proxops.systems.shapes import Surface
from proxops.systems.touch.contact_phase import AwayConfig, fly_contact
from proxops.systems.touch.contact_plant import Arm, TouchCraft, make_contact_plant
from proxops.systems.touch.descent import DescentGuidance, Site

UP, UPRIGHT = np.array([0.0, 0.0, 1.0]), (1.0, 0.0, 0.0, 0.0)
PULL = 5e-5


def flown(thrust: float, tilt: float, longest: float = 20.0):
    mesh = trimesh.creation.box((40.0, 40.0, 2.0))
    mesh.apply_translation((0.0, 0.0, -1.0))
    field, spin = EvenField([0.0, 0.0, -PULL]), SteadySpin(np.zeros(3))
    arm = Arm(np.array([0.0, 0, -2.84]), -UP)
    craft = TouchCraft(
        1400.0, 1300.0 * np.eye(3), arm, {"bus": (np.zeros(3), np.array([2.4, 7.0, 2.3]))}
    )
    guidance = DescentGuidance(field, spin, craft.mass, 6.0, Site(3.0 * UP, UP))
    ground = Surface(mesh.vertices, mesh.faces)
    diagram = make_contact_plant(ground, field, spin, craft, step=0.02)
    start = np.array([0.0, 0, 3.05, 0.005, 0, -0.1])
    turned = (np.cos(tilt / 2.0), np.sin(tilt / 2.0), 0.0, 0.0)
    away = AwayConfig(thrust_n=thrust, speed_m_s=0.2)
    error = np.zeros(6)
    return fly_contact(
        diagram, guidance, craft, (start, turned, np.zeros(3)), UPRIGHT, error, away, longest
    )


def test_touched_and_away() -> None:
    tilt = np.radians(1.0)
    touch = flown(30.0, tilt)
    assert touch is not None
    assert touch.state[5] == pytest.approx(-0.1, abs=0.002)
    assert touch.tilt == pytest.approx(tilt, rel=0.1)
    # A mass on the damped arm, of 1,385 kg: zeta = 200 / (2 sqrt(1100 1385)) = 0.081.
    frequency, damping = np.sqrt(1100.0 / 1385.0), 100.0 / np.sqrt(1100.0 * 1385.0)
    stroke = 0.1 / frequency * np.exp(-damping * np.pi / 2.0)
    assert touch.stroke == pytest.approx(stroke, rel=0.05)
    assert touch.duration == pytest.approx(np.pi / frequency, abs=0.5)
    assert (touch.parts, touch.touches) == (0.0, 0)
    assert touch.speed == pytest.approx(0.2, abs=0.01)
    assert touch.rate < np.radians(0.5)


def test_who_does_not_get_away_in_time() -> None:
    assert flown(1.0, 0.0, longest=5.0) is None
