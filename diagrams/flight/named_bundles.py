"""Which policy's bundle a named controller flies, and the hash that identifies it."""

from __future__ import annotations

from pathlib import Path

from proxops.assets import ASSETS
from proxops.diagrams.scenario import Scenario
from proxops.systems import GuidanceBundle, PolicyBundle
from proxops.systems.policy import GUIDANCE_FILE

WITH_BUNDLE = ("policy", "hybrid", "pd", "mpc")
"""Kinds of controllers whose names may contain a policy's bundle, such as `policy:out/bundle`."""
_WITHOUT_BUNDLE = ("pd", "mpc")
"""The kinds among them that fly without a policy if the name contains no bundle."""
_SHIPPED_POLICY = ASSETS / "any_body"
# Bundles that ship beside it, by the names that a controller's name may have after the colon.
_NAMED_BUNDLES = {"end-to-end": ASSETS / "end_to_end"}


def bundle_of(name: str, scenario: Scenario) -> Path | None:
    """Gives the folder of the bundle that a named controller flies; None if it flies none.

    `policy` and `hybrid` fly the scenario's bundle; `pd` and `mpc` fly none. After a colon comes
    `end-to-end`, the pilot that ships for Kleopatra, or a path relative to the working directory.
    """
    kind, colon, path = name.partition(":")
    if kind not in WITH_BUNDLE or name in _WITHOUT_BUNDLE:
        return None
    if not colon:
        return Path(scenario.policy.bundle or _SHIPPED_POLICY)
    return _NAMED_BUNDLES.get(path, Path(path))


def policy_sha256(bundle: Path) -> str:
    """Gives the hash that identifies a policy's bundle.

    Raises:
      InputError: there is no bundle in the folder, or it is damaged.
    """
    kind = GuidanceBundle if (bundle / GUIDANCE_FILE).exists() else PolicyBundle
    return kind.load(bundle).sha256
