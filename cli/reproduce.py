"""`proxops reproduce`: reproduces the paper and all that goes beyond it, with one command."""

from __future__ import annotations

import dataclasses as dc
import enum
from pathlib import Path
from typing import Annotated

import typer

from proxops.cli.common import (
    EVALUATION_SEEDS,
    Processes,
    ScenarioChanges,
    SchedulerAddress,
    check_folder,
    check_transits_drawn,
    print_rows,
    status,
    training_extra,
    typed_command,
    work_bar,
)
from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems.common import InputError

_QUICK_TRANSITS, _QUICK_BODIES = 2, 2


class LidarNetwork(enum.StrEnum):
    """The network that replaces the lidar in the flights in which the paper's network does."""

    LEARNED = "learned"
    PAPER = "paper"


def reproduce_command(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="paper, believed, worlds, or a campaign such as flagship. Default: all.",
        ),
    ] = None,
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario file (YAML). Default: Kleopatra.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(help="Train nothing and fly few transits, as a first look. It takes minutes."),
    ] = False,
    transits: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Number of transits for each controller. Default: 200 and, of the flagship, 852; "
            "with --quick 2.",
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            min=EVALUATION_SEEDS,
            help="Seed of the paper's transits; seeds below 10,000 are for training.",
        ),
    ] = EVALUATION_SEEDS,
    lidar: Annotated[
        LidarNetwork,
        typer.Option(
            help="Network that makes the frames of the paper's disturbed flights: our ray network "
            "(learned), or an MLP like the paper's (paper)."
        ),
    ] = LidarNetwork.LEARNED,
    bodies: Annotated[
        Path | None,
        typer.Option(help="Folder of bodies of your own, YAML files of proxops shape --body."),
    ] = None,
    settings: ScenarioChanges = None,
    out: Annotated[Path, typer.Option(help="Folder for all stages and the report.")] = Path(
        "out/reproduction"
    ),
    workers: Processes = None,
    scheduler: SchedulerAddress = None,
) -> None:
    """Reproduce all evidence: the paper, then what goes beyond it, with one report.

    paper collects, trains and flies as the paper does, on the true state, and has a report of its
    own in the folder paper. believed flies on navigation, in a world that is as believed. worlds
    draws each flight's world, and flies at other bodies. Beyond the paper no frames are logged,
    gravity is that of its table unless --quick is given, and --scenario and --set count at the
    scenario's own body only: at others all is as proxops shape sets it up.

    The command writes report.html, report.md and results.json, and a folder for each stage. Run it
    again to continue after an interruption; a stage that is done is repeated only if its inputs
    have changed.

    Examples:

      proxops reproduce --quick --out out/look

      proxops reproduce flagship --out out/reproduction

      proxops reproduce worlds --bodies my_bodies
    """
    check_folder(out)
    # matplotlib is slow to import.
    from proxops.studies import campaigns, reproduction

    names, settings, folder = names or [], settings or [], out / reproduction.PAPER
    wanted = load_scenario(scenario, settings)
    check_transits_drawn(wanted, settings)
    load_body(wanted.body)
    own = [] if bodies is None else reproduction.own_bodies(bodies)
    transits = _QUICK_TRANSITS if quick and transits is None else transits
    with_paper = not names or reproduction.PAPER in names

    def known(recipe: Path | None) -> list[campaigns.Campaign]:
        """All campaigns that can be flown with the policy of the paper's recipe."""
        count = _QUICK_BODIES if quick else len(campaigns.BODIES)
        found = campaigns.all_campaigns(recipe, own, count)
        return [dc.replace(each, transits=transits or each.transits) for each in found]

    to_be_trained = folder if with_paper and not quick else None
    recipe = reproduction.paper_policy(folder) or to_be_trained
    chosen = reproduction.chosen_campaigns(names, known(recipe))
    if own and not {str(path) for path in own} & {each.body for each in chosen}:
        raise InputError("--bodies names bodies at which nothing is flown: name worlds too")
    if seed != EVALUATION_SEEDS and not with_paper:
        raise InputError("--seed is that of the paper's transits: name paper too, or leave it out")
    if lidar != LidarNetwork.LEARNED and to_be_trained is None:
        raise InputError("--lidar is for the paper's training: name paper too, without --quick")
    command, paper = typed_command(), None
    with work_bar() as progress, Workers(workers, scheduler).kept() as fleet:

        def tell(stage: str, done: float, text: str) -> None:
            progress(done, f"{stage} {text}")

        if with_paper:
            judged = reproduction.ReproductionSettings(seed=seed)
            judged = judged if transits is None else judged.of_transits(transits)
            training = None
            if not quick:
                with training_extra("; or give --quick"):
                    training = reproduction.TrainingSettings(lidar_network=lidar.value)
            paper = reproduction.reproduce(
                load_scenario(scenario, settings, on_true_state=True), folder, judged, training,
                command=command, workers=fleet, tell=tell,
            )  # fmt: skip
        # Frames of so many flights would fill a disk, and a table takes a minute at each body.
        gravity = wanted.gravity if quick else "table"
        shared = dc.replace(wanted, log_ranges=False, gravity=gravity)
        flown = known(reproduction.paper_policy(folder))
        found = reproduction.fly_and_tell(
            flown, reproduction.chosen_campaigns(names, flown), shared, out,
            command=command, workers=fleet, tell=tell,
        )  # fmt: skip
    if paper is not None:
        lines = [(f"{line['what']} (paper: {line['paper']})", line["ours"])
                 for line in paper["paper_and_ours"]]  # fmt: skip
        print_rows("the paper's numbers, and ours", lines)
        if paper["not_run"]:
            status.print(f"Not run: {', '.join(paper['not_run'])}")
    print_rows("success", reproduction.success_lines(found))
    status.print(f"Wrote report.html, report.md and results.json in {out}")
