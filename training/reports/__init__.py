"""Reports: one writer for HTML and Markdown, and the figures that reports share. No PyTorch.

Start with `write_report`, which writes sections of text, tables and pictures as one HTML file and
as Markdown. `force_figures` compares forces with the expert's, `plot_frames` draws lidar frames.
"""

from proxops.training.reports.force_errors import force_figures, plot_forces, report_markdown
from proxops.training.reports.lidar_frames import plot_frames
from proxops.training.reports.report_writer import (
    Block,
    Page,
    Picture,
    Section,
    Table,
    Text,
    picture,
    write_report,
)

__all__ = [
    "Block",
    "Page",
    "Picture",
    "Section",
    "Table",
    "Text",
    "force_figures",
    "picture",
    "plot_forces",
    "plot_frames",
    "report_markdown",
    "write_report",
]
