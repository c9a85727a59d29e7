"""From PyTorch to a bundle that flies, with the report that goes with it.

Start with `export_policy` for any module of your own. ONNX Runtime is compared with PyTorch before
anything is written.
"""

from proxops.training.export.onnx_export import (
    accepted_difference,
    describing,
    onnx_bytes,
    write_bundle_folder,
    write_folder,
)
from proxops.training.export.policy_export import export_policy
from proxops.training.export.policy_report import export_recipe, report_title, write_report

__all__ = [
    "accepted_difference",
    "describing",
    "export_policy",
    "export_recipe",
    "onnx_bytes",
    "report_title",
    "write_bundle_folder",
    "write_folder",
    "write_report",
]
