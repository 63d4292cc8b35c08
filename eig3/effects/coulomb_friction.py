"""Dry friction, smoothed at low speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
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
    """Coulomb's friction of a mass that a load presses on a plane.

    The force is -coefficient load v / sqrt(v^2 + slip^2).

    Parameters
    ----------
    coefficient : float or array_like
        Coefficient of friction.
    load : float or array_like
        The normal force, N.
    slip : float or array_like
        The speed at which the friction reaches 0.71 of its limit, m/s. At lower speeds the friction acts as a stiff
        damper: an explicit method then needs a short step, and the mass creeps where it should stick.
    normal : array_like, shape (dimension,), optional
        A unit vector normal to the plane: the friction acts along the plane only. Without it, the friction acts against
        the whole velocity.

    Raises
    ------
    ValueError
        For a coefficient or load below 0, a slip that is not positive, or a normal that is not a unit vector.
    """

    coefficient: ArrayLike
    load: ArrayLike
    slip: ArrayLike = 1e-3
    normal: ArrayLike | None = None

    nonnegative = ("coefficient", "load")
    source = "Coulomb (1785), smoothed"

    def __post_init__(self) -> None:
        super().__post_init__()
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
