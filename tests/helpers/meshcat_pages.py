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
