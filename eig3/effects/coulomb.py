"""The force between two electric charges."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .charges import OfCharges, screened_potential_of, screened_tension_of
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


@element
def tension_of_charges(r, charges, prefactor, cutoff, alpha, pull_at_cutoff):
    return charges * shifted_tension(r, cutoff, screened_tension_of(r, prefactor, alpha), pull_at_cutoff)


@element
def potential_of_charges(r, charges, prefactor, cutoff, alpha, pull_at_cutoff, energy_at_cutoff):
    one = screened_potential_of(r, prefactor, alpha)
    return charges * shifted_potential(r, cutoff, one, pull_at_cutoff, energy_at_cutoff)


@dataclass(frozen=True, eq=False)
class Coulomb(Shifted, OfCharges):
    """Repulsion or attraction of two point charges, with or without a cutoff.

    Formula: V(r) = prefactor / r, or prefactor erfc(alpha r) / r for alpha > 0. With a cutoff the energy is V(r) -
    V(cutoff) - (r - cutoff) V'(cutoff) up to the cutoff and 0 beyond (a shifted force), so that energy and force are
    continuous. The tension is the derivative of the energy.

    With charges, a pair has charges_i charges_j times this energy. For each point, charges_i^2 / 2 times the limit of
    this energy - prefactor / r at r = 0 is added, so that this damped shifted sum approaches the sum over all periodic
    images: for rock salt to 1e-4 with a cutoff of 4 distances of ions and alpha = 3 / cutoff. `Ewald` is the exact sum.

    Parameters
    ----------
    prefactor : float or array_like
        q1 q2 / (4 pi epsilon_0), N m^2: charges of one sign have a positive prefactor and repel each other. With
        charges: 1 / (4 pi epsilon_0) in their units.
    alpha : float or array_like
        The damping parameter, 1/m; some 2 / cutoff is usual, and 0 is Coulomb's law.
    cutoff : float or array_like, optional
        The distance beyond which there is no force, m. Without it, the force acts at all distances and is not shifted.
    charges : array_like, optional
        The charge of each point of one group, in units in which prefactor times the square of a charge has N m^2.

    Raises
    ------
    ValueError
        For alpha below 0, a cutoff that is not positive, and charges without a cutoff, of points that are not one
        group, or with excluded pairs.

    Notes
    -----
    Other codes: with a cutoff, the pair forces of LAMMPS ``pair_style coul/dsf alpha cutoff``, where the prefactor is
    qqrd2e q1 q2; with charges, also its energies, and the prefactor is qqrd2e. The cutoff methods of OpenMM's
    ``NonbondedForce`` have a reaction field instead; give this energy to a ``CustomNonbondedForce``.

    Not included: without charges, the self energy of each charge, which ``coul/dsf`` adds: the energy of a crystal then
    differs from Madelung's sum by a constant, and the forces do not. Charges of two groups, and of links between given
    points, for which the prefactor has the product. Charges with excluded pairs: the sum over all images needs all
    pairs, and ``Coulomb(-prefactor * q1 * q2)`` between the two ends of a bond removes the energy of this pair.
    """

    prefactor: ArrayLike
    alpha: ArrayLike = 0.0
    cutoff: ArrayLike | None = None
    charges: ArrayLike | None = field(default=None, kw_only=True)
    pull_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)
    energy_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)

    nonnegative = ("alpha",)
    source = "Coulomb (1785); damped shifted force of Fennell and Gezelter (2006)"

    def __post_init__(self):
        self.require(self.charges is None or self.cutoff is not None, "cutoff must be given with charges")
        super().__post_init__()
        if self.charges is not None:
            self._shift(screened_tension_of, screened_potential_of, "prefactor", "alpha")
        elif self.is_damped:
            self._shift(damped_tension_of, damped_potential_of, "prefactor", "alpha")
        else:
            self._shift(tension_of, potential_of, "prefactor")

    @property
    def is_damped(self):
        return np.any(self.alpha)

    @property
    def tension(self):
        if self.charges is not None:
            return tension_of_charges
        if self.cutoff is None:
            return damped_tension_of if self.is_damped else tension_of
        return damped_tension if self.is_damped else plain_tension

    @property
    def potential(self):
        if self.charges is not None:
            return potential_of_charges
        if self.cutoff is None:
            return damped_potential_of if self.is_damped else potential_of
        return damped_potential if self.is_damped else plain_potential

    def check_group(self, pair_force, cloud):
        if self.charges is not None and pair_force.exclude_bonded:
            raise ValueError(
                f"charges of {self.title} act between all points: leave out exclude_bonded, and add "
                "Coulomb(-prefactor * q1 * q2) to the two ends of each bond."
            )

    def self_energy(self, columns):
        if self.charges is None:
            return 0.0
        prefactor, cutoff, alpha, pull, energy = (
            float(columns[name][0]) for name in ("prefactor", "cutoff", "alpha", "pull_at_cutoff", "energy_at_cutoff")
        )
        squares = float(np.sum(columns["charges"] ** 2))
        return squares * ((cutoff * pull - energy) / 2 - prefactor * alpha / math.sqrt(math.pi))
