"""Runtime assurance of a survey: whatever is commanded, nothing enters the sphere."""

import numpy as np
import pytest
from one_system import context_of

from proxops.diagrams.scenario import load_body, load_scenario
from proxops.diagrams.surveys.survey_flight import Flying, sphere_limits
from proxops.systems.assurance import SphereAssurance, SphereLimits
from proxops.systems.assurance.sphere_assurance import assured
from proxops.systems.common import InputError, spread_directions
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT
from proxops.systems.mapping import SurveyController

MASS, LIMITS = 100.0, SphereLimits(1000.0, 2e-3, 5e-3, 0.05, 20.0)


def system_of(place, velocity, force, deviations=(0.0, 0.0)):
    system = SphereAssurance(LIMITS, MASS)
    state = np.concatenate([place, velocity])
    return system.GetOutputPort("force").Eval(
        context_of(system, 0.0, state=state, force=np.array(force), deviations=deviations)
    )


def test_a_safe_command_passes_bit_for_bit() -> None:
    force = np.array([0.1, -0.2, 1.0 / 3.0])
    np.testing.assert_array_equal(system_of([3000.0, 0.0, 0.0], [-0.5, 1.0, 0.0], force), force)
    np.testing.assert_array_equal(system_of([np.nan] * 3, [np.nan] * 3, force), force)


def test_it_thrusts_away_from_the_middle() -> None:
    """Along the line, as hard as the thrusters along each axis can, when the fall is too fast."""
    up = np.array([2.0, -1.0, 2.0]) / 3.0
    given = system_of(1100.0 * up, -0.9 * up, [0.0, 0.0, 0.0])
    np.testing.assert_allclose(given, MASS * LIMITS.thrust * up * 1.5)
    # v^2 / 2 a is 147 m at 0.9 m/s, without the step of 20 s: 200 m are enough, and unsure not.
    away = 1200.0 * up, -0.9 * up, [0.0, 0.0, 0.0]
    assert not system_of(*away).any()
    assert system_of(*away, (0.0, 0.05)).any()
    assert system_of(*away, (10.0, 0.0)).any()


def test_thrust_that_does_not_hold_is_refused() -> None:
    with pytest.raises(InputError, match="leave out assurance"):
        SphereAssurance(LIMITS._replace(pull=1.0), MASS)


@pytest.mark.parametrize("wanted", ["inwards", "anything", "across"])
def test_a_thousand_adversaries_do_not_enter(wanted: str) -> None:
    """Each with errors at the edge of what is allowed for, in steps of its own integration.

    The pull is that of a point mass, of the greatest size, and something pushes inwards.
    """
    random, count, steps = np.random.default_rng(7), 1000, 200
    dt, push = LIMITS.period / 10, 5e-4
    gm = (LIMITS.pull - push) * LIMITS.radius**2
    place = 3000.0 * spread_directions(count)
    velocity = 0.6 * random.standard_normal((count, 3))
    errors, interventions, least = (30.0, 0.05), 0, np.inf
    share = 1.0 + LIMITS.error * random.choice([-1.0, 1.0], count)
    for _ in range(steps):
        up = place / np.linalg.norm(place, axis=1, keepdims=True)
        if wanted == "inwards":
            wish = -LIMITS.thrust * up
        elif wanted == "across":
            wish = LIMITS.thrust * np.cross(up, [0.0, 0.0, 1.0]) - 0.5 * LIMITS.thrust * up
        else:
            wish = LIMITS.thrust * random.uniform(-1.0, 1.0, (count, 3))
        # It takes itself to be farther out, and to rise faster, than it does.
        seen = np.hstack([place + 0.99 * errors[0] * up, velocity + 0.99 * errors[1] * up])
        given = np.array([assured(w, s, errors, LIMITS) for w, s in zip(wish, seen, strict=True)])
        interventions += int((given != wish).any(axis=1).sum())
        for _ in range(10):
            far = np.linalg.norm(place, axis=1, keepdims=True)
            pull = -(gm / far**2 + push) * place / far
            velocity = velocity + dt * (share[:, None] * given + pull)
            place = place + dt * velocity
            least = min(least, float(far.min()))
    assert interventions > 1000
    assert LIMITS.radius < least < 1.5 * LIMITS.radius


@pytest.mark.parametrize("name", ["kleopatra", "bennu", "ryugu", "toutatis", "didymos"])
def test_the_pull_at_the_sphere_is_bounded(name: str) -> None:
    """By the polyhedron's gravity, at the least sphere that holds the body."""
    body = load_body(name)
    scenario = load_scenario(name, {"task": {"_tag": "!Survey"}, "dispersions": "first_look"})
    limits = sphere_limits(scenario, body, 1.0)
    radius = float(np.linalg.norm(body.shape.vertices, axis=1).max())
    ways = spread_directions(2000)
    pull = -np.einsum(
        "ij,ij->i", body.gravity_field.evaluate(1.001 * radius * ways).acceleration, ways
    )
    gm = body.gravity_field.mass * GRAVITATIONAL_CONSTANT
    assert pull.max() * radius**2 < 3.2 * gm
    assert limits.pull > 3.2 * gm / limits.radius**2


class Falling(SurveyController):
    """Thrusts towards the middle."""

    def _force(self, time, values):
        if not values[:3].any():
            return np.zeros(3)
        down = -self.around.turn(time).T @ values[:3]
        return self._thrust * down / np.abs(down).max()


@pytest.mark.slow
def test_a_survey_stays_out_against_its_controller(monkeypatch: pytest.MonkeyPatch) -> None:
    """On what its own filter believes, in a world that is drawn."""
    monkeypatch.setattr("proxops.diagrams.surveys.survey_flight.SurveyController", Falling)
    changes = {"task": {"_tag": "!Survey", "hours": 12.0}, "assurance": {}, "transit.seed": 5}
    flight = Flying(
        load_scenario("bennu", changes | {"dispersions": "approach"}), load_body("bennu")
    ).fly(12.0)
    assert flight.interventions > 100
    assert flight.entries == 0
    assert not flight.collided
