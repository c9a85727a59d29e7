"""A rigid spacecraft is drawn as it is turned, with flames as long as its thrusters are on."""

import dataclasses as dc
import re
import typing
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from meshcat_pages import animated, doubles, points_told, pose
from pydrake.multibody.tree import SpatialInertia
from scipy.spatial.transform import Rotation
from short_flights import short_scenario
from synthetic_log import synthetic_log

from proxops.diagrams.flight.simulation import make_simulator
from proxops.diagrams.flight.transit_diagram import make_transit_diagram
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import replay
from proxops.diagrams.meshcat.meshcat_scene import Scene, quiet_meshcat
from proxops.diagrams.meshcat.rigid_scene import RigidView, enlargement
from proxops.diagrams.meshcat.site_scene import add_site, part_shown
from proxops.diagrams.scenario import (
    RigidBodyConfig,
    Scenario,
    TouchAndGoConfig,
    arm_solids,
    dump_scenario,
    load_body,
    load_scenario,
    load_spacecraft,
    solids_of,
    touch_site,
    with_site,
)
from proxops.systems.attitude import AttitudeGuidanceConfig, TrueRigidBodyConfig
from proxops.systems.lidar import LidarConfig

UNIT = 100e3
FAILED, FAILURE = 5, 1000.0


@pytest.fixture(scope="module")
def log() -> FlightLog:
    """Turned at random in each row, with thrusters on for random times in a third of the rows."""
    plain = synthetic_log(120, ranges=False)
    rows, random = plain.dataset.sizes["time"], np.random.default_rng(1)
    attitude = random.normal(size=(rows, 4))
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    on = random.uniform(0.02, 1.0, (rows, 12)) * (random.uniform(size=(rows, 12)) < 1 / 3)
    scenario = Scenario(
        spacecraft=RigidBodyConfig(pointing=AttitudeGuidanceConfig(mode="body")),
        lidar=LidarConfig(planes=8, rays=6, field_of_view_deg=20.0),
    )
    broken = TrueRigidBodyConfig(failed_thruster=FAILED, failure_time_s=FAILURE)
    scenario = dc.replace(scenario, truth=dc.replace(scenario.truth, rigid_body=broken))
    columns = {"attitude": ("quaternion", attitude), "on_times": ("thruster", on)}
    data = plain.dataset.assign(
        {name: (("time", dimension), values) for name, (dimension, values) in columns.items()}
    )
    return FlightLog(data.assign_attrs(scenario=dump_scenario(scenario)), plain.body)


@pytest.fixture(scope="module")
def page(log: FlightLog) -> str:
    return replay.replay_page(log)


def test_it_is_where_it_is_and_turned_as_it_is(log: FlightLog, page: str) -> None:
    places = animated(page, "/spacecraft", "position")
    turns = animated(page, "/spacecraft/turned", "quaternion")
    reach = animated(page, "/spacecraft/turned/sight", "scale")
    positions, attitudes = log.dataset["state"].values[:, :3], log.dataset["attitude"].values
    assert len(turns) == len(places) == len(positions)
    for row, (w, x, y, z) in enumerate(attitudes):
        np.testing.assert_allclose(places[row], positions[row] / UNIT)
        # A quaternion and its negative are the same turn.
        assert abs(turns[row] @ [x, y, z, w]) == pytest.approx(1.0)
        np.testing.assert_allclose(reach[row], np.linalg.norm(positions[row]) / UNIT)


def test_flames_are_as_long_as_thrusters_are_on(log: FlightLog, page: str) -> None:
    """At each row, between the keys too, and none comes out of a thruster that gives nothing."""
    on, keys_of_all = log.dataset["on_times"].values.copy(), 0
    on[log.dataset["time"].values > FAILURE, FAILED] = 0.0
    rows = np.arange(len(on))
    for thruster in range(12):
        keys = animated(page, f"/spacecraft/turned/flames/{thruster:02d}/flame", "scale")
        lengths = np.interp(rows, list(keys), [scale[0] for scale in keys.values()])
        np.testing.assert_allclose(lengths, np.maximum(on[:, thruster], 1e-3))
        keys_of_all += len(keys)
    assert keys_of_all < on.size


def test_flames_leave_the_thrusters_against_the_force(log: FlightLog) -> None:
    meshcat = quiet_meshcat()
    view = RigidView(Scene(meshcat, log.body), log.scenario)
    view.add()
    for k, row in enumerate(load_spacecraft("smallsat").config.thrusters):
        drawn = pose(meshcat, f"/spacecraft/turned/flames/{k:02d}")
        np.testing.assert_allclose(drawn[:3, 0], -np.array(row[3:6]), atol=1e-9)
        np.testing.assert_allclose(drawn[:3, 3] * UNIT / view.times, row[:3], atol=1e-9)
    flame = points_told(meshcat, "/spacecraft/turned/flames/00/flame")
    assert flame[:, 0].min() == 0.0 < flame[:, 0].max()


def test_it_is_drawn_as_large_as_a_point(log: FlightLog, page: str) -> None:
    """smallsat is 4.2 m wide, and a point is drawn 0.145 units wide."""
    view = RigidView(Scene(quiet_meshcat(), log.body), log.scenario)
    assert view.times == 3000.0 == pytest.approx(0.145 * UNIT / 4.2, rel=0.2)
    assert enlargement(solids_of(load_spacecraft("smallsat")), unit=10.0) == 1.0
    assert "spacecraft × 3,000" in page
    assert "field of view, 20°" in page
    assert "spacecraft ×" not in replay.replay_page(synthetic_log(3, ranges=False))


