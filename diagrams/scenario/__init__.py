"""The scenario, the body and the transit: all that a flight depends on besides its controller.

Start with `load_scenario` and the dataclasses of `scenario_config`, which give each value its
default, unit and limits; then read `load_body` and `transit_set`. To add a value to the scenario,
add a field to one of these dataclasses. Nothing in this room simulates.
"""

from proxops.diagrams.scenario.body import Body, BodyConfig, load_body
from proxops.diagrams.scenario.scenario import (
    change_scenario,
    dump_scenario,
    load_scenario,
    parse_scenario,
)
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import (
    ArrivalConfig,
    AssuranceConfig,
    ForceNoiseConfig,
    HybridConfig,
    KicksConfig,
    LearnedLidarConfig,
    LidarConfig,
    MismatchConfig,
    MpcConfig,
    PolicyConfig,
    RandomWalkDisturbanceConfig,
    Scenario,
    SpacecraftConfig,
    TransitConfig,
    WeightedCostConfig,
)
from proxops.diagrams.scenario.transits import (
    Transit,
    draw_transit,
    hover_force,
    is_blocked,
    of_transit,
    scenario_transit,
    transit_set,
)
from proxops.diagrams.scenario.typed_yaml import load_typed, parse_mapping

__all__ = [
    "ArrivalConfig",
    "AssuranceConfig",
    "Body",
    "BodyConfig",
    "ForceNoiseConfig",
    "HybridConfig",
    "KicksConfig",
    "LearnedLidarConfig",
    "LidarConfig",
    "MismatchConfig",
    "MpcConfig",
    "PolicyConfig",
    "RandomWalkDisturbanceConfig",
    "Scenario",
    "SpacecraftConfig",
    "Transit",
    "TransitConfig",
    "WeightedCostConfig",
    "change_scenario",
    "check_scenario",
    "draw_transit",
    "dump_scenario",
    "hover_force",
    "is_blocked",
    "load_body",
    "load_scenario",
    "load_typed",
    "of_transit",
    "parse_mapping",
    "parse_scenario",
    "scenario_transit",
    "transit_set",
]
