"""`Sunlight`: what the Sun does to the spacecraft, by its light and by its tide."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, ValueProducer

from proxops.systems.common import (
    FAR,
    LONG,
    Values,
    Vector,
    Vector3,
    Vectors3,
    check_positive,
    config,
    finite_vector,
    number,
    quaternion_inverse,
    quaternion_of,
    rotated,
    vector,
    vector_of,
)
from proxops.systems.rotation import SpinModel
from proxops.systems.shapes import Polyhedron, ray_caster
from proxops.systems.vehicle.facets import Facets, light_on_facets
from proxops.systems.vehicle.sun_ephemeris import SunEphemeris, sun_ephemeris

# Power of sunlight at 1 au in W/m^2 and GM of the Sun in m^3/s^2: nominal values of the
# International Astronomical Union, resolution B3 of 2015.
_IRRADIANCE, _SUN = 1361.0, 1.3271244e20
# 1 au in m, by resolution B2 of 2012, and the speed of light in m/s; both are exact.
_AU, _LIGHT = 149_597_870_700.0, 299_792_458.0
_DAY = 86400.0


@config
class SunlightConfig:
    """The Sun, and how a point takes its light: as a ball, which has no front.

    A rigid spacecraft takes it with its facets.
    """

    # Direction from the body to the Sun at the start, in the frame N, which does not turn and has
    # the axes of K then. Its length does not matter.
    direction: list[float] = vector([1.0, 0.0, 0.0], at_least=-FAR, at_most=FAR)
    # Distance from the Sun, which stays as it is. The default is Kleopatra's in the mean.
    distance_au: float = number(2.79, at_least=1e-2, at_most=1e3, unit="au")
    # Time in which the body goes once round the Sun; null: the direction in N does not change.
    year_days: float | None = number(None, at_least=1e-3, at_most=LONG, unit="days")
    # Direction in N about which it goes round, at right angles to `direction`.
    orbit_pole: list[float] = vector([0.0, 0.0, 1.0], at_least=-FAR, at_most=FAR)
    # SPICE kernel that says where the Sun is instead of `direction`, or a meta-kernel that names
    # several; the distance is then that at the start, and stays as it is.
    kernels: str | None = None
    # The body by its name or number in the kernels, and when the flight starts, as SPICE reads it.
    spice_body: str = ""
    epoch: str = ""
    # The frame of SPICE whose axes N has: those at the start, which for one of a body are K's.
    spice_frame: str = "ECLIPJ2000"
    # Area that the spacecraft, if it is a point, shows to the Sun from any side.
    area_m2: float = number(1.0, at_least=0.0, at_most=1e6, unit="m^2")
    # Coefficient of reflectivity: 1 of a surface that takes up all light, 2 of one that throws all
    # of it back to where it came from.
    reflectivity: float = number(1.3, at_least=0.0, at_most=2.0)


def sun_direction(time: float, settings: SunlightConfig) -> Vector:
    """Unit vector from the body to the Sun in N, at a time in s.

    It goes round the pole of the orbit in the sense in which the body goes round the Sun.
    """
    if settings.kernels is not None:
        return vector_of(_ephemeris(settings).direction(time))
    start = _unit(settings.direction)
    if settings.year_days is None:
        return start
    angle = 2.0 * math.pi * time / (settings.year_days * _DAY)
    x, y, z = _unit(settings.orbit_pole)
    return rotated(quaternion_of((angle * x, angle * y, angle * z)), start)


def _ephemeris(settings: SunlightConfig) -> SunEphemeris:
    assert settings.kernels is not None
    return sun_ephemeris(
        settings.kernels, settings.spice_body, settings.epoch, settings.spice_frame
    )


def at_its_distance(settings: SunlightConfig) -> SunlightConfig:
    """The settings with the Sun's distance at the start from the kernels, if there are any."""
    if settings.kernels is None:
        return settings
    return replace(settings, distance_au=_ephemeris(settings).distance_au)


