"""`PolyhedralGravity`: a gravity field as a Drake system, in double and AutoDiffXd."""

from __future__ import annotations

import sys
import typing

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem, LeafSystem_, ValueProducer
from pydrake.systems.scalar_conversion import TemplateSystem

from proxops.systems.common import InputError, make_for_floats
from proxops.systems.gravity.gravity_field import Field, Gravity


def _checked(field: Field) -> Field:
    """The field; raises `InputError` if it is none."""
    if not hasattr(field, "evaluate"):
        raise InputError(
            f"PolyhedralGravity needs a field, got a {type(field).__name__}: give "
            "body.gravity_field, or GravityField(shape, density=...)"
        )
    return field


def _evaluate(field: Field, position: np.ndarray) -> Gravity:
    """The field at one position (3,), given as numbers or as AutoDiffXd."""
    if position.dtype == object:
        position = ExtractValue(position)
    return field.evaluate(position.reshape(1, 3))


def _with_derivatives(value: np.ndarray, jacobian: np.ndarray, position: np.ndarray) -> np.ndarray:
    """AutoDiffXd array of `value` (n,), whose Jacobian by position is (n, 3)."""
    derivatives = ExtractGradient(position)
    if derivatives.size == 0:
        return np.array([AutoDiffXd(number) for number in value])
    return InitializeAutoDiff(value.reshape(-1, 1), jacobian @ derivatives).ravel()


# Without the scope Drake searches the stack for this module, which slows each import.
@TemplateSystem.define(
    "PolyhedralGravity_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__]
)
def PolyhedralGravity_(T):  # noqa: N802 (Drake's own naming of templates)
    """`PolyhedralGravity` for the scalar type T, float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """Gravity of a polyhedron at a point, all in the body-fixed frame K.

        ```
                     ┌───────────────────┐
                     │                   ├─► acceleration (3), m/s^2
        position ───►│ PolyhedralGravity ├─► gradient (9), 1/s^2, row by row
          (3), m     │                   ├─► potential (1), m^2/s^2
                     └───────────────────┘
        ```

        Each output depends on the position alone and is computed when it is asked for; all come
        from one evaluation of the field. In AutoDiffXd, acceleration and potential carry
        derivatives; there is no gradient port, because its derivative would need the third
        derivatives of the potential.

        Args:
          field: any field whose frame is K, such as `load_body(path).gravity_field`.

        Raises:
          InputError: the argument is no field.
        """

        def _construct(self, field: Field, *, converter=None):
            super().__init__(converter=converter)
            self.field = _checked(field)
            self._position_port = self.DeclareVectorInputPort("position", 3)
            self._gravity = self.DeclareCacheEntry(
                "gravity",
                ValueProducer(
                    allocate=lambda: AbstractValue.Make(object()), calc=self._calc_gravity
                ),
                {self._position_port.ticket()},
            )
            depends = {self._gravity.ticket()}
            self.DeclareVectorOutputPort("acceleration", 3, self._calc_acceleration, depends)
            if T is float:
                self.DeclareVectorOutputPort("gradient", 9, self._calc_gradient, depends)
            self.DeclareVectorOutputPort("potential", 1, self._calc_potential, depends)

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other.field, converter=converter)

        def _calc_gravity(self, context, value):
            value.set_value(_evaluate(self.field, self._position_port.Eval(context)))

        def _calc_acceleration(self, context, output):
            gravity = self._gravity.Eval(context)
            value = gravity.acceleration[0]
            if T is not float:
                position = self._position_port.Eval(context)
                value = _with_derivatives(value, gravity.gradient[0], position)
            output.SetFromVector(value)

        def _calc_gradient(self, context, output):
            gravity = self._gravity.Eval(context)
            output.SetFromVector(gravity.gradient[0].ravel())

        def _calc_potential(self, context, output):
            gravity = self._gravity.Eval(context)
            value = gravity.potential
            if T is not float:
                position = self._position_port.Eval(context)
                value = _with_derivatives(value, gravity.acceleration, position)
            output.SetFromVector(value)

    return Impl


if typing.TYPE_CHECKING:  # Editors don't see into templates.

    class PolyhedralGravity(LeafSystem):
        """Gravity of a polyhedron at a point, in K: see `PolyhedralGravity_`."""

        field: Field

        def __init__(self, field: Field): ...

else:
    PolyhedralGravity = make_for_floats(PolyhedralGravity_)
