"""`ThrusterAllocation`: which thrusters give a force and a torque, and for how long."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.solvers import ClpSolver, MathematicalProgram
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.attitude.thruster_layout import ThrusterLayout, lost_directions
from proxops.systems.common import SolverFailure, Values, Vector3, Vectors3, kernel, rotation_matrix

# What a missing N m, and a missing share of the force, cost beside a N of thrust: torque comes
# first, then force, then propellant.
_TORQUE, _FORCE = 1e6, 1e4
# Shares this close to a bound lie on it.
_ROUNDING = 1e-9
# Where many solutions cost the same, in N.
_TIE = 1e-7
# Below this force in N and torque in N m, nothing is asked for.
_NOTHING = 1e-5
_LOWER, _INSIDE, _UPPER = 0.0, 0.5, 1.0
_ZERO = np.zeros(3)


class Allocated(NamedTuple):
    """What thrusters are to do in a period."""

    shares: Values
    """(n,) of the period for which each is on, from 0 to 1."""
    force: float
    """Share of the wanted force that is given, from 0 to 1."""
    basis: Values
    """(n + 7,) of each variable of the program: on its lower bound, within, or on the upper."""


class AllocationProgram:
    """The linear program of an allocation, on Drake's MathematicalProgram.

    ::

        minimise    sum f_i a_i - M_F s + M_t sum |e|
        subject to  sum F_i a_i = s F,   sum T_i a_i + e = T,   0 <= a_i <= 1,   0 <= s <= 1

    F_i and T_i are force and torque of thruster i, f_i its size. A pseudo-inverse takes twice the
    propellant. The direction of the force is kept where its size cannot be given.
    """

    def __init__(self, layout: ThrusterLayout):
        """Takes the thrusters."""
        n = layout.count
        self.layout = layout
        program = MathematicalProgram()
        x = program.NewContinuousVariables(n + 7)
        self._matrix = np.zeros((6, n + 7))
        self._matrix[3:, n + 1 :] = np.hstack([np.eye(3), -np.eye(3)])
        self._balance = program.AddLinearEqualityConstraint(self._matrix, np.zeros(6), x)
        self._upper = np.append(np.ones(n + 1), np.full(6, np.inf))
        self._bounds = program.AddBoundingBoxConstraint(np.zeros(n + 7), self._upper, x)
        self._cost = np.concatenate([layout.forces, [-_FORCE], np.full(6, _TORQUE)])
        program.AddLinearCost(self._cost, x)
        self._program, self._solver = program, ClpSolver()

    def solve(
        self, force: Vector3, torque: Vector3, wrenches: np.ndarray, before: Values | None = None
    ) -> Allocated:
        """Gives the cheapest shares for a force (3,) in N and a torque (3,) in N m, in S.

        Args:
          wrenches: (6, n) of each thruster that is on; a zero column is not used.
          before: `basis` of a similar problem, which is tried first.

        Raises:
          SolverFailure: the program has no solution, which a finite force and torque always have.
        """
        n, matrix = self.layout.count, self._matrix
        if before is None:
            before = np.full(n + 7, _LOWER)
        if all(abs(each) < _NOTHING for each in (*force.tolist(), *torque.tolist())):
            return Allocated(np.zeros(n), 1.0, before)
        matrix[:, :n], matrix[:3, n] = wrenches, -force
        balance = np.concatenate([_ZERO, torque])
        self._upper[:n] = wrenches.any(axis=0)
        x = self._solved_by(before, balance)
        if x is None:
            x = self._solved(balance)
            before = np.where(x > _ROUNDING, _INSIDE, _LOWER)
            before[(x >= self._upper - _ROUNDING) & (self._upper > 0.0)] = _UPPER
        return Allocated(x[:n].clip(0.0, 1.0), min(float(x[n]), 1.0), before)

    def _solved(self, balance: Values) -> Values:
        self._balance.evaluator().UpdateCoefficients(self._matrix, balance)
        self._bounds.evaluator().UpdateUpperBound(self._upper)
        result = self._solver.Solve(self._program)
        if not result.is_success():
            raise SolverFailure(f"no thruster allocation with the balance {balance} N, N m")
        return result.get_x_val()

    def _solved_by(self, basis: Values, balance: Values) -> Values | None:
        """The solution if it has this basis, else None.

        From one attitude step to the next a basis mostly remains, and this takes far less time than
        a solver.
        """
        x = _by_basis(basis, balance, self._matrix, self._cost, self._upper)
        return None if np.isnan(x[0]) else x


@kernel(error_model="numpy")
def _by_basis(basis, balance, matrix, cost, upper):
    """The solution x of `AllocationProgram` by its basis; NaN where it is not optimal.

    See Bertsimas and Tsitsiklis, Introduction to Linear Optimization, 1997, section 3.1: the basic
    variables follow from the balance, and no reduced cost is on the wrong side.
    """
    size = len(basis)
    x, none, inside, count = np.zeros(size), np.full(1, np.nan), np.zeros(6, np.int64), 0
    for k in range(size):
        if basis[k] == _INSIDE:
            if count == 6:
                return none
            inside[count] = k
            count += 1
        elif basis[k] == _UPPER:
            x[k] = 1.0
    if count != 6:
        return none
    # The columns of the basic variables, what they have to balance, and their inverse, by Gauss and
    # Jordan with pivots.
    work = np.zeros((6, 13))
    for i in range(6):
        work[i, 7 + i], work[i, 6] = 1.0, balance[i]
        for j in range(6):
            work[i, j] = matrix[i, inside[j]]
        for k in range(size):
            work[i, 6] -= matrix[i, k] * x[k]
    for i in range(6):
        pivot = i
        for j in range(i + 1, 6):
            if abs(work[j, i]) > abs(work[pivot, i]):
                pivot = j
        if work[pivot, i] == 0.0:
            return none
        for k in range(13):
            work[i, k], work[pivot, k] = work[pivot, k], work[i, k]
        for k in range(12, i - 1, -1):
            work[i, k] /= work[i, i]
        for j in range(6):
            if j != i:
                for k in range(12, i - 1, -1):
                    work[j, k] -= work[j, i] * work[i, k]
    prices = np.zeros(6)
    for i in range(6):
        value = work[i, 6]
        if not -_ROUNDING <= value <= upper[inside[i]] + _ROUNDING:  # Nor NaN.
            return none
        x[inside[i]] = value
        for j in range(6):
            prices[j] += cost[inside[i]] * work[i, 7 + j]
    for k in range(size):
        if basis[k] != _INSIDE:
            reduced = cost[k]
            for i in range(6):
                reduced -= prices[i] * matrix[i, k]
            if (reduced if basis[k] == _LOWER else -reduced) < -_TIE:
                return none
    return x


def pulses(wanted: Values, owed: Values, period: float, least: float) -> tuple[Values, Values]:
    """On-times (n,) in s of a period, and what is still owed after it.

    What is shorter than the least on-time is added to what is wanted next.

    Args:
      wanted: (n,) in s. owed: (n,) in s, from the period before. period: s.
      least: on-time in s.
    """
    due = wanted + owed
    on = np.where(due < least, 0.0, np.minimum(due, period))
    # What a whole period cannot hold is lost, else it would come when nobody wants it.
    return on, np.where(on < period, due - on, 0.0)


@kernel(error_model="numpy")
def _given(shares, wrenches, axes, forces):
    """What thrusters give that are on for shares (n,) of a period: see `ThrusterAllocation`.

    Force (3,) in K and torque (3,) in S, all sizes together (1,), and force apart (3,) in K.
    """
    force, torque, thrust, apart = np.zeros(3), np.zeros(3), np.zeros(1), np.zeros(3)
    for k in range(len(shares)):
        thrust[0] += forces[k] * shares[k]
        for i in range(3):
            torque[i] += wrenches[3 + i, k] * shares[k]
            along = 0.0
            for j in range(3):
                along += axes[i, j] * wrenches[j, k] * shares[k]
            force[i] += along
            apart[i] += along * along
    return force, torque, thrust, np.sqrt(apart)


class ThrusterAllocation(LeafSystem):
    """Makes on-times of thrusters from a force and a torque, at each attitude step.

    ```
    force (3), N, K as believed ──►┌────────────────────┐
    attitude (4), R_KS as believed►│                    │─► on_times (n), s
    torque (3), N m, S ───────────►│ ThrusterAllocation │─► given_force (3), N, K as believed
    thruster_torques (3 n), N m ──►│                    │─► given_torque (3), N m, S
    failed (n) ───────────────────►│                    │─► given_thrust (1), N
                                   │                    │─► given_apart (3), N, K as believed
                                   └────────────────────┘─► lost (3), S
    ```

    The attitude is that of the middle of the period that begins. `thruster_torques` is what each
    thruster that is on gives, as estimated, and `failed` is 1 of those that give nothing; both may
    remain open: then the data sheet holds. `given_…` is what the on-times give in the mean over the
    period, as far as is known, so that wheels give the rest of the torque and navigation knows the
    force: together, as the sum of all sizes, and as the root of the sum of squares along each axis.
    `lost` is the middle of the directions in which the thrusters that are left cannot push, a unit
    vector, or 0; what is asked for along them is left out, so that the rest of the force is given.
    What is owed because a pulse was too short, and the basis of the last solution, are discrete
    state.
    """

    def __init__(self, layout: ThrusterLayout, period: float):
        """Takes the thrusters and the attitude period in s."""
        super().__init__()
        self.layout, self.period = layout, period
        self._program, self._wrenches = AllocationProgram(layout), layout.wrenches()
        n = layout.count
        declare = self.DeclareVectorInputPort
        self._force_port, self._torque_port = declare("force", 3), declare("torque", 3)
        self._attitude_port = declare("attitude", 4)
        self._torques_port = declare("thruster_torques", 3 * n)
        self._failed_port = declare("failed", n)
        # What is owed, and the basis.
        self._memory = self.DeclareDiscreteState(n + n + 7)
        self._step = self.DeclareCacheEntry(
            "step",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_step),
            {self.all_input_ports_ticket(), self.xd_ticket()},
        )
        for k, (name, size) in enumerate(
            (
                ("on_times", n),
                ("given_force", 3),
                ("given_torque", 3),
                ("given_thrust", 1),
                ("given_apart", 3),
            )
        ):
            self.DeclareVectorOutputPort(
                name,
                size,
                lambda context, output, k=k: output.SetFromVector(self._step.Eval(context)[k]),
                {self._step.ticket()},
            )
        lost = {self._failed_port.ticket()}
        self.DeclareVectorOutputPort("lost", 3, self._calc_lost, lost)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def _lost(self, context) -> Vectors3:
        """The directions (k, 3) in S in which the thrusters cannot push."""
        failed = np.zeros(0)
        if self._failed_port.HasValue(context):
            failed = self._failed_port.Eval(context)
        return (
            lost_directions(self._wrenches * (1.0 - failed)) if failed.any() else np.zeros((0, 3))
        )

    def _calc_lost(self, context, output):
        middle = self._lost(context).sum(axis=0)
        size = math.hypot(*middle.tolist())
        output.SetFromVector(middle / size if size > 0.0 else middle)

    def _calc_step(self, context, value):
        # Forces stay those of the data sheet. An estimate from torques would be a scale that
        # changes while it is learned; the navigation takes scales for constant.
        wrenches = self._wrenches.copy()
        if self._torques_port.HasValue(context):
            wrenches[3:] = self._torques_port.Eval(context).reshape(3, -1)
        if self._failed_port.HasValue(context):
            wrenches *= 1.0 - self._failed_port.Eval(context)
        axes = rotation_matrix(self._attitude_port.Eval(context))
        force = axes.T @ self._force_port.Eval(context)
        for direction in self._lost(context):
            force = force - max(float(force @ direction), 0.0) * direction
        memory = context.get_discrete_state(self._memory).value()
        torque, n = self._torque_port.Eval(context), self.layout.count
        found = self._program.solve(force, torque, wrenches, memory[n:])
        owed = memory[:n]
        on, owed = pulses(self.period * found.shares, owed, self.period, self.layout.least_on_time)
        given = _given(on / self.period, wrenches, axes, self.layout.forces)
        value.set_value((on, *given, np.concatenate([owed, found.basis])))

    def _remember(self, context, discrete_state):
        discrete_state.set_value(self._memory, self._step.Eval(context)[5])
