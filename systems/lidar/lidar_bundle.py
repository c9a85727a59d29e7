"""The bundle of a learned lidar: a folder with the network and all that it needs to be flown."""

from __future__ import annotations

import typing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from proxops.systems.common import BundleKind, InputError, read_bundle

if typing.TYPE_CHECKING:
    import onnxruntime as ort

LIDAR_FORMAT = "proxops learned lidar 1"
LIDAR_FILE = "bundle.json"
CHORDS_INPUT, HIT_OUTPUT, DEPTH_OUTPUT = "chords", "hit_logit", "depth"
"""Names in the network: chord ends (K, 6) in; logit of the hit's probability (K,) and depth (K,),
the share of the chord in front of the surface, out; all float32."""
_KIND = BundleKind(
    noun="learned lidar",
    file=LIDAR_FILE,
    format=LIDAR_FORMAT,
    keys={
        "planes": int, "rays": int, "cube_m": float, "centre_m": list, "semi_axes_m": list,
        "body": str, "shape_sha256": str, "model_sha256": str, "training": dict, "versions": dict,
    },
    command="proxops train-lidar",
)  # fmt: skip


@dataclass(frozen=True)
class LidarBundle:
    """A learned lidar as it was read from its folder."""

    path: Path
    planes: int
    rays: int
    cube: float
    """Edge in m of the cube about the body that the training positions filled."""
    centre: np.ndarray
    """(3,) in m in K: of the ellipsoid whose chords describe the rays."""
    semi_axes: np.ndarray
    """(3,) in m along x, y, z: of that ellipsoid."""
    shape_sha256: str
    """Of the body that it was trained on: `Polyhedron.sha256`."""
    sha256: str
    """Of `bundle.json`, which holds the network's hash: names the bundle."""
    session: ort.InferenceSession = field(repr=False)

    @classmethod
    def load(cls, path: str | Path) -> LidarBundle:
        """Reads a bundle's folder.

        Raises:
          InputError: no bundle, of another format, or damaged; the message says which.
        """
        folder = Path(path)
        content, sha256, session = read_bundle(folder, _KIND)
        for key in ("centre_m", "semi_axes_m"):
            if len(content[key]) != 3 or not all(isinstance(x, float) for x in content[key]):
                raise InputError(f"{folder / LIDAR_FILE} is damaged: {key} is not three numbers")
        return cls(
            path=folder,
            planes=content["planes"],
            rays=content["rays"],
            cube=content["cube_m"],
            centre=np.array(content["centre_m"]),
            semi_axes=np.array(content["semi_axes_m"]),
            shape_sha256=content["shape_sha256"],
            sha256=sha256,
            session=session,
        )

    def predict(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logits of the hit's probability and depths (K,), float32, for chord ends (K, 6)."""
        hit, depth = self.session.run([HIT_OUTPUT, DEPTH_OUTPUT], {CHORDS_INPUT: ends})
        return np.asarray(hit), np.asarray(depth)
