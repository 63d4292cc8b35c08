"""Supports that move as a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..scene.effect import Motion


@dataclass(frozen=True, eq=False)
class SupportMotion(Motion):
    """Fixed points that move along a direction as a function of time.

    Formula: x = x at the start + displacement direction, with the displacement that motion(t) returns.

    Parameters
    ----------
    motion : jitted function
        ``motion(t) -> (displacement, velocity)`` in m and m/s, as numbers.
    direction : array_like, shape (dimension,)
        The vector that multiplies both.

    Notes
    -----
    Other codes: OpenSees ``imposedMotion`` in a ``pattern MultipleSupport``; LAMMPS ``fix move variable``; MuJoCo: a
    mocap body.

    Not included: a rotation in one motion. About the origin by w t, it is two motions of each point, which add up:
    along (x, y) by cos(w t) - 1, and along (-y, x) by sin(w t).
    """

    motion: Callable
    direction: ArrayLike = (1.0,)

    vectors = ("direction",)
    source = "prescribed by the user"
