"""Makes the panel below a replay: numbers, a strip of controllers over time, a legend, cameras."""

from __future__ import annotations

import html
import itertools
import json
import math
import re
from typing import Any

import numpy as np
from pydrake.geometry import Rgba

from proxops.diagrams.logs import REASONS, FlightLog, all_flown_by, flown_by, legend_of
from proxops.diagrams.meshcat.camera_views import View
from proxops.diagrams.meshcat.meshcat_scene import (
    BELIEVED_AXIS,
    GOAL,
    HULL,
    MAP,
    RETURN_USES,
    RETURNS,
    THRUST,
    TRUE_AXIS,
)
from proxops.diagrams.meshcat.navigation_scene import (
    NAVIGATION,
    exaggeration,
    navigation_region,
    return_uses,
)
from proxops.diagrams.meshcat.rigid_scene import SIGHT, enlargement
from proxops.diagrams.meshcat.survey_chapter import shown_times, speed_text, survey_rows
from proxops.diagrams.scenario import (
    RigidBodyConfig,
    described_bounds,
    differing_values,
    load_spacecraft,
    solids_of,
    spin_axes,
)
from proxops.systems.assurance import InterventionReason
from proxops.systems.navigation import NavigationPhase, ReturnUse
from proxops.systems.shapes import clearances
from proxops.systems.touch import TouchPhase

