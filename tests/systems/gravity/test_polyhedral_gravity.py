"""What editors and help() see of the gravity system."""

import inspect

from proxops.systems.gravity import PolyhedralGravity


def test_its_signature_names_its_argument() -> None:
    assert [*inspect.signature(PolyhedralGravity).parameters] == ["field"]
