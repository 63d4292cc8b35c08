"""A cable, which only pulls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def elastic_tautness(r, stiffness, length):
    return stiffness * (r - length)


@element
def damped_tautness(r, rate, stiffness, length, damping):
    return stiffness * (r - length) + min(0.0, damping * rate)


@element
def elastic_tension(r, stiffness, length):
    return max(0.0, elastic_tautness(r, stiffness, length))


@element
def damped_tension(r, rate, stiffness, length, damping):
    is_taut = damped_tautness(r, rate, stiffness, length, damping) > 0
    return stiffness * (r - length) + damping * rate if is_taut else 0.0


@element
def elastic_potential(r, stiffness, length):
    stretch = max(0.0, r - length)
    return stiffness / 2 * stretch * stretch


@dataclass(frozen=True, eq=False)
class Cable(Link):
    """A spring with a damper that pulls and never pushes: it goes slack.

    While the cable is longer than its natural length, its tension at the distance r, which grows at the rate r', is
    stiffness (r - length) + damping r', or 0 where this would push. Where the cable goes slack or taut the force
    changes its form. This is an event: ``solution.events["cable 0"]`` has the times, and the method starts anew there.
    With a fixed step, the step in which it occurs is less accurate; with tolerances it is as accurate as the others.

    Parameters
    ----------
    stiffness : float or array_like
        N/m.
    length : float or array_like
        Natural length, m.
    damping : float or array_like
        N s/m.

    Raises
    ------
    ValueError
        For stiffness, length or damping below 0.
    """

    stiffness: ArrayLike
    length: ArrayLike
    damping: ArrayLike = 0.0

    nonnegative = ("stiffness", "length", "damping")
    source = "Hooke, in tension only"

    @property
    def is_elastic(self):
        return not np.any(self.damping)

    @property
    def tension(self):
        return elastic_tension if self.is_elastic else damped_tension

    @property
    def potential(self):
        return elastic_potential if self.is_elastic else None

    @property
    def event(self):
        return elastic_tautness if self.is_elastic else damped_tautness
