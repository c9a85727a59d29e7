"""`proxops reproduce`: reproduces the paper and all that goes beyond it, with one command."""

from __future__ import annotations

import contextlib
import enum
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

from proxops.cli.common import (
    EVALUATION_SEEDS,
    Processes,
    ScenarioChanges,
    SchedulerAddress,
    check_folder,
    check_transits_drawn,
    print_rows,
    progress_bar,
    status,
    training_extra,
    typed_command,
)
from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems.common import InputError

if typing.TYPE_CHECKING:
    from proxops.studies.beyond import Campaign

Tell = Callable[[str, float, str], Any]
_QUICK_TRANSITS, _QUICK_BODIES = 2, 2


class LidarNetwork(enum.StrEnum):
    """The network that replaces the lidar in the flights in which the paper's network does."""

    LEARNED = "learned"
    PAPER = "paper"


FramesNetwork = Annotated[
    LidarNetwork,
    typer.Option(
        help="Network that makes the frames of the paper's disturbed flights: our ray network "
        "(learned), or an MLP like the paper's (paper)."
    ),
]
CampaignNames = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[NAME]...",
        help="paper, believed, worlds, or a campaign such as flagship. Default: all.",
    ),
]


def reproduce_command(
    names: CampaignNames = None,
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
    from proxops.studies import beyond

    wanted = load_scenario(scenario, settings or [])
    check_transits_drawn(wanted, settings)
    load_body(wanted.body)
    own = [] if bodies is None else beyond.own_bodies(bodies)
    with _stage_bar() as tell, Workers(workers, scheduler).kept() as fleet:
        asked = _Asked(names or [], scenario, settings or [], quick, transits, own, out, fleet)
        asked.check(seed, lidar)
        paper = None
        if asked.wants(beyond.PAPER):
            paper = _reproduce_paper(asked, seed, lidar, tell)
        found = _go_beyond(asked, tell)
    if paper is not None:
        lines = [(f"{line['what']} (paper: {line['paper']})", line["ours"])
                 for line in paper["paper_and_ours"]]  # fmt: skip
        print_rows("the paper's numbers, and ours", lines)
        if paper["not_run"]:
            status.print(f"Not run: {', '.join(paper['not_run'])}")
    print_rows("success", beyond.success_lines(found))
    status.print(f"Wrote report.html, report.md and results.json in {out}")


class _Asked(NamedTuple):
    """What the command line asks for."""

    names: list[str]
    scenario: Path | None
    settings: list[str]
    quick: bool
    transits: int | None
    bodies: list[Path]
    out: Path
    workers: Workers

    def wants(self, name: str) -> bool:
        """Whether a part or a campaign is asked for by its name, or all are."""
        return not self.names or name in self.names

    def campaigns(self, to_be_trained: bool = False) -> list[Campaign]:
        """All campaigns that can be flown now; with --quick or --transits they are shorter.

        Args:
          to_be_trained: whether those of the paper's recipe count before it is trained.
        """
        from proxops.studies import beyond
        from proxops.studies.reproduction import paper_policy

        folder = self.out / beyond.PAPER
        papers = paper_policy(folder) or (folder if to_be_trained else None)
        bodies = _QUICK_BODIES if self.quick else len(beyond.BODIES)
        known = beyond.all_campaigns(papers, self.bodies, bodies)
        count = self.transits if self.transits is not None else _QUICK_TRANSITS
        if not self.quick and self.transits is None:
            return known
        return [each.of_transits(count) for each in known]

    def check(self, seed: int, lidar: LidarNetwork) -> None:
        """Raises `InputError` if a name is wrong, or if nothing heeds an option that is given.

        Args:
          seed, lidar: options of the paper's reproduction.
        """
        from proxops.studies import beyond

        paper = self.wants(beyond.PAPER)
        known = self.campaigns(to_be_trained=paper and not self.quick)
        chosen = beyond.chosen_campaigns(self.names, known)
        if self.bodies and not {str(path) for path in self.bodies} & {each.body for each in chosen}:
            raise InputError("--bodies names bodies at which nothing is flown: name worlds too")
        if seed != EVALUATION_SEEDS and not paper:
            raise InputError(
                "--seed is that of the paper's transits: name paper too, or leave it out"
            )
        if lidar != LidarNetwork.LEARNED and (self.quick or not paper):
            raise InputError("--lidar is for the paper's training: name paper too, without --quick")


def _reproduce_paper(asked: _Asked, seed: int, lidar: LidarNetwork, tell: Tell) -> dict[str, Any]:
    """Runs what is left of the paper's reproduction; returns what its report.json holds."""
    from proxops.studies import beyond
    from proxops.studies.reproduction import ReproductionSettings, reproduce

    wanted = load_scenario(asked.scenario, asked.settings, on_true_state=True)
    judged = ReproductionSettings(seed=seed)
    judged = judged.quick() if asked.quick else judged
    judged = judged if asked.transits is None else judged.of_transits(asked.transits)
    training = None
    if not asked.quick:
        with training_extra("; or give --quick"):
            from proxops.studies.reproduction import TrainingSettings
        training = TrainingSettings(lidar_network=lidar.value)
    return reproduce(
        wanted, asked.out / beyond.PAPER, judged, training,
        command=typed_command(), workers=asked.workers, tell=tell,
    )  # fmt: skip


def _go_beyond(asked: _Asked, tell: Tell) -> dict[str, Any]:
    """Flies what is left of the campaigns that are asked for; returns what results.json holds."""
    from proxops.studies import beyond

    known = asked.campaigns()
    chosen = beyond.chosen_campaigns(asked.names, known)
    wanted = load_scenario(asked.scenario, asked.settings)
    # Frames of so many flights would fill a disk, and a table takes a minute at each body.
    wanted.log_ranges = False
    wanted.gravity = wanted.gravity if asked.quick else "table"
    return beyond.fly_and_tell(
        known, chosen, wanted, asked.out, command=typed_command(), workers=asked.workers, tell=tell
    )


@contextlib.contextmanager
def _stage_bar() -> Iterator[Tell]:
    """Shows a progress bar with the stage, the done share of the stage, and a text."""
    columns = (TextColumn("{task.fields[stage]}"), BarColumn(), TimeElapsedColumn())
    with progress_bar(*columns, TextColumn("{task.description}")) as bar:
        task = bar.add_task("", total=1.0, stage="")

        def tell(stage: str, done: float, text: str) -> None:
            bar.update(task, completed=done, description=text, stage=stage)

        yield tell
