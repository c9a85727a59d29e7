"""The bundle of a learned lidar: a folder with the network and all that a flight with it needs."""

from __future__ import annotations

import typing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from proxops.systems.common import BundleKind, InputError, States, Vector3, open_session

if typing.TYPE_CHECKING:
    import onnxruntime as ort

RAY_NETWORK, FRAME_NETWORK = "ray network", "frame network"
"""Kinds of networks: ours answers for each ray, and the paper's gives whole frames."""
CHORDS_INPUT, HIT_OUTPUT, DEPTH_OUTPUT = "chords", "hit_logit", "depth"
"""Names in a ray network: chord ends (K, 6) in; logit of the hit's probability (K,) and depth (K,),
the share of the chord in front of the surface, out; all float32."""
POSITION_INPUT, RANGES_OUTPUT = "position", "ranges"
"""Names in a frame network: positions (1, 3) in K, over half of the cube's edge, in; ranges
(1, planes * rays) in the bundle's unit of length, not positive where no ray returns, out; all
float32."""
LIDAR_BUNDLE = BundleKind(
    noun="learned lidar",
    file="bundle.json",
    format="proxops learned lidar 1",
    keys={
        "planes": int, "rays": int, "cube_m": float, "body": str, "shape_sha256": str,
        "training": dict,
    },
    command="proxops train-lidar",
)  # fmt: skip


@dataclass(frozen=True)
class LidarBundle:
    """A learned lidar as it was read from its folder."""

    path: Path
    kind: str
    """`RAY_NETWORK` or `FRAME_NETWORK`."""
    planes: int
    rays: int
    cube: float
    """Edge in m of the cube about the body that the training positions filled."""
    centre: Vector3
    """(3,) in m in K: centre of the ellipsoid whose chords describe the rays; ray network only."""
    semi_axes: Vector3
    """(3,) in m along x, y, z: semi-axes of that ellipsoid; ray network only."""
    length_unit: float
    """Unit of length in m of a frame network's ranges."""
    shape_sha256: str
    """Hash of the body's shape: `Polyhedron.sha256`."""
    sha256: str
    """Hash of `bundle.json`, which holds the network's hash, so it names the bundle."""
    session: ort.InferenceSession = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> LidarBundle:
        """Reads a bundle's folder.

        Raises:
          InputError: there is no bundle, or it has another format, or it is damaged; the message
            says which.
        """
        folder = Path(path)
        content, sha256, model = LIDAR_BUNDLE.read(folder)
        try:
            session = open_session(model)
        except InputError as error:
            raise InputError(f"{folder} is no learned lidar: {error}") from error
        source = folder / LIDAR_BUNDLE.file
        kind = content.get("kind", RAY_NETWORK)
        centre = semi_axes = np.zeros(3)
        length_unit = 1.0
        if kind == RAY_NETWORK:
            centre, semi_axes = (
                _three(content, key, source) for key in ("centre_m", "semi_axes_m")
            )
            if not (np.isfinite(centre).all() and ((semi_axes > 0.0) & (semi_axes < np.inf)).all()):
                raise InputError(f"{source} is damaged: centre_m or semi_axes_m cannot be")
        elif kind == FRAME_NETWORK:
            length_unit = content.get("length_unit_m")
            if not isinstance(length_unit, float) or not 0.0 < length_unit < np.inf:
                raise InputError(f"{source} is damaged: length_unit_m is not a positive number")
        else:
            raise InputError(f"{source} is damaged: there is no kind {kind!r} of learned lidar")
        if not (
            content["planes"] >= 1 and content["rays"] >= 1 and 0.0 < content["cube_m"] < np.inf
        ):
            raise InputError(f"{source} is damaged: planes, rays and cube_m must be positive")
        bundle = cls(
            path=folder,
            kind=kind,
            planes=content["planes"],
            rays=content["rays"],
            cube=content["cube_m"],
            centre=centre,
            semi_axes=semi_axes,
            length_unit=length_unit,
            shape_sha256=content["shape_sha256"],
            sha256=sha256,
            session=session,
        )
        bundle._check_network()
        return bundle

    def predict(self, ends: States) -> tuple[np.ndarray, np.ndarray]:
        """Logits of the hit's probability and depths (K,), float32, for chord ends (K, 6)."""
        hit, depth = self.session.run([HIT_OUTPUT, DEPTH_OUTPUT], {CHORDS_INPUT: ends})
        return np.asarray(hit), np.asarray(depth)

    def predict_frame(self, position: Vector3) -> np.ndarray:
        """Ranges (planes * rays,) in m from a position (3,) in m in K; not positive: no return."""
        scaled = (position / (0.5 * self.cube)).astype(np.float32)
        (ranges,) = self.session.run([RANGES_OUTPUT], {POSITION_INPUT: scaled[None]})
        return np.asarray(ranges)[0].astype(np.float64) * self.length_unit

    def _check_network(self) -> None:
        """Raises `InputError` unless the network answers as its kind has to."""
        try:
            if self.kind == RAY_NETWORK:
                hit, depth = self.predict(np.zeros((2, 6), dtype=np.float32))
                sound = hit.shape == depth.shape == (2,)
            else:
                sound = self.predict_frame(np.zeros(3)).shape == (self.planes * self.rays,)
        except Exception as error:  # ONNX Runtime's exceptions have no common type.
            raise InputError(f"{self.path}: its network is no {self.kind}: {error}") from error
        if not sound:
            raise InputError(f"{self.path}: its network is no {self.kind}, by its outputs' shapes")


def _three(content: dict[str, typing.Any], key: str, source: Path) -> np.ndarray:
    """Three numbers (3,) under a key of the bundle's file."""
    values = content.get(key)
    if not isinstance(values, list) or [type(each) for each in values] != [float] * 3:
        raise InputError(f"{source} is damaged: {key} is not three numbers")
    return np.array(values)
