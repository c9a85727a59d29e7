"""Names for arrays of usual shapes, so that signatures say them."""

from typing import Annotated

import numpy as np

Vector3 = Annotated[np.ndarray, "(3,)"]
"""A position, velocity, force or direction; semi-axes."""
Vectors3 = Annotated[np.ndarray, "(N, 3)"]
"""Points, directions or vertices; of facets, the whole numbers of their vertices."""
State = Annotated[np.ndarray, "(6,)"]
"""Position in m and velocity in m/s."""
States = Annotated[np.ndarray, "(N, 6)"]
Matrix3 = Annotated[np.ndarray, "(3, 3)"]
"""A rotation, or the gradient of a field."""
Values = Annotated[np.ndarray, "(N,)"]
"""One number or truth value for each of several things."""
