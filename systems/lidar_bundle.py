"""The bundle of a learned lidar: a folder with the network and all that it needs to be flown."""

from __future__ import annotations

import hashlib
import json
import typing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from proxops.systems.errors import InputError

if typing.TYPE_CHECKING:
    import onnxruntime as ort

FORMAT = "proxops learned lidar 1"
MODEL_FILE = "model.onnx"
BUNDLE_FILE = "bundle.json"
INPUT, HIT, DEPTH = "chords", "hit_logit", "depth"
"""Names in the network: chord ends (K, 6) in; logit of the hit's probability (K,) and depth (K,),
the share of the chord in front of the surface, out; all float32."""
_KEYS = {
    "format": str, "planes": int, "rays": int, "cube_m": float, "centre_m": list,
    "semi_axes_m": list, "body": str, "shape_sha256": str, "model_sha256": str,
    "training": dict, "versions": dict,
}  # fmt: skip


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
        text = _read(folder / BUNDLE_FILE, folder)
        model = _read(folder / MODEL_FILE, folder)
        try:
            content = json.loads(text)
        except ValueError as error:
            raise InputError(f"{folder / BUNDLE_FILE} is damaged: it is not JSON") from error
        _check(content, folder / BUNDLE_FILE)
        if hashlib.sha256(model).hexdigest() != content["model_sha256"]:
            raise InputError(
                f"{folder / MODEL_FILE} is damaged or of another bundle: its hash is not the one "
                f"in {BUNDLE_FILE}; train it again with proxops train-lidar"
            )
        return cls(
            path=folder,
            planes=content["planes"],
            rays=content["rays"],
            cube=content["cube_m"],
            centre=np.array(content["centre_m"]),
            semi_axes=np.array(content["semi_axes_m"]),
            shape_sha256=content["shape_sha256"],
            sha256=hashlib.sha256(text).hexdigest(),
            session=open_session(model),
        )

    def predict(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logits of the hit's probability and depths (K,), float32, for chord ends (K, 6)."""
        hit, depth = self.session.run([HIT, DEPTH], {INPUT: ends})
        return np.asarray(hit), np.asarray(depth)


def open_session(model: bytes) -> ort.InferenceSession:
    """The network of an ONNX file, run by one thread, so that it repeats bit for bit.

    Raises:
      InputError: ONNX Runtime can't take it.
    """
    import onnxruntime as ort  # Slow to import: only when it is needed.

    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's exceptions have no common type.
        raise InputError(f"the network is not one that ONNX Runtime takes: {error}") from error


def _read(path: Path, folder: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{folder} is not the bundle of a learned lidar: {path.name} cannot be read "
            f"({error.strerror}); proxops train-lidar makes one"
        ) from error


def _check(content: typing.Any, path: Path) -> None:
    """Raises `InputError` for what `bundle.json` may not hold, naming the key."""
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{path} is not of the format {FORMAT!r}; train the lidar again")
    for key, kind in _KEYS.items():
        if not isinstance(content.get(key), kind):
            raise InputError(f"{path} is damaged: {key} is no {kind.__name__}")
    for key in ("centre_m", "semi_axes_m"):
        if len(content[key]) != 3 or not all(isinstance(x, float) for x in content[key]):
            raise InputError(f"{path} is damaged: {key} is not three numbers")
