"""A stand-in for the navigation: it gives what a test says, through the ports of the real one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.diagrams.scenario import Body, Scenario
from proxops.systems import ExpectedErrors
from proxops.systems.common import LoggedPort

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


class NavigationDouble(LeafSystem):
    """Gives a state (6) and an attitude (4) as functions of time, and keeps what it was told."""

    def __init__(
        self,
        state: Callable[[float], np.ndarray],
        attitude: Callable[[float], np.ndarray] = lambda time: IDENTITY,
    ):
        super().__init__()
        self.state, self.attitude = state, attitude
        self.told: dict[float, np.ndarray] = {}
        self._ranges = self.DeclareVectorInputPort("ranges", 4320)
        self._command = self.DeclareVectorInputPort("commanded_force", 3)
        depends = {self.time_ticket(), self._ranges.ticket(), self._command.ticket()}
        for name, size, calc in (
            ("state", 6, self._calc_state),
            ("attitude", 4, lambda c, output: output.SetFromVector(self.attitude(c.get_time()))),
            ("covariance", 81, lambda c, output: output.SetFromVector(np.eye(9).ravel())),
            ("record", 5, self._calc_record),
            ("return_use", 4320, lambda c, output: output.SetFromVector(np.ones(4320))),
        ):
            self.DeclareVectorOutputPort(name, size, calc, prerequisites_of_calc=depends)

    def logged_ports(self) -> dict[str, LoggedPort]:
        return {
            f"navigation_{name}": LoggedPort(self.GetOutputPort(name))
            for name in ("state", "attitude", "covariance", "record")
        }

    def _calc_state(self, context, output):
        self.told.setdefault(context.get_time(), self._command.Eval(context).copy())
        output.SetFromVector(self.state(context.get_time()))

    def _calc_record(self, context, output):
        returns = np.isfinite(self._ranges.Eval(context)).sum()
        acquiring = np.isnan(self.state(context.get_time())).any()
        output.SetFromVector([12.0, returns, 3.0, 1.5, 0.0 if acquiring else 1.0])


def use(monkeypatch, double: NavigationDouble) -> None:
    """Makes every diagram use the double."""

    def made(scenario: Scenario, body: Body, expected: ExpectedErrors) -> NavigationDouble:
        return double

    monkeypatch.setattr("proxops.diagrams.flight.on_board.make_navigation", made)
