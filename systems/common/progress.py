"""How long work tells how far it is."""

from collections.abc import Callable
from typing import Any

Progress = Callable[[float, str], Any]
"""Is called now and then with the share done, from 0 to 1, and a text."""
