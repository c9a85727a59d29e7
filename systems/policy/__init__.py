"""Controllers besides the MPC: a learned policy and a PD controller.

Start with `NeuralPolicy`, which runs an ONNX network once a control step, and `PolicyBundle`, the
folder that holds the network and says what it was trained for. `ProportionalDerivative` is a simple
controller to compare others with. PyTorch is not needed here. The names of the network's inputs
and outputs (`POLICY_INPUTS`, `POLICY_OUTPUTS`) are the format of all bundles: change them and every
bundle has to be trained again.
"""

from proxops.systems.policy.neural_policy import NeuralPolicy, PolicyStatus, policy_answer
from proxops.systems.policy.policy_bundle import (
    POLICY_FILE,
    POLICY_FORMAT,
    POLICY_INPUTS,
    POLICY_OUTPUTS,
    PolicyBundle,
    check_network,
    run_network,
)
from proxops.systems.policy.proportional_derivative import ProportionalDerivative

__all__ = [
    "POLICY_FILE",
    "POLICY_FORMAT",
    "POLICY_INPUTS",
    "POLICY_OUTPUTS",
    "NeuralPolicy",
    "PolicyBundle",
    "PolicyStatus",
    "ProportionalDerivative",
    "check_network",
    "policy_answer",
    "run_network",
]
