"""What MkDocs does besides: equations, pages made from what they describe, and the replay.

A line of a page that starts with one of these is replaced:

* `!ports NAME`: the drawing of ports in the docstring of `proxops.systems.NAME`; for `Transit`, of
  `add_transit`.
* `!commands`: a section for each command, with its help.
* `!help`: what `proxops --help` prints.
* `!file PATH`: a file of the repository, as code.
* `!experiments PATH`: a Markdown file of the repository, without its title, headings a level down.
* `!configs`: a table of the keys of each section of a scenario.
* `!dispersions NAME`: a table of dispersions that ship, with the source of each number.
* `!quantities`: the table of uncertain quantities, with whom they are told.
* `!log_variables`: a table of a flight log's variables.
* `!rooms`: which room imports which, drawn from the code.
* `!modules FOLDER`: a table of the rooms of a folder, each of which has a page of reference.

Executed notebooks (`make notebooks`) become pages, with what they printed and drew.

Equations between dollars become MathML, which browsers show without a script. The front page shows
`replay.html`, the replay of a transit that the build flies. At the end no page may load anything
from elsewhere.
"""

import ast
import functools
import html
import inspect
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File
from nbconvert import MarkdownExporter
from typer.testing import CliRunner

from proxops import systems
from proxops.cli.main import COMMANDS, app
from proxops.diagrams.flight import add_transit, fly
from proxops.diagrams.logs import SURVEY, VARIABLES
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.scenario import (
    QUANTITIES,
    DescribedKey,
    described_keys,
    dispersion_entries,
    load_body,
    load_dispersions,
    load_scenario,
)

ROOT = Path(__file__).parents[1]
_FOLDERS = ("systems", "diagrams", "training", "studies")
_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
_LOADED = re.compile(r'<(?:script|img|iframe)[^>]+src="https?:|<link[^>]+href="https?:[^>]*>')
_SHOWN = re.compile(r'<iframe[^>]+src="([^":]+)"')


