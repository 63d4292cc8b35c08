"""A gap that closes on a spring, which only pushes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def opening(r, gap, rest_length):
    return r - rest_length + gap


@element
def damped_pull(r, rate, stiffness, gap, rest_length, damping):
    return stiffness * (r - rest_length + gap) + damping * max(0.0, rate)


@element
def elastic_push(r, stiffness, gap, rest_length):
    return stiffness * min(0.0, opening(r, gap, rest_length))


@element
def damped_push(r, rate, stiffness, gap, rest_length, damping):
    pull = stiffness * opening(r, gap, rest_length) + damping * rate
    return pull if damped_pull(r, rate, stiffness, gap, rest_length, damping) < 0 else 0.0


@element
def elastic_potential(r, stiffness, gap, rest_length):
    closed = min(0.0, opening(r, gap, rest_length))
    return stiffness / 2 * closed * closed


@dataclass(frozen=True, eq=False)
class Gap(Link):
    """A spring with a damper behind a gap, which pushes and never pulls: pounding, a stop, the moat of an isolator.

    Formula: tension = stiffness (r - rest_length + gap) + damping r' while r < rest_length - gap and this is negative,
    otherwise 0; r is the distance of the ends and r' its rate.

    The gap opens or closes at an event: ``solution.events["gap 0"]`` has the times, and the method starts anew there.
    With a fixed step, the step that contains the event is less accurate, and contacts of few steps add energy: take ten
    steps in a contact, which lasts for pi sqrt(m / stiffness). With tolerances, all steps are accurate.

    Parameters
    ----------
    stiffness : float or array_like
        N/m.
    gap : float or array_like
        By how much the link must be shortened before it pushes, m.
    rest_length : float or array_like
        m; 0 between degrees of freedom of a structure.
    damping : float or array_like
        N s/m.

    Raises
    ------
    ValueError
        For a value below 0.

    Notes
    -----
    Other codes: without damping, ``uniaxialMaterial ElasticPPGap`` of OpenSees with a large yield force and opposite
    signs, and ``Translational.Components.ElastoGap`` of Modelica.

    Not included: yielding behind the gap, and friction. For impacts without a duration: `RigidStop` and `MassImpact`.
    """

    stiffness: ArrayLike
    gap: ArrayLike
    rest_length: ArrayLike = 0.0
    damping: ArrayLike = 0.0

    nonnegative = ("stiffness", "gap", "damping")
    source = "Hooke, in compression only"
    picture = "spring"

    @property
    def is_elastic(self):
        return not np.any(self.damping)

    @property
    def tension(self):
        return elastic_push if self.is_elastic else damped_push

    @property
    def potential(self):
        return elastic_potential if self.is_elastic else None

    @property
    def event(self):
        return opening if self.is_elastic else damped_pull
