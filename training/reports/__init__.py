"""Reports: one writer for HTML and Markdown, and the figures that reports share. No PyTorch.

Start with `write_report`, which writes sections of text, tables and pictures as one HTML page and
as Markdown. To add a report, write a function that returns such sections, beside the code that it
reports on; `number_text` gives the figures of its tables. `force_figures` compares forces with the
expert's, and `plot_frames` draws lidar frames.
"""

from proxops.training.reports.figure_text import DASH, SMALL_COMMAND, interval_text, number_text
from proxops.training.reports.force_errors import (
    HISTOGRAMS_CAPTION,
    force_figures,
    plot_forces,
    policy_sections,
)
from proxops.training.reports.lidar_frames import plot_frames
from proxops.training.reports.report import (
    Block,
    Cell,
    Folded,
    Link,
    Mark,
    Page,
    Picture,
    Section,
    Table,
    Text,
    markdown_page,
    markdown_table,
    picture,
    write_markdown,
    write_report,
)

__all__ = [
    "DASH",
    "HISTOGRAMS_CAPTION",
    "SMALL_COMMAND",
    "Block",
    "Cell",
    "Folded",
    "Link",
    "Mark",
    "Page",
    "Picture",
    "Section",
    "Table",
    "Text",
    "force_figures",
    "interval_text",
    "markdown_page",
    "markdown_table",
    "number_text",
    "picture",
    "plot_forces",
    "plot_frames",
    "policy_sections",
    "write_markdown",
    "write_report",
]
