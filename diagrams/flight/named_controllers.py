"""Makes controllers by name: those of proxops, and those of the user, as MODULE:FACTORY."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import sys
import traceback
import types
import typing
from collections.abc import Callable, Generator
from pathlib import Path

from pydrake.systems.framework import System

from proxops.assets import ASSETS
from proxops.diagrams.flight.hybrid_controller import make_hybrid
from proxops.diagrams.flight.scenario_systems import (
    make_estimate_feedback,
    make_mpc,
    make_policy,
    make_proportional_derivative,
    make_zero,
)
from proxops.diagrams.flight.touching import make_touch_controller
from proxops.diagrams.scenario import Body, Scenario, TouchAndGoConfig
from proxops.systems.common import InputError, file_sha256

WITH_BUNDLE = ("policy", "hybrid", "pd", "mpc")
"""Kinds of controllers whose names may contain a policy's bundle, such as `policy:out/bundle`."""
_SHIPPED_POLICY, _SHIPPED_DESCENT = ASSETS / "any_body", ASSETS / "descent"
# Bundles that ship beside it, by the names that a controller's name may have after the colon.
_NAMED_BUNDLES = {"end-to-end": ASSETS / "end_to_end"}
# Name of the attribute that holds the hash of a module when it was imported.
_DIGEST = "_proxops_sha256"


def named_controller(name: str, scenario: Scenario, body: Body) -> System:
    """Makes the controller of a name: `mpc`, `policy`, `hybrid`, `pd`, `zero`, or `MODULE:FACTORY`.

    `policy:FOLDER` and `hybrid:FOLDER` fly the policy of the bundle in FOLDER. `mpc:FOLDER` and
    `pd:FOLDER` fly the MPC and the PD controller on the state that this policy estimates; `mpc` and
    `pd` fly on what the navigation knows, or on the true state if the scenario says so. Of a
    touch-and-go without a transit, `mpc`, `policy` and `hybrid` fly the descent, as the
    `TouchController`.

    FACTORY is the user's function. It is called as `factory(scenario, body)` and returns a System
    with the ports that `make_transit_diagram` needs. MODULE may also be in the working directory.

    Raises:
      InputError: the name is unknown, no policy fits, or the factory cannot be imported or fails.
    """
    (kind, _, _), bundle = name.partition(":"), bundle_of(name, scenario)
    if _is_descent(scenario):
        if name == "mpc" or kind in ("policy", "hybrid"):
            return make_touch_controller(scenario, body, bundle, checked=kind == "hybrid")
        if name in ("pd", "zero") or bundle is not None:
            raise InputError(
                f"controller {name!r} flies transits: a touch-and-go is flown by mpc, policy or "
                "hybrid, or by MODULE:FACTORY"
            )
    if name == "mpc":
        return make_mpc(scenario, body)
    if name == "pd":
        return make_proportional_derivative(scenario)
    if name == "zero":
        return make_zero()
    if bundle is None:
        return users_system(name, scenario, body)
    if kind in ("mpc", "pd"):
        return make_estimate_feedback(kind, bundle, scenario, body)
    policy = make_policy(bundle, scenario, body, checked=kind == "hybrid")
    return make_hybrid(scenario, body, policy) if kind == "hybrid" else policy


def _is_descent(scenario: Scenario) -> bool:
    """Whether the controller is to fly a touch-and-go, not the transit before it."""
    return isinstance(scenario.task, TouchAndGoConfig) and not scenario.task.transit


def bundle_of(name: str, scenario: Scenario) -> Path | None:
    """Gives the folder of the bundle that a named controller flies; None if it flies none.

    `policy` and `hybrid` fly the scenario's bundle; `pd` and `mpc` fly none. After a colon comes
    `end-to-end`, the pilot that ships for Kleopatra, or a path relative to the working directory.
    """
    kind, colon, path = name.partition(":")
    if kind not in WITH_BUNDLE or name in ("pd", "mpc"):
        return None
    if not colon:
        shipped = _SHIPPED_DESCENT if _is_descent(scenario) else _SHIPPED_POLICY
        return Path(scenario.policy.bundle or shipped)
    return _NAMED_BUNDLES.get(path, Path(path))


