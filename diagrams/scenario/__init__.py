"""What a flight depends on besides its controller: the scenario, the body, the transit.

Start with `load_scenario` and the dataclasses of `scenario_config`, where each value stands with
its default, unit and limits; then `load_body` and `transit_set`. A new value is a new field there.
Nothing in this room simulates.
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
from proxops.diagrams.scenario.typed_yaml import load_typed

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
    "parse_scenario",
    "scenario_transit",
    "transit_set",
]
