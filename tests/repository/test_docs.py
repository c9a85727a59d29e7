"""README.md and docs/ tell of what there is: ports, commands, notebooks, and Python that runs."""

import functools
import json
import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from ball_lidar import write_ball_bundle
from commands import proxops, settings
from contact_binary import contact_binary
from flight_folders import copy_flights
from known_guidance import write_guidance
from known_policies import RAYS, DeadReckoning, write_policy
from pages import (
    BLOCKS,
    PAGES,
    ROOT,
    blocks,
    command_lines,
    named_block,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, LeafSystem, PortDataType, System
from short_flights import NEAR, SHORT, kleopatra, write_blob
from synthetic_log import surveyed_log, synthetic_log
from typer.main import get_command

from proxops import systems
from proxops.assets import ASSETS
from proxops.cli import replay
from proxops.cli.main import app, command, main
from proxops.diagrams.flight import fly, make_transit_diagram, named_controller, surroundings
from proxops.diagrams.meshcat import write_movie
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems.lidar import LidarGeometry
from proxops.systems.rotation import SteadySpin
from proxops.systems.vehicle import SunlightConfig

# A base class of other systems, which have sections of their own.
NO_SECTION = {"PlanarLidar"}


# --- ports ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, System]:
    """One system of each kind, by the name of its class."""
    parts = {part: {} for part in ("disturbance", "force_noise", "kicks")}
    everything = load_scenario(None, SHORT | parts | {"assurance": {"bounds": {}}})
    with pytest.warns(UserWarning, match="exceed assurance"):
        diagram = make_transit_diagram(everything, body=kleopatra())
    folder = tmp_path_factory.mktemp("bundles")
    policy = ASSETS / "end_to_end"
    hybrid = named_controller(f"hybrid:{policy}", everything, kleopatra())
    assert isinstance(hybrid, Diagram)
    others = [
        *hybrid.GetSystems(),
        systems.ActualThrust(systems.ThrusterErrors(), 10.0),
        systems.BodyRotation(3e-4),
        systems.Moons([], 3e-4),
        systems.LidarWithMoons(kleopatra().shape, [], 3e-4),
        systems.MoonMask(LidarGeometry(), [], 3e-4, 1e5),
        systems.AttitudeError(systems.SpinKnowledge(0.0, 0.0)),
        systems.CommandAxes(7.0),
        systems.BodyPose(MultibodyPlant(0.0).world_body()),
        systems.EnabledValue(3),
        systems.DelayedHold(10.0, 5.0, 3),
        systems.FrameDelay(RAYS, 2, 10.0),
        systems.LearnedLidar(write_ball_bundle(folder / "lidar", kleopatra().shape.sha256)),
        systems.GuidancePolicy(ASSETS / "any_body", surroundings(everything, kleopatra()), 7.0),
        systems.NeuralPolicy(policy),
        systems.SceneLidar(
            {"ground": kleopatra().shape}, systems.ray_directions(), max_range=350e3
        ),
        systems.ProportionalDerivative(100.0, 7.0, 40.0),
        systems.Sunlight(SunlightConfig(), kleopatra().shape, SteadySpin([0.0, 0.0, 0.0]), None),
        systems.UnexplainedAcceleration(),
    ]
    kinds = {
        systems.PolyhedralGravity: "PolyhedralGravity",
        systems.Spacecraft: "Spacecraft",
    }
    found = [*diagram.GetSystems(), *others]
    by_name = {kinds.get(type(system), type(system).__name__): system for system in found}
    burning = systems.Spacecraft(100.0, None, burns_propellant=True)
    turning = systems.RigidSpacecraft(
        100.0, np.eye(3), None, wheel_axes=np.eye(3), wheel_inertia=0.01
    )
    return by_name | {"Spacecraft": burning, "RigidSpacecraft": turning, "Transit": diagram}


def documented(name: str) -> list[tuple[str, str, str]]:
    """Name, direction and size of the ports in a system's table."""
    (section,) = re.findall(
        rf"^## {name}\n(.*?)(?=^## |\Z)", PAGES["docs/systems.md"], re.DOTALL | re.MULTILINE
    )
    assert f"!ports {name}\n" in section
    return re.findall(r"^\| `(\w+)` \| (in|out) \| ([^|]*?) \|", section, re.MULTILINE)


def size_of(port: Any, name: str) -> str:
    if port.get_data_type() == PortDataType.kAbstractValued:
        return "abstract"
    size = "planes · rays" if port.size() == RAYS else str(port.size())
    free = name == "DelayedHold" or (name == "EnabledValue" and port.get_name() == "value")
    return "size" if free else size


SECTIONS = re.findall(r"^## (\w+)$", PAGES["docs/systems.md"], re.MULTILINE)


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

# Flights of 5 steps, in this process.
BRIEF = ("--set", "arrival.deadline_s=50", "--set", "arrival.dwell_s=50")
# Waits until it is interrupted; needs a cluster; change the shell.
NOT_RUN = {"--meshcat", "--scheduler", "--install-completion"}
# Have tests of their own, and take minutes.
NOT_HERE = {"dagger", "reproduce", "score", "survey", "train-lidar"}
# What surveys make, and what begins with one.
SURVEYED = {
    "bennu_mission", "rock_mission.yaml", "out/mission/flight.yaml", "out/survey/visit.yaml",
    "out/bennu/visit.yaml", "task=!Survey {}",
}  # fmt: skip
GROUP: Any = get_command(app)
OPTIONS_OF_ALL = {option for parameter in GROUP.params for option in parameter.opts} | {"--help"}


def proxops_lines() -> list[tuple[str, str]]:
    return [each for each in command_lines() if each[1].startswith("proxops ")]


def understand(line: str) -> None:
    """Parses a `proxops` command as the program would, and runs nothing."""
    name, *arguments = shlex.split(line, comments=True)[1:]
    if name.startswith("--"):
        assert name in OPTIONS_OF_ALL, line
    else:
        command(name).make_context(name, arguments)


@pytest.mark.parametrize(("page", "line"), proxops_lines())
def test_commands_are_understood(page: str, line: str) -> None:
    understand(line)


def in_brief(words: list[str]) -> list[str]:
    """The same on few and short flights, or little data."""
    name, *rest = words
    for number, word in enumerate(rest):
        if word == "--transits" and name != "fly":
            rest[number + 1] = "2" if name == "collect" else "1"
    if name in ("collect", "evaluate") and "--transits" not in rest:
        rest += ["--transits", "2" if name == "collect" else "1"]
    if name in ("collect", "evaluate"):
        rest += [*BRIEF, "--workers", "1"]
    if name == "fly" and "--from" not in rest:
        rest += BRIEF
    if name == "train":
        rest += ["--quick"]
    return [name, *rest]


def parts_of(words: list[str]) -> set[tuple[str, str]]:
    """What a command is made of, each with the command's name, but for numbers and its folder."""
    told = [word for before, word in zip(["", *words], words, strict=False) if before != "--out"]
    return {(words[0], part) for word in told for part in word.split(",") if not part.isdigit()}


@pytest.fixture
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which the code and commands of the pages find what they name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    (tmp_path / "out" / "flight").mkdir(parents=True)
    synthetic_log().to_netcdf(tmp_path / "out" / "flight" / "flight.nc")  # `make fly` leaves it.
    (tmp_path / "out" / "mission").mkdir()
    surveyed_log().to_netcdf(tmp_path / "out" / "mission" / "flight.nc")
    (tmp_path / "out" / "full").mkdir()
    copy_flights(tmp_path / "out").rename(tmp_path / "out" / "full" / "flights")
    return tmp_path


def test_a_mission_at_an_own_asteroid_is_that_at_bennu(working_folder: Path) -> None:
    (working_folder / "rock_mission.yaml").write_text(named_block("rock_mission.yaml"))
    here = {"body": "bennu", "truth.boulders.narrowest_m": 15.0}
    assert load_scenario("rock_mission.yaml", here) == load_scenario("bennu_mission")


@pytest.mark.slow
def test_every_command_in_brief(
    working_folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Page by page, each command that has a new part, in the folder that those before it leave."""
    for name in ("heavy.yaml", "my_controller.py", "my_pd.py", "my_world.yaml", "clone.py"):
        (working_folder / name).write_text(named_block(name))
    torch.save(run(named_block("clone.py"))["MODEL"].state_dict(), working_folder / "clone.pt")
    learn_by_ppo(working_folder)
    shutil.copy(working_folder / "out" / "flight" / "flight.nc", working_folder / "episode.nc")
    contact_binary(500.0, 2).export(working_folder / "scan.stl")
    shutil.copytree(ROOT / "assets", working_folder / "assets")
    for bundle in ("policy", "dagger/bundle"):
        write_policy(working_folder / "out" / bundle, DeadReckoning())
    write_guidance(working_folder / "out" / "any-body" / "bundle")
    shutil.copytree(ROOT / "assets" / "descent", working_folder / "out" / "descent" / "bundle")
    write_ball_bundle(working_folder / "out" / "lidar" / "bundle", kleopatra().shape.sha256)
    (working_folder / "out" / "full").rename(working_folder / "out" / "kept")
    short = functools.partial(write_movie, seconds=0.5, width=160)  # `test_browser` makes a longer.
    monkeypatch.setattr(replay, "write_movie", short)
    seen: set[tuple[str, str]] = set()
    commands = {tuple(shlex.split(line, comments=True)[1:]): line for _, line in proxops_lines()}
    for typed, line in commands.items():
        words = list(typed)
        if words[0] in NOT_HERE or (SURVEYED | NOT_RUN | {"--from"}) & set(words):
            continue
        if parts_of(words) <= seen:
            continue
        seen |= parts_of(words)
        if words[0] == "train":
            if "paper" not in words:
                continue  # As what is in NOT_HERE.
            words[1] = str(working_folder / "out" / "kept" / "flights")
        brief = words if words[0].startswith("--") else in_brief(words)
        monkeypatch.setattr(sys, "argv", ["proxops", *brief])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code, (line, capfd.readouterr().err)
    run_already = {name for name, _ in seen}
    assert run_already >= {"fly", "replay", "evaluate", "collect", "shape", "train", "site"}
    table = PAGES["docs/how_to/evaluate.md"].partition("## Monte Carlo")[0]
    rows = re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
    assert len(rows) == 5
    for name in re.findall("`(.*?)`", " ".join(rows)):
        assert (working_folder / "out" / "evaluation" / name).exists()


def learn_by_ppo(folder: Path) -> None:
    """The example of PPO in brief: few transits, and few steps of learning."""
    code = named_block("ppo.py")
    brief = {"Transits(64)": "Transits(4)", "128": "8", "1024": "32", "500_000": "32"}
    for printed, less in brief.items():
        assert code.count(printed) == 1
        code = code.replace(printed, less)
    (folder / "ppo.py").write_text(code)
    runpy.run_path("ppo.py", run_name="__main__")


@pytest.mark.slow
def test_what_ppo_learned_flies(working_folder: Path) -> None:
    learn_by_ppo(working_folder)
    short = settings({"arrival.deadline_s": 100.0, "arrival.dwell_s": 50.0})
    words = ["--controllers", "ppo:make", "--transits", 1, *short, "--workers", 1]
    assert proxops("evaluate", *words, "--out", "out/ppo") == 0
    results = json.loads((working_folder / "out" / "ppo" / "results.json").read_text())
    (flight,) = results["controllers"]["ppo:make"]["flights"]
    assert 0.0 < flight["delta_v_m_s"] < 3 * 0.07 * 150.0


@pytest.mark.slow
def test_what_learned_from_the_expert_flies(working_folder: Path) -> None:
    """The example in brief: two short flights to learn from, and few steps of learning."""
    short = settings({"arrival.deadline_s": 100.0, "arrival.dwell_s": 50.0})
    words = ["--transits", 2, "--lidar", "none", "--minari", "proxops/expert-v0", *short]
    assert proxops("collect", *words, "--workers", 1) == 0
    code = named_block("clone.py")
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 40
    assert "range(6000)" in code
    (working_folder / "clone.py").write_text(code.replace("range(6000)", "range(20)"))
    runpy.run_path("clone.py", run_name="__main__")
    words = ["--controllers", "clone:make", "--transits", 1, *short, "--workers", 1]
    assert proxops("evaluate", *words, "--out", "out/clone") == 0
    results = json.loads((working_folder / "out" / "clone" / "results.json").read_text())
    (flight,) = results["controllers"]["clone:make"]["flights"]
    # It commands something, and not always the limit.
    assert 0.0 < flight["delta_v_m_s"] < 3 * 0.07 * 150.0


# --- Python ---------------------------------------------------------------------------------------

# Code that runs on little data here: what is printed, and what is run instead.
IN_BRIEF = {
    '["transit.index=1"]': '["transit.index=1", "arrival.deadline_s=50", "arrival.dwell_s=50"]',
    "load_scenario(transit=1)": "load_scenario(None, IN_BRIEF, transit=1)",
    "length=32, stride=16": "length=8, stride=4",
}


def run(code: str) -> dict[str, Any]:
    for printed, brief in IN_BRIEF.items():
        code = code.replace(printed, brief)
    names: dict[str, Any] = {"IN_BRIEF": {"arrival.deadline_s": 50.0, "arrival.dwell_s": 50.0}}
    exec(compile(code, "a page", "exec"), names)
    return names


PYTHON = [block for block in BLOCKS if block.language == "python"]


def marks_of(page: str) -> list[pytest.MarkDecorator]:
    """The pages of a first hour fly and learn for longer."""
    return [pytest.mark.slow] if page.startswith("docs/first_hour") else []


@pytest.mark.parametrize(
    "code",
    [
        pytest.param(block.text, marks=marks_of(block.page), id=f"{block.page}-{number}")
        for number, block in enumerate(PYTHON)
    ],
)
def test_all_python_runs(working_folder: Path, code: str) -> None:
    write_blob(working_folder)
    (working_folder / "blob.yaml").rename(working_folder / "rock.yaml")
    run(code)


def of_page(page: str, part: str) -> str:
    """The one Python block of a page that has this part."""
    (code,) = (code for code in blocks("python", page) if part in code)
    return code


def test_h5py(working_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = synthetic_log()
    names = run(of_page("docs/how_to/reading_a_log.md", "import h5py"))
    data = log.dataset
    np.testing.assert_array_equal(names["time"], data["time"])
    np.testing.assert_array_equal(names["position"], data["state"][:, :3])
    np.testing.assert_array_equal(names["frame"], data["ranges"][100])
    assert names["scenario"] == data.attrs["scenario"]
    returns = int(np.isfinite(data["ranges"][100]).sum())
    assert capsys.readouterr().out == f"4800 s, {returns} returns at 1000 s\n"


def test_own_sensor_sees_a_sphere() -> None:
    names = run(of_page("docs/how_to/own_sensor.md", "class SphereLidar"))
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


@pytest.mark.parametrize(("block", "goal"), [("my_controller.py", 10e3), ("my_pd.py", 20.0)])
def test_own_controllers_fly_on_navigation(block: str, goal: float) -> None:
    """Also at the first steps, at which no frame has arrived and the state is NaN."""
    settings = {"arrival.dwell_s": 700.0, "truth.lidar.latency_steps": 2, "log_ranges": False}
    settings |= {"navigation.frame_delay_steps": 2, "arrival.deadline_s": 1000.0}
    scenario = load_scenario(None, NEAR | settings)
    body = kleopatra()
    log = fly(scenario, run(named_block(block))["make"](scenario, body), body=body)
    assert np.isnan(log.dataset["navigation_state"].values[:2]).all()
    assert log.summary["terminal_position_error_m"] < goal


def test_the_test_to_copy_passes_and_can_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    code = of_page("docs/quick_start.md", "def test_")
    names = run(code)
    names["test_thrusters_clip_each_axis"]()
    names["Thrusters"] = lambda limit: systems.Thrusters(limit + 1.0)
    with pytest.raises(AssertionError):
        names["test_thrusters_clip_each_axis"]()
