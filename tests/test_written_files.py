"""Files are written for those whom the user's settings let read them, and unpack to what fits."""

import io
from pathlib import Path

import numpy as np
import pytest

from proxops.systems import InputError
from proxops.systems.common import check_unpacked_size, files, write_whole


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o027, 0o640)])
def test_a_file_has_the_permissions_that_the_umask_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, umask: int, mode: int
) -> None:
    monkeypatch.setattr(files, "_umask", umask)
    write_whole(tmp_path / "a.txt", lambda path: path.write_text("text"))
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == mode


def test_an_archive_that_unpacks_to_too_much_is_refused() -> None:
    """A hundred thousand zeros take next to no room in it."""
    file = io.BytesIO()
    np.savez_compressed(file, zeros=np.zeros(100_000))
    assert len(file.getvalue()) < 10_000
    check_unpacked_size(file.getvalue(), 1_000_000)
    with pytest.raises(InputError, match="unpacks to 1 MB"):
        check_unpacked_size(file.getvalue(), 500_000)
