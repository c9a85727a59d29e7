"""The pages in docs/ tell of what there is: ports, commands, notebooks, and Python that runs."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ball_lidar import write_ball_bundle
from known_policies import RAYS, Counting, write_policy
from pydrake.systems.framework import Diagram, LeafSystem, PortDataType, System
from short_flights import SHORT, kleopatra
from typer.main import get_command

from proxops import systems
from proxops.cli.main import app
from proxops.diagrams.flight.named_controllers import named_controller
from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.flight.transit_diagram import make_transit_diagram
from proxops.diagrams.scenario.scenario import load_scenario

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = {path.relative_to(DOCS).as_posix(): path.read_text() for path in DOCS.rglob("*.md")}
# What holds for other modules' own base classes, or as many ports as a user asks for.
NO_SECTION = {"PlanarLidar"}


def python_blocks(page: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", PAGES[page], re.DOTALL | re.MULTILINE)


def run(code: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(code, "docs", "exec"), names)
    return names


# --- ports ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, System]:
    """One system of each kind, by the name of its class."""
    parts = ("assurance", "disturbance", "force_noise", "kicks")
    everything = load_scenario(None, SHORT | {part: {} for part in parts})
    diagram = make_transit_diagram(everything, body=kleopatra())
    folder = tmp_path_factory.mktemp("bundles")
    policy = write_policy(folder / "policy", Counting())
    hybrid = named_controller(f"hybrid:{policy}", everything, kleopatra())
    assert isinstance(hybrid, Diagram)
    others = [
        *hybrid.GetSystems(),
        systems.EnabledValue(3),
        systems.DelayedHold(10.0, 5.0, 3),
        systems.LearnedLidar(write_ball_bundle(folder / "lidar")),
        systems.NeuralPolicy(policy),
        systems.ProportionalDerivative(100.0, 7.0, 40.0),
    ]
    kinds = {
        systems.PolyhedralGravity: "PolyhedralGravity",
        systems.Spacecraft: "Spacecraft",
    }
    found = [*diagram.GetSystems(), *others]
    return {kinds.get(type(system), type(system).__name__): system for system in found}


def documented(name: str) -> list[tuple[str, str, str]]:
    """Name, direction and size of the ports in a system's table."""
    (section,) = re.findall(
        rf"^## {name}\n(.*?)(?=^## |\Z)", PAGES["systems.md"], re.DOTALL | re.MULTILINE
    )
    assert f"!ports {name}\n" in section
    return re.findall(r"^\| `(\w+)` \| (in|out) \| ([^|]*?) \|", section, re.MULTILINE)


def size_of(port: Any, name: str) -> str:
    if port.get_data_type() == PortDataType.kAbstractValued:
        return "abstract"
    size = "planes · rays" if port.size() == RAYS else str(port.size())
    free = name == "DelayedHold" or (name == "EnabledValue" and port.get_name() == "value")
    return "size" if free else size


SECTIONS = re.findall(r"^## (\w+)$", PAGES["systems.md"], re.MULTILINE)


@pytest.mark.parametrize("name", SECTIONS)
def test_tables_of_ports(made: dict[str, System], name: str) -> None:
    system = made[name]
    ports = [("in", system.get_input_port(i)) for i in range(system.num_input_ports())]
    ports += [("out", system.get_output_port(i)) for i in range(system.num_output_ports())]
    real = [(port.get_name(), way, size_of(port, name)) for way, port in ports]
    assert sorted(documented(name)) == sorted(real)


def test_no_system_is_left_out() -> None:
    exported = {name for name in systems.__all__ if isinstance(getattr(systems, name), type)}
    leaves = {name for name in exported if issubclass(getattr(systems, name), LeafSystem)}
    told = "\n".join(PAGES.values())
    assert {name for name in leaves - NO_SECTION if f"!ports {name}\n" not in told} == set()


# --- commands -------------------------------------------------------------------------------------


def commands() -> list[tuple[str, str]]:
    """Page and line of every command in a block without a language."""
    found = []
    for page, text in PAGES.items():
        # Closing fences are matched too, or they would be taken for opening ones.
        for language, block in re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
            if language:
                continue
            lines = block.replace("\\\n", " ").splitlines()
            found += [(page, line) for line in lines if line.startswith("proxops ")]
    return found


