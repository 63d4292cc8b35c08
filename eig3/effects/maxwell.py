"""Maxwell's link: a spring and a damper in series."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def tension_of_spring(state, stiffness):
    return stiffness * state


@element
def rate_of_spring(rate, state, stiffness, damping):
    return rate - stiffness / damping * state


@dataclass(frozen=True, eq=False)
class Maxwell(Link):
    """A spring and a damper in series: viscoelasticity, a damper with an elastic brace.

    Formula: tension = stiffness z with z' = r' - stiffness z / damping; r is the distance of the ends.

    z is the stretch of the spring, m: ``solution.z["maxwell"]``. It is 0 at the start, so the link is relaxed there.
    A `LinearSpring` beside it makes a standard linear solid, and several of them a generalised Maxwell model.

    Parameters
    ----------
    stiffness : float or array_like
        Of the spring, N/m.
    damping : float or array_like
        Of the damper, N s/m.

    Raises
    ------
    ValueError
        For stiffness below 0, or damping that is not positive.

    Notes
    -----
    Other codes: ``uniaxialMaterial Maxwell`` of OpenSees.

    Not included: a first stretch of the spring. The relaxation time damping / stiffness limits the step of explicit
    methods: `Problem.critical_step` includes it.
    """

    stiffness: ArrayLike
    damping: ArrayLike

    nonnegative = ("stiffness",)
    source = "Maxwell, Philosophical Transactions 157 (1867) 49"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(np.asarray(self.damping) > 0, "damping must be positive")

    tension = tension_of_spring
    state_rate = rate_of_spring
