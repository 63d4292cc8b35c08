"""Dry friction, smoothed at low speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import add, dot, scale


@element
def in_space(v, mu, normal_force, regularization_speed):
    return scale(-mu * normal_force / math.sqrt(dot(v, v) + regularization_speed * regularization_speed), v)


@element
def on_plane(v, mu, normal_force, regularization_speed, normal):
    return in_space(add(v, scale(-dot(normal, v), normal)), mu, normal_force, regularization_speed)


@dataclass(frozen=True, eq=False)
class CoulombFriction(Body):
    """Coulomb's friction of a mass that a given normal force presses on a plane, smoothed at low speeds.

    Formula: force = -mu normal_force v / sqrt(|v|^2 + regularization_speed^2).

    Parameters
    ----------
    mu : float or array_like
        Coefficient of friction.
    normal_force : float or array_like
        N.
    regularization_speed : float or array_like
        The speed at which the friction reaches 0.71 of its limit, m/s. At lower speeds the friction acts as a stiff
        damper: an explicit method then needs a short step, and the mass creeps where it should stick.
    normal : array_like, shape (dimension,), optional
        A unit vector normal to the plane: the friction acts along the plane only. Without it, the friction acts against
        the whole velocity.

    Raises
    ------
    ValueError
        For a mu or normal_force below 0, a regularization_speed that is not positive, or a normal that is not a unit
        vector.

    Notes
    -----
    Other codes: the regularized friction of exudyn (``frictionProportionalZone``), whose force is linear in v below
    this speed. MuJoCo's ``frictionloss`` is a constraint that sticks.

    Not included: sticking, and a static coefficient above mu. The normal force is given; `PlaneContact` has the normal
    force of a contact.
    """

    mu: ArrayLike
    normal_force: ArrayLike
    regularization_speed: ArrayLike = 1e-3
    normal: ArrayLike | None = None

    nonnegative = ("mu", "normal_force")
    source = "Coulomb (1785), smoothed"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("regularization_speed") > 0, "regularization_speed must be positive")
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
