"""A cable, which only pulls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def elastic_tautness(r, stiffness, rest_length):
    return stiffness * (r - rest_length)


@element
def damped_tautness(r, rate, stiffness, rest_length, damping):
    return stiffness * (r - rest_length) + min(0.0, damping * rate)


@element
def elastic_tension(r, stiffness, rest_length):
    return max(0.0, elastic_tautness(r, stiffness, rest_length))


@element
def damped_tension(r, rate, stiffness, rest_length, damping):
    is_taut = damped_tautness(r, rate, stiffness, rest_length, damping) > 0
    return stiffness * (r - rest_length) + damping * rate if is_taut else 0.0


@element
def elastic_potential(r, stiffness, rest_length):
    stretch = max(0.0, r - rest_length)
    return stiffness / 2 * stretch * stretch


@dataclass(frozen=True, eq=False)
class Cable(Link):
    """A spring with a damper that pulls and never pushes: it goes slack.

    While the cable is longer than its rest rest_length, its tension at the distance r, which grows at the rate r', is
    stiffness (r - rest_length) + damping r', or 0 where this would push. Where the cable goes slack or taut the force
    changes its form. This is an event: ``solution.events["cable 0"]`` has the times, and the method starts anew there.
    With a fixed step, the step in which it occurs is less accurate; with tolerances it is as accurate as the others.

    Parameters
    ----------
    stiffness : float or array_like
        N/m.
    rest_length : float or array_like
        m.
    damping : float or array_like
        N s/m.

    Raises
    ------
    ValueError
        For stiffness, rest_length or damping below 0.
    """

    stiffness: ArrayLike
    rest_length: ArrayLike
    damping: ArrayLike = 0.0

    nonnegative = ("stiffness", "rest_length", "damping")
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
