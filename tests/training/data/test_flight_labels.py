"""Labels of flights: what the expert commands at the states that a flight passed."""

from pathlib import Path

import numpy as np
import pytest
from flight_folders import copy_flights, flight
from short_flights import kleopatra

from proxops.diagrams.flight import Workers, make_mpc
from proxops.systems import InputError
from proxops.training.data.flight_labels import labels_along, labels_by_flight


def test_labels_along_the_experts_own_flight_are_its_commands():
    log = flight("a-0")
    states = log.dataset["state"].values[:-1]
    program = make_mpc(log.scenario, kleopatra()).program
    labels = labels_along(program, states, log.dataset["target"].values[0], 10.0, 10, 300.0)
    commands = log.dataset["mpc_force"].values[:-1]
    for state, command in zip(states, commands, strict=True):
        found = labels["force"][(labels["state"] == state).all(axis=1)]
        assert len(found) == 1
        np.testing.assert_allclose(found[0], command, atol=1e-6)
    # Every eighth plan labels its later knots too.
    whole = -(-len(states) // 8)
    most = len(states) + whole * (log.scenario.mpc.intervals - 1)
    assert len(states) + whole * (log.scenario.mpc.intervals // 4) < len(labels["state"]) <= most


def test_few_states_of_a_flight_have_the_experts_commands_too(tmp_path: Path):
    logs = sorted(copy_flights(tmp_path).glob("*.nc"))[:1]
    (labels,) = labels_by_flight(logs, tmp_path / "labels", Workers(1), 6)
    data = flight(logs[0].stem).dataset
    states, commands = data["state"].values[:-1], data["mpc_force"].values[:-1]
    every = -(-len(states) // 6)
    assert every > 1
    seen = 0
    for state, command in zip(states[::every], commands[::every], strict=True):
        found = labels["force"][(labels["state"] == state).all(axis=1)]
        seen += len(found)
        # From a plan of several periods before: close, but not the same to the last digit.
        np.testing.assert_allclose(found[0], command, atol=0.05)
    assert seen == len(states[::every]) <= 6
    assert not (labels["state"] == states[1]).all(axis=1).any()
    with pytest.raises(InputError, match="labels of other flights"):
        labels_by_flight(logs, tmp_path / "labels", Workers(1))


def test_where_no_flight_could_begin_it_says_so(tmp_path: Path):
    with pytest.raises(InputError, match="none of the round could begin in its world"):
        labels_by_flight([], tmp_path / "labels", Workers(1))


def test_labels_are_kept_and_belong_to_their_flight(tmp_path: Path, monkeypatch):
    logs = sorted(copy_flights(tmp_path).glob("*.nc"))[:2]
    told: list[float] = []
    workers = Workers(1, progress=lambda done, text: told.append(done))
    first = labels_by_flight(logs, tmp_path / "labels", workers)
    written = [path.stat().st_mtime_ns for path in sorted((tmp_path / "labels").glob("*.npz"))]
    assert told == [0.0, 0.5, 1.0]
    assert len(written) == 2
    again = labels_by_flight(logs, tmp_path / "labels", Workers(1))
    assert written == [
        path.stat().st_mtime_ns for path in sorted((tmp_path / "labels").glob("*.npz"))
    ]
    for one, other in zip(first, again, strict=True):
        for name, values in one.items():
            np.testing.assert_array_equal(values, other[name])
    with monkeypatch.context() as other_way:
        other_way.setattr("proxops.training.data.flight_labels._WHOLE_PLAN_EVERY", 4)
        with pytest.raises(InputError, match="labels of other flights"):
            labels_by_flight(logs, tmp_path / "labels", Workers(1))
    logs[0].write_bytes(logs[1].read_bytes())
    with pytest.raises(InputError, match="another"):
        labels_by_flight(logs, tmp_path / "labels", Workers(1))
