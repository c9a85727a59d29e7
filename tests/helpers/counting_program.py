"""An expert whose solves are counted, and that fails while it is told to."""

from pydrake.solvers import SolutionResult
from short_flights import kleopatra

from proxops.diagrams.flight.scenario_systems import make_mpc
from proxops.diagrams.scenario import Scenario
from proxops.systems import ModelPredictiveController, Plan, TransitProgram
from proxops.systems.common.errors import SolverFailure


class CountingProgram(TransitProgram):
    """Notes the number of linearisations of each call."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.calls: list[int] = []
        self.broken = False
        self.failure = SolutionResult.kSolverSpecificError

    def solve(self, state, target, previous=None, age=0.0, iterations=1, *task, **named) -> Plan:
        self.calls.append(iterations)
        if self.broken:
            raise SolverFailure(self.failure)
        return super().solve(state, target, previous, age, iterations, *task, **named)


def counting_expert(
    kind: type[CountingProgram] = CountingProgram,
) -> tuple[ModelPredictiveController, CountingProgram]:
    """The default scenario's MPC at Kleopatra, and its program."""
    like = make_mpc(Scenario(), kleopatra()).program
    program = kind(like.field, like.spin, like.limits, like.horizon)
    return ModelPredictiveController(program, 10.0), program
