"""`proxops scenario`: prints a scenario; the default one with what each value means."""

from __future__ import annotations

import typer

from proxops.cli.common import ScenarioFile
from proxops.diagrams.scenario import commented_scenario, dump_scenario, load_scenario


def scenario_command(scenario: ScenarioFile = None) -> None:
    """Print the default scenario as YAML, with what each value means, its unit and its limits.

    Of another scenario, print all values. Keep what you change: what a scenario file leaves out has
    its default. A shell's completion offers the same keys after --set.

    Examples:

      proxops scenario

      proxops scenario bennu
    """
    text = commented_scenario() if scenario is None else dump_scenario(load_scenario(scenario))
    typer.echo(text, nl=False)
