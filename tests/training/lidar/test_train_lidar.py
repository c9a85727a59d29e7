"""`proxops train-lidar --quick`, and flights with the lidar that it makes."""

import json
from pathlib import Path

import numpy as np
import pytest
from ball_lidar import write_ball_bundle
from commands import proxops
from short_flights import SHORT, kleopatra

from proxops.diagrams.flight import fly, transit_flights
from proxops.diagrams.logs.flight_log import FlightLog, differences
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems.lidar.lidar_bundle import LidarBundle


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lidar") / "out"
    assert proxops("train-lidar", "--quick", "--out", folder) == 0
    return folder


def names_bundle(folder: Path) -> Path:
    """A scenario file that names the bundle `out/bundle` beside it."""
    path = folder / "learned.yaml"
    path.write_text("lidar: !LearnedLidar {bundle: out/bundle, noise_std_m: 20}\n")
    return path


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    """Its bundle is not trained, but the closed form of a ball."""
    write_ball_bundle(tmp_path / "out" / "bundle", kleopatra().shape.sha256)
    return names_bundle(tmp_path)


@pytest.mark.slow
def test_learns_even_in_seconds(out: Path):
    rows = (out / "curves" / "ray_network.csv").read_text().splitlines()[1:]
    losses = [float(row.split(",")[2]) for row in rows]
    assert losses[-1] < 0.7 * losses[0]
    methods = json.loads((out / "report.json").read_text())["methods"]
    ours = methods["ray network (ours)"]["all"]
    assert ours["mask_iou"] > 0.88
    for name in ("nearest grid frame", "inverse distance, 8 frames", "frame network (paper)"):
        assert ours["mask_iou"] > methods[name]["all"]["mask_iou"]


@pytest.mark.slow
def test_report(out: Path):
    report = json.loads((out / "report.json").read_text())
    assert report["bundle_sha256"] == LidarBundle.load(out / "bundle").sha256
    paper = LidarBundle.load(out / "paper_bundle")
    assert (paper.kind, paper.sha256) == ("frame network", report["paper_bundle_sha256"])
    assert report["shape_sha256"] == kleopatra().shape.sha256
    assert report["ray_caster_frame_ms"] > 0.0
    for figures in report["methods"].values():
        assert {"all", "near_silhouettes", "bands", "frame_ms"} == set(figures)
        hits = sum(band["true_hits"] for band in figures["bands"])
        assert hits == figures["all"]["true_hits"] > 1000
    text = (out / "report.md").read_text()
    for name in [*report["methods"], "ray-caster", "not met", "frames.png"]:
        assert name in text


# --- flying with it -------------------------------------------------------------------------------


@pytest.mark.slow
def test_flies_and_repeats(out: Path, tmp_path: Path):
    scenario = load_scenario(names_bundle(out.parent), SHORT, on_true_state=True)
    log = fly(scenario)
    assert log.summary["success"]
    assert log.dataset.attrs["lidar_sha256"] == LidarBundle.load(out / "bundle").sha256
    log.to_netcdf(tmp_path / "flight.nc")
    assert proxops("fly", "--from", tmp_path / "flight.nc", "--out", tmp_path / "again") == 0
    assert differences(log, FlightLog.load(tmp_path / "again" / "flight.nc")) == []
    ranges = log.dataset["ranges"].values
    cast = load_scenario(None, SHORT | {"lidar.noise_std_m": 20.0}, on_true_state=True)
    real = fly(cast).dataset["ranges"].values
    both = np.isfinite(ranges) & np.isfinite(real)
    # End-on, all is silhouette: a network of seconds sees the body, not its edges.
    assert both.sum() > 0.6 * (np.isfinite(ranges) | np.isfinite(real)).sum()
    assert np.median(np.abs(ranges[both] - real[both])) < 10e3
    assert "lidar_sha256" not in fly(load_scenario(None, SHORT)).dataset.attrs


def test_a_campaign_knows_its_bundle(scenario_file: Path):
    provenance = transit_flights(load_scenario(scenario_file), "mpc", 5, 1)[0].provenance
    bundle = scenario_file.parent / "out" / "bundle"
    assert provenance.files["lidar"] == [LidarBundle.load(bundle).sha256]
    assert transit_flights(load_scenario(), "mpc", 5, 1)[0].provenance.files == {}
