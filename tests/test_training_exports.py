"""What `proxops.training` exports is there, and costs no torch before it is needed."""

import subprocess
import sys

import pytest

from proxops import training
from proxops.training.data import normalisation, packed_flights, packing, transit_split
from proxops.training.loop import windows


@pytest.mark.parametrize(
    ("name", "home"),
    [
        ("Normalisation", normalisation),
        ("PackedFlight", packed_flights),
        ("PackedFlights", packed_flights),
        ("Scale", normalisation),
        ("WindowDataset", windows),
        ("pack_flights", packing),
        ("part_of_transit", transit_split),
        ("window_loader", windows),
    ],
)
def test_exports(name: str, home: object) -> None:
    assert name in training.__all__
    assert getattr(training, name) is getattr(home, name)


def test_everything_exported_is_there() -> None:
    assert len(training.__all__) == len(set(training.__all__))
    assert all(hasattr(training, name) for name in training.__all__)


def test_no_such_name() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Windows'"):
        _ = training.Windows


def test_packing_needs_no_torch() -> None:
    code = (
        "import sys; from proxops.training.data import pack_flights; print('torch' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"
