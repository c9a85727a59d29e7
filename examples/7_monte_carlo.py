"""A Monte Carlo campaign: eight flights on all cores, each in a world of its own.

    python examples/7_monte_carlo.py

Each flight is stored when it ends, so a campaign that was interrupted goes on when it is run again.
`proxops evaluate` does this for several controllers, and writes a report.
"""

from pathlib import Path

import matplotlib.pyplot as plt

from proxops.diagrams.flight import run_campaign, transit_flights
from proxops.diagrams.scenario import load_scenario
from proxops.studies.figures import exact_interval

COUNT = 8


def main() -> None:
    scenario = load_scenario(dispersions="after_survey", log_ranges=False)
    flights = transit_flights(scenario, "hybrid", seed=77, count=COUNT)
    rows = run_campaign(flights, Path("monte_carlo"))
    good = sum(bool(row.get("success")) for row in rows)
    low, high = exact_interval(good, COUNT)
    print(f"{good} of {COUNT} succeed: {100 * low:.1f} to {100 * high:.1f} % at 95 % confidence")
    plt.hist([row["delta_v_m_s"] for row in rows if row.get("success")])
    plt.xlabel("Δv (m/s)")
    plt.ylabel("flights")
    plt.savefig("monte_carlo.png")


if __name__ == "__main__":  # The processes of a campaign import this file.
    main()
