"""`StarTracker`: the attitude against the stars, as it is measured."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import (
    config,
    number,
    quaternion_inverse,
    quaternion_of,
    quaternion_product,
    rotated,
    vector,
)
from proxops.systems.rotation import spin_model
from proxops.systems.vehicle import (
    SlowVector,
    SpinKnowledge,
    TrueAttitudeConfig,
    white_noise_at,
)


@config
class StarTrackerConfig:
    """The data sheet of a star tracker."""

    # Standard deviation of each measurement, about each axis.
    noise_deg: float = number(0.003, at_least=0.0, at_most=10.0, unit="degrees")
    # The direction of its optical axis in S, and the angles from it within which body and Sun blind
    # it.
    boresight: list[float] = vector([0.0, 0.0, 1.0], at_least=-1.0, at_most=1.0)
    blinded_within_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    sun_within_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")


class InertialAttitude(LeafSystem):
    """The attitude against the stars, R_NS, from that against the body, R_KS.

    ```
    attitude (4): R_KS ──► InertialAttitude ──► attitude (4): R_NS
    ```

    R_NS = Rot(phase)^T R_NK R_KS. Those who believe a rotation are `phase` ahead of the true one,
    about the axis that they believe; see `believed_axes`.
    """

    def __init__(self, spins: SpinKnowledge):
        """Takes how the body turns, and what is believed of that."""
        super().__init__()
        self.spin, self._phase = spin_model(spins.true), quaternion_inverse(spins.ahead)
        self._port = self.DeclareVectorInputPort("attitude", 4)
        self.DeclareVectorOutputPort(
            "attitude", 4, self._calc, {self._port.ticket(), self.time_ticket()}
        )

    def _calc(self, context, output):
        body = quaternion_product(self._phase, self.spin.attitude(context.get_time()))
        a, b, c, d = self._port.Eval(context).tolist()
        output.SetFromVector(quaternion_product(body, (a, b, c, d)))


class StarTracker(SlowVector):
    """The attitude that a star tracker measures, at attitude steps.

    ```
    attitude (4), R_NS ──────►┌─────────────┐
    body_attitude (4), R_KS ─►│ StarTracker ├─► measured (4): R_NS as measured; NaN: blinded
    position (3), m, K ──────►│             │
    sun_direction (3), K ────►└─────────────┘
    ```

    It measures R_NS Rot(constant + varying)^T Rot(noise): a constant and a slowly varying error of
    mounting and tracker, which no filter can tell from the truth, and independent noise. It is
    blinded while the direction to the body's centre, or to the Sun, lies within an angle of its
    optical axis; the last three ports matter only then. `sun_direction` may remain open. A Sun that
    the body hides blinds like any other.
    """

    def __init__(
        self,
        sheet: StarTrackerConfig,
        period: float,
        seed: int,
        errors: TrueAttitudeConfig | None = None,
    ):
        """Takes the data sheet, the attitude period in s, a seed, and the errors of mounting.

        Args:
          sheet: the data sheet. period: s. seed: the seed of a new Context.
          errors: of tracker and mounting; None: there are none.
        """
        errors = errors or TrueAttitudeConfig()
        super().__init__(
            errors.constant, errors.varying_std, errors.correlation_time_s, period, seed
        )
        self.sheet = sheet
        axis = np.array(sheet.boresight)
        x, y, z = (axis / np.linalg.norm(axis)).tolist()
        self._boresight = x, y, z
        limits = sheet.blinded_within_deg, sheet.sun_within_deg
        self._body, self._sun = (math.cos(math.radians(each)) if each else None for each in limits)
        self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
        self._body_port = self.DeclareVectorInputPort("body_attitude", 4)
        self._position_port = self.DeclareVectorInputPort("position", 3)
        self._sun_port = self.DeclareVectorInputPort("sun_direction", 3)
        self.DeclareVectorOutputPort(
            "measured", 4, self._calc, {self.all_input_ports_ticket(), *self.seed_tickets()}
        )

    def _calc(self, context, output):
        if self._is_blinded(context):
            output.SetFromVector(np.full(4, np.nan))
            return
        x, y, z = white_noise_at(
            context.get_time(),
            std=math.radians(self.sheet.noise_deg),
            period=self.period,
            seed=self.seed_of(context),
        )
        error = quaternion_product(
            quaternion_inverse(quaternion_of(self.vector_at(context))), quaternion_of((x, y, z))
        )
        p, q, r, s = self._attitude_port.Eval(context).tolist()
        output.SetFromVector(quaternion_product((p, q, r, s), error))

    def _is_blinded(self, context) -> bool:
        blinding = []
        if self._body is not None:
            blinding.append((-self._position_port.Eval(context), self._body))
        if self._sun is not None and self._sun_port.HasValue(context):
            blinding.append((self._sun_port.Eval(context), self._sun))
        if not blinding:
            return False
        w, x, y, z = self._body_port.Eval(context).tolist()
        axis = np.array(rotated((w, x, y, z), self._boresight))  # In K.
        return any(
            float(axis @ way) > least * float(np.linalg.norm(way)) for way, least in blinding
        )
