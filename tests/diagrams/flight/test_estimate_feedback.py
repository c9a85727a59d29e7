"""Policies by the folder of their bundle, and the PD controller on what a policy estimates."""

from pathlib import Path

import numpy as np
import pytest
from known_policies import Counting, DeadReckoning, NotANumber, write_policy
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.diagrams.flight import fly, make_mpc, named_controller
from proxops.diagrams.logs import FlightLog, legend_of
from proxops.systems import InputError, PolicyBundle
from proxops.training.data import plans_along


@pytest.fixture(scope="module")
def reckoning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("reckoning") / "policy", DeadReckoning())


def brief(**changes: object):
    return short_scenario(**(BRIEF | {"log_ranges": False} | changes))


@pytest.fixture(scope="module")
def log(reckoning: Path) -> FlightLog:
    return fly(brief(disturbance={}), f"pd:{reckoning}")


@pytest.mark.slow
def test_flies_the_pd_law_on_the_estimate(log: FlightLog) -> None:
    """The law again in numpy, of the estimate in the log: λ = 8.75e-4 1/s, m k = 5 kg/s."""
    data = log.dataset
    estimate, target = data["estimate"].values[:-1], data["target"].values[0]
    error = target - estimate
    wanted = 5.0 * (np.clip(8.75e-4 * error[:, :3], -40.0, 40.0) + error[:, 3:])
    commanded = (data["force"] - data["disturbance"]).values[:-1]
    np.testing.assert_allclose(commanded, np.clip(wanted, -7.0, 7.0), atol=1e-9)
    # The estimate is not the truth, so this is not what the true state would ask for.
    assert np.abs(estimate - data["state"].values[:-1]).max() > 10.0


def test_mpc_on_the_estimate(reckoning: Path) -> None:
    """Its record is that of the MPC, its plans start from the estimate."""
    log = fly(brief(), f"mpc:{reckoning}")
    data, summary = log.dataset, log.summary
    assert summary["controller"] == f"mpc:{reckoning}"
    assert (data["decision"] == 1).all()
    assert np.isfinite(data["solve_time"].values[:-1]).all()
    assert summary["policy_sha256"] == PolicyBundle.load(reckoning).sha256
    assert (data["policy_time"].values[:-1] > 0.0).all()
    commanded = (data["force"] - data["disturbance"]).values
    np.testing.assert_array_equal(data["mpc_force"].values[:-1], commanded[:-1])
    assert np.isnan(data["policy_force"]).all()
    assert legend_of(data)[1].name == "MPC on the estimate"
    # The same program from the estimates gives the same forces.
    program = make_mpc(log.scenario, log.body).program
    estimates, target = data["estimate"].values[:-1], data["target"].values[0]
    period, cold = log.scenario.control_period_s, log.scenario.mpc.cold_iterations
    plans = list(plans_along(program, estimates, target, period, cold))
    assert all(plan is not None for plan in plans)
    forces = np.array([plan.forces[0] for plan in plans if plan is not None])
    np.testing.assert_allclose(data["mpc_force"].values[:-1], forces, atol=1e-6)
    assert np.abs(estimates - data["state"].values[:-1]).max() > 1.0


@pytest.mark.parametrize("kind", ["pd", "mpc"])
def test_policy_without_estimates_is_refused(kind: str, tmp_path: Path) -> None:
    bundle = write_policy(tmp_path / "policy", Counting())
    with pytest.raises(InputError, match=r"makes no estimate .* fly it as a policy"):
        named_controller(f"{kind}:{bundle}", brief(), kleopatra())


def test_no_force_without_a_finite_estimate(tmp_path: Path) -> None:
    bundle = write_policy(tmp_path / "policy", NotANumber())
    data = fly(brief(), f"pd:{bundle}").dataset
    lost = data["policy_status"].values[:-1] == 1.0
    force = data["force"].values[:-1]
    assert lost.tolist() == [k % 3 == 2 for k in range(len(lost))]
    assert (force[lost] == 0.0).all()
    assert (np.abs(force[~lost]).max(axis=1) > 0.0).all()
