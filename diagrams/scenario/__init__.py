"""The scenario, the body, the transit and the true world: what a flight depends on.

Start with `load_scenario` and `Scenario`, which composes the dataclasses that stand beside the
systems that they configure; then read `World.of`, which makes all that one flight depends on, once:
the drawn scenario, the belief, the body, the true body, the transit. `TruthConfig` says how the
world may differ from what is believed, and `QUANTITIES` what of it is uncertain and who is told.
`filter_tuning` gives one standard deviation of the errors that the navigation expects, and
`uncertainty_set` the greatest errors within which runtime assurance keeps out. Nothing in this room
simulates.
"""

from proxops.diagrams.scenario.body import Body, BodyConfig, check_constants, load_body
from proxops.diagrams.scenario.bounds import described_bounds, uncertainty_set
from proxops.diagrams.scenario.dispersions import Dispersion, dispersion_entries, load_dispersions
from proxops.diagrams.scenario.key_descriptions import (
    DescribedKey,
    commented_scenario,
    described_keys,
    dotted,
)
from proxops.diagrams.scenario.keys import (
    differing_values,
    dotted_leaves,
    given_keys,
    set_value,
    value_at,
)
from proxops.diagrams.scenario.quantities import QUANTITIES
from proxops.diagrams.scenario.remarks import scenario_remarks
from proxops.diagrams.scenario.scenario import (
    change_scenario,
    dump_changes,
    dump_scenario,
    load_scenario,
    parse_scenario,
    shipped_scenarios,
)
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import (
    Scenario,
    TransitConfig,
    TrueStateConfig,
    TruthConfig,
)
from proxops.diagrams.scenario.sky import facets_of, greatest_from_sky
from proxops.diagrams.scenario.spacecraft_model import (
    RigidBodyConfig,
    SpacecraftModel,
    load_spacecraft,
)
from proxops.diagrams.scenario.spacecraft_solids import Solid, solids_of
from proxops.diagrams.scenario.tasks import (
    EnoughConfig,
    MissionConfig,
    SurveyConfig,
    TouchAndGoConfig,
)
from proxops.diagrams.scenario.touchable import (
    arm_solids,
    check_arm,
    place_of,
    site_world,
    touch_arm,
    touch_craft,
    touch_map,
    touch_site,
    with_site,
)
from proxops.diagrams.scenario.transits import (
    Transit,
    check_flyable,
    draw_transit,
    hover_force,
    is_blocked,
    of_transit,
    scenario_transit,
    with_ends,
)
from proxops.diagrams.scenario.true_body import (
    TrueBody,
    UnflyableWorldError,
    make_true_body,
    spin_axes,
    turns_the_axes,
)
from proxops.diagrams.scenario.tuning import expected_of, filter_tuning, survey_errors
from proxops.diagrams.scenario.world import World, believed, dispersed_values, draw_world
from proxops.systems.assurance import AssuranceConfig
from proxops.systems.expert import MpcConfig, WeightedCostConfig
from proxops.systems.hybrid import HybridConfig
from proxops.systems.lidar import LearnedLidarConfig, LidarConfig
from proxops.systems.navigation import LidarNavigationConfig
from proxops.systems.vehicle import (
    ArrivalConfig,
    ForceNoiseConfig,
    KicksConfig,
    PointMassConfig,
    RandomWalkDisturbanceConfig,
    TrueThrustersConfig,
)

__all__ = [
    "QUANTITIES",
    "ArrivalConfig",
    "AssuranceConfig",
    "Body",
    "BodyConfig",
    "DescribedKey",
    "Dispersion",
    "EnoughConfig",
    "ForceNoiseConfig",
    "HybridConfig",
    "KicksConfig",
    "LearnedLidarConfig",
    "LidarConfig",
    "LidarNavigationConfig",
    "MissionConfig",
    "MpcConfig",
    "PointMassConfig",
    "RandomWalkDisturbanceConfig",
    "RigidBodyConfig",
    "Scenario",
    "Solid",
    "SpacecraftModel",
    "SurveyConfig",
    "TouchAndGoConfig",
    "Transit",
    "TransitConfig",
    "TrueBody",
    "TrueStateConfig",
    "TrueThrustersConfig",
    "TruthConfig",
    "UnflyableWorldError",
    "WeightedCostConfig",
    "World",
    "arm_solids",
    "believed",
    "change_scenario",
    "check_arm",
    "check_constants",
    "check_flyable",
    "check_scenario",
    "commented_scenario",
    "described_bounds",
    "described_keys",
    "differing_values",
    "dispersed_values",
    "dispersion_entries",
    "dotted",
    "dotted_leaves",
    "draw_transit",
    "draw_world",
    "dump_changes",
    "dump_scenario",
    "expected_of",
    "facets_of",
    "filter_tuning",
    "given_keys",
    "greatest_from_sky",
    "hover_force",
    "is_blocked",
    "load_body",
    "load_dispersions",
    "load_scenario",
    "load_spacecraft",
    "make_true_body",
    "of_transit",
    "parse_scenario",
    "place_of",
    "scenario_remarks",
    "scenario_transit",
    "set_value",
    "shipped_scenarios",
    "site_world",
    "solids_of",
    "spin_axes",
    "survey_errors",
    "touch_arm",
    "touch_craft",
    "touch_map",
    "touch_site",
    "turns_the_axes",
    "uncertainty_set",
    "value_at",
    "with_ends",
    "with_site",
]
