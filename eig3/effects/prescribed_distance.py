"""Two points whose distance is a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from .rod import OfDistance


@dataclass(frozen=True, eq=False)
class PrescribedDistance(OfDistance):
    """Two points whose distance is a function of time.

    Formula: |x1 - x0| = distance(t). The reaction is the force with which it pushes its ends apart, N.

    Parameters
    ----------
    distance : jitted function
        ``distance(t) -> (distance, rate, acceleration)`` in m, m/s and m/s^2.

    Notes
    -----
    Other codes: exudyn ``ObjectConnectorDistance``, if a function changes its distance before each step. A position
    actuator of MuJoCo is a controlled force, not a constraint.

    Not included: a limit of the force.
    """

    distance: Callable

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"distance": ("t",)}
    needs = ("distance",)
    source = "phi = (|x1 - x0|^2 - distance(t)^2) / (2 |x1 - x0| at the start)"
