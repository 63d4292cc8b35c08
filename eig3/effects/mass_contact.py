"""Contact between two points, such as balls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.jit import element
from ..scene.effect import Link
from .hertz import damped_push, push, stored


@element
def elastic(r, stiffness, reach):
    return -push(reach - r, stiffness)


@element
def damped(r, rate, stiffness, reach, damping):
    return -damped_push(reach - r, -rate, stiffness, damping)


@element
def elastic_potential(r, stiffness, reach):
    return stored(reach - r, stiffness)


@dataclass(frozen=True, eq=False)
class MassContact(Link):
    """Hertz's contact between two masses, or of a mass with a fixed point.

    At the indentation d = reach - r, which grows at the rate d', the two push each other with
    stiffness d^(3/2) (1 + damping d'), and never pull.

    Parameters
    ----------
    stiffness : float or array_like
        N/m^(3/2).
    reach : float or array_like
        The distance at which they touch, the sum of the two radii, m.
    damping : float or array_like
        s/m; 0 makes the contact elastic.
    """

    stiffness: ArrayLike
    reach: ArrayLike
    damping: ArrayLike = 0.0

    cutoff = "reach"
    source = "Hertz (1881); damping of Hunt and Crossley (1975)"

    def needs_direction(self, columns):
        return True

    @property
    def tension(self):
        return damped if np.any(self.damping) else elastic

    @property
    def potential(self):
        return None if np.any(self.damping) else elastic_potential
