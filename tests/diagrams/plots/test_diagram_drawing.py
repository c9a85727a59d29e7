"""The picture of a Diagram: Graphviz's by whatever `dot` there is, or Mermaid's."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, ZeroOrderHold

from proxops.diagrams.plots.diagram_drawing import diagram_picture


def held():
    builder = DiagramBuilder()
    source = builder.AddNamedSystem('the "source"', ConstantVectorSource(np.ones(2)))
    hold = builder.AddNamedSystem("the_hold", ZeroOrderHold(1.0, 2))
    builder.Connect(source.get_output_port(), hold.get_input_port())
    LogVectorOutput(hold.get_output_port(), builder).set_name("log")
    return builder.Build()


def test_mermaid_without_dot(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    picture = diagram_picture(held())
    assert picture.svg is None
    shown = picture._repr_mimebundle_()
    assert "image/svg+xml" not in shown
    assert shown["text/markdown"].startswith("```mermaid\nflowchart LR\n")
    assert shown["text/markdown"].endswith("\n```\n")
    lines = picture.mermaid.splitlines()
    assert lines[1:3] == ['  s0["the #34;source#34;"]', '  s1["the_hold"]']
    assert lines[3:] == ['  s0 -->|"y0 to u"| s1'] or lines[3].endswith("| s1")
    assert "log" not in picture.mermaid


def test_dot_draws_the_diagram(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "dot"
    program.write_text('#!/bin/sh\necho "<svg $1>"\nexec /bin/cat\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    shown = diagram_picture(held())._repr_mimebundle_()
    assert list(shown) == ["image/svg+xml"]
    assert shown["image/svg+xml"].startswith("<svg -Tsvg>")
    assert "the_hold" in shown["image/svg+xml"]
