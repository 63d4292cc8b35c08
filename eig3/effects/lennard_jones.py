"""The Lennard-Jones force between two atoms."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .shifted import Shifted, shifted_potential, shifted_tension


@element
def tension_of(r, epsilon, sigma):
    inverse = 1 / r  # the only division, which the code of a scene shares
    s = (sigma * inverse) ** 2
    s6 = s * s * s
    return 24 * epsilon * s6 * (1 - 2 * s6) * inverse


@element
def potential_of(r, epsilon, sigma):
    s = (sigma * (1 / r)) ** 2
    s6 = s * s * s
    return 4 * epsilon * s6 * (s6 - 1)


@dataclass(frozen=True, eq=False)
class LennardJones(Shifted):
    """Repulsion of two atoms that are close, and attraction of two atoms farther apart.

    Formula: V(r) = 4 epsilon ((sigma / r)^12 - (sigma / r)^6). The energy is V(r) - V(cutoff) - (r - cutoff) V'(cutoff)
    up to the cutoff and 0 beyond (a shifted force), so that energy and force are continuous. The tension is the
    derivative of the energy.

    Parameters
    ----------
    epsilon : float or array_like
        The depth of V, J.
    sigma : float or array_like
        The distance at which V is 0, m; its minimum is at 2^(1/6) sigma.
    cutoff : float or array_like
        The distance beyond which there is no force, m; 2.5 sigma is usual.

    Raises
    ------
    ValueError
        For epsilon or sigma below 0, or a cutoff that is not positive.

    Notes
    -----
    Other codes: LAMMPS ``pair_style lj/smooth/linear cutoff`` with ``pair_coeff 1 1 epsilon sigma``; HOOMD
    ``md.pair.ForceShiftedLJ``. OpenMM's ``NonbondedForce`` shifts no force; give this energy to a
    ``CustomNonbondedForce``.

    Not included: the constant and the tail correction in the energy sum of a crystal or a liquid (``pair_modify tail
    yes``): energy and pressure differ from the sum over all distances, and from ``lj/cut``. Mixing rules: all pairs of
    an effect have one epsilon and one sigma; ``others=`` gives those between two kinds.
    """

    epsilon: ArrayLike
    sigma: ArrayLike
    cutoff: ArrayLike
    pull_at_cutoff: np.ndarray = field(init=False, repr=False)
    energy_at_cutoff: np.ndarray = field(init=False, repr=False)

    nonnegative = ("epsilon", "sigma")
    source = "Lennard-Jones (1924); shifted force of Toxvaerd and Dyre (2011)"

    def __post_init__(self):
        super().__post_init__()
        self._shift(tension_of, potential_of, "epsilon", "sigma")

    @staticmethod
    @element
    def tension(r, epsilon, sigma, cutoff, pull_at_cutoff):
        return shifted_tension(r, cutoff, tension_of(r, epsilon, sigma), pull_at_cutoff)

    @staticmethod
    @element
    def potential(r, epsilon, sigma, cutoff, pull_at_cutoff, energy_at_cutoff):
        return shifted_potential(r, cutoff, potential_of(r, epsilon, sigma), pull_at_cutoff, energy_at_cutoff)
