"""`proxops`: the entry point of the command line."""

from __future__ import annotations

import gc
import importlib
import logging
import os
import sys
import typing
import warnings
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from typer.core import TyperGroup
from typer.main import get_command

COMMANDS = {
    "fly": "Fly one transit; write flight.nc, summary.json and replay.html.",
    "evaluate": "Fly a set of transits with each controller; write results.json, report.html and "
    "report.md.",
    "score": "Fly a controller over a track of the benchmark; write and print its row.",
    "collect": "Fly transits with the MPC; write a log of each, manifest.json and a report.",
    "replay": "Make the replay page of a flight log, and files for other tools.",
    "scenario": "Print the default scenario as YAML, with what each value means, its unit and its "
    "limits.",
    "survey": "Survey a body that is known as an ellipsoid; write its map, body file and scenario.",
    "shape": "Examine a mesh, mend it, and set up its body for flights.",
    "site": "List the places of a scenario's body that can be touched, the best first, and draw "
    "them.",
    "train": "Train a policy to predict the MPC's force.",
    "train-lidar": "Train two networks that predict lidar frames, ours and the paper's; compare "
    "them with others.",
    "dagger": "Let the pilot fly, label its flights with the MPC's forces, and train on them: "
    "DAgger.",
    "reproduce": "Reproduce all evidence: the paper, then what goes beyond it, with one report.",
}
"""The first line of each command's docstring: to import the commands takes seconds."""


class _Commands(TyperGroup):
    """Imports a command when it is used. Lists of commands have only the names and first lines."""

    def resolve_command(self, ctx: typing.Any, args: list[str]) -> typing.Any:
        name, _, rest = super().resolve_command(ctx, args)
        return name, name and command(name), rest


app = typer.Typer(
    name="proxops",
    cls=_Commands,
    help="Fly spacecraft close to small bodies: simulate, evaluate, replay.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _show_log(verbose: bool) -> None:
    """Shows what proxops logs on standard error: warnings, and with `verbose` all else."""
    from proxops.cli.common import LogLines  # Slow to import, as the commands are, which need it.

    logger = logging.getLogger("proxops")
    logger.handlers = [LogLines()]
    logger.setLevel(logging.INFO if verbose else logging.WARNING)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib import metadata  # Nothing else needs it.

        typer.echo(f"proxops {metadata.version('proxops')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show all that is logged, not only warnings.")
    ] = False,
) -> None:
    """Fly spacecraft close to small bodies: simulate, evaluate, replay."""
    _show_log(verbose)


for _name, _line in COMMANDS.items():
    app.command(_name, help=_line)(lambda: None)


def command(name: str) -> typing.Any:
    """Imports a command and gives it, as an object of typer's."""
    gc.disable()  # Nothing that is imported is garbage; to look for it takes a tenth of the time.
    module = importlib.import_module(_module(name))
    gc.freeze()
    gc.enable()
    function = getattr(module, f"{name.replace('-', '_')}_command")
    alone = typer.Typer(add_completion=False)
    alone.command(name)(function)
    _find_folder_for_matplotlib()
    made: typing.Any = get_command(alone)
    for each in (made, *made.params):
        each.help = escape(each.help or "")  # Else [exchange] would be markup.
    return made


def _module(name: str) -> str:
    return f"proxops.cli.{name.replace('-', '_')}"


def _find_folder_for_matplotlib() -> None:
    """Finds one where its own cannot be written: else it complains, or without a home it fails."""
    from proxops.cli.common import check_folder
    from proxops.systems.common import InputError, cache_folder

    if os.environ.get("MPLCONFIGDIR"):
        return
    linux = {"XDG_CONFIG_HOME": ".config", "XDG_CACHE_HOME": ".cache"}
    try:
        if sys.platform == "linux":
            for name, folder in linux.items():
                check_folder(Path(os.environ.get(name) or Path.home() / folder) / "matplotlib")
        else:
            check_folder(Path.home() / ".matplotlib")
    except (InputError, RuntimeError):  # RuntimeError: the user has no home.
        if (found := cache_folder("matplotlib")) is not None:
            os.environ["MPLCONFIGDIR"] = str(found)


_INTERRUPTED = 130
_LONGEST_MESSAGE = 2000
_warned: set[str] = set()


def main() -> None:
    """Runs the command line.

    The exit code is 0 if the command succeeded; 1 if its result is negative, such as defects in a
    mesh or a flight that differs from its log; 2 for bad input; 130 if it was interrupted.
    """
    warnings.formatwarning = _warning
    try:
        app()
    except ValueError as error:
        from proxops.systems.common import InputError  # It has been imported, if it was raised.

        if not isinstance(error, InputError):
            raise
        _end(2, f"error: {_one_line(str(error))}")
    except SystemExit as end:
        if end.code == _INTERRUPTED:  # Typer has caught the KeyboardInterrupt.
            hint = "; run the same command again to go on" if _goes_on(sys.argv[1:2]) else ""
            _end(_INTERRUPTED, f"interrupted{hint}")
        raise
    except BrokenPipeError:
        # The reader of the output has ended, so nothing more is printed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:  # Such as a folder that may not be read.
        _end(2, f"error: {_one_line(str(error))}")


def _end(code: int, message: str) -> typing.NoReturn:
    print(f"proxops: {message}", file=sys.stderr)
    sys.exit(code)


def _warning(message: Warning | str, *_: object) -> str:
    """A warning as a line for people, without the place in the code; nothing the second time."""
    line = f"proxops: warning: {_one_line(str(message))}\n"
    if line in _warned:
        return ""
    _warned.add(line)
    return line


def _one_line(message: str) -> str:
    """A message without the line ends and control characters that a file may have put into it."""
    line = " ".join(message.splitlines())
    shown = "".join(letter if letter.isprintable() else "?" for letter in line)
    return shown if len(shown) <= _LONGEST_MESSAGE else f"{shown[:_LONGEST_MESSAGE]} ..."


def _goes_on(names: list[str]) -> bool:
    """Tells whether a command can continue after an interruption: its help says so."""
    return any(
        "Run it again to" in " ".join((command(name).help or "").split())
        for name in names
        if name in COMMANDS and _module(name) in sys.modules  # Else it was still being imported.
    )


if __name__ == "__main__":
    main()
