"""The force between two atoms without charge."""

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
    """Repulsion of two atoms that are close, and attraction of two that are farther apart.

    The potential is 4 epsilon ((sigma / r)^12 - (sigma / r)^6), up to the shifted force: a constant is added to the
    tension so that it is 0 at the cutoff, and it is 0 beyond.

    Parameters
    ----------
    epsilon : float or array_like
        Of the potential without the shift, J.
    sigma : float or array_like
        The distance at which this potential is 0, m; its minimum is at 2^(1/6) sigma.
    cutoff : float or array_like
        The distance from which on there is no force, m; 2.5 sigma is usual.

    Raises
    ------
    ValueError
        For epsilon or sigma below 0, or a cutoff that is not positive.
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
