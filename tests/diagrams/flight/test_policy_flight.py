"""A policy flown: what the log says of it, that it repeats, and the commands that fly it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import proxops
from known_policies import Counting, DeadReckoning, NotANumber, write_policy
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.cli.common import console
from proxops.cli.fly import _table
from proxops.diagrams.flight.named_controllers import bundle_of, named_controller
from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs.flight_log import FlightLog, differences
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.systems import GuidancePolicy, PolicyBundle
from proxops.systems.policy import PolicyConfig


@pytest.fixture(scope="module")
def reckoning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("reckoning") / "policy", DeadReckoning())


@pytest.fixture(scope="module")
def counting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("counting") / "policy", Counting())


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


def test_log_of_a_policy(log: FlightLog, reckoning: Path) -> None:
    data = log.dataset
    assert (data["decision"] == 2).all()
    assert (data["policy_time"][:-1] > 0.0).all()
    assert (data["policy_status"][:-1] == 0).all()
    assert data["policy_status"].attrs["flag_meanings"] == "answered not_finite"
    assert np.isnan(data["mpc_force"]).all()
    assert np.isnan(data["solve_time"]).all()
    assert data.attrs["policy_sha256"] == PolicyBundle.load(reckoning).sha256
    np.testing.assert_allclose(
        data["disturbance"], (data["force"] - data["policy_force"]).values, atol=1e-12
    )


def test_summary_of_a_policy(log: FlightLog) -> None:
    summary, data = log.summary, log.dataset
    assert (summary["controller"], summary["policy_share"], summary["mpc_solves"]) == (
        "policy", 1.0, 0,
    )  # fmt: skip
    assert summary["policy_sha256"] == data.attrs["policy_sha256"]
    times = 1e3 * data["policy_time"].values
    assert summary["control_ms_median"] == pytest.approx(np.nanmedian(times))
    assert summary["control_ms_p99"] == pytest.approx(np.nanpercentile(times, 99))
    error = data["estimate"].values - data["state"].values
    for name, part in (("position_error_m", error[:, :3]), ("velocity_error_m_s", error[:, 3:])):
        sizes = np.sqrt((part**2).sum(axis=1))
        assert summary[f"estimate_{name}_median"] == pytest.approx(np.nanmedian(sizes))
        assert summary[f"estimate_{name}_p95"] == pytest.approx(np.nanpercentile(sizes, 95))
    # Gravity, some 1e-2 m/s^2, is what it does not know of.
    assert 10.0 < summary["estimate_position_error_m_median"] < 500.0
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert "policy step, median and p99" in dict(_table(log, summary))


def test_policy_without_estimates(counting: Path) -> None:
    log = fly(brief(counting), "policy")
    assert "estimate" not in log.dataset
    assert not [name for name in log.summary if name.startswith("estimate")]
    forces = log.dataset["policy_force"].values[:-1]
    np.testing.assert_array_equal(forces[:, 0], np.minimum(np.arange(len(forces)), 7))
    nearest = log.dataset["ranges"].min(dim=("plane", "ray")).values[:-1]
    np.testing.assert_allclose(forces[:, 2], nearest / 1e5, rtol=1e-6)
    total = np.concatenate([[0.0], np.cumsum(log.dataset["force"].values[:-2, 1])])
    np.testing.assert_allclose(forces[:, 1], np.clip(total, -7.0, 7.0), atol=1e-5)


def test_answers_that_are_not_finite_are_counted(tmp_path: Path) -> None:
    log = fly(brief(write_policy(tmp_path / "policy", NotANumber("force"))), "policy")
    statuses = log.dataset["policy_status"].values[:-1]
    assert statuses.tolist() == [float(k % 3 == 2) for k in range(len(statuses))]
    assert (log.dataset["policy_force"].values[:-1][statuses == 1.0] == 0.0).all()
    table = dict(_table(log, log.summary))
    assert table["steps without force: policy not finite"] == str(int(statuses.sum()))


# --- once a step, and again -----------------------------------------------------------------------


# --- the scenario and the commands ----------------------------------------------------------------


def test_end_to_end_names_the_pilot_that_ships(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    pilot = bundle_of("policy:end-to-end", Scenario())
    assert pilot == bundle_of("hybrid:end-to-end", Scenario(policy=PolicyConfig("elsewhere")))
    assert pilot is not None
    assert PolicyBundle.load(pilot).estimates
    assert bundle_of("policy:./end-to-end", Scenario()) == Path("end-to-end")
    assert isinstance(named_controller("policy", Scenario(), kleopatra()), GuidancePolicy)


def test_thrust_limit_is_the_scenario_s(counting: Path) -> None:
    scenario = brief(counting, spacecraft__thrust_limit_n=3.0, log_ranges=False)
    forces = fly(scenario, "policy").dataset["policy_force"].values[:-1]
    np.testing.assert_array_equal(forces[:, 0], np.minimum(np.arange(len(forces)), 3))


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., int]:
    """`proxops ARGUMENTS` in this process, in a folder of its own; returns the exit code."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "width", 200)
    return proxops


SHORT = [
    "--set", "transit.start_m=[160e3, 0, 0]", "--set", "transit.goal_m=[160e3, 8e3, 0]",
    "--set", "arrival.deadline_s=100", "--set", "arrival.dwell_s=50",
]  # fmt: skip


def test_fly_and_fly_again(run, reckoning: Path, tmp_path: Path, capsys) -> None:
    with_policy = (*SHORT, "--set", f"policy.bundle={reckoning}", "--controller", "policy")
    assert run("fly", *with_policy, "--out", "one") == 0
    printed = capsys.readouterr().out
    for words in ("Kleopatra, policy", "policy step, median", "position error of the estimate"):
        assert words in printed
    assert run("fly", "--from", "one/flight.nc", "--out", "two") == 0
    one, two = (FlightLog.load(tmp_path / name / "flight.nc") for name in ("one", "two"))
    assert differences(one, two) == []
    assert json.loads((tmp_path / "two" / "summary.json").read_text()) == two.summary
