"""`proxops scenario`: prints a scenario with what each value means."""

from __future__ import annotations

import typer

from proxops.cli.common import ScenarioFile
from proxops.diagrams.scenario import commented_scenario, load_scenario


def scenario_command(scenario: ScenarioFile = None) -> None:
    """Print a scenario as YAML, with what each value means, its unit and its limits.

    Keep what you change: what a scenario file leaves out has its default. A shell's completion
    offers the same keys after --set.

    Examples:

      proxops scenario

      proxops scenario bennu
    """
    typer.echo(commented_scenario(load_scenario(scenario)), nl=False)
