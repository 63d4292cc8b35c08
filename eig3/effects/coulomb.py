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
    """Repulsion or attraction of two point charges, with or without a cutoff.

    Formula: V(r) = prefactor / r, or prefactor erfc(alpha r) / r for alpha > 0. With a cutoff the energy is V(r) -
    V(cutoff) - (r - cutoff) V'(cutoff) up to the cutoff and 0 beyond (a shifted force), so that energy and force are
    continuous. The tension is the derivative of the energy.

    Parameters
    ----------
    prefactor : float or array_like
        q1 q2 / (4 pi epsilon_0), N m^2: charges of one sign have a positive prefactor and repel each other.
    alpha : float or array_like
        The damping parameter, 1/m; some 2 / cutoff is usual, and 0 is Coulomb's law.
    cutoff : float or array_like, optional
        The distance beyond which there is no force, m. Without it, the force acts at all distances and is not shifted.

    Raises
    ------
    ValueError
        For alpha below 0, or a cutoff that is not positive.

    Notes
    -----
    Other codes: with a cutoff, the pair forces of LAMMPS ``pair_style coul/dsf alpha cutoff``, where the prefactor is
    qqrd2e q1 q2. The cutoff methods of OpenMM's ``NonbondedForce`` have a reaction field instead; give this energy to a
    ``CustomNonbondedForce``.

    Not included: the self energy of each charge, which ``coul/dsf`` adds: the energy of a crystal differs from the
    Madelung sum by a constant, and the forces do not. Sums over all periodic images (``kspace_style``, PME). Charges of
    single points: all pairs of an effect have one prefactor, so add one effect for each pair of kinds.
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
