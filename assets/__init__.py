"""Data that ship with proxops: asteroids, scenarios, dispersions, spacecraft and policy bundles."""

from pathlib import Path

ASSETS: Path = Path(__file__).parent
"""The folder itself: wheels are installed unzipped, so a plain path serves."""