def _ports(name: str) -> str:
    maker = add_transit if name == "Transit" else getattr(systems, name)
    text = inspect.cleandoc(maker.__doc__)
    (drawing,) = re.findall(r"^```\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[:1]
    return f"```text\n{drawing}```"


def _help(command: str) -> str:
    """The help of a command, or of the whole program if the name is empty."""
    environment = {"COLUMNS": "100", "TERMINAL_WIDTH": "100", "NO_COLOR": "1", "TERM": "dumb"}
    found = CliRunner().invoke(app, [*command.split(), "--help"], env=environment)
    if found.exit_code:
        raise PluginError(f"proxops {command} --help: exit code {found.exit_code}")
    lines = [line.rstrip() for line in found.stdout.strip("\n").splitlines()]
    return "\n".join(["```text", *lines, "```"])


def _commands(_: str) -> str:
    return "\n\n".join(f"## {name}\n\n{_help(name)}" for name in COMMANDS)


def _file(path: str) -> str:
    kind = {".py": "python", ".yaml": "yaml"}.get(Path(path).suffix, "text")
    return f"```{kind}\n{(ROOT / path).read_text()}```"


def _log_variables(_: str) -> str:
    columns = [(name, ("time", *each.dimensions), each) for name, each in VARIABLES.items()]
    columns += [(name, each.dimensions, each) for name, each in SURVEY.items()]
    rows = [
        f"| `{name}` | {', '.join(dimensions)} | {each.units} | {each.long_name} |"
        for name, dimensions, each in columns
    ]
    return "\n".join(["| variable | dimensions | unit | what it is |", "|---|---|---|---|", *rows])


def _dispersions(name: str) -> str:
    scenario, body = load_scenario(), load_body("kleopatra")
    tree = dispersion_entries(name)
    lines = ["| key | distribution | at Kleopatra | source |", "|---|---|---|---|"]
    for each in load_dispersions(name):
        entry, bounds = tree[each.key], each.distribution.bounds()
        times = f" × {entry['times'].replace('_', ' ')}" if "times" in entry else ""
        at_kleopatra = "–"
        if times and bounds is not None:
            ends = dict.fromkeys(f"{each.unit(scenario, body) * end:.3g}" for end in bounds)
            at_kleopatra = " to ".join(ends)
        text = _distribution(entry) + times
        lines.append(f"| `{each.key}` | {text} | {at_kleopatra} | {each.source} |")
    return "\n".join(lines)


def _configs(_: str) -> str:
    def sections(title: str, keys: Sequence[DescribedKey]) -> Iterator[str]:
        rows = [
            f"| `{key.name}` | {_code(key.default)} | {key.unit} | {key.limits} | {key.meaning} |"
            for key in keys
        ]
        head = ["| key | default | unit | limits | meaning |", "|---|---|---|---|---|"]
        yield "\n".join([f"## {title or 'The whole scenario'}", "", *head, *rows])
        for key in keys:
            for tag, inner in key.sections.items():
                named = f": !{tag}" if len(key.sections) > 1 else ""
                yield from sections(
                    f"{title.partition(':')[0]}.{key.name}".strip(".") + named, inner
                )

    return "\n\n".join(sections("", described_keys()))


def _code(text: str) -> str:
    return text and f"`{text}`"


def _quantities(_: str) -> str:
    lines = ["| key | tunes `navigation.expected.…` | `assurance.bounds.…` |", "|---|---|---|"]
    for each in QUANTITIES:
        if each.known:
            row = "known on the day", "known on the day"
        else:
            bound = {None: "not covered", "": "not needed"}.get(each.bounds, f"`{each.bounds}`")
            row = f"`{each.tunes}`" if each.tunes else "–", bound
        lines.append(f"| `{each.key}` | {row[0]} | {row[1]} |")
    return "\n".join(lines)


def _distribution(entry: dict) -> str:
    """A distribution of a YAML file, in words."""
    spread = entry.get("three_sigma", 0.0)
    if "normal" in entry:
        return f"normal, {entry['normal']:g} ± {spread:g}"
    if "half_normal" in entry:
        return f"half normal, {entry['half_normal']:g} to {entry['half_normal'] + spread:g}"
    for kind in ("uniform", "log_uniform"):
        if kind in entry:
            low, high = entry[kind]
            return f"{kind.replace('_', ' ')}, {low:.10g} to {high:.10g}"
    if "choice" in entry:
        return f"one of {', '.join(f'{value:g}' for value in entry['choice'])}"
    return f"always {entry['fixed']:.4g}"


def _experiments(path: str) -> str:
    _, _, text = (ROOT / path).read_text().partition("\n")
    return re.sub(r"^#", "##", text, flags=re.MULTILINE)


def _faces(folder: str) -> dict[str, str]:
    """The docstring of each room of a folder, by its name."""
    return {
        path.parent.name: ast.get_docstring(ast.parse(path.read_text())) or ""
        for path in sorted((ROOT / folder).glob("*/__init__.py"))
    }


def _modules(folder: str) -> str:
    lines = ["| room | what lives there |", "|---|---|"]
    for room, about in _faces(folder).items():
        first = " ".join(about.partition("\n\n")[0].split())
        lines.append(f"| [{room}]({folder}/{room}.md) | {first} |")
    return "\n".join(lines)


def _room_page(folder: str, room: str, about: str) -> str:
    """The reference of the public modules of a room."""
    options = "    options: {show_root_heading: false}"
    parts = [f"# proxops.{folder}.{room}\n\n{about}\n"]
    for name in sorted(path.stem for path in (ROOT / folder / room).glob("[!_]*.py")):
        module = f"proxops.{folder}.{room}.{name}"
        parts.append(f"## {room}.{name}\n\n::: {module}\n{options}\n")
    return "\n".join(parts)


def _imports() -> dict[tuple[str, str], set[tuple[str, str]]]:
    """The rooms, as folder and name, that each room imports."""
    found = {}
    for room in (path.parent for path in ROOT.glob("*/*/__init__.py")):
        named = re.findall(
            r"^\s*from proxops\.(\w+)\.(\w+)",
            "\n".join(path.read_text() for path in room.glob("*.py")),
            re.MULTILINE,
        )
        found[room.parent.name, room.name] = {*named} - {(room.parent.name, room.name)}
    return {room: {other for other in others if other in found} for room, others in found.items()}


def _rooms(_: str) -> str:
    """A column for each folder; a room stands above all rooms of its folder that it imports."""
    imports = _imports()

    @functools.cache
    def depth(room: tuple[str, str]) -> int:
        own = [depth(other) for other in imports[room] if other[0] == room[0]]
        return 1 + max(own, default=-1)

    width, height, columns = 240, 58, ("systems", "diagrams", "training", "studies")
    levels = 1 + max(map(depth, imports))
    boxes, lines = {}, []
    for x, folder in enumerate(columns):
        for level in range(levels):
            here = sorted(each for each in imports if each[0] == folder and depth(each) == level)
            for k, room in enumerate(here):
                wide = (width - 16) / len(here)
                left = x * width + 8 + k * wide
                boxes[room] = left, (levels - 1 - level) * height + 34, wide - 4
    for room, others in imports.items():
        left, top, wide = boxes[room]
        for other in others:
            if other[0] == room[0]:
                to_left, to_top, to_wide = boxes[other]
                lines.append(
                    f'<path d="M{left + wide / 2:.0f} {top + 22:.0f}L{to_left + to_wide / 2:.0f} '
                    f'{to_top:.0f}" stroke="currentColor" opacity="0.3"/>'
                )
    for x, folder in enumerate(columns):
        towards = sorted({other[0] for room in imports if room[0] == folder
                          for other in imports[room]} - {folder})  # fmt: skip
        words = f" → {', '.join(towards)}" if towards else ""
        lines.append(
            f'<text x="{x * width + 8}" y="18" fill="currentColor" font-size="11">'
            f'<tspan font-weight="bold">{folder}</tspan>{words}</text>'
        )
    for (_, name), (left, top, wide) in boxes.items():
        lines.append(
            f'<rect x="{left:.0f}" y="{top:.0f}" width="{wide:.0f}" height="22" rx="4" '
            'fill="var(--md-default-bg-color)" stroke="currentColor"/>'
            f'<text x="{left + wide / 2:.0f}" y="{top + 15:.0f}" fill="currentColor" '
            f'text-anchor="middle" font-size="{min(11.0, 1.75 * wide / len(name)):.1f}">'
            f"{name}</text>"
        )
    size = f"{width * len(columns)} {levels * height + 20}"
    return f'<svg viewBox="0 0 {size}" style="width: 100%">{"".join(lines)}</svg>'


_MAKERS = {
    "commands": _commands,
    "configs": _configs,
    "dispersions": _dispersions,
    "quantities": _quantities,
    "experiments": _experiments,
    "file": _file,
    "help": _help,
    "log_variables": _log_variables,
    "modules": _modules,
    "ports": _ports,
    "rooms": _rooms,
}


def on_config(config, **_):
    """Puts a page for each room below the page of its folder."""

    def with_rooms(entry):
        if isinstance(entry, dict):
            return {title: with_rooms(inner) for title, inner in entry.items()}
        if isinstance(entry, list):
            return [with_rooms(each) for each in entry]
        found = re.fullmatch(r"reference/(\w+)\.md", entry)
        if found is None or found[1] not in _FOLDERS:
            return entry
        rooms = (f"reference/{found[1]}/{room}.md" for room in _faces(found[1]))
        return {f"proxops.{found[1]}": [entry, *rooms]}

    config.nav = with_rooms(config.nav)
    return config


def on_files(files, config, **_):
    """Adds the rooms' pages, the notebooks', and the replay of the front page: transit 1."""
    for folder in _FOLDERS:
        for room, about in _faces(folder).items():
            page = _room_page(folder, room, about)
            files.append(File.generated(config, f"reference/{folder}/{room}.md", content=page))
    log = fly(load_scenario(None, ["transit.index=1"]), "hybrid")
    if not log.summary["success"]:
        raise PluginError("the flight of the front page does not arrive")
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "replay.html"
        write_replay(log, page)
        content = page.read_bytes()
    files.append(File.generated(config, "replay.html", content=content))
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        for name, made in _notebook_files(path.name).items():
            files.append(File.generated(config, f"notebooks/{name}", content=made))
    return files


def _notebook_files(name: str) -> dict[str, str | bytes]:
    """The page of an executed notebook, its pictures and the pages in its frames, by file name."""
    executed = ROOT / "build" / "notebooks" / name
    if not executed.is_file():
        raise PluginError(f"{executed} is missing: run `make notebooks`")
    stem, shown = executed.stem, {}
    names = {"unique_key": f"{stem}_files", "output_files_dir": f"{stem}_files"}
    text, found = MarkdownExporter().from_filename(executed, resources=names)

    def frame(within: re.Match) -> str:
        shown[f"{stem}_{len(shown)}.html"] = html.unescape(within[1])
        return f'src="{list(shown)[-1]}"'

    page = re.sub(r'srcdoc="([^"]*)"', frame, text)
    return {f"{stem}.md": page, **shown, **found["outputs"]}


def on_page_markdown(markdown, page, **_):
    """Replaces the lines that ask for something."""

    def made(asked: re.Match) -> str:
        return _MAKERS[asked[1]]((asked[2] or "").strip())

    return re.sub(rf"^!({'|'.join(_MAKERS)})(?: (.*))?$", made, markdown, flags=re.MULTILINE)


def on_page_content(content, **_):
    """Turns equations into MathML."""

    def written(found: re.Match) -> str:
        display = "inline" if found[2] == "(" else "block"
        made = convert(html.unescape(found[3]), display=display)
        if "\\" in made:
            raise PluginError(f"this equation was not understood: {found[3]}")
        return made

    return _EQUATION.sub(written, content)


@event_priority(-100)  # After the search's own.
def on_post_build(config, **_):
    """Refuses pages that need a network, or that show a page that is not there.

    The index of the search becomes a script, too, which pages load that are opened from files.
    """
    index = Path(config.site_dir, "search", "search_index.json")
    index.with_suffix(".js").write_text(f"var __index = {index.read_text()}")
    for page in Path(config.site_dir).rglob("*.html"):
        text = page.read_text()
        for found in _LOADED.findall(text):
            if 'rel="canonical"' not in found:
                raise PluginError(f"{page} loads from elsewhere: {found}")
        for shown in _SHOWN.findall(text):
            if not (page.parent / shown).is_file():
                raise PluginError(f"{page} shows {shown}, which is not there")
