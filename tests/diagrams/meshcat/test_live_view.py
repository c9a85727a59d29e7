"""A flight as it happens: the scene, the spacecraft and the controller's plan, in a Meshcat."""

from itertools import pairwise

import numpy as np
import pytest
from counting_program import counting_expert
from navigation_double import NavigationDouble, use
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, LeafSystem, System
from short_flights import Scripted

from proxops.diagrams.flight.simulation import make_simulator
from proxops.diagrams.flight.transit_diagram import make_transit_diagram
from proxops.diagrams.meshcat import live_view
from proxops.diagrams.meshcat.meshcat_scene import Scene, add_plan, quiet_meshcat
from proxops.diagrams.meshcat.navigation_scene import move_navigation
from proxops.diagrams.scenario.body import load_body
from proxops.diagrams.scenario.scenario_config import Scenario, TrueStateConfig
from proxops.systems import Plan
from proxops.systems.navigation import LidarNavigationConfig

PERIOD = 10.0
BODY = load_body("kleopatra")


class Silent(LeafSystem):
    """A controller that does nothing, with or without an output port `plan`."""

    def __init__(self, plan: str = ""):
        super().__init__()
        for name in ("force", "plan") if plan == "vector" else ("force",):
            self.DeclareVectorOutputPort(
                name=name, size=3, calc=lambda _, out: out.SetFromVector(np.zeros(3))
            )
        if plan == "abstract":
            made = Plan(
                times=np.arange(3.0), states=np.outer([1e5, 2e5, 4e5], np.ones(6)),
                forces=np.zeros((2, 3)), target=np.zeros(6), cost=0.0, slack=0.0, status=0,
                iterations=0,
            )  # fmt: skip
            self.DeclareAbstractOutputPort(
                name="plan",
                alloc=lambda: AbstractValue.Make(made),
                calc=lambda _, out: out.set_value(made),
            )


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The plans that are drawn, positions (N, 3) in m."""
    plans: list[np.ndarray] = []

    def noted(scene: Scene, positions: np.ndarray) -> None:
        plans.append(positions.copy())
        add_plan(scene, positions)

    monkeypatch.setattr(live_view, "add_plan", noted)
    return plans


def flown(controller: System, meshcat: Meshcat | None, steps: float) -> tuple[Diagram, Context]:
    scenario = Scenario(navigation=TrueStateConfig())
    diagram = make_transit_diagram(scenario, controller, meshcat, BODY)
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(steps * PERIOD)
    return diagram, simulator.get_context().Clone()


def test_plan_moves_with_the_flight_and_costs_no_solves(drawn: list[np.ndarray]) -> None:
    unseen, unseen_program = counting_expert()
    plain, plain_context = flown(unseen, None, 20.5)
    meshcat = quiet_meshcat()
    controller, program = counting_expert()
    diagram, context = flown(controller, meshcat, 20.5)
    assert len(program.calls) == len(unseen_program.calls) == 21
    assert meshcat.HasPath("/plan")
    assert len(drawn) == 21
    # Each begins where the spacecraft is at its step, and ends at the goal.
    log = diagram.GetSubsystemByName("log_state").FindLog(context)  # type: ignore[attr-defined]
    goal = diagram.GetSubsystemByName("target").get_output_port().Eval(context_of(diagram, context))
    for positions, state in zip(drawn, log.data().T, strict=True):
        np.testing.assert_allclose(positions[0], state[:3], atol=1.0)
        np.testing.assert_allclose(positions[-1], goal[:3], atol=1.0)
    assert all(not np.array_equal(a, b) for a, b in pairwise(drawn))
    # Looking on changes nothing.
    states = [
        d.GetSubsystemByName("log_state").FindLog(c).data()  # type: ignore[attr-defined]
        for d, c in ((plain, plain_context), (diagram, context))
    ]
    assert np.array_equal(*states)


def context_of(diagram: Diagram, context: Context) -> Context:
    return diagram.GetSubsystemByName("target").GetMyContextFromRoot(context)


def test_controller_without_a_plan(drawn: list[np.ndarray]) -> None:
    meshcat = quiet_meshcat()
    diagram, _ = flown(Silent("vector"), meshcat, 2.5)
    view = diagram.GetSubsystemByName("live_view")
    assert {view.get_input_port(i).get_name() for i in range(view.num_input_ports())} == {
        "position", "force", "ranges",
    }  # fmt: skip
    assert not drawn
    assert not meshcat.HasPath("/plan")
    assert meshcat.HasPath("/spacecraft")


def test_what_the_navigation_believes(monkeypatch: pytest.MonkeyPatch) -> None:
    """At each step its error and its covariance, and that of a flight without one is gone."""
    moved = []

    def noted(scene, position, region, row, times) -> None:
        moved.append((position.copy(), region, times))
        move_navigation(scene, position, region, row, times)

    monkeypatch.setattr(live_view, "move_navigation", noted)
    start = np.array([160e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    use(monkeypatch, NavigationDouble(lambda time: start if time > 5.0 else np.full(6, np.nan)))
    meshcat, controller = quiet_meshcat(), Scripted(lambda _: np.zeros(3), ports=[("state", 6)])
    scenario = Scenario(navigation=LidarNavigationConfig())
    diagram = make_transit_diagram(scenario, controller, meshcat, BODY)
    make_simulator(diagram, scenario).AdvanceTo(25.0)
    assert [bool(region.known[0]) for _, region, _ in moved] == [False, True, True]
    position, region, times = moved[-1]
    np.testing.assert_allclose(region.errors[0], start[:3] - position)
    np.testing.assert_allclose(region.semi_axes[0], 3.0)
    assert times == 4e3
    assert meshcat.HasPath("/navigation/marker")
    assert meshcat.HasPath("/lidar/now/rejected")
    flown(Silent(), meshcat, 0.5)
    assert not meshcat.HasPath("/navigation")
    assert not meshcat.HasPath("/lidar/now/rejected")