@pytest.mark.parametrize(("page", "line"), commands())
def test_commands_are_understood(page: str, line: str) -> None:
    group: Any = get_command(app)
    name, *arguments = shlex.split(line, comments=True)[1:]
    if name.startswith("--"):
        assert name in {option for parameter in group.params for option in parameter.opts} | {
            "--help"
        }
    else:
        group.commands[name].make_context(name, arguments)


def test_files_of_the_paper_table_exist() -> None:
    table = PAGES["paper.md"].partition("## Its two diagrams")[0]
    paths = re.findall(r"`([\w/]+\.py)`", table)
    assert len(paths) > 10
    for path in paths:
        assert (ROOT / path).is_file(), path


def test_notebooks_that_are_told_of() -> None:
    numbers = {path.name.partition("_")[0] for path in (ROOT / "notebooks").glob("*.ipynb")}
    text = PAGES["index.md"].partition("The notebooks in")[2].replace("\n", " ")
    assert set(re.findall(r"(?<=[ ,:])(\d) ", text)) == numbers


def test_readme_sections_that_are_shown() -> None:
    """`make docs` would say so too, but not here."""
    headings = re.findall(r"^## (.*)$", (ROOT / "README.md").read_text(), re.MULTILINE)
    for page, text in PAGES.items():
        for wanted in re.findall(r"^!readme (.*)$", text, re.MULTILINE):
            assert headings.count(wanted) == 1, (page, wanted)


# --- Python ---------------------------------------------------------------------------------------


def test_own_sensor_sees_a_sphere() -> None:
    names = run(python_blocks("how_to/own_sensor.md")[0])
    lidar, radius, position = names["lidar"], 60e3, np.array([150e3, 0.0, 0.0])
    silent = names["SphereLidar"](radius, noise_std=0.0)
    frame = silent.frames(np.zeros(1), position[None], seed=0)[0].reshape(-1)
    hits = np.isfinite(frame)
    ends = position + frame[hits, None] * silent.directions[hits]
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), radius, atol=0.1)
    # The disk that is seen: rays within its angle of the line of sight, and no others.
    within = silent.directions @ [-1.0, 0.0, 0.0] > np.cos(np.arcsin(radius / 150e3))
    np.testing.assert_array_equal(hits, within)
    assert lidar.errors.noise_std == 50.0


def test_own_controller_arrives() -> None:
    """The 30 lines of the page, on the short flight of the tests, and then hold at the goal."""
    (code,) = python_blocks("how_to/own_controller.md")
    lines = [line for line in code.splitlines() if line and not line.startswith("#")]
    assert len(lines) <= 30
    scenario = load_scenario(None, SHORT | {"arrival.dwell_s": 3000.0, "log_ranges": False})
    body = kleopatra()
    summary = fly(scenario, run(code)["make"](scenario, body), body=body).summary
    assert summary["success"]
    assert summary["terminal_position_error_m"] < 1.0


def test_the_test_to_copy_passes_and_can_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = python_blocks("quick_start.md")
    names = run(code)
    names["test_thrusters_clip_each_axis"]()
    names["Thrusters"] = lambda limit: systems.Thrusters(limit + 1.0)
    with pytest.raises(AssertionError):
        names["test_thrusters_clip_each_axis"]()


def test_errata_table_of_angles() -> None:
    """What the page says of the printed angle and the right one, computed."""
    u = np.array([7.0, 0.0, 0.0])
    for degrees, printed, right in ((0.0, 90.0, 0.0), (90.0, 0.0, 90.0), (180.0, -90.0, 180.0)):
        v = 3.0 * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
        cross = np.linalg.norm(np.cross(u, v))
        assert np.degrees(np.arctan2(u @ v, cross)) == pytest.approx(printed, abs=1e-9)
        assert np.degrees(np.arctan2(cross, u @ v)) == pytest.approx(right, abs=1e-9)
        said = re.findall(rf"^\| {degrees:.0f}°.*$", PAGES["errata.md"], re.MULTILINE)
        assert len(said) == 1
        cells = [cell.strip().replace("−", "-") for cell in said[0].split("|")]
        assert cells[2].startswith(f"{printed:.0f}°")
        assert cells[3].startswith(f"{right:.0f}°")
