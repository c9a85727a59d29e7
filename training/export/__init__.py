"""Export of PyTorch networks to bundles that fly, with a report on the policy.

Start with `export_recipe`, which takes a policy and the flights that it learned from;
`export_policy` takes any module with the interface of a policy, `export_guidance` the guidance for
any body, and `export_descent` that of a descent. Every export runs what flies against PyTorch
before it writes anything.
"""

from proxops.training.export.onnx_export import accepted_difference, onnx_bytes, publish
from proxops.training.export.policy_export import export_descent, export_guidance, export_policy
from proxops.training.export.policy_report import export_recipe, report_title, write_report

__all__ = [
    "accepted_difference",
    "export_descent",
    "export_guidance",
    "export_policy",
    "export_recipe",
    "onnx_bytes",
    "publish",
    "report_title",
    "write_report",
]
