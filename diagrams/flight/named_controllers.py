"""Makes controllers by name: those of proxops, and those of the user, as MODULE:FACTORY."""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import inspect
import sys
import traceback
import types
from collections.abc import Callable, Generator
from pathlib import Path

from pydrake.systems.framework import System

from proxops.diagrams.flight.hybrid_controller import make_hybrid
from proxops.diagrams.flight.named_bundles import WITH_BUNDLE, bundle_of
from proxops.diagrams.flight.scenario_systems import (
    make_estimate_feedback,
    make_mpc,
    make_policy,
    make_proportional_derivative,
    make_zero,
)
from proxops.diagrams.scenario import Body, Scenario
from proxops.systems.common import InputError, file_sha256

# Name of the attribute that holds the hash of a module when it was imported.
_DIGEST = "_proxops_sha256"


def named_controller(name: str, scenario: Scenario, body: Body) -> System:
    """Makes the controller of a name: `mpc`, `policy`, `hybrid`, `pd`, `zero`, or `MODULE:FACTORY`.

    `policy:FOLDER` and `hybrid:FOLDER` fly the policy of the bundle in FOLDER. `mpc:FOLDER` and
    `pd:FOLDER` fly the MPC and the PD controller on the state that this policy estimates; `mpc` and
    `pd` fly on what the navigation knows, or on the true state if the scenario says so.

    FACTORY is the user's function. It is called as `factory(scenario, body)` and returns a System
    with the ports that `make_transit_diagram` needs. MODULE may also be in the working directory.

    Raises:
      InputError: the name is unknown, no policy fits, or the factory cannot be imported or fails.
    """
    if name == "mpc":
        return make_mpc(scenario, body)
    bundle = bundle_of(name, scenario)
    if bundle is not None:
        kind, _, _ = name.partition(":")
        if kind in ("mpc", "pd"):
            return make_estimate_feedback(kind, bundle, scenario, body)
        policy = make_policy(bundle, scenario, body, checked=kind == "hybrid")
        return make_hybrid(scenario, body, policy) if kind == "hybrid" else policy
    if name == "pd":
        return make_proportional_derivative(scenario)
    if name == "zero":
        return make_zero()
    module_name, colon, factory_name = name.partition(":")
    if not colon:
        raise InputError(
            f"controller {name!r} is not known: use mpc, policy, hybrid, pd, zero, one of "
            "policy:FOLDER, hybrid:FOLDER, mpc:FOLDER and pd:FOLDER, or MODULE:FACTORY"
        )
    _check_module_name(name)
    try:
        with _working_directory_importable():
            factory = _factory(name, _module(module_name), factory_name)
            controller = factory(scenario, body)
    except _UnfitFactoryError as error:
        raise InputError(str(error)) from error
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name == module_name.partition(".")[0]:
            raise InputError(_not_found(name)) from error
        place = _place(error, module_name)
        raise InputError(
            f"controller {name!r}: {type(error).__name__}: {error} "
            f"({Path(place.filename).name}, line {place.lineno})"
        ) from error
    if not isinstance(controller, System):
        raise InputError(f"controller {name!r} made a {type(controller).__name__}, not a System")
    return controller


def _check_module_name(name: str) -> None:
    """Raises `InputError` if a controller's name has a path in place of a module."""
    module, _, factory = name.partition(":")
    path = Path(module)
    if path.suffix == ".py" or path.name != module:
        raise InputError(
            f"controller {name!r}: name the module without folder and .py, as "
            f"{path.stem}:{factory}, and run the command in its folder"
        )


class _UnfitFactoryError(Exception):
    """A factory is missing or takes other arguments; the message says which."""


