"""What a page of Meshcat holds."""

import base64
import json
import re
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat


def messages(html: str) -> list[bytes]:
    """Returns Meshcat's binary messages, which the page sends to the viewer."""
    return [base64.b64decode(text) for text in re.findall(r"base64,([A-Za-z0-9+/=]{20,})", html)]


def known(page: str) -> dict[str, Any]:
    """Returns the data of the flight in the panel's script."""
    (content,) = re.findall(r"const flight = (\{.*\});", page)
    return json.loads(content)


def points_told(meshcat: Meshcat, name: str) -> np.ndarray:
    """The points (N, 3) of what a Meshcat holds under a name."""
    return points_of(meshcat.StaticHtml(), name)


def points_of(page: str, name: str) -> np.ndarray:
    """The points (N, 3) of what a page holds under a name."""
    [message] = [m for m in messages(page) if name.encode() in m and b"set_object" in m]
    at = message.index(b"position")
    at = message.index(b"array", at) + len(b"array")
    # MessagePack: an extension of type 0x17 (float32) whose length precedes it.
    kind = message[at]
    width = {0xC7: 1, 0xC8: 2, 0xC9: 4}[kind]
    size = int.from_bytes(message[at + 1 : at + 1 + width], "big")
    data = message[at + 2 + width : at + 2 + width + size]
    return np.frombuffer(data, np.float32).reshape(-1, 3)


def animated(page: str, name: str, track: str) -> dict[int, np.ndarray]:
    """The keys of a track (scale, position or quaternion) of a path's animation, by their frames.

    A quaternion is (x, y, z, w), as three.js has it.
    """
    [message] = [m for m in messages(page) if b"set_animation" in m]
    start = message.index(name.encode() + b"\xa4clip")
    clip = message[start : message.find(b"\xa4path", start) % (len(message) + 1)]
    clip = clip[clip.index(b"." + track.encode()) :]
    clip = clip[: clip.find(b"\xa4name") % (len(clip) + 1)]
    key = rb"\xa4time(?:([\x00-\x7f])|\xcc(.)|\xcd(..))\xa5value[\x93\x94]((?:\xcb.{8}){3,4})"
    return {
        int.from_bytes(b"".join(time), "big"): np.frombuffer(
            b"".join(value[k + 1 : k + 9] for k in range(0, len(value), 9)), ">f8"
        )
        for *time, value in re.findall(key, clip, re.DOTALL)
    }


def doubles(packed: bytes, name: bytes, count: int) -> np.ndarray:
    """The numbers of an array in MessagePack: each is float64 after a byte of its own."""
    at = packed.index(b"\xcb", packed.index(name))
    return np.array(
        [np.frombuffer(packed[k + 1 : k + 9], ">f8")[0] for k in at + 9 * np.arange(count)]
    )


def pose(meshcat: Meshcat, name: str) -> np.ndarray:
    """The transform (4, 4) of a path."""
    return doubles(meshcat._GetPackedTransform(name), b"matrix", 16).reshape(4, 4).T
