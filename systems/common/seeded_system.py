"""`SeededSystem`: what every random system shares, its seed and its step."""

from __future__ import annotations

from pydrake.systems.framework import (
    BasicVector,
    DependencyTicket,
    LeafSystem,
    NumericParameterIndex,
)

from proxops.systems.common.checks import check_positive
from proxops.systems.common.errors import InputError

# A Context keeps the seed as a float64, which is exact below this.
_SEED_LIMIT = 2**53


class SeededSystem(LeafSystem):
    """A LeafSystem whose random numbers are a pure function of its seed and the control step.

    The seed is a numeric parameter of the Context, so that two Contexts of one system can differ.
    The step is the number of control periods since time 0. A derived class draws its numbers with
    `generator(self.seed_of(context), self.step_of(context))` and adds `seed_tickets()` to the
    prerequisites of every output that does so. Nothing about random numbers has to be stored.

    Attributes:
      period: the control period in s.
      seed: the seed of a new Context.
    """

    def __init__(self, period: float, seed: int):
        """Takes the control period in s and the seed of a new Context."""
        super().__init__()
        check_positive(type(self).__name__, period=period)
        self._check_seed(seed)
        self.period, self.seed = period, int(seed)
        self._seed_index = self.DeclareNumericParameter(BasicVector([float(seed)]))

    def set_seed(self, context, seed: int) -> None:
        """Sets the seed in a Context of this system.

        Raises:
          InputError: it is no whole number from 0 to 2^53 - 1.
        """
        self._check_seed(seed)
        self.ValidateContext(context)
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def _check_seed(self, seed: int) -> None:
        if not (0 <= seed < _SEED_LIMIT and seed == int(seed)):
            raise InputError(
                f"{type(self).__name__} needs a seed that is a whole number from 0 to 2^53 - 1, "
                f"got {seed}"
            )

    def seed_of(self, context) -> int:
        """The seed in a Context of this system."""
        self.ValidateContext(context)
        return int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))

    def step_of(self, context) -> int:
        """The number of the control step that is nearest to the Context's time."""
        return round(context.get_time() / self.period)

    def seed_tickets(self) -> set[DependencyTicket]:
        """What random numbers depend on: time and seed."""
        seed = self.numeric_parameter_ticket(NumericParameterIndex(self._seed_index))
        return {self.time_ticket(), seed}
