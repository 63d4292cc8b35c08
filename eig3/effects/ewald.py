"""The forces between charges and all their periodic images."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.lattice_sum import LatticeSum
from .charges import OfCharges, screened_potential_of, screened_tension_of


@dataclass(frozen=True, eq=False)
class Ewald(OfCharges, LatticeSum):
    """Coulomb forces between charges and all their images in a box that is periodic along x, y and z: Ewald's sum.

    Formula: energy = sum of prefactor charges_i charges_j / r over all pairs and images, which a conductor surrounds.
    Each charge gets two clouds of the normal distribution. Pairs of charges with opposite clouds have the energy
    prefactor charges_i charges_j erfc(alpha r) / r up to the cutoff, and the other clouds are a sum over waves. Both
    sums leave out terms with factors below accuracy = exp(-(alpha cutoff)^2).

    The sum over waves takes a time in proportion to the points and to the waves, and one thread: some hundreds of ions
    are fast. `Coulomb` with a cutoff is an approximation for many.

    Parameters
    ----------
    prefactor : float
        1 / (4 pi epsilon_0) in the units of the charges, N m^2.
    charges : array_like
        The charge of each point, in units in which prefactor times the square of a charge has N m^2. Their sum is 0.
    cutoff : float
        The distance of pairs up to which they are computed one by one, m; at most half a side of the box.
    accuracy : float
        The ratio of the neglected terms to the others.

    Raises
    ------
    ValueError
        For a cutoff that is not positive, an accuracy that is not between 0 and 1, charges with another sum, or a scene
        without a box.

    Notes
    -----
    Other codes: LAMMPS ``pair_style coul/long cutoff`` with ``kspace_style ewald``, and OpenMM's ``NonbondedForce``
    with ``Ewald``; both choose alpha by another estimate of the error.

    Not included: a mesh for the waves (PME, PPPM), boxes that shear, bonded pairs that do not act on each other, and
    charges with a sum other than 0. The energy leaves out the pairs of fixed charges up to the cutoff,
    which have a constant energy.
    """

    prefactor: float
    charges: ArrayLike
    cutoff: float
    accuracy: float = 1e-6
    alpha: float = field(init=False, repr=False, default=0.0)

    cutoff_field = "cutoff"
    picture = ""
    source = "Ewald (1921)"

    def __post_init__(self):
        super().__post_init__()
        for name in ("prefactor", "cutoff", "accuracy"):
            self.require(np.ndim(getattr(self, name)) == 0, f"{name} must be one number")
        self.require(self._reals("cutoff") > 0, "cutoff must be positive")
        accuracy = self._reals("accuracy")
        self.require((accuracy > 0) & (accuracy < 1), "accuracy must be above 0 and below 1")
        object.__setattr__(self, "alpha", self._terms / self.cutoff)  # the record is frozen

    @property
    def _terms(self):
        return math.sqrt(-math.log(self.accuracy))

    @property
    def most(self):
        return 2 * self.alpha * self._terms

    def needs_direction(self, columns):
        return True

    def self_energy(self, columns):
        squares = float(np.sum(columns["charges"] ** 2))
        return -self.prefactor * self.alpha / math.sqrt(math.pi) * squares

    @staticmethod
    @element
    def tension(r, charges, prefactor, cutoff, alpha):
        return charges * screened_tension_of(r, prefactor, alpha) if r < cutoff else 0.0

    @staticmethod
    @element
    def potential(r, charges, prefactor, cutoff, alpha):
        return charges * screened_potential_of(r, prefactor, alpha) if r < cutoff else 0.0
