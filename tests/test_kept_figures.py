"""The figures of speed that `make bench` keeps: one entry for each version and machine."""

import json
from pathlib import Path

import pytest
from scripts import load_script


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PROXOPS_BENCH_RESULTS", str(tmp_path / "results.json"))
    return tmp_path / "results.json"


def test_figures_of_one_version_are_one_entry(file: Path) -> None:
    kept = load_script("benchmarks/_kept.py")
    kept.keep({"a frame (ms)": 0.123456, "a step (ms)": 2.0})
    kept.keep({"a step (ms)": 1.0, "a flight (s)": 3.0})
    [entry] = json.loads(file.read_text())
    assert entry["figures"] == {"a frame (ms)": 0.123, "a step (ms)": 1.0, "a flight (s)": 3.0}
    assert entry["version"] == kept.metadata.version("proxops")
    assert entry["packages"]["numpy"] == kept.metadata.version("numpy")


def test_other_versions_stay(file: Path) -> None:
    old = {"version": "0.1.0", "machine": "a", "packages": {}, "figures": {"a step (ms)": 9.0}}
    file.write_text(json.dumps([old]))
    load_script("benchmarks/_kept.py").keep({"a step (ms)": 1.0})
    first, second = json.loads(file.read_text())
    assert first == old
    assert second["figures"] == {"a step (ms)": 1.0}


def test_nothing_is_kept_unless_a_file_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PROXOPS_BENCH_RESULTS", raising=False)
    monkeypatch.chdir(tmp_path)
    load_script("benchmarks/_kept.py").keep({"a step (ms)": 1.0})
    assert list(tmp_path.iterdir()) == []
