"""Models of rigid spacecraft: what ships, and what a stranger's file may have wrong."""

from pathlib import Path

import numpy as np
import pytest

from proxops.assets import ASSETS
from proxops.diagrams.scenario import RigidBodyConfig, load_scenario, load_spacecraft
from proxops.diagrams.scenario.scenario import dump_scenario, parse_scenario
from proxops.systems import InputError

SHIPPED = sorted(path.parent.name for path in ASSETS.glob("spacecraft/*/spacecraft.yaml"))
URDF = """<robot name="it">
  <link name="bus"><inertial><mass value="{mass}"/>
    <inertia ixx="{ixx}" iyy="3" izz="4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="wheel"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="axis" type="{joint}"><parent link="bus"/><child link="wheel"/>
    <origin xyz="0.5 0 0" rpy="0 1.5707963267948966 0"/><axis xyz="0 0 1"/></joint>
</robot>
"""
THRUSTERS = load_spacecraft("smallsat").config.thrusters


def written(folder: Path, rows=THRUSTERS, mass="9", ixx="2", joint="continuous", **more) -> str:
    """Writes a model; returns the path of its YAML file."""
    (folder / "bus.urdf").write_text(URDF.format(mass=mass, ixx=ixx, joint=joint))
    lines = {"bus": "bus.urdf", "thrusters": [*map(list, rows)], **more}
    path = folder / "it.yaml"
    path.write_text("\n".join(f"{key}: {value}" for key, value in lines.items()))
    return str(path)


@pytest.mark.parametrize("name", SHIPPED)
def test_models_that_ship_are_what_they_say(name):
    model = load_spacecraft(name)
    wanted = {"smallsat": 100.0, "smallsat_16": 100.0, "osiris_rex": 1400.0, "hayabusa2": 560.0}
    assert model.mass == pytest.approx(wanted[name])
    np.testing.assert_allclose(model.centre_of_mass, 0.0, atol=1e-6)
    moments = np.linalg.eigvalsh(model.inertia)
    assert moments[2] < moments[0] + moments[1]
    assert model.wheels is not None
    np.testing.assert_allclose(np.linalg.norm(model.wheels.axes, axis=1), 1.0)
    # What controllers may ask for can be given along each axis, and turns nothing.
    wrenches = model.thrusters.wrenches()
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        along = np.clip(wrenches[:3].T @ axis, 0.0, None)
        assert along.sum() >= model.config.thrust_limit_n


def test_mass_inertia_and_wheels_come_from_links_and_joints(tmp_path):
    """10 kg: a link of 9 kg at the origin and a wheel of 1 kg half a metre along x, about x."""
    model = load_spacecraft(written(tmp_path))
    assert model.mass == pytest.approx(10.0)
    np.testing.assert_allclose(model.centre_of_mass, [0.05, 0.0, 0.0])
    steiner = 9 * 0.05**2 + 0.45**2
    np.testing.assert_allclose(
        model.inertia, np.diag([2.01, 3.01 + steiner, 4.01 + steiner]), atol=1e-9
    )
    np.testing.assert_allclose(model.thrusters.places[0], np.array(THRUSTERS[0][:3]) - [0.05, 0, 0])
    assert model.wheels is None
    with pytest.raises(InputError, match="wheels' axes must span space"):
        load_spacecraft(written(tmp_path, wheels="[axis]", thrust_limit_n=6.0))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mass": "0"}, "a mass or inertia that no body has: .*bus.urdf:2"),
        ({"ixx": "9"}, "a mass or inertia that no body has: .*bus.urdf:2"),
        ({"joint": "fixed", "wheels": "[axis]"}, "'axis' is weld: a wheel turns"),
        ({"wheels": "[other]"}, "no joint 'other'"),
        ({"mass": "9000"}, "are they in kg, m and kg m"),
        ({"bus": "none.urdf"}, "does not exist"),
        ({"bus": "it.yaml"}, "cannot be read"),
        ({"rows": [*THRUSTERS[:4]]}, "a force along y in both directions"),
        ({"rows": [*THRUSTERS[:11], [0, 0, 0, 0, 0, 0, 4]]}, "thruster 11 needs seven numbers"),
        ({"rows": []}, "1 to 100 rows"),
        ({"thrust": 3}, "there is no key 'thrust'"),
    ],
)
def test_a_model_that_cannot_fly_is_refused_by_name(changes, words, tmp_path):
    with pytest.raises(InputError, match=words):
        load_spacecraft(written(tmp_path, **changes))


def test_a_scenario_names_a_model_and_takes_mass_and_thrust_from_it(tmp_path):
    rigid = {"_tag": "!RigidBody", "model": "osiris_rex"}
    scenario = load_scenario(spacecraft=rigid)
    assert isinstance(scenario.spacecraft, RigidBodyConfig)
    assert (scenario.spacecraft.mass_kg, scenario.spacecraft.thrust_limit_n) == (1400.0, 6.0)
    assert parse_scenario(dump_scenario(scenario)) == scenario
    # The control period of 10 s is divided evenly.
    for asked, steps in ((1.0, 10), (3.0, 4), (20.0, 1)):
        divided = load_scenario(spacecraft={**rigid, "attitude_period_s": asked})
        assert (divided.attitude_steps, divided.attitude_period_s) == (steps, 10.0 / steps)
    with pytest.raises(InputError, match="'osirisrex' does not ship"):
        load_scenario(spacecraft={"_tag": "!RigidBody", "model": "osirisrex"})
    # A path in a scenario file is relative to that file.
    written(tmp_path)
    path = tmp_path / "scenario.yaml"
    path.write_text("spacecraft: !RigidBody {model: it.yaml}")
    assert load_scenario(path).spacecraft.mass_kg == pytest.approx(10.0)
