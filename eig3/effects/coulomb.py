"""The force between two electric charges."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .shifted import Shifted, shifted_potential, shifted_tension


@element
def tension_of(r, strength):
    return -strength / (r * r)


@element
def potential_of(r, strength):
    return strength / r


@element
def damped_tension_of(r, strength, damping):
    s = damping * r
    return -strength * (math.erfc(s) / r + 2 / math.sqrt(math.pi) * damping * math.exp(-s * s)) / r


@element
def damped_potential_of(r, strength, damping):
    return strength * math.erfc(damping * r) / r


@element
def plain_tension(r, strength, reach, pull_at_reach):
    return shifted_tension(r, reach, tension_of(r, strength), pull_at_reach)


@element
def plain_potential(r, strength, reach, pull_at_reach, energy_at_reach):
    return shifted_potential(r, reach, potential_of(r, strength), pull_at_reach, energy_at_reach)


@element
def damped_tension(r, strength, reach, damping, pull_at_reach):
    return shifted_tension(r, reach, damped_tension_of(r, strength, damping), pull_at_reach)


@element
def damped_potential(r, strength, reach, damping, pull_at_reach, energy_at_reach):
    return shifted_potential(r, reach, damped_potential_of(r, strength, damping), pull_at_reach, energy_at_reach)


@dataclass(frozen=True, eq=False)
class Coulomb(Shifted):
    """Repulsion or attraction of two point charges, up to a reach: Coulomb's law with a shifted force.

    The potential is strength / r, or with a damping strength erfc(damping r) / r. A constant is added to the tension so
    that it reaches 0 at the distance reach, and it is 0 beyond. In a neutral system the damped shifted force comes near
    the sum over all distances. For the plain law, take a reach far beyond the scene, such as 1e9 m.

    Parameters
    ----------
    strength : float or array_like
        q1 q2 / (4 pi epsilon_0), N m^2: charges of the same sign have a positive strength and repel each other.
    reach : float or array_like
        The distance from which on there is no force, m.
    damping : float or array_like
        1/m; some 2 / reach is usual.

    Raises
    ------
    ValueError
        For damping below 0, or a reach that is not positive.
    """

    strength: ArrayLike
    reach: ArrayLike
    damping: ArrayLike = 0.0
    pull_at_reach: np.ndarray = field(init=False, repr=False)
    energy_at_reach: np.ndarray = field(init=False, repr=False)

    nonnegative = ("damping",)
    source = "Coulomb (1785); damped shifted force of Fennell and Gezelter (2006)"

    def __post_init__(self):
        super().__post_init__()
        if self.is_damped:
            self._shift(damped_tension_of, damped_potential_of, "strength", "damping")
        else:
            self._shift(tension_of, potential_of, "strength")

    @property
    def is_damped(self):
        return np.any(self.damping)

    @property
    def tension(self):
        return damped_tension if self.is_damped else plain_tension

    @property
    def potential(self):
        return damped_potential if self.is_damped else plain_potential
