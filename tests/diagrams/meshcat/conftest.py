"""What scenes are drawn in."""

import pytest
from pydrake.geometry import Meshcat

from proxops.diagrams.meshcat.meshcat_scene import quiet_meshcat


@pytest.fixture
def meshcat() -> Meshcat:
    return quiet_meshcat()
