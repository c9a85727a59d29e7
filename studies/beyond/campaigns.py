"""The campaigns that go beyond the paper: which controllers fly where, and what they are told."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path

from proxops.studies.evaluation import EXPERT, Variant

BELIEVED, WORLDS = "believed", "worlds"
PARTS = (BELIEVED, WORLDS)
"""In the first the world is as believed; in the second it is drawn for each flight, or the body is
another one."""

POLICY, HYBRID, ADAPTIVE = "policy", "hybrid", "hybrid, adaptive"
PILOT, PILOT_HYBRID = "end-to-end pilot", "hybrid, end-to-end pilot"
PAPER_POLICY = "paper's recipe"
ASSURED_HYBRID = "hybrid, assured"
"""Names of controllers in the report and in results.json."""

BODIES = tuple(f"22:{number}" for number in range(10))
"""Generated bodies, SEED:NUMBER, on which nothing was trained and no choice was made."""
DISPERSED_BODIES = ("22:2", "22:3", "22:6")
"""Those at which flights are dispersed, too: the first three at which runtime assurance flies."""

FLAGSHIP = "flagship"
"""Name of the campaign that says most: whole flights, dispersed, assured, nobody told anything."""
PAPER_RECIPE = "paper-recipe"
"""Name of the campaign that is there only once `proxops reproduce paper` has trained the recipe."""

_SEED = 25_000
_FLAGSHIP_FLIGHTS = 852
_ASSURED = {"assurance": {}}
_ASSURED_FOR_LESS = {"assurance": {"bounds": "before_survey"}}
_ADAPTIVE = {"hybrid.period_rule": "adaptive"}
_TRUE_STATE = "navigation=!TrueState {}"

_MPC = Variant(EXPERT, "mpc")
_POLICY = Variant(POLICY, "policy")
_ASSURED_POLICY = Variant("policy, assured", "policy", _ASSURED)
_HYBRID = Variant(HYBRID, "hybrid")
_ASSURED_HYBRID = Variant(ASSURED_HYBRID, "hybrid", _ASSURED)
_ADAPTIVE_HYBRID = Variant(ADAPTIVE, "hybrid", _ADAPTIVE)
_PILOT = Variant(PILOT, "policy:end-to-end")


@dc.dataclass(frozen=True)
class Campaign:
    """Flights of some controllers on the same transits, in the same worlds, at one body."""

    name: str
    """Of its stage, and of its entry in results.json."""
    part: str
    """One of `PARTS`."""
    title: str
    told: str
    """One sentence on what those on board are told."""
    variants: Sequence[Variant]
    transits: int = 200
    dispersions: str | None = None
    """Name of the dispersions from which each flight's world is drawn; None: the world is as
    believed."""
    body: str | None = None
    """SEED:NUMBER of a generated body, or the path of a body's file; None: the scenario's."""
    true_state: bool = False
    """Whether all are told the true state."""
    seed: int = _SEED

    @property
    def changes(self) -> list[str]:
        """What the campaign changes in the scenario that all share, for `change_scenario`."""
        changes = [] if self.dispersions is None else [f"dispersions={self.dispersions}"]
        return [*changes, _TRUE_STATE] if self.true_state else changes

    def of_transits(self, transits: int) -> Campaign:
        """The same with another number of flights of each controller."""
        return dc.replace(self, transits=transits)


def all_campaigns(
    paper_policy: Path | None = None,
    own_bodies: Sequence[Path] = (),
    bodies: int = len(BODIES),
) -> list[Campaign]:
    """Returns all campaigns, in the order in which they are flown and told.

    Args:
      paper_policy: the bundle of the paper's recipe; without it, there is no campaign of it.
      own_bodies: body files of the user's, each flown as the generated bodies are.
      bodies: number of generated bodies.
    """
    return [
        *_believed(),
        *([] if paper_policy is None else [_papers(paper_policy)]),
        *_dispersed(),
        *(_at_body(name, f"body {name}") for name in BODIES[:bodies]),
        *(_dispersed_at(name) for name in DISPERSED_BODIES[:bodies]),
        *(_at_body(str(path), path.stem) for path in own_bodies),
    ]


def _believed() -> list[Campaign]:
    return [
        Campaign(
            "navigation",
            BELIEVED,
            "On navigation, in a world that is as believed",
            "Nobody is told the state; map, gravity, spin, thrust and mass are the true ones.",
            [
                _MPC,
                _POLICY,
                _ASSURED_POLICY,
                _HYBRID,
                _ASSURED_HYBRID,
                _ADAPTIVE_HYBRID,
                _PILOT,
                Variant(PILOT_HYBRID, "hybrid:end-to-end"),
                Variant("PD", "pd"),
                Variant("no force", "zero"),
                Variant("no force, assured", "zero", _ASSURED),
            ],
        ),
        Campaign(
            "true-state",
            BELIEVED,
            "What the navigation costs: the same, told the true state",
            "All are told the true state, and the world is as believed.",
            [_MPC, _POLICY, _HYBRID, _ADAPTIVE_HYBRID],
            true_state=True,
        ),
    ]


def _papers(bundle: Path) -> Campaign:
    """A campaign of its own: nothing else has to be flown anew when it is trained."""
    return Campaign(
        PAPER_RECIPE,
        BELIEVED,
        "The paper's recipe on the same transits",
        "It flies from the frames alone.",
        [Variant(PAPER_POLICY, f"policy:{bundle}")],
    )


def _dispersed() -> list[Campaign]:
    told = (
        "Nobody is told the state or the world; navigation and assurance are told how large errors "
        "may be, by the same dispersions."
    )
    return [
        Campaign(
            FLAGSHIP,
            WORLDS,
            "After the survey: the flagship",
            told,
            [_ASSURED_HYBRID],
            transits=_FLAGSHIP_FLIGHTS,
            dispersions="after_survey",
            seed=_SEED + 1,
        ),
        Campaign(
            "after-survey",
            WORLDS,
            "After the survey: all controllers",
            told,
            [
                _MPC,
                _POLICY,
                _ASSURED_POLICY,
                _HYBRID,
                _ASSURED_HYBRID,
                _ADAPTIVE_HYBRID,
                _PILOT,
                Variant("PD", "pd"),
            ],
            dispersions="after_survey",
        ),
        Campaign(
            "before-survey",
            WORLDS,
            "Before the survey",
            told,
            [_MPC, _POLICY, _HYBRID, _ASSURED_HYBRID, _PILOT],
            dispersions="before_survey",
        ),
        Campaign(
            "first-look",
            WORLDS,
            "At first look",
            "Nobody is told the state or the world. Assurance refuses errors as large as these, "
            "because the thrust would not hold the spacecraft; it is told those of before_survey.",
            [_MPC, _HYBRID, Variant("hybrid, assured for less", "hybrid", _ASSURED_FOR_LESS)],
            dispersions="first_look",
        ),
    ]


def _at_body(body: str, title: str) -> Campaign:
    return Campaign(
        campaign_name(body),
        WORLDS,
        f"At {title}",
        "Nobody is told the state; the body is as its map. The policy never saw it.",
        [_MPC, _POLICY, _HYBRID, _ASSURED_HYBRID],
        body=body,
    )


def _dispersed_at(body: str) -> Campaign:
    return Campaign(
        f"after-survey-{campaign_name(body)}",
        WORLDS,
        f"After the survey, at body {body}",
        "Nobody is told the state or the world. The policy never saw the body.",
        [_ASSURED_HYBRID],
        dispersions="after_survey",
        body=body,
    )


def campaign_name(body: str) -> str:
    """Name of the campaign at a body: SEED:NUMBER, or the path of its file."""
    return f"at-{Path(body).stem.replace(':', '-')}"
