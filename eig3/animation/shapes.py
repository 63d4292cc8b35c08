"""Shapes of springs and limits of axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_TURNS = 8
_STRAIGHT = 0.15  # fraction of a spring at each end that is straight
_MARGIN = 0.1


def coils(a: ArrayLike, b: ArrayLike, width: float) -> np.ndarray:
    """Return springs between points a and b of a plane, shape (k, 2), as lines of shape (k, points, 2)."""
    a, b = np.asarray(a), np.asarray(b)
    along = b - a
    length = np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.where(length > 0, length, 1.0) * width / 2
    share = np.concatenate([[0.0], np.linspace(_STRAIGHT, 1 - _STRAIGHT, 2 * _TURNS + 1), [1.0]])
    side = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], _TURNS)[: 2 * _TURNS - 1], [0.0, 0.0]])
    return a[:, None] + share[:, None] * along[:, None] + side[:, None] * across[:, None]


def limits(values: np.ndarray) -> tuple[float, float]:
    """Return limits that contain all values, with a margin."""
    low, high = float(np.min(values)), float(np.max(values))
    margin = _MARGIN * (high - low) or _MARGIN * abs(high) or 1.0
    return low - margin, high + margin
