"""The exceptions: `InputError` for bad input, `SolverFailure` for a solver without a solution."""

from __future__ import annotations

import typing

if typing.TYPE_CHECKING:
    from pydrake.solvers import SolutionResult


class InputError(ValueError):
    """Bad input: the message says what is wrong, where, and what to do about it.

    The command line prints the message alone and exits with code 2.
    """


class SolverFailure(Exception):  # noqa: N818 (not an error: the flight goes on)
    """A solver found no solution; `result` says why."""

    def __init__(self, result: SolutionResult):
        """Takes Drake's result of the solve."""
        super().__init__(result.name)
        self.result = result
