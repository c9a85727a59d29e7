"""Data that ship with proxops: the asteroid's shape and constants, and the policy bundle."""

from pathlib import Path, PurePosixPath

# The folder itself: wheels are installed unzipped, so a plain path serves.
ASSETS: Path = Path(__file__).parent


def asset_path(name: str) -> Path:
    """Absolute path of a shipped file or folder, e.g. ``asset_path("kleopatra/kleopatra.obj")``.

    Args:
        name: path relative to the assets folder, with forward slashes and no "..".

    Raises:
        FileNotFoundError: nothing by that name ships; the message lists what does.
    """
    parts = PurePosixPath(name).parts
    path = ASSETS.joinpath(*parts)
    if parts and parts[0] != "/" and ".." not in parts and path.exists():
        return path
    shipped = sorted(
        file.relative_to(ASSETS).as_posix()
        for file in ASSETS.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    )
    raise FileNotFoundError(f"no asset named {name!r}; there are: {', '.join(shipped)}")