def _unit(direction: list[float]) -> Vector:
    x, y, z = direction
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def light_acceleration(settings: SunlightConfig, mass: float) -> float:
    """Acceleration in m/s^2, away from the Sun, that sunlight gives a spacecraft of a mass in kg.

    (S / c) C A / (m d^2), with the irradiance S at 1 au and the distance d in au: Montenbruck and
    Gill, Satellite Orbits, 2000, equation 3.75.
    """
    return light_pressure(settings) * settings.reflectivity * settings.area_m2 / mass


def light_pressure(settings: SunlightConfig) -> float:
    """Pressure of sunlight in N/m^2 on what absorbs it, (S / c) / d^2."""
    return _IRRADIANCE / _LIGHT / settings.distance_au**2


def solar_tide(arm: Vector, direction: Vector, distance_au: float) -> Vector:
    """The Sun's gravity at a place less that at the body's centre of mass, in m/s^2.

    (GM / d^3) (3 (s·r) s - r), the first term of a series in |r| / d. In any frame.

    Args:
      arm: r in m from the centre of mass. direction: s, unit vector to the Sun.
      distance_au: d.
    """
    x, y, z = arm
    a, b, c = direction
    rate = _SUN / (distance_au * _AU) ** 3
    along = 3.0 * (a * x + b * y + c * z)
    return rate * (along * a - x), rate * (along * b - y), rate * (along * c - z)


def greatest_sunlight(
    settings: SunlightConfig, mass: float, distance: float, shown: float | None = None
) -> float:
    """The greatest acceleration in m/s^2 by light and tide.

    Args:
      settings: the Sun. mass: the least of the spacecraft, in kg.
      distance: the greatest from the centre of mass, in m.
      shown: the greatest force over pressure in m^2, of facets; None: that of the ball.
    """
    tide = 2.0 * _SUN / (settings.distance_au * _AU) ** 3 * distance
    if shown is not None:
        return light_pressure(settings) * shown / mass + tide
    return light_acceleration(settings, mass) + tide


def in_shadow(shape: Polyhedron, positions: Vectors3, directions: Vectors3) -> Values:
    """Tells where the body hides the Sun's centre: (N,) bool, by one ray from each place.

    There is no half shadow. At 2.8 au the Sun is 0.2 degrees wide, so that the edge of the
    shadow is 0.3 % of the distance behind the body wide.

    Args:
      shape: of the body. positions: (N, 3) in m in K.
      directions: unit vectors (N, 3) to the Sun in K.
    """
    return ray_caster(shape).distances(positions, directions) < np.inf


