"""`proxops`: the entry point of the command line."""

from __future__ import annotations

import os
import sys
import warnings
from importlib import metadata
from typing import Annotated

import typer

from proxops.cli import (
    collect,
    dagger,
    evaluate,
    fly,
    replay,
    reproduce,
    score,
    shape,
    train,
    train_lidar,
)
from proxops.systems.common import InputError

app = typer.Typer(
    name="proxops",
    help="Fly spacecraft close to small bodies: simulate, evaluate, replay.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
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
) -> None:
    """Fly spacecraft close to small bodies: simulate, evaluate, replay."""


app.command("fly")(fly.fly_command)
app.command("evaluate")(evaluate.evaluate_command)
app.command("score")(score.score_command)
app.command("collect")(collect.collect_command)
app.command("replay")(replay.replay_command)
app.command("shape")(shape.shape_command)
app.command("train")(train.train_command)
app.command("train-lidar")(train_lidar.train_lidar_command)
app.command("dagger")(dagger.dagger_command)
app.command("reproduce")(reproduce.reproduce_command)

_INTERRUPTED = 130
_LONGEST_MESSAGE = 2000


def main() -> None:
    """Runs the command line.

    The exit code is 0 if the command succeeded; 1 if its result is negative, such as defects in a
    mesh or a flight that differs from its log; 2 for bad input; 130 if it was interrupted.
    """
    warnings.formatwarning = _warning
    try:
        app()
    except InputError as error:
        print(f"proxops: error: {_one_line(str(error))}", file=sys.stderr)
        sys.exit(2)
    except SystemExit as end:
        if end.code == _INTERRUPTED:  # Typer has caught the KeyboardInterrupt.
            hint = "; run the same command again to go on" if _goes_on(sys.argv[1:2]) else ""
            print(f"proxops: interrupted{hint}", file=sys.stderr)
        raise
    except BrokenPipeError:
        # The reader of the output has ended, so nothing more is printed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:  # Such as a folder that may not be read.
        print(f"proxops: error: {_one_line(str(error))}", file=sys.stderr)
        sys.exit(2)


def _warning(message: Warning | str, *_: object) -> str:
    """A warning as a line for people, without the place in the code."""
    return f"proxops: warning: {_one_line(str(message))}\n"


def _one_line(message: str) -> str:
    """A message without the line ends and control characters that a file may have put into it."""
    line = " ".join(message.splitlines())
    shown = "".join(letter if letter.isprintable() else "?" for letter in line)
    return shown if len(shown) <= _LONGEST_MESSAGE else f"{shown[:_LONGEST_MESSAGE]} ..."


def _goes_on(name: list[str]) -> bool:
    """Tells whether a command can continue after an interruption: its help says so."""
    texts = {
        command.name: " ".join((getattr(command.callback, "__doc__", "") or "").split())
        for command in app.registered_commands
    }
    return any("Run it again to" in texts.get(word, "") for word in name)


if __name__ == "__main__":
    main()
