"""The policies that ship: nothing is trained here, ten transits each."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import Diagram
from short_flights import kleopatra

from proxops.diagrams.flight import Workers, named_controller, run_campaign, transit_flights
from proxops.diagrams.scenario import load_scenario
from proxops.systems import GuidancePolicy

# Seeds from 10,000 on are kept for evaluation; the policies were trained on others than this one.
SEED = 77


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["policy", "hybrid", "policy:end-to-end"])
def test_nine_of_ten_transits_arrive_and_none_enters_the_keep_out(
    tmp_path: Path, controller: str
) -> None:
    scenario = load_scenario(None, {"log_ranges": False})
    flights = transit_flights(scenario, controller, SEED, 10)
    rows = run_campaign(flights, tmp_path, workers=Workers(1))
    assert [row["transit"] for row in rows] == list(range(10))
    # Transits 1, 4 and 7 have their straight line blocked by the keep-out ellipsoid.
    assert sum(row["success"] for row in rows) >= 9
    assert sum(row["keep_out_violations"] for row in rows) == 0
    assert not any(row["collided"] for row in rows)
    # It is the network that flies: alone always, in the hybrid most of the time.
    least = 0.5 if controller == "hybrid" else 1.0
    assert all(row["policy_share"] >= least for row in rows)


@pytest.mark.slow
def test_a_greater_margin_is_flown_wider(tmp_path: Path) -> None:
    def nearest(margin: float) -> list[float]:
        scenario = load_scenario(None, {"log_ranges": False, "policy.margin_m": margin})
        flights = transit_flights(scenario, "policy", SEED, 8)
        blocked = [flights[number] for number in (1, 4, 7)]
        rows = run_campaign(blocked, tmp_path / f"{margin:.0f}", workers=Workers(1))
        assert all(row["success"] for row in rows)
        return [row["min_clearance_m"] for row in rows]

    wider = np.subtract(nearest(15e3), nearest(9e3))
    assert wider.min() > 0.0
    assert wider.mean() > 2e3


@pytest.mark.parametrize(("controller", "usual"), [("policy", 9e3), ("hybrid", 4.5e3)])
def test_the_margin_is_smaller_where_the_mpc_checks(controller: str, usual: float) -> None:
    for given, margin in ((None, usual), (1e3, 1e3)):
        scenario = load_scenario(None, {"policy.margin_m": given})
        system = named_controller(controller, scenario, kleopatra())
        policy = system.GetSubsystemByName("policy") if isinstance(system, Diagram) else system
        assert isinstance(policy, GuidancePolicy)
        wider = policy.surroundings.semi_axes - kleopatra().keep_out_semi_axes
        np.testing.assert_allclose(wider, margin)
