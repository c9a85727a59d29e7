"""Shows what a flight costs: time and size of the log by controller, control step, memory, import.

With `--batch` it shows instead the steps a second of that many transits at once (`TransitBatch`). A
simple pilot flies them: a spring and a damper. Where the body blocks the way, most end in it, and
others begin.

Each controller flies transits of the standard set in this process, on one thread, with the lidar
logged at every step, and then again in a world that is drawn from `after_survey`. The MPC's step
stands beside the paper's. With `--gravity table` all on board, and the world as believed, have the
field from its table. `--spacecraft` flies a rigid one, of this model; `--layouts` shows what each
layout of thrusters takes. `--sky` shows what a body that tumbles, two moons and sunlight cost, all
together. Run it on a machine that does nothing else:

    python benchmarks/flight.py [--transits 3] [--gravity table] [--spacecraft smallsat]
    python benchmarks/flight.py --batch 512 [--steps 300]
    python benchmarks/flight.py --layouts
    python benchmarks/flight.py --sky [--transits 3]
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _kept import keep
from _tables import Shown

from proxops.assets import ASSETS
from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import (
    Body,
    draw_world,
    load_body,
    load_scenario,
    load_spacecraft,
    make_true_body,
)
from proxops.systems.attitude import AllocationProgram
from proxops.systems.common import spread_directions
from proxops.systems.shapes import ray_caster

PAPER_MPC_S = 0.473
CONTROLLERS = ("mpc", "policy", "hybrid")
DISPERSIONS = ("after_survey", "after_survey_rigid")
# Kleopatra's, as docs/method/gravity.md has them.
SKY = """
rotation: !TorqueFreeSpin {}
moons:
  - {mass_kg: 1.29e15, radius_m: 4.5e3, semi_major_axis_m: 656e3, period_s: 237.2e3}
  - {mass_kg: 6.1e14, radius_m: 3.5e3, semi_major_axis_m: 499e3, period_s: 157.5e3}
"""


def import_time() -> float:
    """Median wall time in s of `import proxops.systems` in a new process, Python's start less."""

    def run(code: str) -> float:
        started = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        return time.perf_counter() - started

    full = [run("import proxops.systems") for _ in range(5)]
    bare = [run("pass") for _ in range(5)]
    return statistics.median(full) - statistics.median(bare)


def flight_times(controller: str, count: int, body: Body, chosen: dict) -> np.ndarray:
    """Processor time (count, 2) in s of flights: as believed, and in a drawn world.

    Making the true body is a part of it; loading the map is not.
    """
    times = np.zeros((count, 2))
    for index in range(count):
        for k, dispersions in enumerate((None, DISPERSIONS["spacecraft" in chosen])):
            changes = {"transit.index": index, "dispersions": dispersions, "log_ranges": False}
            started = time.process_time()
            fly(load_scenario(None, changes | chosen), controller, body=body)
            times[index, k] = time.process_time() - started
    return times


def body_times(count: int, body: Body) -> list[float]:
    """Wall times in s of making true bodies, with their ray casters."""
    times = []
    for index in range(count):
        wanted = load_scenario(None, {"transit.index": index, "dispersions": "before_survey"})
        truth = draw_world(wanted, body).truth
        started = time.perf_counter()
        ray_caster(make_true_body(body, truth).shape)
        times.append(time.perf_counter() - started)
    return times


def print_sky(count: int) -> None:
    """Processor time of flights with all of it, over that of the same flights without."""
    lines = {}
    with tempfile.TemporaryDirectory() as folder:
        path, shipped = Path(folder) / "sky.yaml", ASSETS / "kleopatra"
        text = (shipped / "kleopatra.yaml").read_text()
        path.write_text(text.replace("mesh: ", f"mesh: {shipped}/", 1) + SKY)
        changes = {}, {"body": str(path), "sunlight": {}}
        ways = [(each, load_body(each.get("body", "kleopatra"))) for each in changes]
        for controller in CONTROLLERS:
            lines[controller] = []
            for craft in ({}, {"spacecraft": {"_tag": "!RigidBody", "model": "smallsat"}}):
                times = np.zeros((count + 1, 2))
                for index in range(count + 1):  # The first loads what is compiled.
                    for k, (each, body) in enumerate(ways):
                        scenario = load_scenario(None, {"transit.index": index} | each | craft)
                        started = time.process_time()
                        log = fly(scenario, controller, body=body)
                        span = float(log.dataset["time"].values[-1])
                        times[index, k] = (time.process_time() - started) / span
                plain, all_of_it = 1e3 * times[1:].mean(axis=0)
                lines[controller] += [f"{all_of_it:.2f}", f"{all_of_it / plain:.2f} x"]
    headings = "point (ms/s)", "over without", "smallsat (ms/s)", "over without"
    Shown("ms for each second flown: tumbling, two moons, sunlight", headings, lines).show()


