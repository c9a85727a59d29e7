"""The bounds of runtime assurance: from values, from dispersions, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.diagrams.flight.hybrid_controller import zero_hybrid
from proxops.diagrams.scenario.bounds import uncertainty_set
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.diagrams.scenario.scenario_config import TruthConfig
from proxops.diagrams.scenario.transits import of_transit
from proxops.diagrams.scenario.true_body import make_true_body
from proxops.diagrams.scenario.world import draw_world
from proxops.systems import InputError
from proxops.systems.assurance import AssuranceBounds
from proxops.systems.shapes import Polyhedron, vertex_normals
from proxops.systems.vehicle import SpinKnowledge, believed_axes

# Everything that a bound is made of, but what changes gravity, which takes longer.
DISPERSIONS = """
truth.gravity: {normal: 1.02, three_sigma: 0.03}
truth.thrusters.scale: {uniform: [0.9, 1.02]}
truth.thrusters.direction_deg: {normal: 0.0, three_sigma: 1.0}
truth.attitude.constant_deg: {normal: 0.0, three_sigma: 0.1}
truth.phase_deg: {uniform: [-0.2, 0.3]}
truth.mass: {normal: 1.0, three_sigma: 0.02}
truth.acceleration.constant_m_s2: {normal: 0.0, three_sigma: 2.0e-4}
truth.acceleration.varying_std_m_s2: {fixed: 1.0e-5}
truth.thrusters.least_impulse_n_s: {fixed: 0.05}
truth.lidar.bias_m: {normal: 0.0, three_sigma: 10.0}
spacecraft.mass_kg: {normal: 1.0, three_sigma: 0.02, times: value}
"""
TRUE_STATE = "navigation=!TrueState {}"


def write(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def bounds_of(*overrides: str):
    return uncertainty_set(load_scenario(None, overrides), kleopatra())


def test_ends_of_dispersions(tmp_path: Path) -> None:
    path = write(tmp_path, DISPERSIONS)
    bounds = bounds_of(f"assurance={{bounds: {path}}}", TRUE_STATE)
    assert bounds.gravity == pytest.approx(0.05)
    assert bounds.thrust == pytest.approx(0.1)
    assert bounds.thrust_direction_deg == pytest.approx(1.1 * math.sqrt(3.0) + 0.3)
    # The mass that is known on the day is no error.
    assert bounds.mass == pytest.approx(0.02)
    assert bounds.acceleration_m_s2 == pytest.approx(2e-4 + 4e-5 + 0.05 / 10.0 / 100.0)
    none = bounds.position_m, bounds.velocity_m_s, bounds.surface_m, bounds.delay_s
    assert none == (0, 0, 0, 0)
    # The navigation measures the phase.
    navigated = bounds_of(f"assurance={{bounds: {path}}}")
    assert navigated.thrust_direction_deg == pytest.approx(1.1 * math.sqrt(3.0))


def test_a_rigid_spacecraft_may_owe_pulses_and_give_them_while_it_turns(tmp_path: Path) -> None:
    """Of `smallsat`: two thrusters of 4 N each way along an axis, 20 ms at least, 0.005 degrees."""
    path = write(tmp_path, "truth.mass: {fixed: 1.0}\n")
    given = f"assurance={{bounds: {path}}}", "spacecraft=!RigidBody {}"
    assert bounds_of(*given).acceleration_m_s2 == pytest.approx(4 * 4.0 * 0.02 / 10.0 / 100.0)
    tracker = 4.0 * 0.005 * math.sqrt(3.0)
    assert bounds_of(*given).thrust_direction_deg == pytest.approx(tracker)
    turning = bounds_of(*given, "spacecraft.pointing.mode=body")
    assert turning.thrust_direction_deg == pytest.approx(tracker + 0.2)


def test_propellant_of_the_worst_thruster_counts(tmp_path: Path) -> None:
    path = write(tmp_path, "truth.specific_impulse_s: {uniform: [100.0, 300.0]}\n")
    burnt = 1.0 - math.exp(-6.0 * 40.0 / (9.80665 * 100.0))
    assert bounds_of(f"assurance={{bounds: {path}}}").mass == pytest.approx(burnt)


@pytest.mark.slow
def test_a_surface_too_rough_for_the_mesh_still_counts(tmp_path: Path) -> None:
    """The draws that are not refused are as rough as the mesh permits."""
    contrast = "truth.density_contrast: {uniform: [-0.1, 0.1]}\n"
    smooth = bounds_of(f"assurance={{bounds: {write(tmp_path, contrast, 'smooth.yaml')}}}")
    text = contrast + "truth.surface_rms_m: {half_normal: 0.0, three_sigma: 4.0e4}\n"
    rough = bounds_of(f"assurance={{bounds: {write(tmp_path, text)}, deviations: 4}}")
    assert rough.acceleration_m_s2 > smooth.acceleration_m_s2 > 0.0


def test_gravity_of_drawn_worlds_is_within_the_bound(tmp_path: Path) -> None:
    text = (
        "truth.density_contrast: {uniform: [-0.05, 0.05]}\ntruth.size: {uniform: [0.99, 1.01]}\n"
        "truth.surface_rms_m: {half_normal: 0.0, three_sigma: 200.0}\n"
    )
    path, body = write(tmp_path, text), kleopatra()
    bounds = bounds_of(f"assurance={{bounds: {path}}}")
    ways = np.random.default_rng(4).normal(size=(500, 3))
    points = ways * body.keep_out_semi_axes / np.linalg.norm(ways, axis=1, keepdims=True)
    believed, worst = body.gravity_field.evaluate(points).acceleration, 0.0
    for index in range(6):
        scenario = of_transit(load_scenario(None, [f"dispersions={path}"]), 7, index)
        true = make_true_body(body, draw_world(scenario, body).truth)
        off = true.gravity_field.evaluate(points).acceleration - believed
        worst = max(worst, float(np.abs(off).max()))
    assert 0.2 * bounds.acceleration_m_s2 < worst <= bounds.acceleration_m_s2


def test_pole_and_spin_are_covered(tmp_path: Path) -> None:
    """Coriolis and centrifugal acceleration by the textbook's cross products."""
    text = "truth.pole_deg: {uniform: [-0.5, 0.5]}\ntruth.spin: {uniform: [0.99, 1.01]}\n"
    bounds = bounds_of(f"assurance={{bounds: {write(tmp_path, text)}}}", TRUE_STATE)
    body, random = kleopatra(), np.random.default_rng(2)
    true = make_true_body(body, TruthConfig(pole_deg=[0.5, -0.5], spin=1.01)).spin.rate
    places = random.normal(size=(2000, 3))
    places *= 280e3 / np.linalg.norm(places, axis=1, keepdims=True)
    speeds = random.choice([-40.0, 40.0], (2000, 3))

    def felt(spin: np.ndarray) -> np.ndarray:
        return -2.0 * np.cross(spin, speeds) - np.cross(spin, np.cross(spin, places))

    off = np.abs(felt(np.array(true)) - felt(np.array([0.0, 0.0, body.spin_rate]))).max()
    assert 0.3 * bounds.acceleration_m_s2 < off <= bounds.acceleration_m_s2
    for time in np.linspace(0.0, 7800.0, 40):
        axes = believed_axes(time, SpinKnowledge(tuple(true), body.spin_rate))
        turned = Rotation.from_quat(axes, scalar_first=True).magnitude()
        assert turned <= math.radians(bounds.thrust_direction_deg)


