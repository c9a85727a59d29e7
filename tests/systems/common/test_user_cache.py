"""Arrays in the user's cache folder: kept as they are, and gone if their file is damaged."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proxops.systems.common.user_cache import keep_arrays, kept_arrays, name_of

ARRAYS = {"table": np.arange(6.0).reshape(2, 3), "one": np.array(3.0)}


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        keep_arrays("test", name_of("whole"), ARRAYS)
        yield folder / "proxops" / "test" / f"{name_of('whole')}.npz"


def right(found: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(array, ARRAYS[name]) for name, array in found.items())


def test_what_was_kept_is_there(kept: Path) -> None:
    found = kept_arrays("test", kept.stem)
    assert found is not None
    assert found.keys() == ARRAYS.keys()
    assert right(found)
    assert kept_arrays("test", name_of("another")) is None


@given(data=st.data())
def test_one_wrong_byte_is_seen_or_does_no_harm(kept: Path, data: st.DataObject) -> None:
    """The directory of an archive has no checksum: its flags and versions make zipfile stumble."""
    content = bytearray(kept.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path = kept.with_name("damaged.npz")
    path.write_bytes(content)
    found = kept_arrays("test", "damaged")
    assert found is None or right(found)  # Some may be missing.


def test_without_a_home_there_is_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert kept_arrays("test", "whole") is None
