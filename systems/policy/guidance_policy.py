"""`GuidancePolicy`: a learned controller for any body of a family, from state and goal to force."""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from pathlib import Path

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.common import InputError, LoggedPort, check_positive, config, number
from proxops.systems.policy.guidance_bundle import GuidanceBundle
from proxops.systems.policy.neural_policy import NeuralPolicy, PolicyStatus
from proxops.systems.policy.surroundings import NUMBERS, Surroundings
from proxops.systems.rotation import TorqueFreeSpin

# The law's time and its least time together are 1.9 times what the flight still takes (median along
# flights at three bodies). A smaller number leaves a reserve.
_LAW_OVER_FLIGHT = 1.7
# Least force along an axis, over the thrust limit. The expert coasts, with no force at all; a
# network that learned from it would command a little all the time, which takes 2 to 5 % more.
COAST = 0.05


@config
class PolicyConfig:
    """The learned policy: a `GuidancePolicy` or a `NeuralPolicy` of `proxops.systems`."""

    # The folder `bundle` that `proxops train` wrote. In a scenario file the path is relative to the
    # file; elsewhere it is relative to the working directory. null means the policy that ships
    # with proxops.
    bundle: str | None = None
    # Of a policy for any body (see `proxops.systems.GuidancePolicy`): it keeps out of an ellipsoid
    # that is larger than the keep-out ellipsoid. This length is added to each semi-axis. null means
    # three times mpc.keep_out_margin_m, or in a hybrid, where the MPC checks it, one and a half.
    margin_m: float | None = number(None, at_least=0.0, at_most=1e9, unit="m")
    # Whether it may fly where body or spacecraft lie outside of what it learned.
    beyond_family: bool = False


