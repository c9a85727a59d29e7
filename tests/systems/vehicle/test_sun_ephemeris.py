"""Where the Sun is by SPICE kernels that the test writes itself, against two-body motion."""

import dataclasses as dc

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.systems.common import InputError
from proxops.systems.vehicle import SunlightConfig, at_its_distance
from proxops.systems.vehicle.sunlight import sun_direction

spice = pytest.importorskip("spiceypy")

# 2,000,042 is no body that SPICE knows; at the epoch it is at 1.2 au and moves across.
BODY, MU, AU = 2000042, 1.3271244e11, 149597870.7
START = np.array([1.2 * AU, 0.1 * AU, -0.05 * AU, 2.0, 26.0, 3.0])
LEAP = """KPL/LSK
\\begindata
DELTET/DELTA_T_A = 32.184
DELTET/K = 1.657D-3
DELTET/EB = 1.671D-2
DELTET/M = ( 6.239996D0 1.99096871D-7 )
DELTET/DELTA_AT = ( 37, @2017-JAN-1 )
\\begintext
"""


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """A meta-kernel of leap seconds and an orbit of two bodies in ten days."""
    monkeypatch.chdir(tmp_path)  # A kernel's path may have 80 characters.
    (tmp_path / "leap.tls").write_text(LEAP)
    spk = tmp_path / "body.bsp"
    handle = spice.spkopn(str(spk), "two bodies", 0)
    spice.furnsh(str(tmp_path / "leap.tls"))
    epoch = spice.str2et("2026-01-01T00:00:00")
    first, last = epoch - 1.0, epoch + 864000.0
    spice.spkw05(
        handle, BODY, 10, "J2000", first, last, "orbit", MU, 2, [START, moved(864000.0)],
        [epoch, last],
    )  # fmt: skip
    spice.spkcls(handle)
    meta = tmp_path / "all.tm"
    meta.write_text(
        "KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( 'leap.tls', 'body.bsp' )\n\\begintext\n"
    )
    yield str(meta)
    spice.kclear()


def moved(time: float) -> np.ndarray:
    def rate(_, y):
        return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    return solve_ivp(rate, (0.0, time), START, "DOP853", rtol=1e-13, atol=1e-6).y[:, -1]


def settings(kernels: str, **changes: str) -> SunlightConfig:
    given = SunlightConfig(kernels=kernels, spice_body=str(BODY), epoch="2026-01-01T00:00:00")
    return dc.replace(given, **changes)


def test_the_sun_is_where_an_orbit_has_it(kernels: str) -> None:
    ecliptic = Rotation.from_euler("x", -84381.448 / 3600.0, degrees=True)
    for time in (0.0, 1e4, 3e5, 8e5):
        place = -moved(time)[:3] if time else -START[:3]
        wanted = ecliptic.apply(place / np.linalg.norm(place))
        np.testing.assert_allclose(sun_direction(time, settings(kernels)), wanted, atol=1e-9)
    found = at_its_distance(settings(kernels)).distance_au
    assert found == pytest.approx(np.linalg.norm(START[:3]) / AU, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"spice_body": "2000043"}, "SPK"),
        ({"epoch": "noon"}, "SPICE"),
        ({"spice_frame": "NO"}, "SPICE"),
    ],
)
def test_what_the_kernels_do_not_say_is_told(kernels: str, changes: dict, words: str) -> None:
    with pytest.raises(InputError, match=rf"sunlight.kernels: .*{words}"):
        sun_direction(0.0, settings(kernels, **changes))


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(InputError, match=r"there is no file nowhere\.tm"):
        sun_direction(0.0, settings("nowhere.tm"))
