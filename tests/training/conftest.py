"""What several tests of training read."""

import pytest
from flight_folders import copy_flights

from proxops.training.data import PackedFlights, pack_flights


@pytest.fixture(scope="session")
def packed(tmp_path_factory: pytest.TempPathFactory) -> PackedFlights:
    """The flights of `flight_folders`, packed. Do not change them."""
    return pack_flights(copy_flights(tmp_path_factory.mktemp("packed")))
