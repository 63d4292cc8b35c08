"""Contact between masses and a plane, on one side of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .coulomb_friction import on_plane
from .hertz import damped_push, push, stored
from .vector import add, dot, scale


@element
def elastic(x, stiffness, normal, offset):
    return scale(push(offset - dot(normal, x), stiffness), normal)


@element
def damped(x, v, stiffness, normal, offset, damping):
    return scale(damped_push(offset - dot(normal, x), -dot(normal, v), stiffness, damping), normal)


@element
def elastic_rough(x, v, stiffness, normal, offset, friction, regularization_speed):
    load = push(offset - dot(normal, x), stiffness)
    return add(scale(load, normal), on_plane(v, friction, load, regularization_speed, normal))


@element
def damped_rough(x, v, stiffness, normal, offset, damping, friction, regularization_speed):
    load = damped_push(offset - dot(normal, x), -dot(normal, v), stiffness, damping)
    return add(scale(load, normal), on_plane(v, friction, load, regularization_speed, normal))


@element
def elastic_potential(x, stiffness, normal, offset):
    return stored(offset - dot(normal, x), stiffness)


@dataclass(frozen=True, eq=False)
class PlaneContact(Body):
    """Hertz's contact of a mass with the plane normal . x = offset; the normal points to the free side.

    Formula: push = stiffness d^(3/2) (1 + damping d') along the normal, at the indentation d = offset - normal . x with
    the rate d', and 0 where d or the bracket is negative. Friction along the plane: -friction push v_t / sqrt(|v_t|^2 +
    regularization_speed^2), with the tangential velocity v_t.

    For masses with a radius, add the radius to the offset: x is the position of the centre.

    Parameters
    ----------
    stiffness : float or array_like
        N/m^(3/2).
    normal : array_like, shape (dimension,)
        A unit vector.
    offset : float or array_like
        m.
    damping : float or array_like
        s/m; 0 makes the contact elastic.
    friction : float or array_like
        Coefficient of friction along the plane, as in `CoulombFriction` with the push as the normal force.
    regularization_speed : float or array_like
        The speed at which the friction reaches 0.71 of its limit, m/s.

    Raises
    ------
    ValueError
        For stiffness, damping or friction below 0, a normal that is not a unit vector, or a regularization_speed that
        is not positive.

    Notes
    -----
    Other codes: without damping and friction, LAMMPS ``fix wall/gran`` with the style ``hertz/history``, where
    stiffness = Kn sqrt(R) for spheres of radius R. A plane of MuJoCo is a soft constraint instead.

    Not included: sticking friction, its history, and the spin of the mass.
    """

    stiffness: ArrayLike
    normal: ArrayLike
    offset: ArrayLike = 0.0
    damping: ArrayLike = 0.0
    friction: ArrayLike = 0.0
    regularization_speed: ArrayLike = 1e-3

    vectors = ("normal",)
    nonnegative = ("stiffness", "damping", "friction")
    source = "Hertz (1881); damping of Hunt and Crossley (1975)"
    picture = "plane"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_unit("normal")
        self.require(self._reals("regularization_speed") > 0, "regularization_speed must be positive")

    @property
    def is_elastic(self):
        return not np.any(self.damping)

    @property
    def is_smooth(self):
        return not np.any(self.friction)

    @property
    def dimensions(self):
        return (1, 2, 3) if self.is_smooth else (2, 3)

    @property
    def force(self):
        if self.is_smooth:
            return elastic if self.is_elastic else damped
        return elastic_rough if self.is_elastic else damped_rough

    @property
    def potential(self):
        return elastic_potential if self.is_elastic and self.is_smooth else None
