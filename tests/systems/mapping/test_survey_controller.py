"""A survey's controller: how it takes a measured attitude, and what it says of its own motion."""

import numpy as np
from one_system import context_of
from scipy.spatial.transform import Rotation

from proxops.systems.common import spread_directions
from proxops.systems.mapping import Around, SurveyController
from proxops.systems.mapping.survey_filter import PLACE, STATES, VELOCITY
from proxops.systems.vehicle import ThrusterErrors, thrust_given

AROUND = Around(
    np.array([250.0, 240.0, 230.0]), 4.9, 0.1, 4e-4, 600.0, 280.0, 1e-7, 1e-8, 3600.0
)  # fmt: skip
RAYS, PERIOD, TIME = spread_directions(4000), 20.0, 4000.0
AWAY = np.array([1500.0, -900.0, 400.0])  # From the body's centre, in K.


def frame(directions: np.ndarray) -> np.ndarray:
    """Ranges to a ball of 240 m, along directions in K."""
    along = -directions @ AWAY
    below = along**2 - (AWAY @ AWAY - 240.0**2)
    hits = (below > 0.0) & (along > 0.0)
    return np.where(hits, along - np.sqrt(np.maximum(below, 0.0)), np.inf)


def after_a_frame(directions: np.ndarray, turned: Rotation | None) -> np.ndarray:
    controller = SurveyController(AROUND, directions, 1400.0, 6.0, PERIOD)
    ranges = frame(directions if turned is None else turned.apply(directions))
    context = context_of(controller, TIME, ranges=ranges)
    if turned is not None:
        attitude = turned.as_quat(scalar_first=True)
        controller.GetInputPort("body_attitude").FixValue(context, attitude)
    context.SetDiscreteState(controller.EvalUniquePeriodicDiscreteUpdate(context))
    return context.get_discrete_state(0).value().copy()


def test_a_measured_attitude_turns_the_rays() -> None:
    """The same rays in K, by a lidar that is turned against it."""
    turned = Rotation.from_rotvec([0.3, -1.1, 0.6])
    found = after_a_frame(turned.inv().apply(RAYS), turned)
    np.testing.assert_allclose(found[:STATES], after_a_frame(RAYS, None)[:STATES], rtol=1e-9)
    place = found[PLACE] @ AROUND.turn(TIME)
    assert np.linalg.norm(place - AWAY) < 50.0


def test_it_says_how_it_moves_in_k() -> None:
    """Beside places in K, a moment apart, of the motion that it knows in N."""
    controller = SurveyController(AROUND, RAYS, 1400.0, 6.0, PERIOD)
    context = context_of(controller, TIME)
    assert np.isnan(controller.GetOutputPort("state").Eval(context)).all()
    values = after_a_frame(RAYS, None)
    values[VELOCITY] = [0.05, -0.02, 0.03]
    context.SetDiscreteState(values)
    found = controller.GetOutputPort("state").Eval(context)

    def place(time: float) -> np.ndarray:
        return (values[PLACE] + (time - TIME) * values[VELOCITY]) @ AROUND.turn(time)

    np.testing.assert_allclose(found[:3], place(TIME))
    np.testing.assert_allclose(found[3:], (place(TIME + 1.0) - place(TIME - 1.0)) / 2.0, atol=1e-6)


def test_it_asks_for_what_its_thrusters_give() -> None:
    """Along one axis of three less is wanted than a pulse."""
    values = after_a_frame(RAYS, None)
    values[VELOCITY] = [0.05, -0.02, 0.03]
    values[STATES : STATES + STATES**2] = 0.0  # It is sure of all that.

    def force(least_impulse: float) -> np.ndarray:
        controller = SurveyController(AROUND, RAYS, 1400.0, 6.0, PERIOD, least_impulse)
        context = context_of(controller, TIME)
        context.SetDiscreteState(values)
        return controller.GetOutputPort("force").Eval(context)

    wanted = force(0.0)
    errors = ThrusterErrors(least_impulse=PERIOD * float(np.median(np.abs(wanted))))
    given = thrust_given(wanted.tolist(), errors, PERIOD, TIME)
    assert np.count_nonzero(given) == 2
    np.testing.assert_array_equal(force(errors.least_impulse), given)
