"""Draws a Diagram's systems and wiring with Graphviz, or with Mermaid if `dot` is missing."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass

from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import VectorLogSink


@dataclass(frozen=True)
class DiagramPicture:
    """A picture that notebooks show: as SVG, or as Mermaid text that JupyterLab and GitHub draw."""

    svg: str | None
    """The picture as SVG; None if the program `dot` is not installed."""
    mermaid: str

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict[str, str]:
        """Gives the formats of the picture; IPython calls this method by its name."""
        if self.svg is not None:
            return {"image/svg+xml": self.svg}
        return {
            "text/markdown": f"```mermaid\n{self.mermaid}```\n",
            "text/vnd.mermaid": self.mermaid,
            "text/plain": self.mermaid,
        }


def diagram_picture(diagram: Diagram) -> DiagramPicture:
    """Draws the systems of a Diagram and their connections, but not the inside of a system."""
    return DiagramPicture(_graphviz_svg(diagram), mermaid_text(diagram))


def mermaid_text(diagram: Diagram) -> str:
    """Gives a Mermaid flowchart of the systems and connections, without the log sinks."""
    systems = [each for each in diagram.GetSystems() if not isinstance(each, VectorLogSink)]
    names = {system.get_name(): f"s{number}" for number, system in enumerate(systems)}
    lines = ["flowchart LR"]
    lines += [f'  {node}["{_label(name)}"]' for name, node in names.items()]
    wires = []
    for (reader, taken), (writer, given) in diagram.connection_map().items():
        if reader.get_name() in names and writer.get_name() in names:
            port = reader.get_input_port(taken).get_name()
            source = writer.get_output_port(given).get_name()
            text = port if port == source else f"{source} to {port}"
            wires.append(
                f'  {names[writer.get_name()]} -->|"{_label(text)}"| {names[reader.get_name()]}'
            )
    return "\n".join([*lines, *sorted(wires)]) + "\n"


def _label(text: str) -> str:
    """Escapes a text for use between quotation marks in Mermaid."""
    return "".join(
        letter if letter.isalnum() or letter in " _-:/.+" else f"#{ord(letter)};" for letter in text
    )


def _graphviz_svg(system: System) -> str | None:
    if shutil.which("dot") is None:
        return None
    text = system.GetGraphvizString(max_depth=1)
    drawn = subprocess.run(["dot", "-Tsvg"], input=text, capture_output=True, text=True, check=True)
    return drawn.stdout
