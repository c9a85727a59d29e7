"""Shows what each part of the policy for any body buys, in closed loop, at bodies it never saw.

All variants fly the same transits on the navigation's state, but the last:

- `bare law`: the guidance law of least effort inside the policy, all learned corrections zero;
- `no body inputs`: a network that is told nothing of the body. Only the law knows its gravity;
- `one body`: a network that learned from plans of `--one` transits at Kleopatra alone;
- `plans alone`: what `proxops train --recipe any-body` gives, before DAgger;
- `DAgger, as believed`: all rounds flown in worlds as believed, if `--as-believed` names it;
- `all of it`: what `proxops dagger` gives;
- `all of it, true state`: the same, told the truth.

The last two are flown by the policy that ships. The others need PyTorch, `--guidance` and
`--dagger`: folders that `proxops train` and `proxops dagger` wrote. Their policy is `all of it`
then. The second and the third are trained here, with the settings of `--guidance`, the second from
its plans. Trainings and flights are kept in the folder of `--out`: run the command again to finish
what was interrupted. Δv is over the MPC's on navigation.

    python benchmarks/any_body_ablation.py [--guidance out/any-body --dagger out/any-body-dagger]
        [--as-believed out/any-body-believed] [--one 1600] [--bodies kleopatra 20:0 …]
        [--transits 20] [--seed 60] [--workers N] [--out out/any-body-ablation]
        [--markdown table.md]
"""

import argparse
import dataclasses as dc
from pathlib import Path

from _bodies import KLEOPATRA
from _campaign import campaign_parser, show, workers_with_bar
from any_body import HEADINGS, MPC, table_of_flights

from proxops.studies.campaigns import Stages, Variant

ON_TRUTH = {"navigation": {"_tag": "!TrueState"}}
# A network that learned at one body knows a family of one.
ANYWHERE = {"policy.beyond_family": True}
KEPT = [each for each in HEADINGS if each not in ("policy share (%)", "solves saved (%)")]


def options() -> argparse.Namespace:
    """The options of the command line; ends the program if one is wrong."""
    parser = campaign_parser(__doc__, "out/any-body-ablation", transits=20, seed=60)
    parser.add_argument("--guidance", type=Path, help="a folder of proxops train")
    parser.add_argument("--dagger", type=Path, help="a folder of proxops dagger")
    parser.add_argument("--as-believed", type=Path, help="such a folder, without dispersions")
    parser.add_argument("--one", type=int, default=1600, help="transits at Kleopatra to learn from")
    usual = [KLEOPATRA, *(f"20:{number}" for number in range(4))]
    parser.add_argument("--bodies", nargs="+", default=usual, metavar="BODY")
    parser.set_defaults(set=[], dispersions=None, true_state=False)
    return parser.parse_args()


def trained_bundles(asked: argparse.Namespace) -> dict[str, Path]:
    """Bundles of all variants that ship with nothing; those that are missing are trained."""
    if (asked.guidance, asked.dagger) == (None, None):
        return {}
    if None in (asked.guidance, asked.dagger):
        raise SystemExit("any_body_ablation.py: --guidance and --dagger belong together")
    # PyTorch takes a while to import, and nothing else here needs it.
    from _guidance_variants import bare_law, no_body_inputs, one_body

    with workers_with_bar(asked) as workers:
        stages = Stages(asked.out / "trained", lambda name, *done: workers.progress(*done))
        bundles = {
            "bare law": bare_law(asked.dagger, stages),
            "no body inputs": no_body_inputs(asked.guidance, stages, workers),
            "one body": one_body(asked.guidance, asked.one, stages, workers),
        }
    bundles["plans alone"] = asked.guidance / "bundle"
    if asked.as_believed is not None:
        bundles["DAgger, as believed"] = asked.as_believed / "bundle"
    return bundles | {"all of it": asked.dagger / "bundle"}


def variants(asked: argparse.Namespace) -> list[Variant]:
    """The MPC and the variants of the policy."""
    found = trained_bundles(asked)
    controllers = {name: f"policy:{bundle.resolve()}" for name, bundle in found.items()}
    controllers.setdefault("all of it", "policy")
    made = [Variant(name, controller, ANYWHERE) for name, controller in controllers.items()]
    told = dc.replace(made[-1], name="all of it, true state", changes=ON_TRUTH | ANYWHERE)
    return [Variant(MPC, "mpc"), *made, told]


def main() -> None:
    asked = options()
    kept = [HEADINGS.index(heading) for heading in KEPT]
    flown = table_of_flights(variants(asked), asked)
    lines = {name: [line[k] for k in kept] for name, line in flown.items()}
    title = f"Transits 0 … {asked.transits - 1} of seed {asked.seed} on navigation, as believed"
    show(title, KEPT, lines, asked.markdown)


if __name__ == "__main__":
    main()
