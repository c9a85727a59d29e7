"""Prints the tests of what differs from the last commit or, if nothing does, of the last commit.

`make quick` runs them: of systems/lidar/lidar.py those in tests/systems/lidar, of cli/fly.py, which
is in no room, those in tests/cli, of a module of tests/helpers those that import it.
"""

import subprocess
from pathlib import Path


def git(*words: str) -> set[Path]:
    """The paths that a command of git prints."""
    done = subprocess.run(["git", *words], capture_output=True, text=True, check=True)
    return {Path(line) for line in done.stdout.splitlines()}


def tests_of(path: Path) -> set[Path]:
    """Folders or files of tests."""
    if path.is_relative_to("tests/helpers"):
        line = f"from {path.stem} import"
        return {test for test in Path("tests").rglob("test_*.py") if line in test.read_text()}
    if path.is_relative_to("tests"):
        return {path} if path.name.startswith("test_") and path.exists() else set()
    places = [Path("tests", *path.parts[:depth]) for depth in (2, 1)]
    return set([place for place in places if place.is_dir()][:1])


new = git("ls-files", "--others", "--exclude-standard")
changed = git("diff", "--name-only", "HEAD") | new or git("diff", "--name-only", "HEAD~", "HEAD")
tests = set().union(*map(tests_of, changed))
print(*sorted(tests - {test for test in tests if tests & set(test.parents)}))
