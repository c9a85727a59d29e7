"""What the lidar's tests look at."""

import pytest
import short_flights

from proxops.systems import Polyhedron


@pytest.fixture(scope="session")
def kleopatra() -> Polyhedron:
    return short_flights.kleopatra().shape
