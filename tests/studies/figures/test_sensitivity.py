"""Which quantity drives what: on sets of flights whose cause is known."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from flight_rows import row
from SALib.analyze import pawn

from proxops.studies.figures import DUMMY, drawn_columns, told_from_chance
from proxops.studies.figures.sensitivity import OUTPUTS, _pawn, rank_drivers
from proxops.systems.common import generator

Drawn = dict[str, Any]
NOTHING = {output: [] for output in OUTPUTS if output != "touch_miss_m"}


def flights(count: int, end: Callable[[Drawn], Drawn]) -> list[Drawn]:
    """Rows of flights whose dispersed quantities decide how they end."""
    rows = []
    for k in range(count):
        lots = generator(1, k)
        drawn = {
            "truth.gravity": float(lots.normal(1.0, 0.05)),
            "truth.attitude.constant_deg": lots.normal(0.0, 0.1, 3).tolist(),
            "truth.thrusters.scale": lots.normal(1.0, 0.02, 2).tolist(),
            "truth.lidar.dropout": float(lots.uniform(0.0, 0.1)),
            "truth.mesh": ["a.obj", "b.obj", "c.obj"][lots.integers(3)],
        }
        noise = float(lots.normal(0.0, 1.0))
        rows.append(row(transit=k, seed=1, dispersed=drawn, **end(drawn | {"noise": noise})))
    return rows


def turned(drawn: Drawn) -> Drawn:
    """Fails if the attitude is off by more than a limit; Δv follows gravity."""
    fails = float(np.linalg.norm(drawn["truth.attitude.constant_deg"])) > 0.25
    return {
        "success": not fails,
        "terminal_position_error_m": (50e3 if fails else 100.0) * np.exp(0.2 * drawn["noise"]),
        "delta_v_m_s": 150.0 * drawn["truth.gravity"] + drawn["noise"],
    }


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return rank_drivers(flights(200, turned))


def test_drivers_are_found(found: dict[str, Any]) -> None:
    assert tuple(found) == tuple(NOTHING)
    assert found["failure"][0].quantity == "|truth.attitude.constant_deg|"
    assert found["terminal_position_error_m"][0].quantity == "|truth.attitude.constant_deg|"
    assert told_from_chance(found["delta_v_m_s"]) == ["truth.gravity"]


def test_the_rest_is_not_told_from_chance(found: dict[str, Any]) -> None:
    for ranking in found.values():
        indices = [entry.index for entry in ranking]
        assert indices == sorted(indices, reverse=True)
        [dummy] = [entry for entry in ranking if entry.quantity == DUMMY]
        for entry in ranking:
            assert 0.0 <= entry.low <= entry.index <= entry.high <= 1.0
            if entry is not dummy:
                assert entry.above_chance == (entry.index > dummy.high)
    told = {name for ranking in found.values() for name in told_from_chance(ranking)}
    assert all("gravity" in name or "attitude" in name for name in told)


def test_a_miss_follows_what_a_survey_was_off_by() -> None:
    """Those that did not touch have none."""

    def touched(drawn: Drawn) -> Drawn:
        off = float(np.exp(drawn["noise"]))
        miss = {"touch_miss_m": 1e3 * off} if drawn["truth.mesh"] != "c.obj" else {}
        return turned(drawn) | miss | {"survey_map_rms_of_size": off}

    ranked = rank_drivers(flights(200, touched))["touch_miss_m"]
    assert told_from_chance(ranked)[0] == "survey_map_rms_of_size"


@pytest.mark.parametrize("count", [50, 200, 201, 301])
def test_indices_are_salibs(count: int) -> None:
    """Also of 0/1 outputs, of outputs with ties, and of inputs with ties."""
    problem = {"num_vars": 6, "names": [f"x{k}" for k in range(6)]}
    random = generator(1, count)
    inputs = np.argsort(random.random((count, 6)), axis=0).astype(float)
    inputs[:, 3:] = inputs[random.integers(count, size=count), 3:]
    for output in (
        random.random(count), random.random(count) < 0.1, np.round(random.random(count), 1),
    ):  # fmt: skip
        found = _pawn(inputs, output.astype(float))
        with warnings.catch_warnings():
            # scipy warns where it can't compute a p-value exactly.
            warnings.simplefilter("ignore")
            theirs = pawn.analyze(problem, inputs, output.astype(float), S=10)["mean"]
        np.testing.assert_allclose(found, theirs, rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_one_ranking_in_twenty_names_something_where_nothing_has_an_effect() -> None:
    """Of 30 quantities, of which any may be named. Each alone would be in one ranking of 4."""
    count, sets = 60, 200
    named = 0
    for seed in range(sets):
        drawn = generator(seed, 5).normal(size=(count, 31))
        rows = [
            row(transit=k, seed=seed, delta_v_m_s=drawn[k, 0],
                dispersed={f"x{j}": drawn[k, j] for j in range(1, 31)})
            for k in range(count)
        ]  # fmt: skip
        named += bool(told_from_chance(rank_drivers(rows)["delta_v_m_s"]))
    # 10 are expected; a binomial distribution exceeds 19 in one case of 500.
    assert 2 <= named <= 19


def test_index_of_failure_by_hand() -> None:
    """Ten slices of 20 flights; 20 failures in the last: distances 0.9 once and 0.1 nine times."""
    rows = [
        row(transit=k, success=k < 180, dispersed={"x": k / 7.0}) for k in range(200)
    ]  # fmt: skip
    entry = rank_drivers(rows)["failure"][0]
    # SALib leaves the greatest value out of its slice.
    assert entry.index == pytest.approx((0.9 + 9 * 0.1) / 10, abs=1e-9)


def test_the_transit_can_be_the_driver() -> None:
    """Δv grows with the distance: what was drawn of the world does less, and is not told."""
    rows = flights(200, lambda _: {})
    for flight, distance in zip(rows, generator(1, 200).uniform(70e3, 330e3, 200), strict=True):
        flight["transit_distance_m"] = float(distance)
        flight["transit_start_clearance_m"] = float(generator(2, flight["transit"]).uniform(0, 9e4))
        flight["delta_v_m_s"] = 1e-3 * distance + 10.0 * flight["dispersed"]["truth.gravity"]
    assert told_from_chance(rank_drivers(rows)["delta_v_m_s"]) == ["transit_distance_m"]


def test_columns() -> None:
    rows = [
        {"dispersed": {"a": 1.0, "fixed": 3, "v": [1.0, -2.0], "s": [1.0, 1.1], "t": "x", "n": 5}},
        {"dispersed": {"a": 2.0, "fixed": 3, "v": [-1.0, 4.0], "s": [1.0, 0.9], "t": "b"}},
    ]
    columns = drawn_columns(rows)
    # The sizes of thrust near 1 have no norm; the components of v lie on both sides of zero.
    assert list(columns) == ["a", "v[0]", "v[1]", "|v|", "s[1]", "t", "n"]
    np.testing.assert_allclose(columns["|v|"].values, np.sqrt([5.0, 17.0]))
    np.testing.assert_array_equal(columns["v[1]"].values, [-2.0, 4.0])
    assert columns["t"].labels == ("b", "x")
    np.testing.assert_array_equal(columns["t"].values, [1.0, 0.0])
    assert columns["n"].labels == ("5", "None")
    assert not drawn_columns([{"dispersed": {"truth.surface_seed": seed}} for seed in (3, 4)])
    never = drawn_columns([{"dispersed": {"never_s": float("inf"), "at_s": at}} for at in (1e9, 2)])
    assert list(never) == ["at_s"]
    assert drawn_columns([{"dispersed": {}}]) == drawn_columns([]) == {}


def test_too_few_flights_and_outputs_that_are_equal() -> None:
    assert rank_drivers(flights(49, turned)) == NOTHING
    equal = rank_drivers(flights(60, lambda _: {}))
    assert equal == NOTHING
    unchanged = [row(transit=k, delta_v_m_s=float(k), dispersed={"x": 1.0}) for k in range(60)]
    assert rank_drivers(unchanged)["delta_v_m_s"] == []