@pytest.mark.parametrize(
    ("text", "acceleration"),
    [
        # Half a quantum of force; four deviations of a kick each period.
        ("truth.thrusters.quantum_n: {fixed: 0.2}", 0.1 / 100.0),
        ("kicks.velocity_std_m_s: {fixed: 0.01}", 4.0 * 0.01 / 10.0),
    ],
)
def test_closed_forms(tmp_path: Path, text: str, acceleration: float) -> None:
    bounds = bounds_of(f"assurance={{bounds: {write(tmp_path, text)}}}")
    assert bounds.acceleration_m_s2 == pytest.approx(acceleration)


def test_sunlight_is_bounded(tmp_path: Path) -> None:
    """Light on the least mass, and 2 GM r / d^3 at twice the longest semi-axis; by hand."""
    sun = "sunlight={area_m2: 100, distance_au: 1, reflectivity: 1}"
    light = 1361.0 / 299_792_458.0 * 100.0 / 100.0
    tide = 2.0 * 1.3271244e20 / 149_597_870_700.0**3 * 2.0 * 140e3
    assert bounds_of("assurance={}", sun).acceleration_m_s2 == pytest.approx(light + tide)
    path = write(tmp_path, "truth.mass: {uniform: [0.5, 1.0]}\n")
    bounds = bounds_of(f"assurance={{bounds: {path}}}", sun)
    assert bounds.acceleration_m_s2 == pytest.approx(2.0 * light + tide)
    with pytest.raises(InputError, match="mass must be below 1"):
        bounds_of("assurance={}", "truth.mass=2", sun)
    # Bounds that are given hold nothing else, and it is said that there is more.
    scenario = load_scenario(None, ["assurance={bounds: {}}", sun])
    with pytest.warns(UserWarning, match=r"acceleration_m_s2: .* say 0$"):
        draw_world(scenario, kleopatra())


