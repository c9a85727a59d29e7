"""Frames that arrive late."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from proxops.diagrams.scenario.body import load_body
from proxops.systems import FrameDelay, Lidar, LidarErrors, LidarGeometry

GEOMETRY = LidarGeometry(planes=4, rays=60)


# With 0.1 s and 0.7 s, sums of periods and multiples of them differ in the last bit.
@pytest.mark.parametrize("period", [10.0, 0.1, 0.7])
def test_frames_late_by_steps(period: float) -> None:
    """A spacecraft that moves past Kleopatra; the flight ends between two control steps."""
    steps, end, builder = 3, 12.4 * period, DiagramBuilder()
    path = PiecewisePolynomial.FirstOrderHold(
        [0.0, 2.0 * end], np.array([[120e3, 60e3, -20e3], [-100e3, 90e3, 40e3]]).T
    )
    source = builder.AddSystem(TrajectorySource(path))
    lidar = builder.AddSystem(
        Lidar(load_body("kleopatra").shape, LidarErrors(50.0, frame_loss=0.2), GEOMETRY, period, 4)
    )
    delay = builder.AddSystem(FrameDelay(GEOMETRY.size, steps, period))
    assert not delay.HasAnyDirectFeedthrough()
    builder.Connect(source.get_output_port(), lidar.GetInputPort("position"))
    builder.Connect(lidar.GetOutputPort("ranges"), delay.get_input_port())
    logs = [
        LogVectorOutput(port, builder, publish_period=period)
        for port in (delay.get_output_port(), source.get_output_port())
    ]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(end)
    context = simulator.get_context()
    late, places = (log.FindLog(context).data().T for log in logs)
    times = logs[0].FindLog(context).sample_times()
    assert len(times) == 13
    # The last row of a flight's log is between two control steps.
    here = delay.GetMyContextFromRoot(context)
    late = np.concatenate([late, delay.get_output_port().Eval(here)[None]])
    places = np.concatenate([places, path.value(end).T])
    times = np.append(times, end)
    measured = lidar.frames(times, places, lidar.seed)
    assert np.isinf(late[:steps]).all()
    assert np.isfinite(measured).any(axis=(1, 2)).sum() > 8
    wanted = measured[:-steps].reshape(len(times) - steps, -1)
    assert np.array_equal(late[steps:].astype(np.float32), wanted)
