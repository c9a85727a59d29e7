"""Commands that work in a folder of their own."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import Ran, proxops
from short_flights import kleopatra

from proxops.cli.common import console


@pytest.fixture
def run(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., Ran]:
    """`proxops ARGUMENTS` in this process, working in a folder of its own."""
    kleopatra().gravity_field.evaluate(np.ones((1, 3)))  # Compiled by now, which would be told.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "width", 200)

    def ran(*arguments: object) -> Ran:
        capfd.readouterr()
        code = proxops(*arguments)
        out, err = capfd.readouterr()
        return Ran(code, str(out), str(err))

    return ran