def test_values_one_by_one_and_from_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, "gravity: 0.1\nthrust_direction_deg: 2\nvelocity_m_s: 0.5\n")
    for text in (path, "{gravity: 0.1, thrust_direction_deg: 2, velocity_m_s: 0.5}"):
        bounds = bounds_of(f"assurance={{bounds: {text}}}")
        assert (bounds.gravity, bounds.velocity_m_s) == (0.1, 0.5)
        assert math.radians(bounds.thrust_direction_deg) == pytest.approx(math.radians(2.0))
    assert bounds_of("assurance.bounds.position_m=300").position_m == 300.0
    assert bounds_of("assurance={}").gravity == 0.0


OWN = [
    "truth.gravity=0.95", "truth.thrusters.scale=[1.0, 0.9, 1.02]", "truth.lidar.bias_m=20",
    "force_noise={std_n: 0.02}", "kicks={velocity_std_m_s: 0.001}",
]  # fmt: skip


def test_what_the_scenario_itself_declares_is_bounded(tmp_path: Path) -> None:
    bounds = bounds_of("assurance={}", *OWN)
    assert bounds.gravity == pytest.approx(0.05)
    assert bounds.thrust == pytest.approx(0.1)
    # Four standard deviations of noise on 100 kg, and of a kick in a period of 10 s.
    assert bounds.acceleration_m_s2 == pytest.approx(4.0 * (0.02 / 100.0 + 0.001 / 10.0))
    # Dispersions take the place of what they disperse, and of nothing else.
    path = write(tmp_path, "truth.gravity: {uniform: [1.0, 1.02]}\n")
    file = tmp_path / "own.yaml"
    file.write_text("truth: {gravity: 0.95}\n")
    both = load_scenario(file, [f"dispersions={path}", "assurance={}", *OWN[1:]])
    bounds = uncertainty_set(both, kleopatra())
    assert (bounds.gravity, bounds.thrust) == pytest.approx((0.02, 0.1))
    # A drawn world is not bounded by its draw.
    drawn = draw_world(both, kleopatra())
    assert drawn.dispersed == ["truth.gravity"]
    assert draw_world(drawn, kleopatra()) == drawn
    # Bounds that are given hold nothing else.
    assert uncertainty_set(
        load_scenario(None, ["assurance={bounds: {gravity: 0.1}}", *OWN]), kleopatra()
    ) == AssuranceBounds(gravity=0.1)


def test_a_section_that_only_the_draw_makes_has_its_defaults(tmp_path: Path) -> None:
    path = write(tmp_path, "force_noise.correlation_time_s: {uniform: [50, 100]}\n")
    bounds = bounds_of("assurance={}", f"dispersions={path}")
    assert bounds.acceleration_m_s2 == pytest.approx(4.0 * 0.7 / 100.0)


