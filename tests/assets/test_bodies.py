"""The shipped bodies that are made of a table by latitude and longitude."""

import math

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation

from proxops.assets import ASSETS, loft
from proxops.diagrams.scenario import load_body
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT
from proxops.systems.rotation import TorqueFreeSpin

# Extents (km) and volume (km3) of the models that were measured, as the READMEs have them.
MODELS = {
    "bennu": ((0.568, 0.543, 0.495), 0.06163),
    "ryugu": ((1.019, 1.019, 0.964), 0.37727),
    "toutatis": ((2.285, 1.919, 4.603), 7.670),
    "didymos": ((0.818, 0.802, 0.605), 0.20336),
    "dimorphos": ((0.178, 0.169, 0.115), 0.00176),
}
BODIES = ("bennu", "ryugu", "toutatis", "didymos")
DAY = 86400.0


@pytest.mark.parametrize("name", BODIES)
def test_body_loads_and_is_as_large_as_its_model(name: str) -> None:
    body, (extents, volume) = load_body(name), MODELS[name]
    np.testing.assert_allclose(body.shape.extents, np.multiply(extents, 1e3), rtol=0.01)
    density = body.config.mass_kg / (volume * 1e9)
    assert body.exact_field.density == pytest.approx(density, rel=0.01)
    np.testing.assert_allclose(body.shape.centre_of_mass, 0.0, atol=1e-6)
    readme = (ASSETS / name / "README.md").read_text(encoding="utf-8")
    assert " × ".join(f"{size:.3f}" for size in extents) in readme


@pytest.mark.parametrize("name", MODELS)
def test_mesh_is_sound_and_as_large_as_its_model(name: str) -> None:
    mesh = trimesh.load_mesh(loft.FIGURES[name].mesh, process=False)
    extents, volume = MODELS[name]
    assert 3900 <= len(mesh.faces) <= 4000
    assert mesh.is_volume
    assert mesh.euler_number == 2
    assert mesh.volume == pytest.approx(volume, rel=0.01)
    np.testing.assert_allclose(mesh.extents, extents, rtol=0.01)
    np.testing.assert_allclose(mesh.center_mass, 0.0, atol=1e-5)
    assert np.degrees(mesh.face_angles.min()) > 30.0


@pytest.mark.parametrize("name", MODELS)
def test_mesh_follows_the_table(name: str) -> None:
    """Rays along the table's directions meet the mesh near the table's radii."""
    figure = loft.FIGURES[name]
    rows = np.loadtxt(figure.table, delimiter=",", skiprows=1)
    latitude, longitude = np.radians(rows[1:-1, :1]), np.radians(np.arange(0.0, 360.0, 3.0))
    mesh = trimesh.load_mesh(figure.mesh, process=False)
    ways = np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    ).reshape(-1, 3)[::7]
    met, ray, _ = mesh.ray.intersects_location(np.zeros_like(ways), ways, multiple_hits=False)
    assert len(met) == len(ways)
    wrong = np.linalg.norm(met, axis=1) - rows[1:-1, 1:].reshape(-1)[::7][ray]
    assert np.sqrt(np.mean(wrong**2)) < 0.004 * mesh.extents.max()
    assert abs(np.mean(wrong)) < 2e-4 * mesh.extents.max()


@pytest.mark.parametrize("name", [name for name in BODIES if name != "didymos"])
def test_keep_out_ellipsoid_holds_mesh_and_table_with_six_percent(name: str) -> None:
    axes = load_body(name).keep_out_semi_axes / 1e3
    figure = loft.FIGURES[name]
    mesh = trimesh.load_mesh(figure.mesh, process=False)
    for points in (mesh.vertices, loft.read_sections(figure.table).reshape(-1, 3)):
        assert 1.06 <= 1.0 / np.linalg.norm(points / axes, axis=1).max() < 1.075


