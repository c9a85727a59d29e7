"""`proxops fly`: flies one transit and writes its log, its figures of merit and a replay."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import json
import shlex
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.framework import Context, Diagram

from proxops.cli.common import (
    AsJson,
    DispersionsName,
    ScenarioChanges,
    ScenarioFile,
    check_folder,
    complete_controllers,
    print_remarks,
    print_rows,
    status,
    typed_command,
    with_dispersions,
    work_bar,
)
from proxops.cli.survey import report_survey
from proxops.diagrams.flight import WITH_BUNDLE, fly, mended_map_of_flight
from proxops.diagrams.logs import (
    FlightLog,
    differences,
    fallback_steps,
    length_text,
    three_digits,
    why_never_known,
)
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.scenario import (
    Body,
    MissionConfig,
    Scenario,
    load_body,
    load_scenario,
)
from proxops.systems.common import InputError, compiling_told, make_folder, write_json
from proxops.systems.navigation import MendedMap, save_mended_map

# Share of the steps below which a navigation within three standard deviations is overconfident.
_CONSISTENT = 0.9


def fly_command(
    scenario: ScenarioFile = None,
    controller: Annotated[
        str | None,
        typer.Option(
            help="mpc[:BUNDLE] (the default is mpc), policy[:BUNDLE], hybrid[:BUNDLE], "
            "pd[:BUNDLE], zero, or MODULE:FACTORY for your own controller. BUNDLE is a folder, or "
            "end-to-end: the pilot for Kleopatra that ships.",
            autocompletion=complete_controllers,
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the set of transits.")] = None,
    transit: Annotated[int | None, typer.Option(help="Number of the transit in the set.")] = None,
    settings: ScenarioChanges = None,
    dispersions: DispersionsName = None,
    out: Annotated[Path, typer.Option(help="Folder for flight.nc, summary.json, replay.html.")] = (
        Path("out/flight")
    ),
    log_file: Annotated[
        Path | None, typer.Option("--from", help="Repeat the flight of this flight.nc.")
    ] = None,
    mended_map: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.obj",
            help="Write the map with what the navigation learned of its surface; "
            "--set navigation.map=FILE.obj flies with it.",
        ),
    ] = None,
    meshcat: Annotated[
        bool, typer.Option("--meshcat", help="Show the flight live in a browser.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Fly one transit, touch-and-go or mission; write flight.nc, summary.json and replay.html.

    A mission surveys its body, writes what `proxops survey` writes, and flies on with flight.yaml,
    by the hybrid unless told otherwise. Run again, it does not fly its survey twice.

    Examples:

      proxops fly

      proxops fly bennu --controller hybrid

      proxops fly bennu_mission --seed 34000 --out out/mission

      proxops fly --transit 1 --set spacecraft.mass_kg=120 --out out/heavy

      proxops fly --dispersions after_survey --controller policy --seed 10000

      proxops fly --dispersions after_survey --mended-map out/mended.obj

      proxops fly --from out/heavy/flight.nc --out out/again
    """
    check_folder(out)
    keep = _MapKeeper(mended_map)
    server, original, whole = _meshcat() if meshcat else None, None, None
    if log_file is not None:
        _refuse_settings(scenario, settings or None, seed, transit, dispersions)
        original = _log_to_repeat(log_file, controller, out)
        wanted, body, true_body = original.scenario, original.body, original.true_body
        controller = original.dataset.attrs["controller"]
    else:
        wanted = _scenario(scenario, with_dispersions(settings, dispersions), seed, transit)
        wanted, controller, whole = _begun(wanted, controller, out)
        body, true_body = load_body(wanted.body), None
        wanted = _without_making_a_table(wanted, body)
        print_remarks(wanted, body)
    with work_bar("flying") as progress, compiling_told(progress):
        log = fly(
            wanted, controller, meshcat=server, progress=progress, body=body, true_body=true_body,
            finished=keep,
        )  # fmt: skip
    _save(log if whole is None else whole(log), out, as_json)
    keep.save()
    if original is not None:
        _compare(original, log, log_file)
    if server is not None:
        _wait_for_ctrl_c()


def _compare(original: FlightLog, log: FlightLog, log_file: Path | None) -> None:
    if changed := differences(original, log):
        status.print(f"The flight differs from its log in: {', '.join(changed)}")
        raise typer.Exit(1)
    status.print(f"The flight repeats {log_file} bit for bit.")


def _refuse_settings(*given: object) -> None:
    if any(value is not None for value in given):
        raise InputError("--from repeats a flight as it was: give no scenario or settings")


