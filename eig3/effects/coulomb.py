"""The force between two electric charges."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .shifted import Shifted, shifted_potential, shifted_tension


@element
def tension_of(r, prefactor):
    return -prefactor / (r * r)


@element
def potential_of(r, prefactor):
    return prefactor / r


@element
def damped_tension_of(r, prefactor, alpha):
    s = alpha * r
    return -prefactor * (math.erfc(s) / r + 2 / math.sqrt(math.pi) * alpha * math.exp(-s * s)) / r


@element
def damped_potential_of(r, prefactor, alpha):
    return prefactor * math.erfc(alpha * r) / r


@element
def plain_tension(r, prefactor, cutoff, pull_at_cutoff):
    return shifted_tension(r, cutoff, tension_of(r, prefactor), pull_at_cutoff)


@element
def plain_potential(r, prefactor, cutoff, pull_at_cutoff, energy_at_cutoff):
    return shifted_potential(r, cutoff, potential_of(r, prefactor), pull_at_cutoff, energy_at_cutoff)


@element
def damped_tension(r, prefactor, cutoff, alpha, pull_at_cutoff):
    return shifted_tension(r, cutoff, damped_tension_of(r, prefactor, alpha), pull_at_cutoff)


@element
def damped_potential(r, prefactor, cutoff, alpha, pull_at_cutoff, energy_at_cutoff):
    return shifted_potential(r, cutoff, damped_potential_of(r, prefactor, alpha), pull_at_cutoff, energy_at_cutoff)


@dataclass(frozen=True, eq=False)
class Coulomb(Shifted):
    """Repulsion or attraction of two point charges, up to a cutoff: Coulomb's law with a shifted force.

    The potential is prefactor / r, or prefactor erfc(alpha r) / r with the alpha alpha. A constant is added to the
    tension so that it is 0 at the cutoff, and it is 0 beyond. In a neutral system the damped shifted force comes near
    the sum over all distances.

    Parameters
    ----------
    prefactor : float or array_like
        q1 q2 / (4 pi epsilon_0), N m^2: charges of one sign have a positive prefactor and repel each other.
    alpha : float or array_like
        1/m; some 2 / cutoff is usual, and 0 is the plain law.
    cutoff : float or array_like, optional
        The distance from which on there is no force, m. Without it, the force acts at all distances and is not shifted.

    Raises
    ------
    ValueError
        For alpha below 0, or a cutoff that is not positive.
    """

    prefactor: ArrayLike
    alpha: ArrayLike = 0.0
    cutoff: ArrayLike | None = None
    pull_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)
    energy_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)

    nonnegative = ("alpha",)
    source = "Coulomb (1785); damped shifted force of Fennell and Gezelter (2006)"

    def __post_init__(self):
        super().__post_init__()
        if self.is_damped:
            self._shift(damped_tension_of, damped_potential_of, "prefactor", "alpha")
        else:
            self._shift(tension_of, potential_of, "prefactor")

    @property
    def is_damped(self):
        return np.any(self.alpha)

    @property
    def tension(self):
        if self.cutoff is None:
            return damped_tension_of if self.is_damped else tension_of
        return damped_tension if self.is_damped else plain_tension

    @property
    def potential(self):
        if self.cutoff is None:
            return damped_potential_of if self.is_damped else potential_of
        return damped_potential if self.is_damped else plain_potential