class Sunlight(LeafSystem):
    """Accelerates the spacecraft by the pressure of sunlight and by the Sun's tide.

    ```
    position (3), m, K ─►┌──────────┐─► acceleration (3), m/s^2, K
    mass (1), kg ───────►│ Sunlight │─► direction (3), K: unit vector to the Sun
      (if it changes)    │          │
    attitude (4) ───────►│          │─► torque (3), N m, S
      (with facets)      └──────────┘     (with facets)
    ```

    Light pushes a ball away from the Sun, as `light_acceleration` says, or facets, as
    `light_on_facets` does, and not in the body's shadow. `attitude` is R_KS.
    Whether the spacecraft is in it is discrete state, found by a ray at each control step and kept
    until the next: an integrator meets no jump within a step, and casts no rays. So the shadow
    begins and ends up to a period late. The tide acts everywhere.
    """

    def __init__(
        self,
        settings: SunlightConfig,
        shape: Polyhedron,
        spin: SpinModel,
        mass: float | None,
        axis_point: Vector3 | Vector = (0.0, 0.0, 0.0),
        period: float = 10.0,
        facets: Facets | None = None,
    ):
        """Takes the Sun, and body and spacecraft as they truly are.

        Args:
          settings: the Sun, and what the spacecraft shows to it.
          shape: of the body, which casts the shadow.
          spin: of the body; N and K have the same axes at time 0.
          mass: of the spacecraft in kg; None: it has a port for it.
          axis_point: centre of mass (3,) of the body in m in K.
          period: control period in s.
          facets: of the spacecraft; None: it is a ball.
        """
        super().__init__()
        if mass is not None:
            check_positive("Sunlight", mass=mass)
        check_positive("Sunlight", period=period)
        self.settings = at_its_distance(settings)
        self.shape, self.spin, self.mass = shape, spin, mass
        is_fixed = settings.kernels is None and settings.year_days is None
        self._fixed = sun_direction(0.0, settings) if is_fixed else None
        self.axis_point = finite_vector("Sunlight", "axis_point", axis_point)
        self.facets = facets
        self._position_port = self.DeclareVectorInputPort("position", 3)
        depends = {self.time_ticket(), self._position_port.ticket(), self.xd_ticket()}
        if mass is None:
            self._mass_port = self.DeclareVectorInputPort("mass", 1)
            depends.add(self._mass_port.ticket())
        if facets is not None:
            self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
            self._light = self.DeclareCacheEntry(
                "light",
                ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_light),
                {self.time_ticket(), self._attitude_port.ticket(), self.xd_ticket()},
            )
            depends.add(self._light.ticket())
        self.DeclareVectorOutputPort(
            "acceleration",
            3,
            lambda context, output: output.SetFromVector(self._acceleration(context)),
            depends,
        )
        self.DeclareVectorOutputPort(
            "direction",
            3,
            lambda context, output: output.SetFromVector(self.direction(context.get_time())),
            {self.time_ticket()},
        )
        if facets is not None:
            self.DeclareVectorOutputPort(
                "torque",
                3,
                lambda context, output: output.SetFromVector(self._light.Eval(context)[1]),
                {self._light.ticket()},
            )
        shadow = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period, 0.0, lambda context, state: state.set_value(shadow, self._shadow(context))
        )

    def direction(self, time: float) -> Vector:
        """Unit vector to the Sun in K at a time in s."""
        to_sun = self._fixed or sun_direction(time, self.settings)
        return rotated(quaternion_inverse(self.spin.attitude(time)), to_sun)

    def _shadow(self, context) -> np.ndarray:
        """1 where the body hides the Sun, else 0."""
        place, direction = self._position_port.Eval(context), self.direction(context.get_time())
        return in_shadow(self.shape, place[None], np.array([direction])).astype(float)

    def _calc_light(self, context, value):
        """Force (3,) in N, along the axes of K, and torque (3,) in N m, in S."""
        if context.get_discrete_state_vector()[0]:
            value.set_value((np.zeros(3), np.zeros(3)))
            return
        assert self.facets is not None
        attitude = tuple(self._attitude_port.Eval(context).tolist())
        direction = rotated(quaternion_inverse(attitude), self.direction(context.get_time()))
        force, torque = light_on_facets(self.facets, direction)
        pressure = light_pressure(self.settings)
        value.set_value((pressure * np.array(rotated(attitude, force)), pressure * torque))

    def _acceleration(self, context) -> Vector:
        # Number by number, as in `rotating_frame_acceleration`: seven times a step in flight.
        direction = self.direction(context.get_time())
        x, y, z = self._position_port.Eval(context).tolist()
        p, q, r = self.axis_point
        tide = solar_tide((x - p, y - q, z - r), direction, self.settings.distance_au)
        if self.facets is not None:
            mass = self._mass_port.Eval(context)[0] if self.mass is None else self.mass
            force = self._light.Eval(context)[0] / float(mass)
            return tuple((force + tide).tolist())
        push = 0.0
        if not context.get_discrete_state_vector()[0]:
            mass = self._mass_port.Eval(context)[0] if self.mass is None else self.mass
            push = light_acceleration(self.settings, float(mass))
        (a, b, c), (u, v, w) = tide, direction
        return a - push * u, b - push * v, c - push * w
