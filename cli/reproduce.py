"""`proxops reproduce`: reproduces the paper and all that goes beyond it, with one command."""

from __future__ import annotations

import dataclasses as dc
import enum
import functools
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

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
from proxops.diagrams.scenario import Scenario, load_body, load_scenario
from proxops.systems.common import InputError, Progress

if typing.TYPE_CHECKING:
    from proxops.studies.campaigns import Campaign

Tell = Callable[[str, float, str], Any]
_QUICK_TRANSITS = 2


class LidarNetwork(enum.StrEnum):
    """The network that replaces the lidar in the flights in which the paper's network does."""

    LEARNED = "learned"
    PAPER = "paper"


CampaignNames = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[NAME]...",
        help="paper, believed, worlds, rigid, real, touch, maps, missions, or a campaign such as "
        "flagship. Default: all.",
    ),
]
FramesNetwork = Annotated[
    LidarNetwork,
    typer.Option(
        help="Network that makes the frames of the paper's disturbed flights: our ray network "
        "(learned), or an MLP like the paper's (paper)."
    ),
]


def reproduce_command(
    names: CampaignNames = None,
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario file (YAML), or its name. Default: Kleopatra.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(help="Train nothing and fly few transits, as a first look. It takes minutes."),
    ] = False,
    transits: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Number of flights for each controller. Default: 20 to 852; with --quick 2.",
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            min=EVALUATION_SEEDS,
            help="Seed of the paper's transits; seeds below 10,000 are for training.",
        ),
    ] = EVALUATION_SEEDS,
    lidar: FramesNetwork = LidarNetwork.LEARNED,
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
    draws each flight's world, and flies at other bodies; rigid flies a rigid spacecraft, and real
    at real bodies. touch flies down to a place, maps surveys, and missions do all of it. Beyond the
    paper no frames are logged, gravity is that of its table unless --quick is given, and --scenario
    and --set count at the scenario's own body only.

    The command writes report.html, report.md and results.json, and a folder for each stage. Run it
    again to continue after an interruption; a stage that is done is repeated only if its inputs
    have changed.

    Examples:

      proxops reproduce --quick --out out/look

      proxops reproduce flagship --out out/reproduction

      proxops reproduce worlds --bodies my_bodies
    """
    check_folder(out)
    wanted, options = load_scenario(scenario, settings or []), Workers(workers, scheduler)
    check_transits_drawn(wanted, settings)
    load_body(wanted.body)
    transits = _QUICK_TRANSITS if quick and transits is None else transits
    asked = _Asked(names or [], quick, transits, bodies, out)
    asked.check(seed, lidar)
    with work_bar() as progress, options.kept() as fleet:
        tell = functools.partial(_tell, progress)
        paper = None
        if asked.with_paper:
            on_true_state = load_scenario(scenario, settings or [], on_true_state=True)
            paper = _reproduce_paper(asked, on_true_state, seed, lidar, fleet, tell)
        found = _go_beyond(asked, wanted, fleet, tell)
    _print(paper, found)
    status.print(f"Wrote report.html, report.md and results.json in {out}")


class _Asked(typing.NamedTuple):
    """What the command line asks for."""

    names: list[str]
    quick: bool
    transits: int | None
    bodies: Path | None
    out: Path

    @property
    def paper(self) -> Path:
        """The folder of the paper's reproduction."""
        from proxops.studies.reproduction import PAPER  # matplotlib is slow to import.

        return self.out / PAPER

    @property
    def with_paper(self) -> bool:
        """Whether the paper is reproduced, too."""
        return not self.names or self.paper.name in self.names

    def campaigns(self, *, to_be_trained: bool = False) -> tuple[list[Campaign], list[Campaign]]:
        """All campaigns that can be flown now, and those of them that are asked for.

        Args:
          to_be_trained: whether those of the paper's recipe count before it is trained.
        """
        from proxops.studies.campaigns import all_campaigns
        from proxops.studies.reproduction import chosen_campaigns, own_bodies, paper_policy

        recipe = paper_policy(self.paper) or (self.paper if to_be_trained else None)
        own = [] if self.bodies is None else own_bodies(self.bodies)
        known = all_campaigns(recipe, own, self.quick)
        known = [dc.replace(each, transits=self.transits or each.transits) for each in known]
        return known, chosen_campaigns(self.names, known)

    def check(self, seed: int, lidar: LidarNetwork) -> None:
        """Raises `InputError` if a name is wrong, or if nothing heeds an option that is given."""
        from proxops.studies.reproduction import own_bodies

        trains = self.with_paper and not self.quick
        _, chosen = self.campaigns(to_be_trained=trains)
        own = set() if self.bodies is None else {str(path) for path in own_bodies(self.bodies)}
        if own and not own & {each.body for each in chosen}:
            raise InputError("--bodies names bodies at which nothing is flown: name worlds too")
        if seed != EVALUATION_SEEDS and not self.with_paper:
            raise InputError(
                "--seed is that of the paper's transits: name paper too, or leave it out"
            )
        if lidar != LidarNetwork.LEARNED and not trains:
            raise InputError("--lidar is for the paper's training: name paper too, without --quick")


def _tell(progress: Progress, stage: str, done: float, text: str) -> None:
    progress(done, f"{stage} {text}")


def _reproduce_paper(
    asked: _Asked, scenario: Scenario, seed: int, lidar: LidarNetwork, fleet: Workers, tell: Tell
) -> dict[str, Any]:
    """Runs what is left of the paper's reproduction; returns what its report.json holds."""
    from proxops.studies import reproduction

    judged = reproduction.ReproductionSettings(seed=seed)
    judged = judged if asked.transits is None else judged.of_transits(asked.transits)
    training = None
    if not asked.quick:
        with training_extra("; or give --quick"):
            training = reproduction.TrainingSettings(lidar_network=lidar.value)
    return reproduction.reproduce(
        scenario, asked.paper, judged, training,
        command=typed_command(), workers=fleet, tell=tell,
    )  # fmt: skip


def _go_beyond(asked: _Asked, scenario: Scenario, fleet: Workers, tell: Tell) -> dict[str, Any]:
    """Flies what is left of the campaigns that are asked for; returns what results.json holds."""
    from proxops.studies.reproduction import fly_and_tell

    # Frames of so many flights would fill a disk, and a table takes a minute at each body.
    gravity = scenario.gravity if asked.quick else "table"
    shared = dc.replace(scenario, log_ranges=False, gravity=gravity)
    return fly_and_tell(
        *asked.campaigns(), shared, asked.out, command=typed_command(), workers=fleet, tell=tell
    )


def _print(paper: dict[str, Any] | None, found: dict[str, Any]) -> None:
    from proxops.studies.reproduction import success_lines

    if paper is not None:
        lines = [(f"{line['what']} (paper: {line['paper']})", line["ours"])
                 for line in paper["paper_and_ours"]]  # fmt: skip
        print_rows("the paper's numbers, and ours", lines)
        if paper["not_run"]:
            status.print(f"Not run: {', '.join(paper['not_run'])}")
    print_rows("success", success_lines(found))
