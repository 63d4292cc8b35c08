"""A lead-rubber bearing in the plane, with its circular yield surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..scene.effect import Link
from .circle import distance_over_yield, pull_of_both, within_circle


@dataclass(frozen=True, eq=False)
class LeadRubber(Link):
    """A lead-rubber bearing across two horizontal directions, which yield together.

    Formula: force = stiffness r + strength z / yield_length with
    z' = r' - (|z| / yield_length)^sharpness max(0, z . r') z / |z|^2; r is the displacement of the second end relative
    to the first, a vector.

    z is the hysteretic displacement, m: ``solution.z["lead rubber"]`` has its two components for each bearing. Its
    length tends to yield_length in each direction, so the force of the lead has a circular yield surface. The bearing
    unloads elastically. It has no events, so ensembles run it in lanes.

    Parameters
    ----------
    stiffness : float or array_like
        Of the rubber, which is the stiffness after yield, N/m.
    strength : float or array_like
        The force of the lead after yield, N.
    yield_length : float or array_like
        The displacement at which the lead would yield if it yielded suddenly, m.
    sharpness : float or array_like
        A coefficient, at least 1: how suddenly the lead yields.

    Raises
    ------
    ValueError
        For a value outside these ranges, or below 0.

    Notes
    -----
    Other codes: ``elastomericBearingBoucWen`` of OpenSees in shear, with beta = gamma = 0.5. Along one direction it is
    `BoucWen` with pinching = 0.5.

    Not included: the vertical force and its influence, heating of the lead, and the stiffening of rubber at large
    strains. EIG-3, AB2 and RK2 need damping beside this link: see `BoucWen`.
    """

    stiffness: ArrayLike
    strength: ArrayLike
    yield_length: ArrayLike
    sharpness: ArrayLike = 2.0

    nonnegative = ("stiffness", "strength")
    directions = 2
    state_size = 2
    source = "Park, Wen and Ang, Earthquake Engineering and Structural Dynamics 14 (1986) 543"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(np.asarray(self.yield_length) > 0, "yield_length must be positive")
        self.require(np.asarray(self.sharpness) >= 1, "sharpness must be at least 1")

    tension = pull_of_both
    state_rate = within_circle
    ductility = distance_over_yield