def _begun(
    scenario: Scenario, controller: str | None, out: Path
) -> tuple[Scenario, str, Callable[[FlightLog], FlightLog] | None]:
    """The scenario to fly, by whom, and what makes the log of a mission whole.

    Of a mission, whose survey is flown here, the scenario is that of what comes after it.
    """
    if not isinstance(scenario.task, MissionConfig):
        return scenario, controller or "mpc", None
    # matplotlib is slow to import.
    from proxops.diagrams.surveys import begin_mission, whole_log

    with work_bar("surveying") as progress, compiling_told(progress):
        surveyed, after = begin_mission(scenario, load_body(scenario.body), out, progress)
        rows = report_survey(out, scenario, surveyed)
    status.print("Survey: its report is report.html")
    for name, text in rows:
        status.print(f"  {name}: {text}")
    return after, controller or "hybrid", partial(whole_log, surveyed)


def _wait_for_ctrl_c() -> None:
    status.print("Press Ctrl-C to end.")
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            time.sleep(1.0)


def _tell_of_doubts(summary: dict[str, Any]) -> None:
    consistent = summary.get("navigation_consistent", 1.0)
    if consistent < _CONSISTENT:
        status.print(
            f"Note: the navigation was overconfident: within its 3 sigma in {consistent:.0%} of "
            "the steps. An error of the world is larger than it expects, or of another kind: see "
            "navigation.expected, and docs/method/truth.md."
        )
    assured = summary.get("assured_share", 1.0)
    if assured < _CONSISTENT:
        status.print(
            f"Note: runtime assurance judged {assured:.0%} of the steps. In the others the errors "
            "of the state were too great for it, and commands passed: raise "
            "spacecraft.speed_limit_m_s, or shorten control_period_s."
        )


def _meshcat() -> Meshcat:
    # Its usual host is every network interface.
    server = Meshcat(MeshcatParams(host="localhost"))
    status.print(f"Meshcat is at {server.web_url()}")
    return server


def _scenario(
    path: Path | None, changes: list[str], seed: int | None, transit: int | None
) -> Scenario:
    ends = {"transit.seed": seed, "transit.index": transit}
    chosen = [f"{key}={value}" for key, value in ends.items() if value is not None]
    wanted = load_scenario(path, [*changes, *chosen])
    if wanted.transit.start_m is not None and chosen:
        raise InputError(
            "the scenario gives a start and a goal: leave out either --seed and --transit, or "
            "transit.start_m and transit.goal_m"
        )
    return wanted


def _without_making_a_table(scenario: Scenario, body: Body) -> Scenario:
    """The scenario; in exact gravity, if a table would have to be made for one flight."""
    if scenario.gravity != "table" or body.gravity_table_is_kept:
        return scenario
    status.print(
        f"This machine has no gravity table of {body.config.name} yet, so the flight takes "
        "exact gravity; its log says so. The first campaign (proxops evaluate) makes the table."
    )
    return dc.replace(scenario, gravity="exact")


class _MapKeeper:
    """Keeps the mended map of a flight until its log is written, if a file for it was named."""

    def __init__(self, path: Path | None):
        self._path = path
        self._found: MendedMap | InputError | None = None
        if path is not None:
            check_folder(path.parent, "--mended-map")
            if path.suffix != ".obj":
                raise InputError(f"--mended-map writes an OBJ file: name FILE.obj, not {path}")
            if path.exists() and not path.with_suffix(".npz").exists():
                raise InputError(f"--mended-map {path}: this file is no mended map: name another")

    def __call__(self, diagram: Diagram, context: Context) -> None:
        if self._path is None:
            return
        try:
            self._found = mended_map_of_flight(diagram, context)
        except InputError as error:
            self._found = error  # The flight is not lost.

    def save(self) -> None:
        """Writes the map.

        Raises:
          InputError: there is none.
        """
        if isinstance(self._found, InputError):
            raise self._found
        if self._path is not None and self._found is not None:
            make_folder(self._path.parent)
            save_mended_map(self._found, self._path)
            low, middle, high = np.percentile(self._found.deviations, [5.0, 50.0, 95.0])
            status.print(
                f"Wrote {self._path}, and what may still be wrong with it in "
                f"{self._path.with_suffix('.npz').name}: one standard deviation of a vertex is "
                f"{middle:.3g} m (median; {low:.3g} to {high:.3g} m for 90 % of them)"
            )


