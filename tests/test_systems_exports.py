"""What `proxops.systems` exports is where it is defined, once."""

import pytest

from proxops import systems
from proxops.systems.gravity import equilibria, surface_maps
from proxops.systems.lidar import lidar
from proxops.systems.shapes import ray_caster


@pytest.mark.parametrize(
    ("name", "home"),
    [
        ("RayCaster", ray_caster),
        ("RayFan", ray_caster),
        ("effective_field", surface_maps),
        ("find_equilibria", equilibria),
        ("plane_cut", surface_maps),
        ("surface_map", surface_maps),
    ],
)
def test_exports(name: str, home: object) -> None:
    assert name in systems.__all__
    assert getattr(systems, name) is getattr(home, name)


def test_everything_exported_is_there() -> None:
    assert len(systems.__all__) == len(set(systems.__all__))
    assert all(hasattr(systems, name) for name in systems.__all__)


def test_lidar_does_not_pass_on_the_ray_caster() -> None:
    assert not hasattr(lidar, "RayCaster")
