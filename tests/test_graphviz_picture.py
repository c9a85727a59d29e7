"""The Graphviz picture: by whatever `dot` there is, or none."""

from pathlib import Path

import pytest
from pydrake.systems.primitives import ZeroOrderHold

from proxops.diagrams.plots.graphviz_picture import graphviz_svg


def test_none_without_dot(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert graphviz_svg(ZeroOrderHold(1.0, 1)) is None


def test_dot_draws_the_system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "dot"
    program.write_text('#!/bin/sh\necho "<svg $1>"\nexec /bin/cat\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    hold = ZeroOrderHold(1.0, 1)
    hold.set_name("the_hold")
    picture = graphviz_svg(hold)
    assert picture is not None
    assert picture.startswith("<svg -Tsvg>")
    assert "the_hold" in picture
