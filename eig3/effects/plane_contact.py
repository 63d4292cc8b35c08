"""Contact of masses with a plane, on one side of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.jit import element
from ..scene.effect import Body
from .hertz import damped_push, push, stored
from .vector import dot, scale


@element
def elastic(x, stiffness, normal, offset):
    return scale(push(offset - dot(normal, x), stiffness), normal)


@element
def damped(x, v, stiffness, normal, offset, damping):
    return scale(damped_push(offset - dot(normal, x), -dot(normal, v), stiffness, damping), normal)


@element
def elastic_potential(x, stiffness, normal, offset):
    return stored(offset - dot(normal, x), stiffness)


@dataclass(frozen=True, eq=False)
class PlaneContact(Body):
    """Hertz's contact of a mass with the plane normal . x = offset, free on the side to which the normal points.

    At the indentation d, which grows at the rate d', the plane pushes with stiffness d^(3/2) (1 + damping d'), and
    never pulls. A mass with a radius touches when its centre is that far away: add the radius to the offset.

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

    Raises
    ------
    ValueError
        For a normal that is not a unit vector.
    """

    stiffness: ArrayLike
    normal: ArrayLike
    offset: ArrayLike = 0.0
    damping: ArrayLike = 0.0

    vectors = ("normal",)
    source = "Hertz (1881); damping of Hunt and Crossley (1975)"

    def __post_init__(self) -> None:
        self.require_unit("normal")

    @property
    def force(self):
        return damped if np.any(self.damping) else elastic

    @property
    def potential(self):
        return None if np.any(self.damping) else elastic_potential
