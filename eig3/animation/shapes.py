"""Shapes of springs, bodies and cut planes, and limits of axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals

_TURNS = 8
_STRAIGHT = 0.15  # fraction of a spring at each end that is straight
_MARGIN = 0.1


@dataclass(frozen=True)
class Solid:
    """The shape of a rigid body in a picture.

    Attributes
    ----------
    kind : {"box", "sphere", "cylinder", "capsule"}
        A sphere may have three different axes. The last axis of a cylinder and of a capsule is their length.
    points : tuple of int
        The numbers of the point in the centre, and of a point on the surface along each axis.
    """

    kind: Literal["box", "sphere", "cylinder", "capsule"]
    points: tuple[int, ...]


def shape_of(shape: Any, dimension: int) -> tuple[Any, np.ndarray]:
    """Return the kind of a shape and its semi-axes, m, from its kind and its sizes, as `Scene.body` describes them.

    Raises
    ------
    ValueError
        If the kind is not known in the dimension, or the sizes are not positive or not as many as it needs.
    """
    counts = {"box": dimension, "sphere": 1} | ({"cylinder": 2, "capsule": 2} if dimension == 3 else {})
    kind, sizes = shape if isinstance(shape, tuple | list) and len(shape) == 2 else (None, ())
    if not isinstance(kind, str) or kind not in counts:
        known = ", ".join(f'"{name}"' for name in counts)
        raise ValueError(f"shape must be a kind, which is one of {known}, with its sizes, not {shape!r}.")
    size = np.atleast_1d(reals(sizes, "shape"))
    if size.shape != (counts[kind],) or not (np.isfinite(size) & (size > 0)).all():
        raise ValueError(f"shape must have {counts[kind]} positive sizes for a {kind}, m, not {sizes!r}.")
    if kind == "box":
        return kind, size / 2
    if kind == "sphere":
        return kind, np.full(dimension, size[0])
    radius, length = size
    return kind, np.array([radius, radius, length / 2 + radius * (kind == "capsule")])


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


def cut(normal: np.ndarray, offset: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the corners of the part of a plane in space that is inside a box, shape (corners, 3), in cyclic order."""
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(8, 3)
    above = corners @ normal - offset
    edges = [(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit and above[i] * above[i | bit] < 0]
    if not edges:
        return np.empty((0, 3))
    cuts = np.array([(corners[i] * above[j] - corners[j] * above[i]) / (above[j] - above[i]) for i, j in edges])
    first = cuts[0] - cuts.mean(axis=0)
    around = np.arctan2((cuts - cuts.mean(axis=0)) @ np.cross(normal, first), (cuts - cuts.mean(axis=0)) @ first)
    return np.asarray(cuts[np.argsort(around)])