def _log_to_repeat(log_file: Path, named: str | None, out: Path) -> FlightLog:
    """Loads a log, and checks that its flight may be repeated into a folder.

    A controller MODULE:FACTORY flies again only if the user names it: a log may come from a
    stranger, and flying MODULE:FACTORY imports and runs a module.

    Raises:
      InputError: the folder holds the log; the user names another controller than the log's; the
        log's controller is MODULE:FACTORY and the user names none; or it has no name by which it
        can be made.
    """
    if (out / "flight.nc").resolve() == log_file.resolve():
        raise InputError(f"--out {out} holds the log that is repeated: give another folder")
    log = FlightLog.load(log_file)
    flown = str(log.dataset.attrs["controller"])
    if named is not None and named != flown:
        raise InputError(
            f"--from repeats the flight of controller {flown!r}: give no other --controller"
        )
    kind, colon, _ = flown.partition(":")
    if not colon and kind not in (*WITH_BUNDLE, "zero"):
        raise InputError(
            f"the log's controller, {flown}, is a System that was made in Python: repeat the "
            "flight there, with fly(log.scenario, YourSystem(), body=log.body, "
            "true_body=log.true_body)"
        )
    if named is None and colon and kind not in WITH_BUNDLE:
        raise InputError(
            f"the log names the controller {flown!r}, a module that would be imported and run: "
            f"if you trust it, add --controller {shlex.quote(flown)}"
        )
    return log


def _save(log: FlightLog, out: Path, as_json: bool) -> None:
    log.dataset.attrs["command"] = typed_command()
    summary = log.summary
    make_folder(out)
    (out / "replay.html").unlink(missing_ok=True)  # It may be of another flight.
    log.to_netcdf(out / "flight.nc")
    write_json(out / "summary.json", summary)
    write_replay(log, out / "replay.html")
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    else:
        flown = summary["controller"]
        if "touched" in summary:
            # Its own controller has the name `mpc`, too.
            flown = "touch-and-go" if flown == "mpc" else f"touch-and-go, {flown}"
        title = f"{log.body.config.name}, {flown}"
        print_rows(title, _first_rows(log, summary), _other_rows(log, summary))
    status.print(f"Wrote flight.nc, summary.json and replay.html in {out}")
    _tell_of_doubts(summary)


def _first_rows(log: FlightLog, summary: dict[str, Any]) -> list[tuple[str, str, bool | None]]:
    """What a stranger asks first: at most ten rows of names, values, and whether they are good."""
    arrival = summary["arrival_time_s"]
    success, entries = summary["success"], summary["keep_out_violations"]
    rows: list[tuple[str, str, bool | None]] = [
        ("success", "yes" if success else "no", success),
        ("collision", "yes" if summary["collided"] else "no", not summary["collided"]),
    ]
    if "touched" not in summary:
        rows += [
            ("entries into the keep-out ellipsoid", str(entries), entries == 0),
            (
                "least clearance of the keep-out ellipsoid",
                length_text(summary["min_clearance_m"]),
                None,
            ),
        ]
    flown, wall = float(log.dataset["time"].values[-1]), summary["wall_s"]
    rows += [
        ("arrival", "never" if arrival is None else f"{arrival:.0f} s", None),
        (
            f"distance from the {_end(summary)} at the end",
            length_text(summary["terminal_position_error_m"]),
            None,
        ),
        (
            "Δv" if arrival is None else "Δv until arrival",
            f"{three_digits(summary['delta_v_m_s'])} m/s",
            None,
        ),
    ]
    rows += [(*row, None) for row in _error(summary, "navigation")]
    rows.append(
        ("computed", f"{flown:.0f} s in {wall:.1f} s, {flown / wall:.0f} x real time", None)
    )
    return rows


def _other_rows(log: FlightLog, summary: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("transit", _transit_text(log.scenario)),
        *([("values drawn", str(len(summary["dispersed"])))] if summary["dispersed"] else []),
        *(_touch(summary) if "touched" in summary else []),
        (
            f"speed against the {_end(summary)} at the end",
            f"{three_digits(summary['terminal_speed_m_s'])} m/s",
        ),
        ("Δv of the hold", f"{three_digits(summary['hold_delta_v_m_s'])} m/s"),
        ("control steps", str(summary["steps"])),
    ]
    if summary["mpc_solves"]:
        rows.append(("times that the MPC was solved", str(summary["mpc_solves"])))
    if summary["control_ms_median"] is not None:
        median, p99 = summary["control_ms_median"], summary["control_ms_p99"]
        who = "MPC" if summary["mpc_solves"] else "policy"
        if "agreement" in log.dataset:
            who = "hybrid"
        rows.append((f"{who} step, median and p99", f"{median:.2f} ms, {p99:.2f} ms"))
    if summary["policy_share"] > 0.0 and summary["policy_share_to_arrival"] is not None:
        shares = [100.0 * summary[name] for name in ("policy_share", "policy_share_to_arrival")]
        told = f"{shares[0]:.1f} %, {shares[1]:.1f} %"
        rows.append(("steps flown by the policy, all and to arrival", told))
    rows += _error(summary, "estimate")
    if "navigation_following" in summary:
        followed = f"{summary['navigation_following']:.1%}"
        rows.append(("steps at which the navigation knew where it is", followed))
        rows += why_never_known(log.dataset, log.scenario, log.true_body.shape.vertices)
    if "navigation_consistent" in summary:
        consistent = f"{summary['navigation_consistent']:.1%}"
        rows.append(("navigation within its 3 sigma, worst of 9 components", consistent))
    rows += _attitude(summary)
    if "interventions" in summary:
        counts = f"{summary['interventions']}, {summary['interventions_keep_out']}"
        rows.append(("interventions of runtime assurance, all and to keep out", counts))
    if "assured_share" in summary:
        rows.append(("steps that runtime assurance judged", f"{summary['assured_share']:.1%}"))
    rows += [(f"steps {what}", str(count)) for what, count in fallback_steps(log.dataset).items()]
    return rows


