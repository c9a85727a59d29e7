"""The delayed hold against what its equation says, events that coincide included."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from proxops.systems import DelayedHold


class Clock(LeafSystem):
    """Puts out 1 plus the number of the period that has begun, and its square."""

    def __init__(self, period: float):
        super().__init__()

        def calc(context, output):
            count = 1.0 + np.round(context.get_time() / period, 6) // 1.0
            output.SetFromVector([count, count**2])

        self.DeclareVectorOutputPort("count", 2, calc)


def simulator_of(period: float, delay: float) -> tuple[Simulator, DelayedHold]:
    builder = DiagramBuilder()
    clock = builder.AddSystem(Clock(period))
    hold = builder.AddNamedSystem("hold", DelayedHold(period, delay, 2))
    builder.Connect(clock.get_output_port(), hold.get_input_port())
    return Simulator(builder.Build()), hold


def value(simulator: Simulator, hold: DelayedHold) -> list[float]:
    context = hold.GetMyContextFromRoot(simulator.get_context())
    return hold.GetOutputPort("y").Eval(context).tolist()


# With 0.1 s, k T + T and (k + 1) T differ in the last bit for some k.
@pytest.mark.parametrize("period", [10.0, 0.1, 0.7])
@pytest.mark.parametrize("share", [0.02, 1.0])
def test_samples_take_effect_a_delay_later(period: float, share: float) -> None:
    delay = share * period
    simulator, hold = simulator_of(period, delay)
    simulator.Initialize()
    assert value(simulator, hold) == [0.0, 0.0]
    for k in range(60):
        # Before and after sample k takes effect.
        before, after = k * period + 0.99 * delay, k * period + delay + 1e-4 * period
        simulator.AdvanceTo(before)
        assert value(simulator, hold) == [k, k**2], (k, before)
        simulator.AdvanceTo(after)
        assert value(simulator, hold) == [k + 1, (k + 1) ** 2], (k, after)


@pytest.mark.parametrize("share", [0.02, 0.5, 1.0])
def test_mean_over_the_last_period(share: float) -> None:
    """Of what the equation says: sample k from k T + delay on."""
    simulator, hold = simulator_of(10.0, share * 10.0)
    for k in range(1, 20):
        simulator.AdvanceTo(10.0 * k)  # Before the updates of this time.
        context = hold.GetMyContextFromRoot(simulator.get_context())
        old, new = max(k - 1.0, 0.0), float(k)  # Samples k - 2 and k - 1, which count from 1.
        expected = share * old + (1.0 - share) * new
        assert hold.GetOutputPort("mean").Eval(context)[0] == pytest.approx(expected)