_PAGE = """
<style>
  body {display: flex; flex-direction: column; height: 100vh; background: #0c0e18}
  #meshcat-pane {flex: 1; height: auto; min-height: 0}
  #panel {padding: 8px 16px 10px; color: #c8ccd4; font: 13px/1.5 system-ui, sans-serif}
  #panel > div {display: flex; flex-wrap: wrap; gap: 2px 12px; align-items: center;
    justify-content: space-between}
  #panel b {color: #ffffff; font-variant-numeric: tabular-nums; white-space: pre}
  #panel small {color: #99a0ae; font-size: 12px; margin-right: 4px}
  #panel i {font-style: normal}
  #legend span {margin-right: 14px}
  #time {appearance: none; flex: 1; height: 10px; margin: 9px 0; border-radius: 3px}
  #time::-webkit-slider-thumb {appearance: none; width: 5px; height: 20px; background: #ffffff;
    border-radius: 2px; box-shadow: 0 0 3px #000000}
  #time::-moz-range-thumb {width: 5px; height: 20px; border: 0; background: #ffffff;
    border-radius: 2px}
  #panel button {font: inherit; color: inherit; background: #2a3042; border: 0; border-radius: 4px;
    padding: 1px 10px; cursor: pointer}
  #panel button.on {background: #4a5678; color: #ffffff}
  #play, #margins small {width: 66px}
  #margins svg {flex: 1; height: 30px; background: #171b2a}
  #margins path, #margins polyline {fill: none; stroke: #99a0ae; vector-effect: non-scaling-stroke}
  #margins polyline {stroke: #ffffff; stroke-width: 1.5}
  #world {position: fixed; left: 12px; top: 10px; max-height: 70vh; overflow: auto;
    color: #c8ccd4; background: #0c0e1899; font: 11px/1.3 system-ui, sans-serif}
  #bounds {position: fixed; right: 12px; top: 30px; max-width: 45vw; color: #c8ccd4;
    background: #0c0e1899; font: 11px/1.3 system-ui, sans-serif}
  #world summary {cursor: pointer; color: #ffffff}
  #world td {padding: 0 10px 0 0; font-variant-numeric: tabular-nums}
</style>
{{world}}<div id="panel">
  <div><span><b>{{title}}</b> <small>{{speed}}</small></span>{{numbers}}</div>
  {{margins}}<div><button id="play">pause</button>
    <input id="time" type="range" min="0" max="1" value="0" step="any" aria-label="time"
      style="background: {{strip}}"></div>
  <div><div id="chapters"></div><div id="views"></div></div>
  <div id="legend">{{legend}}</div>
</div>
<script>
"use strict";
(() => {
  const flight = {{flight}};
  const element = name => document.getElementById(name);
  const slider = element("time"), play = element("play"), animator = viewer.animator;
  const length = m => Math.abs(m) >= 5000 ? (m / 1000).toFixed(1) + " km"
    : m.toFixed(Math.abs(m) < 10 ? 1 : 0) + " m";
  const clock = s => (s < 0 ? "-" : "") + [s / 3600, s / 60 % 60, s % 60]
    .map(part => String(Math.floor(Math.abs(part))).padStart(2, "0")).join(":");

  function seek(time) {
    animator.seek(time);
    animator.display_progress(time);
  }
  // As OrbitControls has it: y is up.
  function look(eye, target) {
    viewer.controls.target.set(...target);
    viewer.camera.position.set(...eye);
    viewer.controls.update();
    viewer.set_dirty();
  }
  // Views fit a picture of 4:3 or wider; from farther away they fit a narrow one, as a phone's.
  function see(name) {
    const [eye, target] = flight.views[name];
    const view = viewer.dom_element;
    const away = Math.max((4 / 3) * view.clientHeight / view.clientWidth, 1);
    look(eye.map((x, k) => target[k] + away * (x - target[k])), target);
  }
  // Behind the spacecraft, the body before it; the wheel still sets the distance.
  let following = false;
  function follow() {
    const at = viewer.scene_tree.find(["spacecraft"]).object
      .getWorldPosition(new MeshCat.THREE.Vector3());
    const away = viewer.camera.position.distanceTo(viewer.controls.target);
    const out = at.clone().normalize().multiplyScalar(0.92).add({x: 0, y: 0.35, z: 0});
    const eye = at.clone().addScaledVector(out.normalize(), away);
    if (eye.distanceTo(viewer.camera.position) > 1e-6) look(eye.toArray(), at.toArray());
  }
  for (const name of [...Object.keys(flight.views), "follow"]) {
    const button = document.createElement("button");
    button.textContent = name;
    button.style.marginLeft = "6px";
    button.onclick = () => {
      for (const other of element("views").children) other.classList.toggle("on", other === button);
      following = name === "follow";
      if (following) look([1, 0, 0], [0, 0, 0]);
      else see(name);
    };
    element("views").append(button);
  }
  for (const [time, name] of flight.chapters) {
    const button = document.createElement("button");
    button.textContent = name;
    button.style.marginRight = "6px";
    button.onclick = () => seek(time);
    element("chapters").append(button);
  }
  viewer.dom_element.addEventListener("pointerdown", () => {
    following = false;
    for (const button of element("views").children) button.classList.remove("on");
  });

  play.onclick = () => animator.playing ? animator.pause() : animator.play();
  slider.oninput = () => seek(slider.valueAsNumber);
  let lit = false;
  // The path shines a little, so that its colours differ in the shade too.
  function light() {
    viewer.scene_tree.find(["path"]).object.traverse(part => {
      if (part.isMesh) part.material.emissive?.copy(part.material.color).multiplyScalar(0.3);
    });
    lit = true;
  }
  function tick() {
    requestAnimationFrame(tick);
    show();
  }
  // A film calls it, too.
  function show() {
    if (!(animator.duration > 0)) return;
    if (!lit) {
      light();
      see(Object.keys(flight.views)[0]);
    }
    slider.max = animator.duration;
    slider.value = animator.time;
    play.textContent = animator.playing ? "pause" : "play";
    let row = flight.time.length - 1;
    while (row > 0 && flight.shown[row] > animator.time + 1e-5) row--;
    const who = flight.who[row];
    flight.chapters.forEach(([time], k) => element("chapters").children[k].classList.toggle("on",
      time <= flight.shown[row] && !(flight.chapters[k + 1]?.[0] <= flight.shown[row])));
    element("clock").textContent = clock(flight.time[row]);
    element("range").textContent = length(flight.range[row]);
    element("speed").textContent = flight.velocity[row].toFixed(2) + " m/s";
    element("thrust").textContent = flight.thrust[row].toFixed(2) + " N";
    element("clearance").textContent = length(flight.clearance[row]);
    element("who").textContent = flight.names[who][0];
    element("who").style.color = flight.names[who][1];
    if (flight.navigation) {
      const {error, region, phase, phases} = flight.navigation;
      element("error").textContent = error[row] === null ? "none" : length(error[row]);
      element("region").textContent = region[row] === null ? "none" : length(region[row]);
      element("phase").textContent = phases[phase[row]] ?? "none";
    }
    if (flight.assurance) {
      const {margin, reason, reasons} = flight.assurance;
      const m = margin[row];
      element("margin").textContent = m === null ? "none" : m === "-inf" ? "unsafe" : length(m);
      element("reason").textContent = reasons[reason[row]][0];
      element("reason").style.color = reasons[reason[row]][1];
    }
    if (following) follow();
  }
  viewer.set_3d_pane_size();
  viewer.show_numbers = show;
  tick();
})();
</script>
"""
# Length in m up to which the curve of margins is linear, and the deepest and highest that it shows.
_NEAR, _DEEPEST, _HIGHEST = 200.0, 2e3, 1e9
_PASSES = "#ffffff"
_NUMBERS = {
    "clock": "time",
    "range": "goal",
    "speed": "speed",
    "thrust": "thrust",
    "clearance": "keep-out",
    "who": "flown by",
}
_ASSURANCE_NUMBERS = {"margin": "safety margin", "reason": "safety filter"}
_NAVIGATION_NUMBERS = {"error": "navigation error", "region": "3σ", "phase": "navigation"}


