"""Variants: each changes what it says, and nothing is mixed up."""

import dataclasses
from pathlib import Path

import pytest
from short_flights import BRIEF, short_scenario
from synthetic_log import synthetic_log

from proxops.diagrams.flight import Workers, fly, transit_flights
from proxops.diagrams.scenario import Body, Scenario, load_scenario
from proxops.studies.campaigns.describing import describe_flight
from proxops.studies.campaigns.variants import (
    Variant,
    evaluate,
    fly_logs,
    fly_variants,
    load_logs,
    variant_flights,
)
from proxops.systems import InputError


def test_flights_are_in_the_world_that_the_variant_says() -> None:
    def heavier(scenario: Scenario, body: Body) -> Scenario:
        truth = dataclasses.replace(scenario.truth, mass=1.0 + 0.1 * scenario.transit.index)
        return dataclasses.replace(scenario, truth=truth)

    variant = Variant("heavier", "zero", {"noise_seed": 3}, world=heavier)
    flights = variant_flights(variant, load_scenario(), 5, [4, 2])
    for flight, number in zip(flights, (4, 2), strict=True):
        wanted = {"transit.seed": 5, "transit.index": number, "noise_seed": 3}
        mass = {"truth.mass": 1.0 + 0.1 * number}
        assert flight.scenario == load_scenario(None, wanted | mass)


@pytest.mark.parametrize("names", [("a", "a"), ("a b", "a-b")])
def test_names_of_the_same_files_are_refused(names: tuple[str, str], tmp_path: Path) -> None:
    variants = [Variant(name, "zero") for name in names]
    with pytest.raises(InputError, match="would write the same files"):
        fly_variants(variants, load_scenario(), 5, 1, tmp_path)
    with pytest.raises(InputError, match="would write the same files"):
        fly_logs(variants, load_scenario(), 5, {}, tmp_path)


def test_rows_and_logs_are_those_of_their_variant(tmp_path: Path) -> None:
    variants = [Variant("idle", "zero"), Variant("pushed", "zero", {"disturbance": {}})]
    shared, alone = short_scenario(**BRIEF), Workers(1)
    rows = fly_variants(variants, shared, 5, 2, tmp_path / "rows", workers=alone)
    assert {name: [row["transit"] for row in each] for name, each in rows.items()} == {
        "idle": [0, 1], "pushed": [0, 1],
    }  # fmt: skip
    wanted = {"pushed": [1], "idle": [0]}
    logs = fly_logs(variants, shared, 5, wanted, tmp_path / "logs", workers=alone)
    assert {name: list(each) for name, each in logs.items()} == wanted
    assert logs["pushed"][1].scenario.disturbance is not None
    assert logs["idle"][0].scenario.disturbance is None
    again = load_logs(tmp_path / "logs", 5, wanted)
    assert again["pushed"][1].dataset.identical(logs["pushed"][1].dataset)
    ends = {row["terminal_position_error_m"] for each in rows.values() for row in each}
    assert logs["idle"][0].summary["terminal_position_error_m"] in ends


def test_controllers_evaluated(tmp_path: Path) -> None:
    """The results are those of the same flights, flown one after the other."""
    shared = short_scenario(**BRIEF)
    found = evaluate(
        ["mpc", "zero"], shared, transits=2, seed=5, folder=tmp_path, workers=Workers(1)
    )
    assert [*found] == ["mpc", "zero"]
    for name, result in found.items():
        ends = [row["terminal_position_error_m"] for row in result.flights]
        alone = [fly(each.scenario, name).summary for each in transit_flights(shared, name, 5, 2)]
        assert ends == [summary["terminal_position_error_m"] for summary in alone]


def test_the_name_of_a_scenario_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="needs a Scenario as scenario, got a str"):
        evaluate(["mpc"], "bennu", folder=tmp_path)  # pyright: ignore[reportArgumentType]


def test_share_of_small_commands_is_of_what_was_commanded() -> None:
    log = synthetic_log()
    data = log.dataset.copy(deep=True)
    data["force"][:] = 5.0
    data["disturbance"][:] = 5.0
    data["disturbance"][1] = [4.9, 5.0, 5.0]
    data["disturbance"][2] = [4.7, 5.0, 5.0]
    steps = len(data["time"]) - 1
    changed = dataclasses.replace(log, dataset=data)
    assert describe_flight(changed, None)["small_command_share"] == pytest.approx(
        (steps - 1) / steps
    )