def controller_files(name: str) -> list[Path]:
    """Gives the files that say what a controller MODULE:FACTORY does.

    They are the module's file, and those that its constant `FILES` names: a list of paths relative
    to the working directory, as for `open`. Modules that this one imports are not considered.

    Returns:
      The paths; none if `name` is another kind of controller, or the module has no file.

    Raises:
      InputError: the module cannot be imported, or one of its `FILES` does not exist.
    """
    kind, colon, _ = name.partition(":")
    if not colon or kind in WITH_BUNDLE:
        return []
    module = _module(name)
    source = getattr(module, "__file__", None)
    if source is None:
        return []
    files = getattr(module, "FILES", [])
    if not (isinstance(files, list | tuple) and all(isinstance(path, str) for path in files)):
        raise InputError(f'{source}: FILES must be a list of texts, as FILES = ["a.pt"]')
    for path in files:
        if not Path(path).is_file():
            raise InputError(f"controller {name!r}: {path}, one of its FILES, does not exist")
    return [Path(source), *map(Path, files)]


def users_system(name: str, scenario: Scenario, body: Body) -> System:
    """Makes the controller, or the law of attitude guidance, of MODULE:FACTORY.

    Raises:
      InputError: the factory cannot be imported or fails, or what it makes is no System.
    """
    if ":" not in name:
        raise InputError(
            f"controller {name!r} is not known: use mpc, policy, hybrid, pd, zero, one of "
            "policy:FOLDER, hybrid:FOLDER, mpc:FOLDER and pd:FOLDER, or MODULE:FACTORY"
        )
    make = users_function(name, 2, "take (scenario, body) and return a System")
    controller = make(scenario, body)
    if not isinstance(controller, System):
        raise InputError(f"controller {name!r} made a {type(controller).__name__}, not a System")
    if not controller.get_name():
        controller.set_name(name)
    return controller


def users_function(name: str, arguments: int, wanted: str) -> Callable[..., typing.Any]:
    """Gives the user's function MODULE:FUNCTION.

    MODULE may be in the working directory, and import from it. What the function raises is told as
    an `InputError`.

    Args:
      name: of module and function. arguments: how many it has to take.
      wanted: says what it should do.

    Raises:
      InputError: it cannot be imported, or takes other arguments.
    """
    function_name, module = name.partition(":")[2], _module(name)
    function = getattr(module, function_name, None)
    if not callable(function):
        raise InputError(
            f"controller {name!r}: {module.__name__} has no function {function_name!r}; it should "
            f"{wanted}"
        )
    try:
        inspect.signature(function).bind(*[None] * arguments)
    except TypeError as error:
        raise InputError(f"controller {name!r}: {function_name} must {wanted}: {error}") from error
    except ValueError:  # It tells no signature.
        pass

    def called(*given: object) -> typing.Any:
        with _in_working_directory(name):
            return function(*given)

    return called


def _module(name: str) -> types.ModuleType:
    """The module of MODULE:FACTORY as its file is now: in a notebook it may have been changed."""
    module_name, _, factory_name = name.partition(":")
    path = Path(module_name)
    if path.suffix == ".py" or path.name != module_name:
        raise InputError(
            f"controller {name!r}: name the module without folder and .py, as "
            f"{path.stem}:{factory_name}, and run the command in its folder"
        )
    with _in_working_directory(name):
        module = importlib.import_module(module_name)
        source = getattr(module, "__file__", None)
        if source is not None:
            digest = file_sha256(Path(source))
            if vars(module).get(_DIGEST, digest) != digest:
                vars(module).pop("FILES", None)
                module = importlib.reload(module)
            setattr(module, _DIGEST, digest)
        return module


@contextlib.contextmanager
def errors_told(name: str) -> Generator[None]:
    """Tells what the code of a controller MODULE:FACTORY raises in flight as an `InputError`."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        place = _last_line(name, error)
        if place is None:
            raise
        raise InputError(_told(name, error, place)) from error


def _last_line(name: str, error: Exception) -> traceback.FrameSummary | None:
    """The last line of the user's module before an error; None: it was not there."""
    source = getattr(sys.modules.get(name.partition(":")[0]), "__file__", None)
    places = traceback.extract_tb(error.__traceback__)
    return next((each for each in reversed(places) if each.filename == source), None)


def _told(name: str, error: Exception, place: traceback.FrameSummary) -> str:
    where = f" ({Path(place.filename).name}, line {place.lineno})"
    if isinstance(error, SyntaxError):
        where = ""  # Its text says where.
    return f"controller {name!r}: {type(error).__name__}: {error}{where}"


@contextlib.contextmanager
def _in_working_directory(name: str) -> Generator[None]:
    """Runs the user's code, which may import from the working directory.

    Raises:
      InputError: the code failed; the message says where.
    """
    module, _, _ = name.partition(":")
    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        yield
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            raise InputError(
                f"controller {name!r}: there is no module {module} in {here}, and none is "
                "installed: run the command in its folder, or set PYTHONPATH"
            ) from error
        place = _last_line(name, error) or traceback.extract_tb(error.__traceback__)[-1]
        raise InputError(_told(name, error, place)) from error
    finally:
        sys.path.remove(here)
