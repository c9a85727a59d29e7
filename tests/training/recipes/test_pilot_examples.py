"""The examples that the pilot's parts learn from, compared with the flights they come from."""

import numpy as np

from proxops.training.data import PackedFlights
from proxops.training.networks.lidar_hits import HitSelection
from proxops.training.recipes.pilot_examples import (
    box_of,
    commands_of,
    flight_labels,
    hits_of,
    part_rows,
    spread_rows,
    transitions_of,
)


def test_spread_rows_are_300_m_of_path_apart(packed: PackedFlights):
    rows = spread_rows(packed, "training")
    assert 3 < len(rows) < len(part_rows(packed, "training"))
    for flight in packed.part("training"):
        own = np.arange(flight.start, flight.start + flight.steps)
        moved = np.linalg.norm(np.diff(packed.state[own, :3], axis=0), axis=1)
        gone = np.concatenate([[0.0], np.cumsum(moved)])
        kept = np.isin(own, rows)
        assert kept[0]
        # One in each stretch of 300 m that has any.
        assert kept.sum() == len(np.unique(gone // 300.0))


def test_hits_lie_where_the_frames_put_them(packed: PackedFlights):
    selection = HitSelection(packed.setting.planes, packed.setting.rays, 64)
    hits = hits_of(packed, selection, "training", 10_000, seed=1)
    assert len(hits.position) == len(spread_rows(packed, "training"))
    low, high = box_of(hits)
    # Seen from beyond the long end: the near tip of the body, with its noise.
    assert 100e3 < high[0] < 140e3
    assert (high - low > 10e3).all()
    places = hits.points[:, :] + hits.position[:, None]
    seen = places[hits.valid > 0].numpy()
    assert (np.abs(seen[:, 0]) < 150e3).mean() > 0.99


def test_transitions_are_what_flights_did(packed: PackedFlights):
    period = packed.setting.control_period_s
    given = transitions_of(packed, "training")
    flights = packed.part("training")
    assert len(given.position) == sum(flight.steps - 1 for flight in flights)
    # Position after the step, by the mean acceleration, to what a varying one leaves.
    first = flights[0]
    after = packed.state[first.start + 1]
    moved = given.position[0] + period * given.velocity[0] + 0.5 * period**2 * given.acceleration[0]
    np.testing.assert_allclose(moved.numpy(), after[:3], atol=1.0)
    np.testing.assert_allclose(
        given.force[0].numpy(), packed.commanded_force[first.start + 1], atol=1e-6
    )


def test_commands_are_the_experts(packed: PackedFlights):
    given = commands_of(flight_labels(packed, "validation"))
    rows = part_rows(packed, "validation")
    np.testing.assert_allclose(given.force.numpy(), packed.mpc_force[rows], atol=1e-6)
    np.testing.assert_allclose(given.goal.numpy(), packed.target[rows, :3])