def print_layouts() -> None:
    """What each layout that ships takes for a small force, in directions evenly all around."""
    lines = {}
    for folder in sorted((ASSETS / "spacecraft").iterdir()):
        model = load_spacecraft(folder.name)
        program, wrenches = AllocationProgram(model.thrusters), model.thrusters.wrenches()
        force = 0.1 * model.config.thrust_limit_n
        sums = [
            model.thrusters.forces @ program.solve(force * way, np.zeros(3), wrenches).shares
            for way in spread_directions(500)
        ]
        along = force * np.abs(spread_directions(500)).sum(axis=1)
        lines[folder.name] = [
            str(model.thrusters.count),
            f"{np.sum(sums) / np.sum(along):.3f}",
            f"{np.max(sums / along):.3f}",
        ]
    headings = "thrusters", "propellant, mean", "greatest"
    Shown("over that of thrusters along each axis", headings, lines).show()


def steps_a_second(observation: str, transits: int, steps: int) -> float:
    """Environment steps for each second of processor time."""
    import gymnasium

    import proxops.training.environment  # noqa: F401  (registers it)

    mode = "vector_entry_point"
    many = gymnasium.make_vec(
        "proxops/Transit-v0", transits, vectorization_mode=mode, observation=observation
    )
    seen, _ = many.reset(seed=1)
    actions = np.zeros((transits, 3))
    began = 0.0
    for k in range(steps + 1):
        if k == 1:  # The first loads what is compiled.
            began = time.process_time()
        if observation == "state":
            way, velocity = seen["goal"] - seen["state"][:, :3], seen["state"][:, 3:]
            actions = np.clip(2e-4 * way - 0.15 * velocity, -1.0, 1.0)
        seen = many.step(actions)[0]
    return steps * transits / (time.process_time() - began)


def print_batch(transits: int, steps: int) -> None:
    """Steps a second of the batch of transits for learners (`TransitBatch`), on one core."""
    lines = {}
    for observation, share in (("state", 1.0), ("lidar", 0.1)):
        found = steps_a_second(observation, transits, max(1, round(share * steps)))
        keep({f"steps a second of a batch of transits, {observation}": found})
        lines[observation] = [f"{found:,.0f}"]
    Shown(f"{transits} transits at once, one core", ["steps a second"], lines).show()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transits", type=int, default=3)
    parser.add_argument("--gravity", choices=("exact", "table"), default="exact")
    parser.add_argument("--spacecraft", metavar="MODEL", help="a rigid one; default: a point")
    parser.add_argument("--layouts", action="store_true", help="the propellant of each, no more")
    parser.add_argument("--sky", action="store_true", help="what tumbling, moons and the Sun cost")
    parser.add_argument("--batch", type=int, default=0, help="transits at once")
    parser.add_argument("--steps", type=int, default=300, help="of each of these")
    asked = parser.parse_args()
    if asked.batch:
        return print_batch(asked.batch, asked.steps)
    if asked.layouts:
        return print_layouts()
    if asked.sky:
        return print_sky(asked.transits)
    count, chosen = asked.transits, {"gravity": asked.gravity}
    where = "" if asked.gravity == "exact" else ", gravity: table"
    if asked.spacecraft:
        chosen["spacecraft"] = {"_tag": "!RigidBody", "model": asked.spacecraft}
        where += f", {asked.spacecraft}"
    peak, costs = 0.0, {}
    step, body = np.zeros(0), load_body("kleopatra").with_gravity(asked.gravity)
    for controller in CONTROLLERS:
        # Warm up.
        short = {"arrival.deadline_s": 100.0, "arrival.dwell_s": 10.0}
        fly(load_scenario(None, short | chosen), controller, body=body)
        walls, spans, sizes = [], [], []
        for index in range(count):
            log = fly(load_scenario(None, {"transit.index": index} | chosen), controller, body=body)
            if controller == "mpc":
                step = np.append(step, log.dataset["solve_time"].values)
                peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            spans.append(float(log.dataset["time"].values[-1]))
            started = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "flight.nc"
                log.to_netcdf(path)
                sizes.append(path.stat().st_size)
            walls.append(log.summary["wall_s"] + time.perf_counter() - started)
        keep({f"a flight by {controller}{where}, over real time": np.sum(spans) / np.sum(walls)})
        plain, drawn = flight_times(controller, count, body, chosen).sum(axis=0)
        costs[controller] = [
            f"{np.mean(walls):.2f}",
            f"{np.sum(spans) / np.sum(walls):.0f} x",
            f"{np.mean(sizes) / 1e6:.1f}",
            f"{drawn / plain:.2f} x",
        ]
    headings = "one core (s)", "against real time", "log (MB)", "drawn world over plain"
    Shown(f"a transit, mean of {count} of seed 10000{where}", headings, costs).show()
    median, p99 = np.nanmedian(step), np.nanpercentile(step, 99)
    made = body_times(max(count, 5), body)
    figures = {
        "MPC control step, median": f"{1e3 * median:.2f} ms",
        "MPC control step, 99th percentile": f"{1e3 * p99:.2f} ms",
        "the paper's MPC step over ours": f"{PAPER_MPC_S / median:.0f} x",
        "peak memory of these flights": f"{peak:.0f} MiB",
        "making a true body, median and greatest": (
            f"{statistics.median(made):.2f} s, {max(made):.2f} s"
        ),
        "import proxops.systems": f"{import_time():.2f} s",
    }
    lines = {name: [value] for name, value in figures.items()}
    Shown(f"the MPC, {step.size} control steps", ["value"], lines).show()
    return None


if __name__ == "__main__":
    main()
