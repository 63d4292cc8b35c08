"""Dry friction, smoothed over small speeds."""

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.jit import element
from ..scene.effect import Body
from .vector import add, dot, scale


@element
def in_space(v, coefficient, load, slip):
    return scale(-coefficient * load / math.sqrt(dot(v, v) + slip * slip), v)


@element
def on_plane(v, coefficient, load, slip, normal):
    return in_space(add(v, scale(-dot(normal, v), normal)), coefficient, load, slip)


@dataclass(frozen=True, eq=False)
class CoulombFriction(Body):
    """Coulomb's friction of a mass that a load presses on a plane: coefficient load v / sqrt(v^2 + slip^2) against v.

    Parameters
    ----------
    coefficient : float or array_like
    load : float or array_like
        N.
    slip : float or array_like
        The speed at which the friction is 0.71 of its whole, m/s. Below it acts as a damper, for which the step of an
        explicit method must be short; the mass creeps where it should stick.
    normal : array_like, shape (dimension,), optional
        A unit vector: only the velocity along the plane is resisted. Without it, the plane is the whole scene.

    Raises
    ------
    ValueError
        For a slip that is not positive, or a normal that is not a unit vector.
    """

    coefficient: ArrayLike
    load: ArrayLike
    slip: ArrayLike = 1e-3
    normal: ArrayLike | None = None

    source = "Coulomb (1785), smoothed"

    def __post_init__(self) -> None:
        self.require(self._reals("slip") > 0, "slip must be positive")
        if self.normal is not None:
            self.require_unit("normal")

    @property
    def dimensions(self):
        return (1, 2, 3) if self.normal is None else (2, 3)

    @property
    def vectors(self):
        return () if self.normal is None else ("normal",)

    @property
    def force(self):
        return in_space if self.normal is None else on_plane
