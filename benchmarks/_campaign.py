"""What the benchmarks that fly campaigns share: their options, and a bar while they fly."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from proxops.diagrams.flight import Row, Workers
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Scenario
from proxops.studies.campaigns import Variant, fly_logs, fly_variants
from proxops.systems.common import InputError


def campaign_parser(text: str, out: str, transits: int, seed: int) -> argparse.ArgumentParser:
    """A parser with the options of all campaigns; `text` is the benchmark's docstring."""
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_campaign_options(parser, out, transits, seed)
    return parser


def add_campaign_options(
    parser: argparse.ArgumentParser, out: str, transits: int, seed: int
) -> None:
    """Adds the options of all campaigns."""
    parser.add_argument("--transits", type=int, default=transits)
    parser.add_argument("--seed", type=int, default=seed, help="of the set of transits")
    parser.add_argument("--workers", type=int, help="processes; default: one for each core")
    parser.add_argument("--out", type=Path, default=Path(out), help="folder of the flights")
    parser.add_argument("--markdown", type=Path, help="also write the table there")


def fly_with_bar(
    variants: Sequence[Variant], scenario: Scenario, asked: argparse.Namespace, **options: Any
) -> dict[str, list[Row]]:
    """`fly_variants` as the options of `campaign_parser` ask; wrong input ends the program."""
    with workers_with_bar(asked) as workers:
        return fly_variants(
            variants, scenario, asked.seed, asked.transits, asked.out, workers=workers, **options
        )


def logs_with_bar(
    variants: Sequence[Variant], scenario: Scenario, asked: argparse.Namespace
) -> dict[str, dict[int, FlightLog]]:
    """`fly_logs` of all transits, as the options of `campaign_parser` ask."""
    transits = {each.name: range(asked.transits) for each in variants}
    with workers_with_bar(asked) as workers:
        return fly_logs(variants, scenario, asked.seed, transits, asked.out, workers=workers)


@contextmanager
def workers_with_bar(asked: argparse.Namespace) -> Iterator[Workers]:
    """Workers that show a bar; wrong input ends the program."""
    columns = TextColumn("flying"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, TextColumn("{task.description}"), console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=1.0)

        def progress(done: float, text: str) -> None:
            bar.update(task, completed=done, description=text)

        try:
            yield Workers(asked.workers, None, progress)
        except InputError as error:
            raise SystemExit(str(error)) from error
