"""The table of campaigns that go beyond the paper: who flies where, and what they are told."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path

from proxops.studies.campaigns.variants import Variant
from proxops.studies.figures import EXPERT

BELIEVED, WORLDS, RIGID, REAL = "believed", "worlds", "rigid", "real"
TOUCH, MAPS, MISSIONS = "touch", "maps", "missions"
PARTS = (BELIEVED, WORLDS, RIGID, REAL, TOUCH, MAPS, MISSIONS)
"""In the first the world is as believed; in the second it is drawn for each flight, or the body is
another one; then a rigid spacecraft flies; then real bodies with spacecraft like those that were
there; then descents to a place, surveys, and missions of all of it."""

PILOT, PAPER_POLICY = "end-to-end pilot", "paper's recipe"
"""Names of controllers in the report and in results.json."""

BODIES = tuple(f"22:{number}" for number in range(10))
"""Generated bodies, SEED:NUMBER, on which nothing was trained and no choice was made."""
_DISPERSED_BODIES = ("22:2", "22:3", "22:6")  # The first three at which runtime assurance flies.

FLAGSHIP = "flagship"
"""Name of the campaign that says most: whole flights, dispersed, assured, nobody told anything."""
PAPER_RECIPE = "paper-recipe"
"""Name of the campaign that is there only once `proxops reproduce paper` has trained the recipe."""

_ASSURED = {"assurance": {}}
_MPC = Variant(EXPERT, "mpc")
_POLICY = Variant("policy", "policy")
_ASSURED_POLICY = Variant("policy, assured", "policy", _ASSURED)
_HYBRID = Variant("hybrid", "hybrid")
_ASSURED_HYBRID = Variant("hybrid, assured", "hybrid", _ASSURED)
_ADAPTIVE = Variant("hybrid, adaptive", "hybrid", {"hybrid.period_rule": "adaptive"})
_PILOT = Variant(PILOT, "policy:end-to-end")
_PD = Variant("PD", "pd")
_FOR_LESS = Variant(
    "hybrid, assured for less", "hybrid", {"assurance": {"bounds": "before_survey"}}
)
_ALL = (_MPC, _POLICY, _ASSURED_POLICY, _HYBRID, _ASSURED_HYBRID, _ADAPTIVE, _PILOT)

_TOLD_DISPERSIONS = (
    "Nobody is told the state or the world; navigation and assurance are told how large errors may "
    "be, by the same dispersions."
)
_TOLD_LESS = (
    "Nobody is told the state or the world. Assurance refuses errors as large as these, because "
    "the thrust would not hold the spacecraft; it is told those of before_survey."
)


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
    scenario: str | None = None
    """Name of a scenario that ships, flown in place of the shared one; None: the shared one is."""
    settings: Sequence[str] = ()
    """Other changes, for `change_scenario`."""
    true_state: bool = False
    """Whether all are told the true state."""
    seed: int = 25_000

    @property
    def changes(self) -> list[str]:
        """What the campaign changes in the scenario that all share, for `change_scenario`."""
        changes = [] if self.dispersions is None else [f"dispersions={self.dispersions}"]
        changes += ["navigation=!TrueState {}"] if self.true_state else []
        return [*changes, *self.settings]


_BELIEVED = (
    Campaign(
        "navigation", BELIEVED, "On navigation, in a world that is as believed",
        "Nobody is told the state; map, gravity, spin, thrust and mass are the true ones.",
        (
            *_ALL,
            Variant("hybrid, end-to-end pilot", "hybrid:end-to-end"),
            _PD,
            Variant("no force", "zero"),
            Variant("no force, assured", "zero", _ASSURED),
        ),
    ),
    Campaign(
        "true-state", BELIEVED, "What the navigation costs: the same, told the true state",
        "All are told the true state, and the world is as believed.",
        (_MPC, _POLICY, _HYBRID, _ADAPTIVE), true_state=True,
    ),
)  # fmt: skip
_DISPERSED = (
    Campaign(
        FLAGSHIP, WORLDS, "After the survey: the flagship", _TOLD_DISPERSIONS,
        (_ASSURED_HYBRID,), transits=852, dispersions="after_survey", seed=25_001,
    ),
    Campaign(
        "after-survey", WORLDS, "After the survey: all controllers", _TOLD_DISPERSIONS,
        (*_ALL, _PD), dispersions="after_survey",
    ),
    Campaign(
        "before-survey", WORLDS, "Before the survey", _TOLD_DISPERSIONS,
        (_MPC, _POLICY, _HYBRID, _ASSURED_HYBRID, _PILOT), dispersions="before_survey",
    ),
    Campaign(
        "first-look", WORLDS, "At first look", _TOLD_LESS,
        (_MPC, _HYBRID, _FOR_LESS), dispersions="first_look",
    ),
)  # fmt: skip
_TOLD_AFAR = (
    "Known are an ellipsoid, a mass and a rotation, each with its error, and no position. The map "
    "is the spacecraft's own."
)
_RIGID = Campaign(
    "rigid-after-survey", RIGID, "A rigid spacecraft, after the survey", _TOLD_DISPERSIONS,
    (_MPC, _POLICY, _ASSURED_HYBRID), transits=100, dispersions="after_survey_rigid",
    settings=("spacecraft=!RigidBody {}",), seed=25_002,
)  # fmt: skip
_TOUCHES = Campaign(
    "touch-bennu", TOUCH, "Touch and go at Bennu", _TOLD_DISPERSIONS,
    (_MPC,), transits=400, dispersions="touch_and_go", scenario="bennu_touch_and_go", seed=25_003,
)  # fmt: skip
_LEARNED = dc.replace(
    _TOUCHES, name="touch-learned", title="Touch and go by a learned descent",
    variants=(_MPC, _POLICY, _HYBRID), transits=100, seed=25_007,
)  # fmt: skip
_REAL = ("bennu", "ryugu", "toutatis", "didymos")
_SURVEYS = (("kleopatra", "first_look"), ("bennu", "approach"), ("ryugu", "approach"))
_MISSIONS = (
    ("bennu_mission", "mission", 100), ("ryugu_mission", "mission", 20),
    ("kleopatra_mission", "first_look", 20), ("didymos_mission", "approach", 20),
    ("toutatis_mission", "approach", 20),
)  # fmt: skip
# Of bodies, and of real missions, maps and missions, for a first look.
_FEW_BODIES, _FEW = 2, 1


def all_campaigns(
    paper_policy: Path | None = None,
    own_bodies: Sequence[Path] = (),
    quick: bool = False,
) -> list[Campaign]:
    """Returns all campaigns, in the order in which they are flown and told.

    Args:
      paper_policy: the bundle of the paper's recipe; without it, there is no campaign of it.
      own_bodies: body files of the user's, each flown as the generated bodies are.
      quick: only some of the bodies, as a first look.
    """
    bodies, few = (_FEW_BODIES, _FEW) if quick else (None, None)
    return [
        *_BELIEVED,
        *([] if paper_policy is None else [_of_papers_recipe(paper_policy)]),
        *_DISPERSED,
        *(_at_body(name, f"body {name}") for name in BODIES[:bodies]),
        *(_dispersed_at(name) for name in _DISPERSED_BODIES[:bodies]),
        *(_at_body(str(path), path.stem) for path in own_bodies),
        _RIGID,
        *map(_real, _REAL[:few]),
        _TOUCHES,
        _LEARNED,
        *(_survey(*each) for each in _SURVEYS[:few]),
        *(_mission(*each) for each in _MISSIONS[:few]),
    ]


def _of_papers_recipe(bundle: Path) -> Campaign:
    """A campaign of its own: nothing else has to be flown anew when it is trained."""
    return Campaign(
        PAPER_RECIPE, BELIEVED, "The paper's recipe on the same transits",
        "It flies from the frames alone.", (Variant(PAPER_POLICY, f"policy:{bundle}"),),
    )  # fmt: skip


def _at_body(body: str, title: str) -> Campaign:
    return Campaign(
        campaign_name(body), WORLDS, f"At {title}",
        "Nobody is told the state; the body is as its map. The policy never saw it.",
        (_MPC, _POLICY, _HYBRID, _ASSURED_HYBRID), body=body,
    )  # fmt: skip


def _dispersed_at(body: str) -> Campaign:
    return Campaign(
        f"after-survey-{campaign_name(body)}", WORLDS, f"After the survey, at body {body}",
        "Nobody is told the state or the world. The policy never saw the body.",
        (_ASSURED_HYBRID,), dispersions="after_survey", body=body,
    )  # fmt: skip


def _real(name: str) -> Campaign:
    return Campaign(
        f"real-{name}", REAL, f"The mission {name}, after the survey", _TOLD_DISPERSIONS,
        (_ASSURED_HYBRID,), transits=100, dispersions="after_survey", scenario=name, seed=25_004,
    )  # fmt: skip


def _survey(name: str, dispersions: str) -> Campaign:
    return Campaign(
        f"map-{name}", MAPS, f"A map of one's own, {name}", _TOLD_AFAR,
        (Variant("survey", "survey"),), transits=20, dispersions=dispersions, scenario=name,
        settings=("task=!Survey {}",), seed=25_005,
    )  # fmt: skip


def _mission(name: str, dispersions: str, count: int) -> Campaign:
    return Campaign(
        name.replace("_", "-"), MISSIONS, f"From first sight on, alone: {name}", _TOLD_AFAR,
        (_HYBRID,), transits=count, dispersions=dispersions, scenario=name, seed=25_006,
    )  # fmt: skip


def campaign_name(body: str) -> str:
    """Name of the campaign at a body: SEED:NUMBER, or the path of its file."""
    return f"at-{Path(body).stem.replace(':', '-')}"
