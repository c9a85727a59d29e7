"""Export of PyTorch networks to bundles that fly, with a report on the policy.

Start with `export_recipe`, which takes a policy and the flights that it learned from;
`policy_export` takes any module with the interface of a policy. Every export runs ONNX Runtime
against PyTorch before it writes anything.
"""

from proxops.training.export.onnx_export import (
    accepted_difference,
    describing,
    onnx_bytes,
    publish,
    write_bundle_folder,
    write_folder,
)
from proxops.training.export.policy_report import export_recipe, report_title, write_report

__all__ = [
    "accepted_difference",
    "describing",
    "export_recipe",
    "onnx_bytes",
    "publish",
    "report_title",
    "write_bundle_folder",
    "write_folder",
    "write_report",
]