def test_a_true_mesh_is_bounded_by_its_distance_and_its_gravity(tmp_path: Path) -> None:
    """The map with one vertex pulled out, and the map turned about z, which is turned back."""
    shape = kleopatra().shape
    normals, _ = vertex_normals(shape)
    points = shape.vertices.copy()
    points[7] += 900.0 * normals[7]
    for name, places in (
        ("peak.obj", points),
        ("turned.obj", Rotation.from_rotvec([0.0, 0.0, 0.01]).apply(shape.vertices.copy())),
    ):
        Polyhedron(places, shape.facets).to_trimesh().export(tmp_path / name)
    files = "truth.mesh: {choice: [peak.obj, turned.obj]}\ntruth.mesh_unit: m\n"
    bounds = bounds_of(f"assurance={{bounds: {write(tmp_path, files)}}}", TRUE_STATE)
    assert bounds.surface_m == pytest.approx(900.0, rel=0.02)
    assert 0.0 < bounds.acceleration_m_s2 < 1e-5
    # A scenario's own mesh counts, too, and is no more than what was said.
    scenario = load_scenario(
        None,
        {
            "truth.mesh": str(tmp_path / "peak.obj"), "truth.mesh_unit": "m",
            "assurance": {"bounds": {"surface_m": 950.0, "acceleration_m_s2": 1e-4}},
        },
    )  # fmt: skip
    draw_world(scenario, kleopatra())
    assert scenario.assurance is not None
    scenario.assurance.bounds = AssuranceBounds(surface_m=800.0, acceleration_m_s2=1e-4)
    with pytest.warns(UserWarning, match=r"surface_m: declared up to 89.*say 800$"):
        draw_world(scenario, kleopatra())


def test_warns_of_what_may_exceed_the_bounds(tmp_path: Path) -> None:
    path = write(tmp_path, DISPERSIONS)
    for overrides, words in (
        (
            [f"dispersions={path}", "assurance={bounds: {gravity: 0.02, thrust: 0.2}}"],
            r"mine\.yaml may exceed assurance\.bounds.*gravity: declared up to 0\.05, .*say 0\.02",
        ),
        (
            ["assurance={bounds: {gravity: 0.1, thrust: 0.05}}", *OWN],
            r"^the scenario may exceed .*thrust: .* to 0\.1, .*0\.05; accel.* up to 0\.0012, .* 0$",
        ),
        (["assurance={bounds: {}}", "disturbance={}"], "adds up to 2 times the command"),
    ):
        with pytest.warns(UserWarning, match=words):
            draw_world(load_scenario(None, overrides), kleopatra())


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("truth.tumbles: {choice: [true, false]}", r"truth\.tumbles has no end"),
        ("disturbance.max_relative_magnitude: {choice: [0.0, 2.0]}", "up to 2 times the command"),
        (
            "truth.thrusters.scale: {uniform: [0.0, 1.0]}",
            r"assurance\.bounds: .*thrust must be below",
        ),
        (
            "truth.specific_impulse_s: {uniform: [0.9, 1.1], times: value}",
            r"assurance\.bounds: truth\.specific_impulse_s has times: value.*its value is None",
        ),
    ],
)
def test_refuses_a_file(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        bounds_of(f"assurance={{bounds: {write(tmp_path, text)}}}")


def test_the_adaptive_schedule_allows_for_the_bounds() -> None:
    """Whatever errs brings the ellipsoid nearer, so checks are not later."""
    state = [0.0, 0.0, 80e3, 0.0, 0.0, -10.0]
    steps = []
    for text in (
        "assurance=null",
        "assurance={bounds: {thrust: 0.1, gravity: 0.1, surface_m: 500}}",
    ):
        selector = zero_hybrid(load_scenario(None, [text]), kleopatra()).GetSubsystemByName(
            "selector"
        )
        errors = selector.position_error, selector.velocity_error
        steps.append(selector.reach.steps_out_of_reach(state, 10.0, 100, *errors, stopping=True))
    assert 0 < steps[1] < steps[0]
