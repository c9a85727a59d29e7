"""Files are written for those whom the user's settings let read them."""

from pathlib import Path

import pytest

from proxops.systems.common import files, write_whole


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o027, 0o640)])
def test_a_file_has_the_permissions_that_the_umask_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, umask: int, mode: int
) -> None:
    monkeypatch.setattr(files, "_umask", umask)
    write_whole(tmp_path / "a.txt", lambda path: path.write_text("text"))
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == mode
