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
_LOST = 3.0  # if the motion is so many times as large as the motion of most points, these alone are in the picture
_FEW = 20  # points: with more, those that fly far away do not scale the picture
_AWAY = 2, 0.01  # points that may fly away to each side: their number, or their share if that is more
_ROUND = 24  # sides of the polygons for round bodies


@dataclass(frozen=True)
class Solid:
    """The shape of a rigid body in a picture.

    Attributes
    ----------
    kind : {"box", "sphere", "cylinder", "capsule"}
        A sphere may have three different axes. The last axis of a cylinder and of a capsule is their length.
    points : tuple of int
        The numbers of the point in the centre, and of a point on the surface along each axis.
    is_given : bool
        False for a box that only has the inertia of the body. A film leaves it out if links show the body.
    """

    kind: Literal["box", "sphere", "cylinder", "capsule"]
    points: tuple[int, ...]
    is_given: bool = True


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


def are_near(least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return whether each point is one of most points, and not one of a few that fly far away.

    `least` and `most`, of the shape (points, 2 or 3), are the ends of the motion of each point along each axis.
    """
    if len(least) <= _FEW:
        return np.ones(len(least), dtype=bool)
    away = max(_AWAY[0], int(_AWAY[1] * len(least)))
    low, high = np.sort(least, axis=0)[away], np.sort(most, axis=0)[-1 - away]
    size = (high - low).max()
    if (most.max(axis=0) - least.min(axis=0)).max() <= _LOST * size:
        return np.ones(len(least), dtype=bool)
    return np.asarray(((least >= low - size) & (most <= high + size)).all(axis=1))


def wrapped(x: np.ndarray, t: np.ndarray, box: Any, shear: float = 0.0) -> np.ndarray:
    """Return the images of points that are inside a periodic box.

    Parameters
    ----------
    x : ndarray, shape (times, points, dimension)
    t : ndarray, shape (times,)
    box : sequence of float
        The sides; 0 along an axis that is not periodic.
    shear : float
        The rate of Lees-Edwards boundaries, 1/s: an image at y + side has moved by shear * side * t along x.
    """
    sides = np.asarray(box, dtype=float)
    x = x.copy()
    if not sides.any():
        return x
    if shear:
        x[..., 0] -= np.floor(x[..., 1] / sides[1]) * (shear * sides[1] * t)[:, None]
    some = np.flatnonzero(sides > 0)
    x[..., some] %= sides[some]
    return x


def edges_of_box(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the edges of a box as pairs of corners, shape (edges, 2, dimension)."""
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, low.size)
    bits = [1 << k for k in range(low.size)]
    return corners[[(i, i | bit) for bit in bits for i in range(len(corners)) if not i & bit]]


def surface(solid: Solid, x: np.ndarray) -> np.ndarray:
    """Return the faces of a body for the places x of all points, shape (frames, points, dimension).

    The result has the shape (frames, faces, corners, dimension).
    """
    centre, *ends = solid.points
    axes = x[:, ends] - x[:, [centre]]
    return x[:, None, None, centre] + np.einsum("fck,tkd->tfcd", unit_faces(solid.kind, axes[0]), axes)


def half_size(kind: str, axes: np.ndarray) -> np.ndarray:
    """Return how far a body with these semi-axes, shape (frames, 2 or 3, dimension), reaches along each axis."""
    if kind == "box":
        return np.asarray(np.abs(axes).sum(axis=1))
    if kind == "sphere":
        return np.linalg.norm(axes, axis=1)
    across, along = np.linalg.norm(axes[:, :-1], axis=1), np.abs(axes[:, -1])
    if kind == "cylinder":
        return np.asarray(across + along)
    radius, length = (np.linalg.norm(axes[:, k], axis=1, keepdims=True) for k in (0, -1))
    return np.asarray(radius + along * (1 - radius / length))


def unit_faces(kind: str, axes: np.ndarray) -> np.ndarray:
    """Return the faces of a body in units of its semi-axes, shape (faces, corners, dimension)."""
    turn = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    if len(axes) == 2:
        corners = (
            [(-1, -1), (1, -1), (1, 1), (-1, 1)] if kind == "box" else np.column_stack([np.cos(turn), np.sin(turn)])
        )
        return np.array([corners], dtype=float)
    if kind == "box":
        side = np.array([(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], dtype=float)
        return np.array([sign * np.roll(side, k, axis=1) for k in range(3) for sign in (1, -1)])
    down = np.linspace(0, np.pi, _ROUND // 2)
    radii, heights = np.sin(down), np.cos(down)
    if kind == "cylinder":
        radii, heights = np.array([0, 1, 1, 0.0]), np.array([1, 1, -1, -1.0])
    if kind == "capsule":  # the ends are half balls, which are lower than the radius in units of the length
        height = np.linalg.norm(axes[0]) / np.linalg.norm(axes[2])
        heights = height * heights + (1 - height) * np.sign(np.round(heights, 12))
    rings = np.stack(
        [np.outer(radii, np.cos(turn)), np.outer(radii, np.sin(turn)), np.outer(heights, 1 + 0 * turn)], -1
    )
    upper, lower = rings[:-1], rings[1:]
    after = np.roll(rings, -1, axis=1)
    faces = np.stack([lower, after[1:], after[:-1], upper], axis=2)
    faces[-1] = np.stack([upper, after[:-1], after[1:], lower], axis=2)[-1]  # begins where the ring is no point
    return faces.reshape(-1, 4, 3)