def panel(log: FlightLog, title: str, views: dict[str, View], unit: float) -> str:
    """Gives the HTML of the panel, for a page whose Meshcat plays the flight.

    Args:
      log: the log of the flight.
      title: title of the panel.
      views: cameras to choose from, in m in K, by name.
      unit: length of a Meshcat unit in m.
    """
    known = legend_of(log.dataset)
    shown = all_flown_by(log.dataset) or flown_by(log.dataset)[:1].tolist()
    entries = [(known[who].colour, f"flown by {known[who].name}") for who in shown]
    thrust = _rigid_marks(log, unit) or [(THRUST, "thrust")]
    marks = [*thrust, *_return_marks(log), (GOAL, "goal"), *_true_marks(log)]
    navigated = "navigation_state" in log.dataset
    if navigated:
        times = exaggeration(navigation_region(log.dataset), unit)
        marks.append(
            (
                NAVIGATION,
                (
                    "where the navigation believes the spacecraft to be, with 3σ: "
                    f"errors × {times:,.0f}"
                ),
            )
        )
    entries += [(_rgb(colour), text) for colour, text in marks]
    legend = "\n".join(
        f'<span><i style="color: {_code(colour)}">&#9679;</i> {html.escape(text)}</span>'
        for colour, text in entries
    )
    numbers = "\n".join(
        f'<span><small>{text}</small><b id="{name}"></b></span>'
        for name, text in {
            **_NUMBERS,
            **(_ASSURANCE_NUMBERS if "assurance_margin" in log.dataset else {}),
            **(_NAVIGATION_NUMBERS if navigated else {}),
        }.items()
    )
    content = json.dumps(_flight(log, views, unit), separators=(",", ":"))
    parts = {
        "title": html.escape(title),
        "speed": speed_text(log.dataset),
        "numbers": numbers,
        "strip": _strip(log),
        "margins": _margin_curve(log),
        "world": _bounds(log) + _world(log),
        "legend": legend,
        # Otherwise "</script>" in a name would end the script.
        "flight": content.replace("<", "\\u003c"),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _PAGE)


def _flight(log: FlightLog, views: dict[str, View], unit: float) -> dict[str, Any]:
    """Gives the data of the page's script: columns with one entry for each row, names and views."""
    data, legend = log.dataset, legend_of(log.dataset)
    state, times = data["state"].values, data["time"].values
    away = (data["state"] - data["target"]).values[:, :3]
    force = np.nan_to_num(data["force"].values)
    force[-1] = 0.0  # The flight has ended.
    who = _steps(log)

    def turned(position: np.ndarray) -> list[float]:
        x, y, z = (position / unit).round(4).tolist()
        return [x, z, -y]

    return {
        "shown": shown_times(data).round(5).tolist(),
        "time": (times - max(times[0], 0.0)).round(2).tolist(),
        "range": np.linalg.norm(away, axis=1).round(1).tolist(),
        "velocity": np.linalg.norm(state[:, 3:], axis=1).round(3).tolist(),
        "thrust": np.linalg.norm(force, axis=1).round(3).tolist(),
        "clearance": clearances(log.body.keep_out_semi_axes, state[:, :3]).round(1).tolist(),
        "who": who.tolist(),
        "names": {
            each: [legend[each].name, _code(legend[each].colour)]
            for each in np.unique(who).tolist()
        },
        "views": {name: [turned(view.eye), turned(view.target)] for name, view in views.items()},
        "navigation": _navigation(log),
        "assurance": _assurance(log),
        "chapters": _chapters(log),
    }


