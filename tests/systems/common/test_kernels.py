"""Compiled functions: kept on disk where it can be written, and never older than their sources."""

import inspect
import json
import os
import pwd
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
import pytest

from proxops.systems.common import cache_folder, compiling_told, kernel, kernels, silent

# A package with a face, a kernel behind it, and kernels of another file that call it.
INNER = """
from proxops.systems.common import kernel

@kernel(error_model="numpy")
def inner(x):
    return x / 2.0
"""
OUTER = """
import numba
import numpy as np
from proxops.systems.common import kernel
from proxops.systems.room import (
    halved,  # A comment, with (brackets.
)

@kernel(error_model="numpy")
def outer(x):
    return halved(x) + 1.0

@kernel(error_model="numpy", parallel=True)
def outer_parallel(x):
    total = np.zeros(x.shape[0])
    for i in numba.prange(x.shape[0]):
        total[i] = halved(x[i]) + 1.0
    return total
"""
SCRIPT = """
import json, multiprocessing, sys
import numpy as np
from proxops.systems.outer import outer, outer_parallel

def found():
    values = [outer(3.0), outer_parallel(np.full(4, 3.0)).tolist()]
    return values, [sum(each.stats.cache_misses.values()) for each in (outer, outer_parallel)]

if __name__ == "__main__":
    spawned = multiprocessing.get_context("spawn").Pool(1)
    print(json.dumps([found(), spawned.apply(found)]))
    spawned.terminate()
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    systems = tmp_path / "code" / "proxops" / "systems"
    (systems / "common").mkdir(parents=True)
    for module in map(inspect.getfile, (kernels, cache_folder, silent)):
        shutil.copy(module, systems / "common")
    (systems / "common" / "__init__.py").write_text(
        "from proxops.systems.common.kernels import kernel\n"
    )
    (systems / "__init__.py").write_text("")
    (systems / "room").mkdir()
    (systems / "room" / "__init__.py").write_text(
        "from proxops.systems.room._inner import inner as halved\n"
    )
    (systems / "room" / "_inner.py").write_text(INNER)
    (systems / "outer.py").write_text(OUTER)
    (tmp_path / "code" / "script.py").write_text(SCRIPT)
    return systems


def flown(package: Path) -> list:
    """What a process finds and what one that it spawned finds: values, and what was compiled."""
    folder = package.parents[1]
    given = {"PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}
    ran = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, env=os.environ | given | {"NUMBA_CACHE_DIR": ""},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert ran.stderr == ""
    return json.loads(ran.stdout)


@pytest.mark.slow
def test_a_change_in_a_called_function_is_seen(package: Path) -> None:
    """Through a face, in serial and parallel kernels; without a change nothing is compiled."""
    compiled, kept = [1, 1], [0, 0]
    before = [2.5, [2.5] * 4]
    assert flown(package) == [[before, compiled], [before, kept]]
    assert flown(package) == [[before, kept], [before, kept]]
    (package / "room" / "_inner.py").write_text(INNER.replace("x / 2.0", "x / 4.0"))
    after = [1.75, [1.75] * 4]
    assert flown(package) == [[after, compiled], [after, kept]]


def test_other_functions_keep_numba_s_own_folder() -> None:
    def another(x):
        return x

    def folder():
        return numba.njit(cache=True)(another).stats.cache_path

    before = folder()
    assert kernel(another).stats.cache_path != before
    assert folder() == before


def test_folders_that_are_not_used_for_a_month_go(tmp_path: Path) -> None:
    month = 31 * 86400.0
    for name, age in (("old", month), ("new", 0.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "kept.nbi").write_text("")
        os.utime(tmp_path / name, (time.time() - age, time.time() - age))
    kernels._remove_unused(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


@pytest.mark.parametrize("temporary", [True, False])
def test_without_a_home_it_works_and_says_nothing(package: Path, temporary: bool) -> None:
    """In an installation that cannot be written either."""
    code = package.parents[1]
    folder = str(code / "kept") if temporary else "/proc/nowhere"
    (code / "kept").mkdir()
    script = (
        f"import tempfile; tempfile.tempdir = {folder!r}\n"
        "from proxops.systems.outer import outer\n"
        "print(outer(3.0), outer.stats.cache_path)\n"
    )
    given = {"HOME": "/dev/null/x", "XDG_CACHE_HOME": "", "NUMBA_CACHE_DIR": ""}
    given |= {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(code)}
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], cwd=code, env=os.environ | given,
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert ran.stderr == ""
    value, _, kept = ran.stdout.partition(" ")
    assert value == "2.5"
    assert kept.startswith(f"{folder}/proxops-{os.getuid()}/" if temporary else "None\n")


@pytest.fixture
def homeless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user whom the machine does not know; returns the folder for temporary files."""

    def unknown(_: int) -> None:
        raise KeyError

    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_the_cache_lies_in_the_user_s_own_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder("gravity") == tmp_path / ".cache" / "proxops" / "gravity"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    assert cache_folder("gravity") == tmp_path / "other" / "proxops" / "gravity"


def test_a_folder_that_another_user_can_change_is_not_used(
    homeless: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One in which others may write, a link to another, and one of another user."""
    folder = homeless / f"proxops-{os.getuid()}"
    folder.mkdir(mode=0o700)
    assert cache_folder("kernels") == folder / "kernels"
    folder.chmod(0o777)
    assert cache_folder("kernels") is None
    folder.rename(homeless / "elsewhere").chmod(0o700)
    folder.symlink_to(homeless / "elsewhere")
    assert cache_folder("kernels") is None
    other = os.getuid() + 1
    (homeless / f"proxops-{other}").mkdir(mode=0o700)
    monkeypatch.setattr(os, "getuid", lambda: other)
    assert cache_folder("kernels") is None


def test_what_is_compiled_is_told(monkeypatch) -> None:
    monkeypatch.setattr(kernels, "_folder", lambda file: None)  # Nothing is kept.

    @kernel
    def doubled(x):
        return 2.0 * x

    @kernel
    def doubled_thrice(x):
        return 3.0 * doubled(x) + min(x, 1.0)

    told = []
    with compiling_told(lambda done, text: told.append((done, text))):
        assert doubled_thrice(1.5) == 10.0
        assert doubled_thrice(2.5) == 16.0  # It is compiled already.
    doubled(1)  # After the block, nothing is told.
    assert [text.split(":")[0] for _, text in told] == [
        "compiling doubled_thrice",
        "compiling doubled",
    ]
    assert 0.0 < told[0][0] < told[1][0] <= 1.0
