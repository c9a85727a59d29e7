"""`proxops scenario`: prints the default scenario, with what each value means."""

from __future__ import annotations

import typer

from proxops.diagrams.scenario import commented_scenario


def scenario_command() -> None:
    """Print the default scenario as YAML, with what each value means, its unit and its limits.

    Keep what you change: what a scenario file leaves out has its default. A shell's completion
    offers the same keys after --set.

    Example:

      proxops scenario
    """
    typer.echo(commented_scenario(), nl=False)