def _end(summary: dict[str, Any]) -> str:
    """What the flight's end is compared with."""
    return "orbit" if "parked_m" in summary else "goal"


def _touch(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows of a table on a touch-and-go."""
    aborts = ", ".join(summary["touch_aborts"]) or "none"
    parts = f"{summary['touch_parts_force_n']:.0f} N"
    rows = [("descents, aborts", f"{summary['touch_tries']}, {aborts}")]
    share, parked = summary.get("touch_policy_share"), "parked_m" in summary
    if not summary["touched"]:
        return [*rows, ("touch", "none"), ("force on bus and panels", parts)]
    speeds = [f"{100.0 * summary[f'touch_{way}_m_s']:.2f} cm/s" for way in ("down", "across")]
    rates = [
        f"{summary[name]:.3f} deg/s" for name in ("touch_rate_deg_s", "touch_later_rate_deg_s")
    ]
    energies = [f"{summary[name]:.2f} J" for name in ("touch_energy_j", "touch_energy_left_j")]
    return [
        *rows,
        ("touch", f"{summary['touch_time_s']:.0f} s, for {summary['touch_duration_s']:.1f} s"),
        ("miss of the site", length_text(summary["touch_miss_m"])),
        ("speed down and across", ", ".join(speeds)),
        ("arm off the normal", f"{summary['touch_tilt_deg']:.2f} deg"),
        ("rate at the touch and 10 s later", ", ".join(rates)),
        ("peak force on the head", f"{summary['touch_force_n']:.0f} N"),
        ("stroke of the arm", f"{100.0 * summary['touch_stroke_m']:.1f} cm"),
        ("energy at the touch, and left", ", ".join(energies)),
        ("force on bus and panels", parts),
        ("times that it came back to the ground", str(summary["touch_again"])),
        *([("descent flown by the policy", f"{share:.0%}")] if share else []),
        *(
            [("parked in orbit, from the centre", length_text(summary["parked_m"]))]
            if parked
            else []
        ),
    ]


def _attitude(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows of a table on the attitude of a rigid spacecraft; none for a point."""
    rows = []
    if "pointing_error_deg_median" in summary:
        median, p99 = (summary[f"pointing_error_deg_{part}"] for part in ("median", "p99"))
        rows.append(("pointing error, median and p99", f"{median:.3f} deg, {p99:.3f} deg"))
    if "wheel_load" in summary:
        rows.append(("greatest momentum of a wheel, of its limit", f"{summary['wheel_load']:.0%}"))
    if summary.get("thrusters_failed"):
        rows.append(("thrusters found to have failed", str(summary["thrusters_failed"])[1:-1]))
    if summary.get("lost_directions"):
        rows.append(("no force is left along", ", ".join(summary["lost_directions"])))
    return rows


def _error(summary: dict[str, Any], whose: str) -> list[tuple[str, str]]:
    """The line of a position's error, if the flight has one."""
    names = [f"{whose}_position_error_m_{part}" for part in ("median", "p95")]
    if names[0] not in summary:
        return []
    error = ", ".join(length_text(summary[name]) for name in names)
    return [(f"position error of the {whose}, median and p95", error)]


def _transit_text(scenario: Scenario) -> str:
    transit = scenario.transit
    # Where a world was drawn, the transit was, too, and stands beside its seed.
    if transit.start_m is None or scenario.dispersed:
        return f"{transit.index} of seed {transit.seed}"
    return "from transit.start_m" + ("" if transit.goal_m is None else " to transit.goal_m")