def test_keep_out_ellipsoid_of_didymos_holds_the_ways_of_its_moon() -> None:
    """The ball of Dimorphos, at any place between pericentre and apocentre, with 6 % to spare."""
    body = load_body("didymos")
    (moon,) = body.moons
    a, e, radius = moon.config.semi_major_axis_m, moon.config.eccentricity, moon.config.radius_m
    turn, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 60), np.linspace(-1.5, 1.5, 31))
    ball = radius * np.stack(
        [np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1
    ).reshape(-1, 3)
    for away in (a * (1.0 - e), a * (1.0 + e)):
        places = ball + [away, 0.0, 0.0]
        # The ellipsoid is round about z.
        assert np.linalg.norm(places / body.keep_out_semi_axes, axis=1).max() < 1.0 / 1.06
    assert body.keep_out_semi_axes[0] == body.keep_out_semi_axes[1]
    reach = np.linalg.norm(moon.shape.vertices, axis=1).max()
    assert 1.06 < radius / reach < 1.075
    np.testing.assert_allclose(body.moon_depths, body.keep_out_semi_axes[0] - a * (1 + e), atol=2.0)


def test_dimorphos_goes_round_as_both_masses_want() -> None:
    body = load_body("didymos")
    (moon,) = body.config.moons
    mu = GRAVITATIONAL_CONSTANT * (body.config.mass_kg + moon.mass_kg)
    period = 2.0 * np.pi * np.sqrt(moon.semi_major_axis_m**3 / mu)
    assert period == pytest.approx(moon.period_s, rel=1e-3)
    assert moon.period_s == pytest.approx(11.3674 * 3600.0, rel=1e-5)


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        (["-90,1,2,1", "0,1,1,1", "90,1,1,1"], "poles"),
        (["-80,1,1,1", "0,1,1,1", "90,1,1,1"], "poles"),
        (["-90,1,1,1", "0,1,0,1", "90,1,1,1"], "positive"),
        (["-90,1,1,1", "0,1,1,1", "0,1,1,1", "90,1,1,1"], "ascend"),
    ],
)
def test_bad_tables(rows: list[str], complaint: str, tmp_path) -> None:
    path = tmp_path / "radii.csv"
    path.write_text("\n".join(["latitude_deg,0,120,240", *rows]))
    with pytest.raises(ValueError, match=complaint):
        loft.read_sections(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kleopatra", "didymos"])
def test_mesh_is_what_the_builder_makes(name: str, tmp_path) -> None:
    """But for ties between nearest facets, which a machine's arithmetic may break either way."""
    figure = loft.FIGURES[name]
    built = loft.build_mesh(loft.read_sections(figure.table), figure.cap, figure.band)
    shipped = trimesh.load_mesh(figure.mesh, process=False)
    np.testing.assert_array_equal(built.faces, shipped.faces)
    np.testing.assert_allclose(built.vertices, shipped.vertices, rtol=0, atol=1e-4 * shipped.scale)
    loft.write_obj(built, tmp_path / "it.obj")
    written = trimesh.load_mesh(tmp_path / "it.obj", process=False)
    np.testing.assert_allclose(written.vertices, built.vertices, rtol=0, atol=6e-6)


# --- Toutatis -------------------------------------------------------------------------------------


def principal_axes(spin: TorqueFreeSpin) -> tuple[np.ndarray, np.ndarray]:
    """Moments, the least first, and axes as columns; the first is the long axis, along +z."""
    moments, axes = np.linalg.eigh(spin.inertia)
    return moments, axes * np.sign(axes[2, 0])


def test_toutatis_turns_about_its_long_axis_in_5_41_days() -> None:
    spin = load_body("toutatis").spin
    assert isinstance(spin, TorqueFreeSpin)
    (least, middle, greatest), axes = principal_axes(spin)
    rate = axes.T @ spin.rate
    doubled_energy = float(np.array([least, middle, greatest]) @ rate**2)
    momentum = float(np.linalg.norm(spin.inertia @ spin.rate))
    assert momentum**2 < doubled_energy * middle  # The long-axis mode.
    # The period 4 K / f of w in K, with K by quadrature.
    across = momentum**2 - doubled_energy * least
    along = doubled_energy * greatest - momentum**2
    frequency = math.sqrt(along * (middle - least) / (least * middle * greatest))
    m = (greatest - middle) * across / ((middle - least) * along)
    quarter, _ = quad(lambda angle: 1.0 / math.sqrt(1.0 - m * math.sin(angle) ** 2), 0, math.pi / 2)
    period = 4.0 * quarter / frequency
    assert period == pytest.approx(5.41 * DAY, rel=1e-5)
    # The model agrees: w comes back then, and not halfway.
    np.testing.assert_allclose(spin.angular_velocity(period), spin.rate, rtol=1e-6, atol=1e-12)
    assert np.linalg.norm(spin.angular_velocity(0.5 * period) - spin.rate) > 1e-6


def test_toutatis_long_axis_precesses_in_7_35_days() -> None:
    """The mean over 20 rounds of w, from Euler's equations and the attitude, step by step."""
    spin = load_body("toutatis").spin
    assert isinstance(spin, TorqueFreeSpin)
    _, axes = principal_axes(spin)
    inverse = np.linalg.inv(spin.inertia)

    def derivative(_: float, state: np.ndarray) -> np.ndarray:
        w, (real, *vector) = state[:3], state[3:]
        turn = 0.5 * np.concatenate([[-np.dot(vector, w)], real * w + np.cross(vector, w)])
        return np.concatenate([-inverse @ np.cross(w, spin.inertia @ w), turn])

    times = np.linspace(0.0, 20 * 5.41 * DAY, 4001)
    start = np.concatenate([spin.rate, [1.0, 0.0, 0.0, 0.0]])
    found = solve_ivp(derivative, times[[0, -1]], start, "DOP853", times, rtol=1e-11, atol=1e-13)
    states = found.y.T
    attitude = Rotation.from_quat(states[:, [4, 5, 6, 3]])
    long_axis = attitude.apply(axes[:, 0])
    momentum = spin.inertia @ spin.rate / np.linalg.norm(spin.inertia @ spin.rate)
    side = np.cross(momentum, long_axis[0])
    front = np.cross(side, momentum)
    azimuth = np.unwrap(
        np.arctan2(
            long_axis @ side / np.linalg.norm(side), long_axis @ front / np.linalg.norm(front)
        )
    )
    mean = 2.0 * math.pi * times[-1] / azimuth[-1]
    assert mean == pytest.approx(7.35 * DAY, rel=1e-5)
    # The closed form of the model has the same attitude.
    time = float(times[1234])
    real, *vector = spin.attitude(time)
    closed = Rotation.from_quat([*vector, real])
    assert (closed.inv() * attitude[1234]).magnitude() < 1e-5
