"""Compiled kernel of `GuidanceNetwork`: the forward pass of one row of inputs.

It computes what `proxops.training.networks.AnyBodyGuidance` does, which explains it, in
some 40 us where caches are cold. A runtime for networks takes three times that, for dozens of small
operations beside the four large ones.
"""

import math

import numpy as np

from proxops.systems.common import kernel

_FAST = {"reassoc", "nsz", "arcp", "contract"}
_fast = kernel(fastmath=_FAST, error_model="numpy", forceinline=True)
_exact = kernel(error_model="numpy", forceinline=True)
_ONE = np.float32(1.0)
# Number of inputs, of which the last is the pace; and of all that the first layer is given.
_INPUTS = 23
_ROW = _INPUTS + 37
# Greatest logarithm of what the law's time and gains are corrected by.
_GREATEST_LOG = 1.0


@_fast
def _layer(weights, biases, x, out):
    for row in range(weights.shape[0]):
        total = biases[row]
        for column in range(weights.shape[1]):
            total += weights[row, column] * x[column]
        out[row] = total


@_exact
def _silu(x):
    """SiLU: x times its logistic function."""
    for k in range(x.size):
        x[k] = x[k] / (_ONE + math.exp(-x[k]))


@_exact
def _length(x, y, z):
    return math.sqrt(x * x + y * y + z * z)


@_exact
def _features(given, bends, row):
    """Fills ``row`` (60,) with the inputs and with what is computed from them."""
    for k in range(_INPUTS):  # A slice takes numba seconds to compile.
        row[k] = given[k]
    p, v, axes = given[0:3], given[3:6], given[15:18]
    e, here, way, closest = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        e[k] = given[6 + k] - p[k]
        here[k], way[k] = p[k] / axes[k], e[k] / axes[k]
    distance, speed = _length(e[0], e[1], e[2]), _length(v[0], v[1], v[2])
    along = here[0] * way[0] + here[1] * way[1] + here[2] * way[2]
    squared = way[0] ** 2 + way[1] ** 2 + way[2] ** 2 + 1e-4
    share = min(max(-along / squared, 0.0), 1.0)
    for k in range(3):
        closest[k] = here[k] + share * way[k]
    depth, level = _length(closest[0], closest[1], closest[2]), _length(here[0], here[1], here[2])
    rising = 0.0
    for k in range(3):
        up, out = here[k] / (level + 1e-3), closest[k] / (depth + 0.05)
        rising += v[k] / axes[k] * up
        row[_INPUTS + k] = math.asinh(e[k] / bends[k])
        row[_INPUTS + 3 + k] = math.asinh(e[k] / bends[3 + k])
        row[_INPUTS + 6 + k] = math.asinh(v[k] / bends[6 + k])
        row[_INPUTS + 9 + k] = e[k] / (distance + 1e-3)
        row[_INPUTS + 12 + k] = v[k] / (speed + 2.5e-3)
        row[_INPUTS + 18 + k], row[_INPUTS + 21 + k] = up, out
        row[_INPUTS + 24 + k] = 3.0 * max(1.3 - depth, 0.0) * out
        row[_INPUTS + 31 + k], row[_INPUTS + 34 + k] = here[k], 2.0 * e[k]
    row[_INPUTS + 15] = math.log(10.0 * distance + 0.01)
    row[_INPUTS + 16] = math.log(speed + 1.25e-3)
    row[_INPUTS + 17] = math.log(max(level - 1.0, 0.005))
    row[_INPUTS + 27], row[_INPUTS + 28], row[_INPUTS + 29] = share, depth, rising
    row[_INPUTS + 30] = 5.0 * max(1.2 - depth, 0.0)


@_exact
def _law(given, correction, law, longest, force):
    """Fills ``force`` (3,): the ZEM/ZEV law with corrections.

    Eq. 20 to 22 of docs/method/equations.md.
    """
    pace = given[_INPUTS - 1]
    acceleration, least_time_squared = law[0] * pace, law[1] / pace
    along = squared = 0.0
    for k in range(3):
        away = given[6 + k] - given[k]
        along += away * given[3 + k]
        squared += away * away
    distance = math.sqrt(squared) + 1e-5
    q = max(along / distance, 0.0) ** 2 / (acceleration * distance)
    share = (q + math.sqrt(q * (q + 9.0) + 1e-9)) / 9.0
    gains = np.empty(3)
    for k in range(3):
        gains[k] = math.exp(min(max(correction[3 + k], -_GREATEST_LOG), _GREATEST_LOG))
    time_squared = 4.0 * gains[0] ** 2 * distance / (acceleration * (1.0 + 2.0 * share))
    time_squared += least_time_squared
    time_squared = min(time_squared, longest * longest)
    time = math.sqrt(time_squared)
    for k in range(3):
        away = given[6 + k] - given[k]
        law = 6.0 * gains[1] * away / time_squared - 4.0 * gains[2] * given[3 + k] / time
        force[k] = law - given[9 + k] + correction[k]


@kernel(error_model="numpy", nogil=True)
def run(given, network, longest, force):
    """Fills ``force`` (3,) float64 from one row ``given`` (23,) float32 and a `GuidanceNetwork`.

    The law's time is at most ``longest``.
    """
    told = given.copy()
    for k in range(told.size):
        if not math.isnan(network.instead[k]):
            told[k] = network.instead[k]
    width = network.biases_1.size
    row, correction = np.empty(_ROW, np.float32), np.empty(6, np.float32)
    one, other = np.empty(width, np.float32), np.empty(width, np.float32)
    _features(told, network.bends, row)
    _layer(network.weights_1, network.biases_1, row, one)
    _silu(one)
    _layer(network.weights_2, network.biases_2, one, other)
    _silu(other)
    _layer(network.weights_3, network.biases_3, other, one)
    _silu(one)
    _layer(network.weights_4, network.biases_4, one, correction)
    _law(given, correction, network.law, longest, force)
