"""What a controller may offer to a flight: names that a System has or does not have.

Any System with an output port `force` is a controller. It may have these attributes, too:

    delay            time in s from a command's evaluation until it acts
    bundle           the bundle that it flies; the log keeps its hash
    legend_entry     a `LegendEntry`: how plots and replays show the controller
    logged_ports()   gives a `LoggedPort` for each column that the log keeps
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from pydrake.systems.framework import InputPort, OutputPort, System

from proxops.systems.common.checks import check_not_negative, check_type
from proxops.systems.common.errors import InputError


class LegendEntry(NamedTuple):
    """How a controller is shown in plots and replays."""

    name: str
    colour: tuple[float, float, float]
    """Red, green and blue, each from 0 to 1."""


@dataclass(frozen=True)
class LoggedPort:
    """A vector output port of a controller whose values the log of a flight keeps."""

    port: OutputPort
    units: str = "1"
    description: str = ""


class Hashed(Protocol):
    """Files that are known by their hash."""

    @property
    def sha256(self) -> str:
        """The hash, in hexadecimal digits."""
        ...


class ControllerOffers(NamedTuple):
    """What one controller offers."""

    delay: float
    """In s; 0 without one."""
    bundle: Hashed | None
    legend_entry: LegendEntry | None
    logged_ports: dict[str, LoggedPort]
    """By the names of their columns."""


def offers_of(controller: System) -> ControllerOffers:
    """Collects what a controller offers.

    Raises:
      InputError: an offer has another type than this module says.
    """
    owner = f"controller {controller.get_name()!r}"
    delay = getattr(controller, "delay", 0.0)
    bundle = getattr(controller, "bundle", None)
    entry = getattr(controller, "legend_entry", None)
    ports = getattr(controller, "logged_ports", dict)()
    check_not_negative(owner, delay=delay)
    if bundle is not None and not isinstance(getattr(bundle, "sha256", None), str):
        raise InputError(
            f"{owner}: its bundle, a {type(bundle).__name__}, has no hash `sha256` for the log; "
            "give the attribute another name if it is none"
        )
    if entry is not None:
        check_type(owner, LegendEntry, legend_entry=entry)
    check_type(owner, dict, logged_ports=ports)
    for column, logged in ports.items():
        check_type(f"{owner}, logged_ports()", LoggedPort, **{repr(column): logged})
    return ControllerOffers(float(delay), bundle, entry, ports)


def force_port(controller: System) -> OutputPort:
    """The output port `force` (3) of a controller.

    Raises:
      InputError: it has none.
    """
    ports = [controller.get_output_port(k) for k in range(controller.num_output_ports())]
    for port in ports:
        if port.get_name() == "force" and port.size() == 3:
            return port
    names = ", ".join(f"{port.get_name()!r} of size {port.size()}" for port in ports)
    raise InputError(
        f"controller {controller.get_name()!r} needs an output port 'force' of size 3; "
        f"it has {names or 'none'}"
    )


def check_port_size(controller: System, port: InputPort, size: int) -> None:
    """Raises `InputError` if an input port of a controller has another size than its signal."""
    if port.size() != size:
        raise InputError(
            f"controller {controller.get_name()!r}: input port {port.get_name()!r} has size "
            f"{port.size()}, but the signal of this name has size {size}"
        )
