"""A policy flown: what the log says of it, that it repeats, and the commands that fly it."""

from pathlib import Path

import numpy as np
import pytest
from known_policies import DeadReckoning, NotANumber, write_policy
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.cli.fly import _other_rows
from proxops.diagrams.flight import bundle_of, fly, named_controller
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems import GuidancePolicy, PolicyBundle
from proxops.systems.policy import PolicyConfig


@pytest.fixture(scope="module")
def reckoning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("reckoning") / "policy", DeadReckoning())


def brief(bundle: Path, **changes: object) -> Scenario:
    return short_scenario(**(BRIEF | {"policy__bundle": str(bundle)} | changes))


@pytest.fixture(scope="module")
def log(reckoning: Path) -> FlightLog:
    return fly(brief(reckoning, disturbance={}, noise_seed=3), "policy")


# --- the log --------------------------------------------------------------------------------------


def test_policy_is_fed_what_is_commanded(log: FlightLog) -> None:
    """Dead reckoning again in numpy, with the log's commands: estimates, then commands."""
    forces, target = log.dataset["force"].values, log.dataset["target"].values[0]
    told = log.dataset["policy_force"].values
    state = np.array([160e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    estimates = [state]
    for force in told[:-2]:
        push = 10.0 * force / 100.0
        state = np.concatenate([state[:3] + 10.0 * (state[3:] + 0.5 * push), state[3:] + push])
        estimates.append(state)
    estimates = np.array(estimates)
    got = log.dataset["estimate"].values[:-1]
    np.testing.assert_allclose(got[:, :3], estimates[:, :3], atol=0.5)
    np.testing.assert_allclose(got[:, 3:], estimates[:, 3:], atol=1e-4)
    wanted = 0.01 * (target[:3] - got[:, :3]) + 4.0 * (target[3:] - got[:, 3:])
    commanded = log.dataset["policy_force"].values[:-1]
    np.testing.assert_allclose(commanded, np.clip(wanted, -7.0, 7.0), atol=1e-3)
    assert np.abs(commanded).max() == 7.0
    assert np.abs(forces[:-1] - commanded).max() > 0.5  # It was disturbed, and was not told.


def test_answers_that_are_not_finite_are_counted(tmp_path: Path) -> None:
    log = fly(brief(write_policy(tmp_path / "policy", NotANumber())), "policy")
    statuses = log.dataset["policy_status"].values[:-1]
    assert statuses.tolist() == [float(k % 3 == 2) for k in range(len(statuses))]
    assert (log.dataset["policy_force"].values[:-1][statuses == 1.0] == 0.0).all()
    table = dict(_other_rows(log, log.summary))
    assert table["steps without force: policy not finite"] == str(int(statuses.sum()))


# --- the scenario ---------------------------------------------------------------------------------


def test_end_to_end_names_the_pilot_that_ships(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    pilot = bundle_of("policy:end-to-end", Scenario())
    assert pilot == bundle_of("hybrid:end-to-end", Scenario(policy=PolicyConfig("elsewhere")))
    assert pilot is not None
    assert PolicyBundle.load(pilot).estimates
    assert bundle_of("policy:./end-to-end", Scenario()) == Path("end-to-end")
    assert isinstance(named_controller("policy", Scenario(), kleopatra()), GuidancePolicy)
