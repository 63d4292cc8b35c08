"""The force between two atoms without charge."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .shifted import Shifted, shifted_potential, shifted_tension


@element
def tension_of(r, depth, size):
    inverse = 1 / r  # the only division, which the code of a scene shares
    s = (size * inverse) ** 2
    s6 = s * s * s
    return 24 * depth * s6 * (1 - 2 * s6) * inverse


@element
def potential_of(r, depth, size):
    s = (size * (1 / r)) ** 2
    s6 = s * s * s
    return 4 * depth * s6 * (s6 - 1)


@dataclass(frozen=True, eq=False)
class LennardJones(Shifted):
    """Repulsion of two atoms that are close, and attraction of two that are farther apart.

    The potential is 4 depth ((size / r)^12 - (size / r)^6), up to the shifted force: a constant is added to the
    tension so that it reaches 0 at the distance reach, and it is 0 beyond.

    Parameters
    ----------
    depth : float or array_like
        Of the potential without the shift, J.
    size : float or array_like
        The distance at which this potential is 0, m; its minimum is at 2^(1/6) size.
    reach : float or array_like
        The distance from which on there is no force, m; 2.5 times the size is usual.

    Raises
    ------
    ValueError
        For depth or size below 0, or a reach that is not positive.
    """

    depth: ArrayLike
    size: ArrayLike
    reach: ArrayLike
    pull_at_reach: np.ndarray = field(init=False, repr=False)
    energy_at_reach: np.ndarray = field(init=False, repr=False)

    nonnegative = ("depth", "size")
    source = "Lennard-Jones (1924); shifted force of Toxvaerd and Dyre (2011)"

    def __post_init__(self):
        super().__post_init__()
        self._shift(tension_of, potential_of, "depth", "size")

    @staticmethod
    @element
    def tension(r, depth, size, reach, pull_at_reach):
        return shifted_tension(r, reach, tension_of(r, depth, size), pull_at_reach)

    @staticmethod
    @element
    def potential(r, depth, size, reach, pull_at_reach, energy_at_reach):
        return shifted_potential(r, reach, potential_of(r, depth, size), pull_at_reach, energy_at_reach)
