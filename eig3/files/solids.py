"""The volume and the moments of inertia of simple solids."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

#: The number of sizes of each solid, half lengths and radii as in MuJoCo.
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}


def mass_properties(kind: str, size: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the volume of a solid, and its moments of inertia for the density 1.

    The size is the radius; the radius and half the length along z, of a capsule between the centres of its caps; or the
    three semi-axes or half sides.
    """
    shapes: dict[str, Callable[..., tuple[float, np.ndarray]]] = {
        "sphere": lambda r: _ellipsoid(r, r, r),
        "ellipsoid": _ellipsoid,
        "box": _box,
        "cylinder": _cylinder,
        "capsule": _capsule,
    }
    return shapes[kind](*size.tolist())


def semi_axes(kind: str, size: np.ndarray) -> tuple[str, np.ndarray]:
    """Return the shape of a solid in pictures, and its semi-axes, m."""
    if kind in ("box", "ellipsoid"):
        return ("sphere" if kind == "ellipsoid" else kind), size
    if kind == "sphere":
        return kind, np.full(3, size[0])
    return kind, np.array([size[0], size[0], size[1] + size[0] * (kind == "capsule")])


def _moments(volume: float, squares: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the volume and the moments, from the mean squares of the coordinates."""
    return volume, volume * (squares.sum() - squares)


def _ellipsoid(a: float, b: float, c: float) -> tuple[float, np.ndarray]:
    return _moments(4 / 3 * math.pi * a * b * c, np.square([a, b, c]) / 5)


def _box(a: float, b: float, c: float) -> tuple[float, np.ndarray]:
    return _moments(8 * a * b * c, np.square([a, b, c]) / 3)


def _cylinder(r: float, half: float) -> tuple[float, np.ndarray]:
    return _moments(2 * math.pi * r**2 * half, np.array([r**2 / 4, r**2 / 4, half**2 / 3]))


def _capsule(r: float, half: float) -> tuple[float, np.ndarray]:
    """A cylinder and two half balls, whose centres of mass are 3/8 r outside its ends."""
    volume, moments = _cylinder(r, half)
    ball, of_ball = _ellipsoid(r, r, r)
    shift = ball * half * (half + 2 * 3 / 8 * r)  # of the mean of z^2, for both half balls
    return volume + ball, moments + of_ball + np.array([shift, shift, 0.0])
