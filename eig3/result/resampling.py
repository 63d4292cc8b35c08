"""Interpolation between saved values, from the values alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

_COUNT = 6  # values that a polynomial matches


def resampled(t: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Interpolate at other times by the polynomials through the values at the six nearest saved times.

    Lagrange's formula gives the exact saved value at a saved time.

    Parameters
    ----------
    t : ndarray, shape (s,)
        No polynomial spans two equal times, which are the times before and after a jump.
    values : ndarray, shape (s, ...)
    times : ndarray, shape (q,)
        Times between the first and the last of t.

    Returns
    -------
    ndarray, shape (q, ...)
    """
    jumps = np.flatnonzero(t[1:] == t[:-1])
    if jumps.size:
        found, part = np.empty((len(times), *values.shape[1:])), np.searchsorted(t[jumps], times, "right")
        bounds = np.concatenate([[0], jumps + 1, [len(t)]])
        for k, (begin, end) in enumerate(pairwise(bounds)):
            found[part == k] = resampled(t[begin:end], values[begin:end], times[part == k])
        return found
    count = min(_COUNT, len(t))
    first = np.clip(np.searchsorted(t, times, side="right") - count // 2, 0, len(t) - count)
    rows = first[:, None] + np.arange(count)
    nodes = t[rows]
    found = np.zeros((len(times), *values.shape[1:]))
    for j in range(count):
        others = np.delete(nodes, j, axis=1)
        weights = np.prod((times[:, None] - others) / (nodes[:, j : j + 1] - others), axis=1)
        found += weights.reshape(-1, *[1] * (values.ndim - 1)) * values[rows[:, j]]
    return found
