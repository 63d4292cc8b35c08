"""An actuator: two points whose distance is a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from .rod import Rod


@dataclass(frozen=True, eq=False)
class Actuator(Rod):
    """Two points whose distance is a function of time.

    Its reaction is the force with which it pushes its ends apart, N, times the ratio of the distance to that at the
    start.

    Parameters
    ----------
    length : jitted function
        ``length(t) -> (length, rate, acceleration)`` in m, m/s and m/s^2.
    """

    length: Callable  # type: ignore[assignment]

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"length": ("t",)}
    needs = ("length",)
    source = "phi = (|x1 - x0|^2 - length(t)^2) / (2 |x1 - x0| at the start)"