def test_rays_turn_with_it(log: FlightLog) -> None:
    view = RigidView(Scene(quiet_meshcat(), log.body), log.scenario)
    w, x, y, z = log.dataset["attitude"].values[7]
    turn = Rotation.from_quat([x, y, z, w])
    rays = log.scenario.lidar_geometry.directions
    np.testing.assert_allclose(view.rays(np.array([w, x, y, z])), turn.apply(rays))
    # All pixels lie in the field of view that is drawn: up to its corners.
    meshcat = quiet_meshcat()
    RigidView(Scene(meshcat, log.body), log.scenario).add()
    sides = points_told(meshcat, "/spacecraft/turned/sight/field_of_view/sides")
    tangents = np.abs(rays[:, :2] / rays[:, 2:])
    assert tangents.max(axis=0) == pytest.approx(sides[:, :2].max(axis=0), rel=0.2)
    assert (tangents < sides[:, :2].max(axis=0)).all()


def test_one_flight_after_another_leaves_nothing(log: FlightLog) -> None:
    meshcat, point = quiet_meshcat(), synthetic_log(3, ranges=False)
    for each, names in ((log, ("turned",)), (point, ("hull", "thrust_x")), (log, ("turned",))):
        replay.add_flight(meshcat, each)
        there = {
            name
            for name in ("turned", "hull", "thrust_x")
            if meshcat.HasPath(f"/spacecraft/{name}")
        }
        assert there == set(names)


@pytest.mark.parametrize("name", ["smallsat", "osiris_rex", "hayabusa2"])
def test_solids_are_those_of_the_file(name: str) -> None:
    model = load_spacecraft(name)
    tree = ElementTree.parse(model.path.parent / model.config.bus)
    sizes = [[*map(float, box.attrib["size"].split())] for box in tree.iterfind(".//visual//box")]
    drawn = [np.ptp(solid.corners, axis=0) for solid in solids_of(model)]
    np.testing.assert_allclose(np.sort(drawn, axis=0), np.sort(sizes, axis=0))


@pytest.mark.parametrize("visual", ["", '<mesh filename="none.obj"/>'])
def test_a_spacecraft_without_a_picture_is_a_box_of_its_inertia(
    tmp_path: Path, visual: str
) -> None:
    shipped = load_spacecraft("osiris_rex")
    bus = (shipped.path.parent / "bus.urdf").read_text()
    found = re.compile(r"<visual>.*?</visual>")
    instead = f"<visual><geometry>{visual}</geometry></visual>" if visual else ""
    (tmp_path / "bus.urdf").write_text(found.sub(instead, bus))
    (tmp_path / "it.yaml").write_text(shipped.path.read_text())
    model = load_spacecraft(str(tmp_path / "it.yaml"))
    (solid,) = solids_of(model)
    own = SpatialInertia.SolidBoxWithMass(model.mass, *solid.shape.size())
    turned = own.ReExpress(solid.pose.rotation()).CalcRotationalInertia().CopyToFullMatrix3()
    np.testing.assert_allclose(turned, model.inertia, rtol=1e-6, atol=1e-6)


def test_live_it_is_turned_as_it_is() -> None:
    """And looking on changes nothing."""
    scenario = dc.replace(short_scenario(), spacecraft=RigidBodyConfig())
    flown = []
    meshcat = quiet_meshcat()
    for seen in (None, meshcat):
        diagram = make_transit_diagram(scenario, None, seen, load_body("kleopatra"))
        simulator = make_simulator(diagram, scenario)
        simulator.AdvanceTo(50.0)
        root = simulator.get_context()
        flown.append(
            [
                diagram.GetSubsystemByName(f"log_{name}").FindLog(root).data()
                for name in ("state", "attitude", "on_times")
            ]
        )
    for one, other in zip(*flown, strict=True):
        np.testing.assert_array_equal(one, other)
    _, attitudes, times = flown[1]
    w, x, y, z = attitudes[:, -1]
    drawn = pose(meshcat, "/spacecraft/turned")
    np.testing.assert_allclose(
        drawn[:3, :3], Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-9
    )
    assert times[:, -1].max() > 0.0
    for thruster, on in enumerate(times[:, -1]):
        packed = meshcat._GetPackedProperty(
            f"/spacecraft/turned/flames/{thruster:02d}/flame", "scale"
        )
        assert doubles(packed, b"value", 3)[0] == pytest.approx(max(on, 1e-3))


def test_a_touch_shows_the_arm_the_corridor_and_what_is_near() -> None:
    """The corridor's lowest edge is a circle about the site; the arm's head hangs below S."""
    scenario = load_scenario("bennu_touch_and_go")
    body = load_body("bennu")
    scenario = with_site(scenario, body)
    near, task = part_shown(scenario), scenario.task
    assert isinstance(task, TouchAndGoConfig)
    assert near == task.descent.home_m
    assert part_shown(load_scenario()) is None
    scene = Scene(typing.cast(typing.Any, lines := Lines()), body, near=near)
    add_site(scene, scenario)
    site = touch_site(scenario, body)
    ring = scene.unit * lines.starts[:, :24].T - site.position
    np.testing.assert_allclose(ring @ site.normal, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), task.descent.room_m)
    rod, head = arm_solids(task)
    assert head.corners[:, 2].min() == pytest.approx(-task.arm_m)
    assert rod.corners[:, 2].max() == pytest.approx(0.05)


class Lines:
    """A Meshcat that keeps where the last line segments start."""

    def SetLineSegments(self, _name, starts, *_rest) -> None:  # noqa: N802
        self.starts = starts