class GuidancePolicy(LeafSystem):
    """Runs a guidance network once a control step, on one thread.

    ```
    state (6) ───►┌────────────────┐
                  │ GuidancePolicy ├─► force (3), N
    target (6) ──►│                ├─► record (2): wall time in s, PolicyStatus
                  └────────────────┘
    ```

    All vectors are in K, in m, m/s and N. The network was trained for a family of bodies and
    spacecraft, and is told the proportions of the one at hand, and the believed gravity: see
    `Surroundings`. It brings the spacecraft to rest at the target's position; the target's velocity
    is not used. The force is clipped to `force_limit`, the thrust limit or the part of it that
    `GuidanceBundle.fitted` leaves, and is none along an axis where it is below `COAST` of it. If it
    is not finite, as without a state, none is commanded.

    The network learned without a deadline. Where the flight would end after `latest`, it hurries:
    the time of the law that the network corrects is then no longer than what is left allows for. It
    takes its usual time again when it is too late, and next to the goal.

    The outputs depend on the inputs and the time alone: there is no memory.
    """

    legend_entry = NeuralPolicy.legend_entry

    def __init__(
        self,
        bundle: GuidanceBundle | str | Path,
        surroundings: Surroundings,
        thrust_limit: float,
        *,
        beyond_family: bool = False,
        latest: float = math.inf,
    ):
        """Takes a bundle that `proxops train --recipe any-body` made, and where it is to fly.

        Args:
          bundle: the bundle or its folder.
          surroundings: the body and the spacecraft as believed.
          thrust_limit: greatest force per axis in N.
          beyond_family: fly although body or spacecraft lie outside of what it learned.
          latest: time in s at which it should have arrived.

        Raises:
          InputError: there is no bundle, it is damaged, the limit or `latest` is not positive, or
            body or spacecraft lie too far outside of what it learned.
        """
        super().__init__()
        check_positive("GuidancePolicy", thrust_limit=thrust_limit)
        if not latest > 0.0:
            raise InputError(f"GuidancePolicy: latest must be positive, got {latest} s")
        self.latest = float(latest)
        self.bundle = bundle if isinstance(bundle, GuidanceBundle) else GuidanceBundle.load(bundle)
        self.surroundings = self.bundle.fitted(surroundings)
        self._least_time = self.bundle.network.least_time(
            self.surroundings.told[NUMBERS.index("pace")]
        )
        self.force_limit = thrust_limit * self.surroundings.acceleration / surroundings.acceleration
        numbers = self.surroundings.numbers()
        beyond = self.bundle.beyond(numbers)
        if beyond and not beyond_family:
            raise InputError(
                f"the policy in {self.bundle.path} did not learn to fly in such proportions: "
                + "; ".join(beyond.values())
                + f" (see help(Surroundings.numbers)). {self._ways_out(beyond, thrust_limit)} Or "
                "fly the MPC, or let it try with policy.beyond_family=true"
            )
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._target_port = self.DeclareVectorInputPort("target", 6)
        # What depends on the goal alone is computed once for each goal.
        self._goal_gravity = self.DeclareCacheEntry(
            "goal gravity",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_gravity),
            {self._target_port.ticket()},
        )
        turns_otherwise = isinstance(surroundings.spin, TorqueFreeSpin)
        self._goal = self.DeclareCacheEntry(
            "goal",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_goal),
            {self._target_port.ticket()} | ({self.time_ticket()} if turns_otherwise else set()),
        )
        self._answer = self.DeclareCacheEntry(
            "answer",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_answer),
            {self.all_input_ports_ticket(), self.time_ticket()},
        )
        depends = {self._answer.ticket()}
        self._force_port = self.DeclareVectorOutputPort(
            "force",
            3,
            lambda context, output: output.SetFromVector(self._answer.Eval(context)[0]),
            depends,
        )
        self._record_port = self.DeclareVectorOutputPort(
            "record",
            2,
            lambda context, output: output.SetFromVector(self._answer.Eval(context)[1:]),
            depends,
        )

    def _ways_out(self, beyond: Collection[str], thrust_limit: float) -> str:
        """Sentences on what would bring the numbers that are beyond what it learned within it."""
        told, ways = self.surroundings, []
        if not {"gravity", "spin"}.isdisjoint(beyond):
            enough = 1.01 * self.bundle.thrust_short(told.numbers()) * thrust_limit
            ways.append(
                f"A thrust limit of {enough:.3g} N is enough for gravity and spin."
                if self.force_limit == thrust_limit
                else "Raise the speed limit: it is so low that only a part of the thrust is used."
            )
        if any(name.startswith("semi_axis") for name in beyond):
            short = 1.01 * self.bundle.semi_axes_short(told)
            longer = [
                f"by {metres:.3g} m along {axis}"
                for axis, metres in zip("xyz", short, strict=True)
                if metres > 0.0
            ]
            ways.append(f"Lengthen keep_out_semi_axes_m of the body: {', '.join(longer)}.")
        if "period" in beyond:
            ways.append(f"Give a control period up to {self.bundle.period_flown(told):.3g} s.")
        return " ".join(ways) or "Change the spacecraft."

    def logged_ports(self) -> dict[str, LoggedPort]:
        """The ports whose values a log keeps, by the names of their columns."""
        return {
            "policy_force": LoggedPort(self._force_port),
            "policy_record": LoggedPort(self._record_port),
        }

    def _calc_gravity(self, context, value):
        goals = self._target_port.Eval(context)[None, :3]
        value.set_value(self.surroundings.field.evaluate(goals).acceleration)

    def _calc_goal(self, context, value):
        goals, gravity = self._target_port.Eval(context)[None, :3], self._goal_gravity.Eval(context)
        at_rest = self.surroundings.at_rest(goals, context.get_time(), gravity)
        value.set_value((goals, at_rest))

    def _calc_answer(self, context, value):
        state = self._state_port.Eval(context)
        started = time.perf_counter()
        force, status = np.zeros(3), PolicyStatus.NOT_FINITE
        if all(map(math.isfinite, state)):
            goals, at_rest = self._goal.Eval(context)
            given = at_rest.copy()
            self.surroundings.fill_way(state[None], goals, given, context.get_time())
            answer = self.bundle.network.run(given[0], self._longest(context)).tolist()
            if all(map(math.isfinite, answer)):
                force = self.surroundings.in_body_frame(*map(self._force, answer))
                status = PolicyStatus.ANSWERED
        value.set_value((force, time.perf_counter() - started, status))

    def _force(self, answer: float) -> float:
        """The force in N along an axis, for the network's answer."""
        if abs(answer) < COAST:
            return 0.0
        return min(max(self.force_limit * answer, -self.force_limit), self.force_limit)

    def _longest(self, context) -> float:
        """The greatest time of the law, in the unit of `Surroundings`; inf: any."""
        left = (self.latest - context.get_time()) / self.surroundings.time
        longest = _LAW_OVER_FLIGHT * left - self._least_time
        return longest if longest > self._least_time else math.inf
