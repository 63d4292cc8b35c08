"""Supports that move as a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..scene.effect import Motion


@dataclass(frozen=True, eq=False)
class SupportMotion(Motion):
    """Fixed points that move along a direction.

    Parameters
    ----------
    motion : jitted function
        ``motion(t) -> (displacement, velocity)`` in m and m/s, as numbers.
    direction : array_like, shape (dimension,)
        The vector that multiplies both.
    """

    motion: Callable
    direction: ArrayLike = (1.0,)

    vectors = ("direction",)
    source = "prescribed by the user"
