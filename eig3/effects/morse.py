"""A chemical bond that can break."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .shifted import Shifted, shifted_potential, shifted_tension


@element
def tension_of(r, D, a, r0):
    near = math.exp(a * (r0 - r))
    return 2 * D * a * near * (1 - near)


@element
def potential_of(r, D, a, r0):
    return D * (1 - math.exp(a * (r0 - r))) ** 2


@element
def tension_to_cutoff(r, D, a, r0, cutoff, pull_at_cutoff):
    return shifted_tension(r, cutoff, tension_of(r, D, a, r0), pull_at_cutoff)


@element
def potential_to_cutoff(r, D, a, r0, cutoff, pull_at_cutoff, energy_at_cutoff):
    return shifted_potential(r, cutoff, potential_of(r, D, a, r0), pull_at_cutoff, energy_at_cutoff)


@dataclass(frozen=True, eq=False)
class Morse(Shifted):
    """A bond of two atoms: stiff near its rest length, soft where it is long, so that it can break.

    Formula: energy = V(r) = D (1 - exp(-a (r - r0)))^2: 0 at r0 and D far away, with the stiffness 2 D a^2 at r0. With
    a cutoff the energy is V(r) - V(cutoff) - (r - cutoff) V'(cutoff) up to the cutoff and 0 beyond (a shifted force);
    the effect can then act between all near points of a group. The tension is the derivative of the energy.

    Parameters
    ----------
    D : float or array_like
        The energy that breaks the bond, J.
    a : float or array_like
        The inverse width of the well, 1/m.
    r0 : float or array_like
        The distance without a force, m.
    cutoff : float or array_like, optional
        The distance beyond which there is no force, m. Without it, the force acts at all distances.

    Raises
    ------
    ValueError
        For D or r0 below 0, or an a or cutoff that is not positive.

    Notes
    -----
    Other codes: LAMMPS ``bond_style morse`` with D, alpha = a and r0; with a cutoff, the forces of ``pair_style
    morse/smooth/linear`` with D0 = D. OpenMM: a ``CustomBondForce``.

    Not included: with a cutoff, a tail correction in the energy sum of a crystal, and mixing rules: see `LennardJones`.
    """

    D: ArrayLike
    a: ArrayLike
    r0: ArrayLike
    cutoff: ArrayLike | None = None
    pull_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)
    energy_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)

    nonnegative = ("D", "r0")
    source = "Morse (1929)"

    def __post_init__(self):
        super().__post_init__()
        self.require(self._reals("a") > 0, "a must be positive")
        self._shift(tension_of, potential_of, "D", "a", "r0")

    @property
    def picture(self):
        return "line" if self.cutoff is None else ""

    def needs_direction(self, columns):
        return columns["r0"] != 0 if self.cutoff is None else True

    @property
    def tension(self):
        return tension_of if self.cutoff is None else tension_to_cutoff

    @property
    def potential(self):
        return potential_of if self.cutoff is None else potential_to_cutoff
