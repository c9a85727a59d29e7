"""Controllers besides the MPC: a learned policy and a PD controller.

Start with `GuidancePolicy`, which flies from state and goal at any body of a family, and
`Surroundings`, all that it is told of the body. `NeuralPolicy` is end-to-end: from lidar frames to
force, at one body. `load_policy` reads the network of either from its folder, as a `GuidanceBundle`
or a `PolicyBundle`, which says what it was trained for; a `DescentBundle` is that of a descent (see
`proxops.systems.touch`). `ProportionalDerivative` is a simple
controller to compare others with. PyTorch is not needed here. The names of the network's inputs and
outputs (`POLICY_INPUTS`, `POLICY_OUTPUTS`) are the format of every `PolicyBundle`: change them and
each has to be trained again.
"""

from proxops.systems.policy.descent_network import (
    DESCENT_BUNDLE,
    DESCENT_INPUTS,
    DescentBundle,
    DescentNetwork,
)
from proxops.systems.policy.guidance_bundle import GUIDANCE_BUNDLE, GuidanceBundle, load_policy
from proxops.systems.policy.guidance_network import GuidanceNetwork
from proxops.systems.policy.guidance_policy import GuidancePolicy, PolicyConfig
from proxops.systems.policy.neural_policy import NeuralPolicy, PolicyStatus, policy_answer
from proxops.systems.policy.policy_bundle import (
    POLICY_BUNDLE,
    POLICY_INPUTS,
    POLICY_OUTPUTS,
    PolicyBundle,
    PolicyFacts,
    check_network,
    run_network,
)
from proxops.systems.policy.proportional_derivative import ProportionalDerivative
from proxops.systems.policy.surroundings import INPUTS, Surroundings

__all__ = [
    "DESCENT_BUNDLE",
    "DESCENT_INPUTS",
    "GUIDANCE_BUNDLE",
    "INPUTS",
    "POLICY_BUNDLE",
    "POLICY_INPUTS",
    "POLICY_OUTPUTS",
    "DescentBundle",
    "DescentNetwork",
    "GuidanceBundle",
    "GuidanceNetwork",
    "GuidancePolicy",
    "NeuralPolicy",
    "PolicyBundle",
    "PolicyConfig",
    "PolicyFacts",
    "PolicyStatus",
    "ProportionalDerivative",
    "Surroundings",
    "check_network",
    "load_policy",
    "policy_answer",
    "run_network",
]
