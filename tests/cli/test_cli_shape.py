"""`proxops shape`: what it says, writes and refuses; and a flight at a body that it set up."""

import dataclasses as dc
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from contact_binary import contact_binary, together
from matplotlib.figure import Figure
from plain_polyhedral_gravity import star_shaped
from short_flights import kleopatra, obj_text
from transit_sets import transit_set

from proxops.assets import ASSETS
from proxops.assets.random_bodies import random_body
from proxops.diagrams.new_body.body_setup import body_yaml, scaled_scenario
from proxops.diagrams.scenario import Scenario, load_body, load_scenario
from proxops.systems.rotation import TorqueFreeSpin
from proxops.systems.shapes.polyhedron import Polyhedron

PNG = b"\x89PNG\r\n\x1a\n"


def write(path: Path, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    path.write_text(obj_text(mesh))
    return mesh


@pytest.fixture(autouse=True)
def _blank_pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only to save time: a picture is drawn in `test_the_picture` alone."""
    if request.function is not test_the_picture:
        monkeypatch.setattr("proxops.diagrams.new_body.plot_shape", lambda report: Figure())


def test_the_picture(run, tmp_path: Path) -> None:
    write(tmp_path / "ball.obj", trimesh.creation.icosphere(1))
    assert run("shape", "ball.obj", "--unit", "m", "--out", "picture.png").code == 0
    assert (tmp_path / "picture.png").read_bytes().startswith(PNG)
    assert (tmp_path / "picture.png").stat().st_size > 20_000


def test_kleopatra(run, tmp_path: Path) -> None:
    arguments = (ASSETS / "kleopatra/kleopatra.obj", "--mass", 2.97e18, "--period", 5.38528)
    code, out, err = run("shape", *arguments)
    assert code == 0
    assert "kleopatra.obj (OBJ, 2002 vertices, 4000 facets): sound" in out
    assert "out/shape/shape.png and out/shape/shape.json" in err
    folder = tmp_path / "out/shape"
    assert sorted(path.name for path in folder.iterdir()) == ["shape.json", "shape.png"]
    assert (folder / "shape.png").read_bytes().startswith(PNG)
    found = json.loads((folder / "shape.json").read_text())
    code, out, _ = run("shape", *arguments, "--json", "--out", "picture.png")
    assert (code, json.loads(out)) == (0, found)
    assert (tmp_path / "picture.png").read_bytes().startswith(PNG)

    body = kleopatra()
    mesh = body.shape.to_trimesh()
    assert found["sound"] is True
    assert found["defects"] == []
    assert (found["vertices"], found["facets"], found["shells"]) == (2002, 4000, 1)
    assert found["self_intersections"] == 0
    assert found["volume_m3"] == pytest.approx(mesh.volume, rel=1e-9)
    assert found["area_m2"] == pytest.approx(mesh.area, rel=1e-9)
    assert found["extents_m"] == pytest.approx(mesh.extents.tolist(), rel=1e-9)
    assert found["density_kg_m3"] == pytest.approx(2.97e18 / mesh.volume, rel=1e-9)
    moments = np.sort(np.linalg.eigvalsh(mesh.moment_inertia))
    assert found["principal_moments_m5"] == pytest.approx(moments.tolist(), rel=1e-9)
    # Kepler's third law, for a period of the spin.
    expected = (6.6743e-11 * 2.97e18 * (5.38528 * 3600 / (2 * np.pi)) ** 2) ** (1 / 3)
    assert found["synchronous_radius_m"] == pytest.approx(expected, rel=1e-9)
    keep_out = found["keep_out"]
    levels = np.sum((mesh.vertices / keep_out["semi_axes_m"]) ** 2, axis=1)
    assert keep_out["largest_level"] == pytest.approx(levels.max(), rel=1e-9)
    assert levels.argmax() == keep_out["farthest_vertex"]
    assert levels.max() == pytest.approx(1 / 1.05**2, rel=1e-6)
    # Smaller than the one that ships, which has 6 % to spare.
    assert keep_out["volume_m3"] < 4 / 3 * np.pi * body.keep_out_semi_axes.prod()
    assert keep_out["volume_over_least_possible"] == pytest.approx(1.0, abs=1e-6)
    # Hovering over the north pole is holding the weight.
    hover = found["hover_on_keep_out"]
    pole = body.gravity_field.evaluate(np.array([[0.0, 0, keep_out["semi_axes_m"][2]]]))
    weight = 100.0 * np.abs(pole.acceleration).max()
    assert hover["greatest_force_per_axis_n"][-1][0] == pytest.approx(weight, rel=1e-4)
    assert hover["least_n"] <= weight <= hover["greatest_n"]


def test_a_model_of_any_scale(run, tmp_path: Path) -> None:
    """A ball whose numbers are 500 across; by its diameter, its volume is 1 km^3."""
    ball = trimesh.creation.icosphere(3)
    ball.vertices *= 500.0 / np.ptp(ball.vertices, axis=0).max()
    write(tmp_path / "ball.obj", ball)
    known = ("--density", 2000, "--period", 8, "--fix", "out.obj", "--body", "ball.yaml")
    code, _, err = run("shape", "ball.obj", "--diameter", 2.0 * 620.35, *known)
    assert code == 0, err
    body = load_body(tmp_path / "ball.yaml")
    assert body.shape.volume == pytest.approx(1e9, rel=1e-4)


@pytest.mark.parametrize(("unit", "told"), [("m", True), ("km", False)])
def test_a_body_of_a_metre_may_be_one_of_a_kilometre(run, tmp_path: Path, unit, told) -> None:
    write(tmp_path / "ball.obj", trimesh.creation.icosphere(2))
    code, out, _ = run("shape", "ball.obj", "--unit", unit)
    assert code == 0
    assert ("the body is 2 m long: if its mesh is in km" in " ".join(out.split())) == told


def test_a_model_without_a_scale(run, tmp_path: Path) -> None:
    """The defect of its density says how to give it one."""
    write(tmp_path / "ball.obj", trimesh.creation.icosphere(2))
    code, out, _ = run("shape", "ball.obj", "--mass", 1e9)
    assert code == 1
    assert "say --size or --diameter METRES" in out


def test_a_body_that_spins_the_other_way(run, tmp_path: Path) -> None:
    mesh = star_shaped(1, size=200.0)
    write(tmp_path / "rock.obj", mesh)
    rock = ("shape", "rock.obj", "--unit", "m", "--density", 2000)
    code, _, err = run(*rock, "--period", -5)
    assert code == 2
    assert "give 5 h, and --fix FILE --flip" in err
    code, out, _ = run(*rock, "--period", 5, "--fix", "new.obj", "--flip", "--body", "rock.yaml")
    assert code == 0
    assert "done: turned half a turn about x" in out
    assert "solid: volume " in out
    body = load_body(tmp_path / "rock.yaml").shape
    about = np.array(mesh.vertices) - Polyhedron(mesh.vertices, mesh.faces).centre_of_mass
    np.testing.assert_allclose(body.vertices, about * [1.0, -1.0, -1.0], atol=1e-9)


def test_a_void_is_told_with_its_share(run, tmp_path: Path) -> None:
    outer, wall = (trimesh.creation.icosphere(2, radius=r) for r in (100.0, 90.0))
    wall.invert()
    write(tmp_path / "hollow.obj", together(outer, wall))
    code, out, _ = run("shape", "hollow.obj", "--unit", "m")
    assert code == 0
    assert "note: a void of 72.9 % of the body" in out


def test_what_cannot_be_mended_is_not_written(run, tmp_path: Path) -> None:
    spiked = trimesh.creation.icosphere(2, radius=9.0)
    spiked.vertices[0] *= -1.5
    write(tmp_path / "lobes.obj", spiked)
    known = ("--density", 2000, "--period", 8)
    code, out, err = run(
        "shape", "lobes.obj", "--unit", "m", *known, "--fix", "out.obj", "--body", "lobes.yaml"
    )
    assert code == 1
    assert "not mended: the mesh cannot be mended" in out
    assert "pairs of facets cut each other" in out
    assert "lobes.yaml is not written" in err
    assert not (tmp_path / "out.obj").exists()
    assert not (tmp_path / "lobes.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("none.obj",), "does not exist"),
        (("rock.obj", "--mass", -1), "mass_kg must be positive"),
        (("rock.obj", "--unit", "m", "--mass", 1, "--density", 1), "not both"),
        (("rock.obj", "--density", 2000), "--density needs --unit, --size or --diameter"),
        (("rock.obj", "--unit", "m", "--margin", -0.5), "margin"),
        (("rock.obj", "--body", "b.yaml"), "--body needs --mass or --density, and --period"),
        (("rock.obj", "--align"), "--align needs --fix"),
        (("rock.obj", "--fix", "rock.gltf"), "must end in .obj or .ply or .stl or .tab"),
        (
            ("rock.obj", "--density", 2000, "--unit", "m", "--period", 9)
            + ("--body", "rock.yaml", "--scenario", "./rock.yaml"),
            "is the file of --body: give another name",
        ),
        (("rock.obj", "--out", "rock.obj"), "is a file, not a folder"),
        ((), "give the mesh file, or --random"),
        (("--random", "1"), "must be SEED:NUMBER"),
        (("--random", "1:2", "--density", 2000), "--random generates mesh, density and period"),
    ],
)
def test_bad_input(run, tmp_path: Path, arguments, complaint: str) -> None:
    write(tmp_path / "rock.obj", star_shaped(1, size=200.0))
    before = sorted(tmp_path.rglob("*"))
    code, out, err = run("shape", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("proxops: error: ")
    assert complaint in err
    assert sorted(tmp_path.rglob("*")) == before


def test_generated_body(run, tmp_path: Path) -> None:
    """Its files hold the body that Python generates, and its scenario has transits."""
    code, out, err = run("shape", "--random", "3:5", "--out", "rock", "--craft-mass", 40)
    assert code == 0, err
    made = random_body(3, 5)
    files = {path.name for path in (tmp_path / "rock").iterdir()}
    named = {"random-3-5.obj", "random-3-5.yaml"}
    assert files == named | {"scenario.yaml", "shape.png", "shape.json"}
    assert "random-3-5.obj" in out
    assert f"Wrote rock/random-3-5.obj: a {made.kind}" in err
    scenario = load_scenario(tmp_path / "rock/scenario.yaml")
    body = load_body(scenario.body)
    np.testing.assert_allclose(
        body.shape.vertices, made.vertices, atol=1e-9 * np.ptp(made.vertices)
    )
    np.testing.assert_array_equal(body.shape.facets, made.facets)
    assert body.exact_field.density == pytest.approx(made.density_kg_m3, rel=1e-5)
    assert body.config.rotation_period_h == made.rotation_period_h
    assert scenario.spacecraft.mass_kg == 40.0
    assert len(transit_set(10000, 2, scenario)) == 2


# The default mass is what the user gives; nothing else has a unit that is not in its name.
UNITS = {"_m": 0.01, "_m_s": 0.01, "_m_s2": 0.01, "_n": 0.01, "_s": 1.0, "_kg": 1.0, "_deg": 1.0}


def dimensional(tree: object, name: str = "") -> dict[str, float]:
    """Every number of a scenario by its dotted name."""
    if not dc.is_dataclass(tree):
        return {name: float(tree)} if isinstance(tree, int | float) else {}
    found: dict[str, float] = {}
    for field in dc.fields(tree):
        found |= dimensional(getattr(tree, field.name), f"{name}.{field.name}".strip("."))
    return found


def test_every_number_of_a_scenario_is_made_similar(tmp_path: Path) -> None:
    """At a Kleopatra a hundredth as large and as dense, lengths and forces are a hundredth."""
    large = kleopatra()
    mesh = trimesh.Trimesh(0.01 * large.shape.vertices, large.shape.facets, process=False)
    write(tmp_path / "small.obj", mesh)
    config = dc.replace(
        large.config,
        mesh="small.obj",
        mesh_unit="m",
        mass_kg=1e-6 * large.config.mass_kg,
        keep_out_semi_axes_m=[0.01 * axis for axis in large.config.keep_out_semi_axes_m],
    )
    (tmp_path / "small.yaml").write_text(body_yaml(config, "a small one"))
    scenario = scaled_scenario(load_body(str(tmp_path / "small.yaml")), "small.yaml")
    given, got = dimensional(Scenario()), dimensional(scenario)
    assert got.keys() == given.keys()
    for name, value in given.items():
        if name.startswith("truth.ground."):  # What the ground is made of has no scale.
            assert got[name] == value
            continue
        unit = max((unit for unit in UNITS if name.endswith(unit)), key=len, default="")
        assert got[name] == pytest.approx(UNITS.get(unit, 1.0) * value, rel=0.02), name


@pytest.mark.slow
def test_flight_at_a_body_that_was_set_up_by_itself(run, tmp_path: Path) -> None:
    """A damaged contact binary of 500 m, from its mesh in metres to the goal behind it."""
    mesh = contact_binary(500.0, 4)
    mesh.apply_translation([30.0, 10.0, -5.0])
    faces = np.delete(np.array(mesh.faces), [7, 1200, 1201], axis=0)
    faces[::9] = faces[::9, ::-1]
    write(tmp_path / "scan.obj", trimesh.Trimesh(mesh.vertices, faces, process=False))
    code, _, err = run(
        "shape", "scan.obj", "--unit", "m", "--density", 1900, "--period", 9, "--craft-mass", 20,
        "--fix", "binary.obj", "--align", "--body", "binary.yaml", "--scenario", "visit.yaml",
    )  # fmt: skip
    assert code == 0, err
    scenario = load_scenario(tmp_path / "visit.yaml")
    body = load_body(scenario.body)
    assert scenario.spacecraft.mass_kg == 20.0
    assert body.config.mass_kg == pytest.approx(1900 * mesh.volume, rel=1e-3)
    assert body.shape.extents[0] == pytest.approx(500.0, rel=0.01)
    transit = transit_set(10000, 2, scenario)[1]
    assert np.abs([transit.start, transit.goal]).max() < 500.0
    # Transit 1 has its straight line blocked.
    code, out, err = run("fly", "visit.yaml", "--transit", 1, "--out", "flight")
    assert code == 0, err
    summary = json.loads((tmp_path / "flight/summary.json").read_text())
    assert summary["success"] is True
    assert summary["collided"] is False
    assert summary["keep_out_violations"] == 0
    assert summary["min_clearance_m"] > 0.0
    assert f"{summary['min_clearance_m']:.2f} m" in out
    assert "km" not in out
    assert summary["terminal_position_error_m"] < 0.05
    assert summary["terminal_speed_m_s"] < 1e-3
    assert summary["arrival_time_s"] < scenario.arrival.deadline_s


def test_a_body_that_tumbles(run, tmp_path: Path) -> None:
    """A slab whose axis of the greatest moment lies 20 degrees off z.

    By symmetry its axis of rotation comes to lie as far on the other side.
    """
    slab = trimesh.creation.box([2e3, 1.2e3, 0.6e3])
    slab.apply_transform(trimesh.transformations.rotation_matrix(np.radians(20.0), [1, 0, 0]))
    write(tmp_path / "slab.obj", slab)
    told = ("shape", "slab.obj", "--unit", "m", "--density", 2000, "--period", 6)
    code, out, _ = run(*told)
    assert code == 0
    assert "20 degrees off the axis of the greatest moment of inertia: at uniform" in out
    assert "the axis up to 40 degrees off z" in out
    code, out, _ = run(*told, "--torque-free", "--body", "slab.yaml")
    assert "--torque-free makes" not in out
    spin = load_body(tmp_path / "slab.yaml").spin
    assert isinstance(spin, TorqueFreeSpin)
    code, _, err = run(*told, "--torque-free")
    assert (code, "--torque-free needs --body" in err) == (2, True)
