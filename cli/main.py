"""`proxops`: entry point of the command line."""

from __future__ import annotations

import os
import sys

import typer

from proxops.cli import collect, dagger, evaluate, fly, replay, reproduce, shape, train, train_lidar
from proxops.systems.errors import InputError

app = typer.Typer(
    name="proxops",
    help="Fly spacecraft close to small bodies: simulate, evaluate, replay.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)
app.command("fly")(fly.fly_command)
app.command("evaluate")(evaluate.evaluate_command)
app.command("collect")(collect.collect_command)
app.command("replay")(replay.replay_command)
app.command("shape")(shape.shape_command)
app.command("train")(train.train_command)
app.command("train-lidar")(train_lidar.train_lidar_command)
app.command("dagger")(dagger.dagger_command)
app.command("reproduce")(reproduce.reproduce_command)


def main() -> None:
    """Runs the command line. Exit codes: 0 done, 1 not as wished, 2 bad input, 130 interrupted."""
    try:
        app()
    except InputError as error:
        message = " ".join(str(error).splitlines())  # What YAML or HDF5 say may have several.
        print(f"proxops: error: {message}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("proxops: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read the output has gone; nothing more to say to anyone.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


if __name__ == "__main__":
    main()
