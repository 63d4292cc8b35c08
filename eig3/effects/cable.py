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

    Formula: tension = stiffness (r - rest_length) + damping r' while r > rest_length and this is positive, otherwise 0;
    r is the distance of the ends and r' its rate.

    The cable goes slack or taut at an event: ``solution.events["cable 0"]`` has the times, and the method starts anew
    there. With a fixed step, the step that contains the event is less accurate; with tolerances it is as accurate as
    the others.

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

    Notes
    -----
    Other codes: without damping, a spatial tendon of MuJoCo with ``springlength="0 rest_length"``, and a ``corotTruss``
    of OpenSees with ``uniaxialMaterial Elastic`` whose Eneg is 0. The damping of a tendon in MuJoCo also acts while the
    tendon is slack.

    Not included: mass, sag and bending of the cable between its ends: take a chain of masses.
    """

    stiffness: ArrayLike
    rest_length: ArrayLike
    damping: ArrayLike = 0.0

    nonnegative = ("stiffness", "damping")
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
