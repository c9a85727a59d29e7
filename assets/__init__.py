"""Data that ship with proxops: the asteroid's shape and constants, and the policy bundles."""

from pathlib import Path

ASSETS: Path = Path(__file__).parent
"""The folder itself: wheels are installed unzipped, so a plain path serves."""
