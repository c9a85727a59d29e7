"""`kernel`: compiles a function with numba, and keeps the machine code on disk."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import shutil
import sys
import time
import typing
from collections.abc import Callable, Generator
from pathlib import Path

from proxops.systems.common.progress import Progress
from proxops.systems.common.user_folders import cache_folder

# At the left margin, so that all of them have been imported when a function below is compiled.
_IMPORT = re.compile(
    r"^from (proxops[\w.]*) import (\([^)]*\)|.*)|^import (proxops[\w.]*)", re.MULTILINE
)
_NAME = re.compile(r"(\w+)(?: as (\w+))?")
_COMMENT = re.compile(r"#.*")
_DAYS_KEPT = 30.0
_names: list[str] = []


def kernel(function: Callable[..., typing.Any] | None = None, **options: typing.Any) -> typing.Any:
    """Compiles a function with numba; used as `@kernel` or `@kernel(error_model="numpy", …)`.

    A kernel may call kernels of other files: after a change in any file that it can call, it is
    compiled anew. (numba's own cache checks the function's own file alone.) The machine code is
    kept in the folder `kernels` of `cache_folder`, or in NUMBA_CACHE_DIR; if neither can be
    written, every process compiles.

    Args:
      options: those of `numba.njit`, without `cache`.
    """
    if function is None:
        return functools.partial(kernel, **options)
    _names.append(function.__name__)
    return functools.update_wrapper(_Kernel(function, options), function)


class _Kernel:
    """Stands for a compiled function, and imports numba when it is called: that takes long."""

    def __init__(self, function: Callable[..., typing.Any], options: dict[str, typing.Any]):
        self.py_func, self._options = function, options

    def __call__(self, *args: typing.Any) -> typing.Any:
        return self.dispatcher(*args)

    @property
    def _numba_type_(self) -> typing.Any:
        """What other kernels, which may call this one, take it for."""
        return self.dispatcher._numba_type_

    @property
    def stats(self) -> typing.Any:
        """Where its machine code is kept, and how often it was found there."""
        return self.dispatcher.stats

    @functools.cached_property
    def dispatcher(self) -> typing.Any:
        """numba's own."""
        import numba
        from numba.core import config

        folder = _folder(self.py_func.__code__.co_filename)
        # numba asks for its folder when the function is decorated. Other functions keep theirs.
        before = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
        try:
            config.CACHE_DIR = str(folder or "")  # pyright: ignore[reportAttributeAccessIssue]
            # Nothing calls a kernel from C, and the wrapper for it takes time to compile.
            self._options |= {"cache": folder is not None, "no_cfunc_wrapper": True}
            return numba.njit(**self._options)(self.py_func)
        finally:
            config.CACHE_DIR = before  # pyright: ignore[reportAttributeAccessIssue]


@contextlib.contextmanager
def compiling_told(progress: Progress) -> Generator[None]:
    """Within the block, reports each kernel that is compiled, of those that have been imported.

    What is loaded from disk is not reported, nor is what a kernel needs of numba itself.
    """
    from numba.core import event

    class Told(event.Listener):
        count = 0

        def on_start(self, event: event.Event) -> None:
            if event.data is not None and (name := event.data["dispatcher"].__name__) in _names:
                self.count += 1
                share = min(1.0, self.count / len(_names))
                progress(share, f"compiling {name}: {self.count} of at most {len(_names)}")

        def on_end(self, event: event.Event) -> None:
            pass

    with event.install_listener("numba:compile", Told()):
        yield


@contextlib.contextmanager
def compilation_timed() -> Generator[Callable[[], float]]:
    """Gives a function that tells for how long, in s, numba has compiled within the block."""
    from numba.core import event

    with event.install_listener("numba:compile", event.TimingListener()) as found:
        yield lambda: found.duration if found.done else 0.0


@functools.cache
def _folder(file: str) -> Path | None:
    """Makes the folder for the machine code of a file's kernels; None if it cannot be made."""
    from numba.core import config

    given = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
    base = Path(given) / "proxops" if given else cache_folder("kernels")
    if base is None:
        return None
    try:
        folder = base / f"{Path(file).stem}-{_key(file)}"
        if not folder.is_dir():
            _remove_unused(base)
            folder.mkdir(parents=True, exist_ok=True)  # Another process may have made it.
        os.utime(folder)  # It is used.
    except OSError:
        return None
    return folder


def _remove_unused(base: Path) -> None:
    """Removes the folders that no process has used for long: of other versions, elsewhere."""
    for folder in base.glob("*"):
        with contextlib.suppress(OSError):
            if folder.stat().st_mtime < time.time() - 86400.0 * _DAYS_KEPT:
                shutil.rmtree(folder, ignore_errors=True)


def _key(file: str) -> str:
    """Names a file's place, and the content of all files whose functions its kernels can call."""
    found, waiting = set(), [file]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += _imported_files(path)
    parts = [(path, hashlib.sha256(_text(path).encode()).hexdigest()) for path in sorted(found)]
    return hashlib.sha256(repr((file, parts)).encode()).hexdigest()[:20]


def _imported_files(path: str) -> list[str]:
    """The files of proxops from which a file imports."""
    found = [_defining_file(module, name) for module, name in _imports(path).values()]
    return [each for each in found if each is not None]


def _defining_file(module: str, name: str) -> str | None:
    """The file of an imported name: that of a module, and past a face that of the definition."""
    whole = sys.modules.get(f"{module}.{name}" if name else module)
    if whole is not None:
        return whole.__file__
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is not None and Path(file).name == "__init__.py" and name in _imports(file):
        return _defining_file(*_imports(file)[name])
    return file


@functools.cache
def _imports(path: str) -> dict[str, tuple[str, str]]:
    """What a file imports from proxops: its name there, the module, and the name in the module."""
    found = {}
    for module, names, whole in _IMPORT.findall(_text(path)):
        if whole:
            found[whole] = whole, ""
        for name, other in _NAME.findall(_COMMENT.sub("", names)):
            found[other or name] = module, name
    return found


@functools.cache
def _text(path: str) -> str:
    return Path(path).read_text(encoding="utf-8")
