"""Two points whose distance is a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from .rod import OfDistance


@dataclass(frozen=True, eq=False)
class PrescribedDistance(OfDistance):
    """Two points whose distance is a function of time.

    Its reaction is the force with which it pushes its ends apart, N, times the ratio of the distance to that at the
    start.

    Parameters
    ----------
    distance : jitted function
        ``distance(t) -> (distance, rate, acceleration)`` in m, m/s and m/s^2.
    """

    distance: Callable

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"distance": ("t",)}
    needs = ("distance",)
    source = "phi = (|x1 - x0|^2 - distance(t)^2) / (2 |x1 - x0| at the start)"
