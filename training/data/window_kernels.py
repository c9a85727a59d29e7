"""Lidar frames from packed hits, many at once: dense, or the hits padded to one length."""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def fill_frames(rows, offset, ray, ranges, fill, mean, scale, frames):
    """Writes (range - mean) / scale into `frames` (N, all rays), and `fill` where nothing returned.

    Args:
      rows: (N,) rows of the packed set. offset, ray, ranges: its hits.
    """
    for k in range(rows.size):
        frames[k, :] = fill
        for hit in range(offset[rows[k]], offset[rows[k] + 1]):
            frames[k, ray[hit]] = (ranges[hit] - mean) / scale


@numba.njit(cache=True, nogil=True)
def fill_hits(
    rows, keys, offset, ray, ranges, random, mean, scale, hit_ray, hit_range, hit_mask
):  # fmt: skip
    """Writes up to K hits of each row, rays rising; 0 and False beyond them.

    Of more than K, those evenly spread over the list are taken, or a random K, each subset alike.

    Args:
      rows: (N,) rows of the packed set. keys: (N,) uint64, what the random choice depends on.
      hit_ray: (N, K) int32. hit_range: (N, K) float32. hit_mask: (N, K) bool.
    """
    room = hit_ray.shape[1]
    for k in range(rows.size):
        first, count = offset[rows[k]], offset[rows[k] + 1] - offset[rows[k]]
        taken = min(count, room)
        place = 0
        for hit in range(count):
            if count <= room:
                wanted = True
            elif random:
                # Selection sampling: Knuth, TAOCP 2, 3.4.2, algorithm S.
                chance = _uniform(keys[k], hit)
                wanted = chance * (count - hit) < room - place
            else:
                wanted = place < room and hit == ((2 * place + 1) * count) // (2 * room)
            if wanted:
                hit_ray[k, place] = ray[first + hit]
                hit_range[k, place] = (ranges[first + hit] - mean) / scale
                hit_mask[k, place] = True
                place += 1
        hit_ray[k, taken:] = 0
        hit_range[k, taken:] = 0.0
        hit_mask[k, taken:] = False


@numba.njit(cache=True, nogil=True)
def window_keys(seed, items, length):
    """Keys (items * length,) for `fill_hits`: a function of seed, item and place in the window."""
    keys = np.empty(items.size * length, dtype=np.uint64)
    for i in range(items.size):
        item = _mixed(np.uint64(seed) ^ _mixed(np.uint64(items[i])))
        for step in range(length):
            keys[i * length + step] = _mixed(item ^ _mixed(np.uint64(step)))
    return keys


@numba.njit(cache=True)
def _mixed(value):
    """The finaliser of SplitMix64: G. L. Steele et al., OOPSLA 2014."""
    value = np.uint64(value) + np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@numba.njit(cache=True)
def _uniform(key, count):
    """From 0 to 1, 1 excluded: number `count` of the stream that the key begins (SplitMix64)."""
    step = np.uint64(count) * np.uint64(0x9E3779B97F4A7C15)
    return float(_mixed(np.uint64(key) + step) >> np.uint64(11)) * 2.0**-53