def _factory(name: str, module: types.ModuleType, factory_name: str) -> Callable[..., object]:
    """The factory of a module.

    Raises:
      _UnfitFactoryError: there is none of this name, or it does not take a scenario and a body.
    """
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise _UnfitFactoryError(
            f"controller {name!r}: {module.__name__} has no function {factory_name!r}; it should "
            "take (scenario, body) and return a System"
        )
    try:
        inspect.signature(factory).bind(None, None)
    except TypeError as error:
        raise _UnfitFactoryError(
            f"controller {name!r}: {factory_name} must take (scenario, body) and return a System: "
            f"{error}"
        ) from error
    except ValueError:  # It tells no signature.
        pass
    return factory


def _not_found(name: str) -> str:
    module, _, _ = name.partition(":")
    return (
        f"controller {name!r}: there is no module {module} in {Path.cwd()}, and none is installed: "
        "run the command in its folder, or set PYTHONPATH"
    )


def _place(error: Exception, module_name: str) -> traceback.FrameSummary:
    """Where an error was raised: the last line of the user's module, if it got as far as that."""
    places = traceback.extract_tb(error.__traceback__)
    source = getattr(sys.modules.get(module_name), "__file__", None)
    own = [each for each in places if each.filename == source]
    return (own or places)[-1]


def _module(name: str) -> types.ModuleType:
    """A module as its file is now: in a notebook it may have been changed after it was imported."""
    module = importlib.import_module(name)
    file = getattr(module, "__file__", None)
    if file is not None:
        digest = file_sha256(Path(file))
        if vars(module).get(_DIGEST, digest) != digest:
            module = importlib.reload(module)
        setattr(module, _DIGEST, digest)
    return module


def controller_files(name: str) -> list[Path]:
    """Gives the files that say what a controller MODULE:FACTORY does.

    They are the module's file, and those that its constant `FILES` names: a list of texts, written
    out in the module, of paths relative to the working directory, as for `open`. Modules that this
    one imports are not considered.

    Returns:
      The paths; none if `name` is another kind of controller, or the module has no file.

    Raises:
      InputError: the module or one of its `FILES` does not exist.
    """
    source = _module_file(name)
    if source is None:
        return []
    files = [source, *map(Path, _named_files(source))]
    for path in files:
        if not path.is_file():
            raise InputError(f"controller {name!r}: {path}, one of its FILES, does not exist")
    return files


def _named_files(source: Path) -> list[str]:
    """The constant `FILES` of a module that need not be imported."""
    if source.suffix != ".py":
        return []
    try:
        values = [
            each.value
            for each in ast.parse(source.read_bytes(), str(source)).body
            if isinstance(each, ast.Assign | ast.AnnAssign | ast.AugAssign)
            and ast.unparse(each.targets[0] if isinstance(each, ast.Assign) else each.target)
            == "FILES"
        ]
        found = [ast.literal_eval(value) for value in values if value is not None]
    except (SyntaxError, TypeError, ValueError) as error:
        raise InputError(f"{source}: {type(error).__name__}: {error}") from error
    if not found:
        return []
    files = found[0] if len(found) == 1 else None
    if not (isinstance(files, list | tuple) and all(isinstance(path, str) for path in files)):
        raise InputError(
            f'{source}: FILES must be a list of texts that is written out once, as FILES = ["a.pt"]'
        )
    return list(files)


def _module_file(name: str) -> Path | None:
    """The file of the module of MODULE:FACTORY; None for another kind of controller."""
    module_name, colon, _ = name.partition(":")
    if not colon or module_name in WITH_BUNDLE:
        return None
    _check_module_name(name)
    if module_name in sys.modules:
        file = getattr(sys.modules[module_name], "__file__", None)
        return None if file is None else Path(file)
    try:
        with _working_directory_importable():
            spec = importlib.util.find_spec(module_name)
    except Exception as error:  # find_spec imports the parent packages.
        raise InputError(f"controller {name!r}: {type(error).__name__}: {error}") from error
    if spec is None:
        raise InputError(_not_found(name))
    return Path(spec.origin) if spec.has_location and spec.origin else None


@contextlib.contextmanager
def _working_directory_importable() -> Generator[None]:
    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        yield
    finally:
        sys.path.remove(here)
