"""A linear spring between two points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def tension(r, stiffness, length):
    return stiffness * (r - length)


@element
def potential(r, stiffness, length):
    return stiffness / 2 * (r - length) * (r - length)


@element
def density_without_length(stiffness):
    return stiffness


@element
def potential_without_length(r, stiffness):
    return stiffness / 2 * r * r


@dataclass(frozen=True, eq=False)
class LinearSpring(Link):
    """A spring whose tension at the distance r is stiffness (r - length).

    Without a natural length the scene computes no distance, which makes the spring cheaper.

    Parameters
    ----------
    stiffness : float or array_like
        N/m.
    length : float or array_like
        Natural length, m.

    Raises
    ------
    ValueError
        For stiffness or length below 0.
    """

    stiffness: ArrayLike
    length: ArrayLike = 0.0

    nonnegative = ("stiffness", "length")
    source = "Hooke"
    picture = "spring"

    @property
    def tension(self):
        return tension if np.any(self.length) else None

    @property
    def density(self):
        return None if np.any(self.length) else density_without_length

    @property
    def potential(self):
        return potential if np.any(self.length) else potential_without_length
