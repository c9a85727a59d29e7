"""The table of uncertain quantities: each is in it, and reaches what the table says."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path

import pytest
from short_flights import kleopatra

from proxops.diagrams.scenario import QUANTITIES, World, load_dispersions, load_scenario
from proxops.diagrams.scenario.keys import default_at, dotted_fields
from proxops.diagrams.scenario.quantities import HARMLESS, Quantity
from proxops.systems.assurance import AssuranceBounds
from proxops.systems.common import InputError
from proxops.systems.navigation import ExpectedErrors, LidarNavigationConfig
from proxops.systems.shapes import Polyhedron

SECTIONS = ("truth.", "disturbance.", "force_noise.", "kicks.")
# Values that are no spread about what is believed.
SPREADS = {
    "truth.mesh": "{choice: [a.obj]}\ntruth.mesh_unit: m",
    "truth.mesh_unit": "{choice: [m, km]}",
    "truth.mesh_of_any_size": "{choice: [true]}",
    "truth.thrusters.failed_axis": "{choice: [x, none]}",
    "truth.specific_impulse_s": "{uniform: [200, 300]}",
    "truth.density_contrast": "{uniform: [0, 0.01]}",
    "truth.surface_rms_m": "{uniform: [0, 30]}",
    "disturbance.max_relative_magnitude": "{uniform: [0, 1]}",
    "truth.tumbles": "{choice: [true, false]}",
    "truth.boulders.widest_m": "{uniform: [9.0e3, 9.1e3]}",
    "truth.boulders.crater_widest_m": "{uniform: [9.0e3, 9.1e3]}",
}


def dispersed(quantity: Quantity, folder: Path, **changes: object) -> World:
    """A world of dispersions of one quantity alone."""
    shape = kleopatra().shape
    Polyhedron(1.001 * shape.vertices, shape.facets).to_trimesh().export(folder / "a.obj")
    spread = SPREADS.get(quantity.key)
    if spread is None:
        default = default_at(quantity.key)
        low = max(default) if isinstance(default, list) else default or 0.0
        whole = isinstance(default, int) and not isinstance(default, bool)
        spread = f"{{uniform: [{low}, {low + (2 if whole else 0.01)}]}}"
    path = folder / "one.yaml"
    path.write_text(f"{quantity.key}: {spread}\n")
    return World.of(load_scenario(None, {"dispersions": str(path), **changes}), kleopatra())


def told(world: World) -> ExpectedErrors:
    """What the navigation of a world is told of its errors."""
    navigation = world.belief.navigation
    assert isinstance(navigation, LidarNavigationConfig)
    assert navigation.expected is not None
    return navigation.expected


def test_every_uncertain_value_has_a_row() -> None:
    rows = [each.key for each in QUANTITIES]
    assert len(set(rows)) == len(rows)
    known = {each.key for each in QUANTITIES if each.known}
    assert set(rows) - known == {key for key in dotted_fields() if key.startswith(SECTIONS)}
    assert known == {"lidar.noise_std_m", "spacecraft.mass_kg"}


def test_rows_name_what_is_there() -> None:
    tunes = {field.name for field in dc.fields(ExpectedErrors)}
    bounds = {field.name for field in dc.fields(AssuranceBounds)}
    # The noise of a measured attitude is that of the data sheet of a rigid spacecraft.
    tunes -= {"attitude_noise_deg", "attitude_noise_correlation_s"}
    # It follows from those of thrust and direction where a rigid spacecraft turns.
    tunes -= {"thrust_varying"}
    assert {each.tunes for each in QUANTITIES} - {None} == tunes
    # The navigation and the MPC themselves tell of position, velocity and delay.
    own = {"position_m", "velocity_m_s", "delay_s"}
    assert {each.bounds for each in QUANTITIES} - {None, HARMLESS} == bounds - own
    assert {each.needs for each in QUANTITIES} - {None} <= {each.key for each in QUANTITIES}
    for name in ("after_survey", "after_survey_rigid", "before_survey", "first_look", "paper"):
        assert {each.key for each in load_dispersions(name)} <= {each.key for each in QUANTITIES}


@pytest.mark.parametrize(
    "quantity", [each for each in QUANTITIES if each.tunes], ids=lambda each: each.key
)
def test_what_is_dispersed_tunes_the_filter(quantity: Quantity, tmp_path: Path) -> None:
    tuned = told(dispersed(quantity, tmp_path))
    usual = told(dispersed(Quantity("truth.lidar.dropout"), tmp_path))
    changed = {
        field.name
        for field in dc.fields(ExpectedErrors)
        if getattr(tuned, field.name) != getattr(usual, field.name)
    }
    if quantity.tunes == "relief_rms_m":  # How wide they are says both.
        changed -= {"relief_correlation_m"}
    # The usual attitude error is generous already.
    assert changed == {quantity.tunes} - ({"attitude_deg"} if not changed else set())


@pytest.mark.slow
@pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda each: each.key)
def test_what_is_dispersed_is_bounded_or_refused(quantity: Quantity, tmp_path: Path) -> None:
    changes = {"assurance": {}, "navigation": {"_tag": "!TrueState"}}
    section = quantity.key.partition(".")[0]
    if section in ("disturbance", "force_noise", "kicks"):
        # Drawn values make a section, whose other values have effects of their own.
        nothing = {"disturbance": "max_relative_magnitude", "force_noise": "std_n"}
        other = f"{section}.{nothing.get(section, 'velocity_std_m_s')}"
        changes |= {} if other == quantity.key else {other: 0.0}
    if quantity.bounds is None:
        with pytest.raises(InputError, match=r"assurance\.bounds"):
            dispersed(quantity, tmp_path, **changes)
        return
    assurance = dispersed(quantity, tmp_path, **changes).belief.assurance
    assert assurance is not None
    assert isinstance(assurance.bounds, AssuranceBounds)
    moved = {name for name, value in dc.asdict(assurance.bounds).items() if value}
    assert quantity.bounds in moved if quantity.bounds else not moved
