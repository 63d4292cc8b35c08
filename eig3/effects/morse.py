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
    """The bond of two atoms: a spring near its rest length, which gets soft and lets go where it is long.

    The potential is D (1 - exp(-a (r - r0)))^2: 0 at r0 and D far away. The stiffness at r0 is 2 D a^2. With a cutoff,
    it is a shifted force as `LennardJones`, and can act between all near points of a group.

    Parameters
    ----------
    D : float or array_like
        The energy that breaks the bond, J.
    a : float or array_like
        1/m.
    r0 : float or array_like
        The distance without a force, m.
    cutoff : float or array_like, optional
        The distance from which on there is no force, m. Without it, the force acts at all distances.

    Raises
    ------
    ValueError
        For D or r0 below 0, or an a or cutoff that is not positive.
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
