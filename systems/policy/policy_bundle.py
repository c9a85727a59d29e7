"""`PolicyBundle`: a folder with a policy's network and the conditions it was trained for."""

from __future__ import annotations

import math
import typing
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from proxops.systems.common import BundleKind, InputError, open_session

if typing.TYPE_CHECKING:
    import onnxruntime as ort

POLICY_INPUTS = ("ranges", "target", "commanded_force", "memory")
POLICY_OUTPUTS = ("force", "estimate", "next_memory")
"""Names of the network's inputs and outputs; each is one row of float32.

Inputs: ranges (planes * rays) in m, +inf where nothing returned; target (6) in m and m/s; the force
(3) in N that was commanded over the last period, 0 at the first step; memory, 0 at the start of a
flight. Outputs: force (3) in N; estimate (6) of position and velocity in m and m/s, NaN if the
network makes none; the memory for the next step."""
POLICY_BUNDLE = BundleKind(
    noun="policy",
    file="policy.json",
    format="proxops policy 1",
    keys={
        "recipe": str, "planes": int, "rays": int, "period_s": float, "thrust_limit_n": float,
        "memory": int, "estimates": bool, "body": str, "shape_sha256": str, "data_sha256": str,
        "metrics": dict, "onnx_difference": float,
    },
    command="proxops train",
)  # fmt: skip
# Fields of `PolicyFacts` that have another name, with their unit, in the manifest.
_UNITS = {"period": "period_s", "thrust_limit": "thrust_limit_n"}


@dataclass(frozen=True, kw_only=True)
class PolicyFacts:
    """What a bundle says of its policy."""

    recipe: str
    """Name of the training recipe."""
    planes: int
    rays: int
    period: float
    """Control period in s."""
    thrust_limit: float
    """Greatest force per axis in N in its training data."""
    memory: int
    """Length of the memory, which goes from step to step; at least 1."""
    estimates: bool
    """Whether it estimates position and velocity."""
    body: str
    """Name of the body that it was trained at."""
    shape_sha256: str
    """`Polyhedron.sha256` of that body."""
    data_sha256: str
    """Hash of the training data."""
    metrics: dict[str, typing.Any] = field(default_factory=dict)
    """Further figures of the training, as JSON takes them."""

    def told(self) -> dict[str, typing.Any]:
        """Gives the facts as the manifest has them."""
        return {key: getattr(self, name) for name, key in _keys().items()}


def _keys() -> dict[str, str]:
    """The manifest's keys by the names of the facts."""
    return {each.name: _UNITS.get(each.name, each.name) for each in fields(PolicyFacts)}


@dataclass(frozen=True, kw_only=True)
class PolicyBundle(PolicyFacts):
    """A policy that was read from its folder."""

    path: Path
    sha256: str
    """Hash of the manifest, which holds the network's hash. It identifies the bundle."""
    session: ort.InferenceSession = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> PolicyBundle:
        """Reads a bundle's folder.

        Raises:
          InputError: there is no bundle, it has another format, or it is damaged; the message says
            which.
        """
        folder = Path(path)
        content, sha256, model = POLICY_BUNDLE.read(folder)
        for key in ("planes", "rays", "period_s", "thrust_limit_n", "memory"):
            if not 0 < content[key] < math.inf:
                raise InputError(f"{folder / POLICY_BUNDLE.file} is damaged: {key} is not positive")
        try:
            session = open_session(model)
            check_network(session, content["planes"] * content["rays"], content["memory"])
        except InputError as error:
            raise InputError(f"{folder} is no policy: {error}") from error
        facts = {name: content[key] for name, key in _keys().items()}
        return cls(path=folder, sha256=sha256, session=session, **facts)


def check_network(session: ort.InferenceSession, rays: int, memory: int) -> None:
    """Raises `InputError` if a network's inputs and outputs are not those of a policy.

    Args:
      rays: number of rays in all planes. memory: length of the memory.
    """
    sizes = {
        "ranges": rays, "target": 6, "commanded_force": 3, "memory": memory,
        "force": 3, "estimate": 6, "next_memory": memory,
    }  # fmt: skip
    for kind, names, values in (
        ("inputs", POLICY_INPUTS, session.get_inputs()),
        ("outputs", POLICY_OUTPUTS, session.get_outputs()),
    ):
        wanted = {name: ("tensor(float)", [1, sizes[name]]) for name in names}
        got = {value.name: (value.type, list(value.shape)) for value in values}
        if got != wanted:
            raise InputError(f"the network's {kind} are {got}, not {wanted}")


def run_network(
    session: ort.InferenceSession,
    ranges: np.ndarray,
    target: np.ndarray,
    commanded_force: np.ndarray,
    memory: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Runs the network once: force (3,), estimate (6,) and next memory, all float32."""
    given = {
        "ranges": ranges,
        "target": target,
        "commanded_force": commanded_force,
        "memory": memory,
    }
    rows = {name: np.asarray(row, dtype=np.float32)[None] for name, row in given.items()}
    force, estimate, next_memory = (np.asarray(row)[0] for row in session.run(POLICY_OUTPUTS, rows))
    return force, estimate, next_memory