def _chapters(log: FlightLog) -> list[tuple[float, str]]:
    """Gives when each phase of a touch-and-go or a mission is shown, in s, and its name.

    [] of another flight.
    """
    data, shown = log.dataset, shown_times(log.dataset)
    surveyed = survey_rows(data)
    if "touch_phase" not in data:
        return [(0.0, "survey"), (float(shown[surveyed]), "transit")] if surveyed else []
    phases = data["touch_phase"].values[surveyed:-1]
    begins = [0, *(np.flatnonzero(np.diff(phases)) + 1).tolist()]
    chapters = [
        (round(float(shown[surveyed + row]), 5), TouchPhase(int(phases[row])).name.lower())
        for row in begins
    ]
    return [(0.0, "survey"), *chapters] if surveyed else chapters


def _assurance(log: FlightLog) -> dict[str, Any] | None:
    """Gives margins and reasons for the page's script; None without runtime assurance.

    A margin of -inf, which JSON does not have, is the text "-inf".
    """
    data = log.dataset
    if "assurance_margin" not in data:
        return None
    margins = [
        round(float(each), 1) if np.isfinite(each) else None if np.isnan(each) else "-inf"
        for each in data["assurance_margin"].values
    ]
    names = {int(InterventionReason.NONE): ["passes", _PASSES]}
    names |= {int(key): [each.name, _code(each.colour)] for key, each in REASONS.items()}
    return {"margin": margins, "reason": _reasons(log).tolist(), "reasons": names}


def _reasons(log: FlightLog) -> np.ndarray:
    """Gives the `InterventionReason` (N,) of each row as whole numbers; an unknown one is NONE."""
    codes = log.dataset["intervention_reason"].values
    known = np.isin(codes, list(InterventionReason))
    return np.where(known, codes, InterventionReason.NONE).astype(int)


def _margin_curve(log: FlightLog) -> str:
    """Gives the HTML of the margin over time, with each intervention in the colour of its reason.

    "" without runtime assurance. Below 0 a command was not safe. The scale is linear up to about
    `_NEAR` and logarithmic beyond.
    """
    data = log.dataset
    if "assurance_margin" not in data:
        return ""
    shown, margins = shown_times(data), data["assurance_margin"].values
    left = 1e3 * shown / max(float(shown[-1]), 1e-9)
    scaled = np.arcsinh(np.clip(margins, -_DEEPEST, _HIGHEST) / _NEAR)
    least, most = (float(end) for end in np.nanpercentile([-1.0, 1.0, *scaled], [0, 100]))
    up = 100.0 * (most - scaled) / (most - least)
    zero = 100.0 * most / (most - least)
    reasons = _reasons(log)[:-1]
    ends = [0, *(np.flatnonzero(np.diff(reasons)) + 1).tolist(), len(reasons)]
    parts = [
        f'<rect x="{left[begin]:.1f}" width="{left[end] - left[begin]:.1f}" height="100" '
        f'fill="{_code(REASONS[InterventionReason(reasons[begin])].colour)}" opacity="0.5"/>'
        for begin, end in itertools.pairwise(ends)
        if reasons[begin:end].any()
    ]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(left, up, strict=True) if np.isfinite(y))
    return (
        '<div id="margins"><small>margin</small>'
        '<svg viewBox="0 0 1000 100" preserveAspectRatio="none"><title>safety margin over time; '
        f"below the line a command was not safe</title>{''.join(parts)}"
        f'<path d="M0 {zero:.1f}H1000" class="zero"/><polyline points="{points}"/></svg></div>\n  '
    )


def _navigation(log: FlightLog) -> dict[str, Any] | None:
    """Gives the columns of the navigation for the page's script; None if the flight had none."""
    data = log.dataset
    if "navigation_state" not in data:
        return None
    region = navigation_region(data)

    def told(lengths: np.ndarray) -> list[float | None]:
        return [
            round(float(length), 2) if known else None
            for length, known in zip(lengths, region.known, strict=True)
        ]

    phases = data["navigation_phase"].values
    return {
        "error": told(np.linalg.norm(region.errors, axis=1)),
        "region": told(region.semi_axes.max(axis=1)),
        "phase": np.where(np.isin(phases, list(NavigationPhase)), phases, -1).astype(int).tolist(),
        "phases": [phase.name.lower() for phase in NavigationPhase],
    }


