"""All commands have help with examples, plain streams, completion and an answer to Ctrl-C."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

import pytest
from commands import proxops

from proxops.cli import common
from proxops.cli.main import COMMANDS, command
from proxops.diagrams.scenario import Scenario, load_scenario, parse_scenario

# As the script that pip installs: that makes `proxops` the name that completion goes by.
SCRIPT = "import sys; sys.argv[0] = 'proxops'; from proxops.cli.entry import main; main()"
PROXOPS = [sys.executable, "-c", SCRIPT]


def environment(**changes: str) -> dict[str, str]:
    kept = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
    return kept | {"COLUMNS": "100"} | changes


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_in_the_help_are_commands(name: str) -> None:
    """Each is parsed as if it were typed; none is run."""
    parser = command(name)
    text = re.sub(r"\s+", " ", parser.help or "")
    _, found, examples = re.split(r"(Examples?:)", text)
    assert found
    typed = re.findall(r"proxops (.*?)(?= proxops |$)", examples)
    assert typed
    for line in typed:
        asked, *arguments = shlex.split(line)
        assert asked == name
        parser.make_context(name, arguments)


SLOW = ["matplotlib", "numba", "numpy", "proxops.systems", "pydrake", "scipy", "torch", "trimesh"]


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("--help", "train-lidar"),
        ("--version", f"proxops {metadata.version('proxops')}\n"),
        ("flyy", ""),
    ],
)
def test_what_needs_no_command_imports_none(option: str, says: str) -> None:
    """Not even where neither the home nor the folder for temporary files can be written."""
    code = (
        "import sys, tempfile; tempfile.tempdir = '/dev/null'\n"
        f"sys.argv = ['proxops', {option!r}]\n"
        "from proxops.cli.entry import main\n"
        "try:\n    main()\n"
        f"finally:\n    print([name for name in {SLOW} if name in sys.modules])\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], env=environment(HOME="/dev/null/x", XDG_CACHE_HOME=""),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert says in ran.stdout
    assert ran.stdout.endswith("[]\n")
    assert ran.stderr == "" if says else "Did you mean 'fly'" in ran.stderr


def interrupt_when(process: subprocess.Popen[str], begun: Path) -> None:
    """Sends what Ctrl-C sends, as soon as the file is there."""
    until = time.monotonic() + 60.0
    while not begun.exists():
        assert time.monotonic() < until
        assert process.poll() is None, process.stderr and process.stderr.read()
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fly", "--out", "out"], "proxops: interrupted\n"),
        (
            ["evaluate", "--transits", "3", "--workers", "1", "--out", "out"],
            "proxops: interrupted; run the same command again to go on\n",
        ),
    ],
)
def test_interrupted(tmp_path: Path, arguments: list[str], says: str) -> None:
    """By Ctrl-C while it flies: one line, the code shells expect, and no half file."""
    # This controller writes a file when it is first asked: from then on there is a flight to stop.
    (tmp_path / "slow_controller.py").write_text(
        "import time\nfrom pathlib import Path\n"
        "from pydrake.systems.framework import LeafSystem\n"
        "class Slow(LeafSystem):\n"
        "    def __init__(self):\n"
        "        super().__init__()\n"
        "        self.DeclareVectorInputPort('state', 6)\n"
        "        self.DeclareVectorOutputPort('force', 3, self.calc)\n"
        "    def calc(self, context, output):\n"
        "        Path('flying').touch()\n"
        "        time.sleep(0.2)\n"
        "def make(scenario, body):\n"
        "    return Slow()\n"
    )
    name = "--controllers" if arguments[0] == "evaluate" else "--controller"
    process = subprocess.Popen(
        [*PROXOPS, *arguments, name, "slow_controller:make"], cwd=tmp_path, env=environment(),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    interrupt_when(process, tmp_path / "flying")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert err == says
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert [path.name for path in files if path.name != ".lock"] == []


def test_help_shows_brackets(capfd: pytest.CaptureFixture[str]) -> None:
    """They are no markup."""
    assert proxops("replay", "--help") == 0
    assert "'proxops[exchange]'" in capfd.readouterr().out


def test_help_names_all_dispersions(capfd: pytest.CaptureFixture[str]) -> None:
    proxops("fly", "--help")
    told = capfd.readouterr().out
    assert all(name in told for name in common.SHIPPED["dispersions"])


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_80_columns(
    name: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of them are for what is said, not for names."""
    monkeypatch.setenv("COLUMNS", "80")
    proxops(name, "--help")
    lines = capfd.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = [re.split(r" {2,}", line.strip("│ ")) for line in lines if line.startswith("│ --")]
    assert all(len(row) > 1 for row in rows)


@pytest.mark.parametrize(
    ("incomplete", "offered"),
    [
        ("mpc.interv", ["mpc.intervals=", "mpc.interval_growth="]),
        ("gravity=", ["gravity=exact", "gravity=table"]),
        ("navigation=T", ["navigation=TrueState"]),
        ("log_ranges=", ["log_ranges=true", "log_ranges=false"]),
        ("dispersions=b", ["dispersions=before_survey"]),
        (
            "body=",
            [f"body={name}" for name in ("bennu", "didymos", "kleopatra", "ryugu", "toutatis")],
        ),
        ("lidar.plan", ["lidar.planes="]),
        ("nothing", []),
    ],
)
def test_changes_complete(incomplete: str, offered: list[str]) -> None:
    assert common.complete_change(incomplete) == offered


def test_controllers_complete() -> None:
    assert common.complete_controllers("h") == ["hybrid", "hybrid:end-to-end"]
    assert common.complete_controllers("mpc,z") == ["mpc,zero"]
    assert common.complete_dispersions("b") == ["before_survey"]


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["fly", "after_survey"], "--set dispersions=after_survey"),
        (["evaluate", "mpc"], "--controllers"),
        (["evaluate", "mpc,zero"], "--controller mpc,zero"),
        (["evaluate", "--controllers", "mpc,", "hybrid"], "no space after a comma"),
    ],
)
def test_a_name_in_place_of_a_file(
    typed: list[str], meant: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert proxops(*typed) == 2
    told = capfd.readouterr().err
    assert "did you mean" in told
    assert meant in told


def test_scenario_prints_the_default(capfd: pytest.CaptureFixture[str]) -> None:
    assert proxops("scenario") == 0
    assert parse_scenario(capfd.readouterr().out) == Scenario()
    assert proxops("scenario", "bennu") == 0
    assert parse_scenario(capfd.readouterr().out) == load_scenario("bennu")
