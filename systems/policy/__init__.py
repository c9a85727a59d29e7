"""Controllers that are not the expert: a learned policy from its bundle, and a PD controller.

Start with `NeuralPolicy`, which runs an ONNX network once a step, and `PolicyBundle`, the folder
that it flies from and the checks that a bundle must pass. PyTorch is never needed here.
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
