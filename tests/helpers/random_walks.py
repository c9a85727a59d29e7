"""Random walks of a disturbance, step by step."""

import numpy as np

from proxops.systems import RandomWalkDisturbance

PERIOD = 10.0


# Of a stretch between resets.
STEPS = 10


def walks(disturbance: RandomWalkDisturbance, commands: np.ndarray, seed: int = 0) -> np.ndarray:
    """Forces (N, 3) for commands (N, 3) of successive control steps."""
    context = disturbance.CreateDefaultContext()
    disturbance.set_seed(context, seed)
    return step_on(disturbance, context, commands)


def step_on(disturbance, context, commands, first_step: int = 0) -> np.ndarray:
    forces = []
    for step, command in enumerate(commands, start=first_step):
        context.SetTime(PERIOD * step)
        disturbance.GetInputPort("force").FixValue(context, command)
        forces.append(disturbance.GetOutputPort("force").Eval(context).copy())
        updated = disturbance.EvalUniquePeriodicDiscreteUpdate(context).value()
        assert np.array_equal(
            np.clip(command + updated, -disturbance.thrust_limit, disturbance.thrust_limit),
            forces[-1],
        )
        context.SetDiscreteState(updated)
    return np.array(forces)


def constant(command, steps: int) -> np.ndarray:
    return np.tile(np.asarray(command, dtype=float), (steps, 1))


def clone_replays_and_seed_counts(make, steps: int, cloned_after: int) -> None:
    """Asserts it of what `make` makes of a seed: the seed is a parameter of the Context."""
    commands = constant([2.0, 1.0, -3.0], steps)
    disturbance = make(4)
    context = disturbance.CreateDefaultContext()
    begun = step_on(disturbance, context, commands[:cloned_after])
    twin = context.Clone()
    left = commands[cloned_after:], cloned_after
    rest = step_on(disturbance, context, *left)
    assert np.array_equal(rest, step_on(disturbance, twin, *left))
    whole = np.concatenate([begun, rest])
    assert np.array_equal(whole, walks(disturbance, commands, seed=4))
    other = walks(disturbance, commands, seed=5)
    assert np.all(np.any(other != whole, axis=1))
    assert np.array_equal(other, walks(make(5), commands, seed=5))