def _return_marks(log: FlightLog) -> list[tuple[Rgba, str]]:
    """Gives the legend of the lidar returns."""
    if "ranges" not in log.dataset:
        return []
    if return_uses(log.dataset) is None:
        return [(RETURNS, "lidar returns")]
    surveyed = [(RETURNS, "the survey's")] if survey_rows(log.dataset) else []
    texts = {
        ReturnUse.USED: "lidar returns that it used",
        ReturnUse.REJECTED: "rejected",
        ReturnUse.NOT_USED: "left alone",
    }
    return [*((RETURN_USES[use], text) for use, text in texts.items()), *surveyed]


def _rigid_marks(log: FlightLog, unit: float) -> list[tuple[Rgba, str]]:
    """Gives the legend of a rigid spacecraft; [] for a point."""
    settings = log.scenario.spacecraft
    if not isinstance(settings, RigidBodyConfig):
        return []
    times = enlargement(solids_of(load_spacecraft(settings.model)), unit)
    field = math.degrees(log.scenario.lidar_geometry.field_of_view)
    seen = f"boresight, and the lidar's field of view, {field:g}°" if field > 0.0 else "boresight"
    return [
        (HULL, f"spacecraft × {times:,.0f}"),
        (THRUST, "thruster flames by on-time"),
        (SIGHT, seen),
    ]


def _true_marks(log: FlightLog) -> list[tuple[Rgba, str]]:
    """Gives the legend of what is shown only where the true body differs from the believed one."""
    true_body, marks = log.differing_body, []
    if true_body is None:
        return marks
    if true_body.shape is not log.body.shape:
        marks.append((MAP, "map, over the true body"))
    if spin_axes(log.body, true_body) is not None:
        marks += [(BELIEVED_AXIS, "believed spin axis"), (TRUE_AXIS, "true spin axis")]
    return marks


def _world(log: FlightLog) -> str:
    """Gives the HTML of the list of what differs from what is believed; "" if nothing does."""
    values = differing_values(log.scenario)
    if not values:
        return ""
    rows = "\n".join(
        f"<tr><td>{html.escape(key)}</td><td>{html.escape(_value(value))}</td></tr>"
        for key, value in values.items()
    )
    return (
        '<details id="world" open><summary>the true world of this flight</summary>\n'
        f"<table>\n{rows}\n</table></details>\n"
    )


def _bounds(log: FlightLog) -> str:
    """Gives the HTML of the bounds of runtime assurance; "" without it."""
    if log.scenario.assurance is None:
        return ""
    text = html.escape(described_bounds(log.scenario))
    return f'<div id="bounds">the safety filter allows for: {text}</div>\n'


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"({', '.join(_value(part) for part in value)})"
    if isinstance(value, float) and 0.0 < abs(value - 1.0) < 1e-3:
        return f"1 {'+' if value > 1.0 else '-'} {abs(value - 1.0):.2g}"
    if isinstance(value, float):
        return f"{value:.4g}"
    return "none" if value is None else str(value)


def _steps(log: FlightLog) -> np.ndarray:
    """Gives the `FlownBy` (N,) from each row to the next; the last row repeats the one before."""
    who = flown_by(log.dataset)
    return np.concatenate([who[:-1], who[-2:-1]]) if len(who) > 1 else who


def _strip(log: FlightLog) -> str:
    """Gives the CSS of a strip over the flight's time, in the colours of the controllers."""
    legend = legend_of(log.dataset)
    who, shown = _steps(log), shown_times(log.dataset)
    length = max(float(shown[-1]), 1e-9)
    changes = [0, *(np.flatnonzero(np.diff(who)) + 1).tolist(), len(who) - 1]
    pieces = []
    for begin, end in itertools.pairwise(changes):
        first, last = (100.0 * shown[row] / length for row in (begin, end))
        pieces.append(f"{_code(legend[int(who[begin])].colour)} {first:.2f}% {last:.2f}%")
    return f"linear-gradient(to right, {', '.join(pieces)})"


def _code(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * level):02x}" for level in colour)


def _rgb(colour: Rgba) -> tuple[float, float, float]:
    return colour.r(), colour.g(), colour.b()
