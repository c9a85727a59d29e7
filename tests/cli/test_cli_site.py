"""`proxops site`: what it lists, draws and refuses."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from proxops.diagrams.scenario import load_body

PNG = b"\x89PNG\r\n\x1a\n"


def test_bennu(run, tmp_path: Path) -> None:
    code, out, err = run("site", "bennu", "--count", 3)
    assert code == 0
    assert "Bennu: 9" in out
    assert "out/site/sites.png and out/site/sites.json" in err
    folder = tmp_path / "out/site"
    assert (folder / "sites.png").read_bytes().startswith(PNG)
    rows = json.loads((folder / "sites.json").read_text())
    assert len(rows) == 3
    shares = [row["greatest_share_of_a_limit"] for row in rows]
    assert shares == sorted(shares)
    assert max(shares) < 1.0

    # Asked about by its latitude and longitude, the first place is the same.
    first = rows[0]
    where = f"{first['latitude_deg']},{first['longitude_deg']}"
    code, out, _ = run("site", "bennu", "--at", where, "--json")
    (again,) = json.loads(out)
    assert code == 0
    np.testing.assert_allclose(again["position_m"], first["position_m"], atol=1e-2)
    assert again["slope_deg"] == pytest.approx(first["slope_deg"], abs=0.01)
    # Gravity and centrifugal acceleration, by hand.
    body, place = load_body("bennu"), np.array(first["position_m"])
    spin = 2.0 * np.pi / (4.296057 * 3600.0)
    apparent = body.exact_field.evaluate(place[None]).acceleration[0]
    apparent = apparent + spin**2 * place * [1.0, 1.0, 0.0]
    assert first["hover_n"] == pytest.approx(1400.0 * np.abs(apparent).max(), rel=1e-9)
    cosine = -apparent @ first["normal"] / np.linalg.norm(apparent)
    assert first["slope_deg"] == pytest.approx(np.degrees(np.arccos(cosine)), abs=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bennu", "--at", "400,0,0"], "120 m off the map, whose nearest point is .*; the nearest"),
        (["bennu", "--at", "95,0"], "-90 to 90"),
        (["bennu", "--at", "here"], "give LAT,LON in degrees or X,Y,Z in m"),
        (["kleopatra", "--at", "0,0"], "hovering takes 4.31 N .*the nearest place that can be is"),
        (["bennu", "--radius", "0"], "radius_m must be above 0"),
        (["bennu", "--slope", "0.1"], "no place of Bennu can be touched, most for their slope"),
        (
            ["bennu", "--at", "80,0", "--set", "sunlight={direction: [0, 0, -1]}"],
            "the Sun never rises there; the nearest place that can be is",
        ),
    ],
)
def test_refused(run, arguments: list[str], message: str) -> None:
    code, out, err = run("site", *arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert re.search(message, err), err
