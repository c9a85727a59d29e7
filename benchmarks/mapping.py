"""Surveys of a body from many seeds: how far map, GM, pole and rate are from the truth.

    python benchmarks/mapping.py kleopatra --seeds 31000:31020 --out out/mapping

A row for each survey, then medians and the worst. A survey that the folder has is not flown again.
Tune on seeds below 10,000 only.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import dataclasses as dc
import json
from pathlib import Path

import numpy as np

from proxops.diagrams.scenario import SurveyConfig, load_body, load_scenario
from proxops.diagrams.surveys import run_survey
from proxops.systems.common import InputError

COLUMNS = {
    "map_rms_of_size": "map rms / size",
    "within_3_sigma": "within 3 sigma",
    "gravity_error": "GM",
    "pole_error_deg": "pole (deg)",
    "rate_error": "rate",
    "delta_v_m_s": "delta-v (m/s)",
    "orbit_delta_v_m_s": "in orbit (m/s)",
    "keep_out_entries": "entries",
    "hours": "hours",
    "flight_s": "flight (s)",
    "estimation_s": "estimation (s)",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--seeds", default="31000:31020")
    parser.add_argument("--hours", type=float, default=20.0)
    parser.add_argument("--dispersions", default="first_look")
    parser.add_argument("--out", type=Path, default=Path("out/mapping"))
    asked = parser.parse_args()
    first, last = map(int, asked.seeds.split(":"))
    rows, body = [], load_scenario(asked.scenario).body
    print("seed", *COLUMNS.values(), sep=" | ")
    for seed in range(first, last):
        folder = asked.out / f"{Path(body).stem}-{seed}"
        made = folder / "survey.json"
        if not made.is_file():
            scenario = load_scenario(asked.scenario, dispersions=asked.dispersions)
            scenario.transit.seed = seed
            scenario = dc.replace(scenario, task=SurveyConfig(hours=asked.hours))
            try:
                run_survey(scenario, load_body(scenario.body), folder)
            except InputError as error:
                print(seed, error, sep=" | ", flush=True)
                continue
        figures = json.loads(made.read_text())
        rows.append([abs(figures[name]) for name in COLUMNS])
        print(seed, *(f"{figures[name]:.4g}" for name in COLUMNS), sep=" | ", flush=True)
    if rows:
        for name, value in (("median", np.median(rows, axis=0)), ("worst", np.max(rows, axis=0))):
            print(name, *(f"{each:.4g}" for each in value), sep=" | ")


if __name__ == "__main__":
    main()
