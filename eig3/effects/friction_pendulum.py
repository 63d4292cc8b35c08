"""A friction pendulum in the plane, with its circular yield surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link
from .circle import distance_over_yield, pull_of_both, within_circle


@element
def pull_of_slider(r, state, friction, radius, weight, yield_length):
    return pull_of_both(r, state, weight / radius, friction * weight, yield_length)


@dataclass(frozen=True, eq=False)
class FrictionPendulum(Link):
    """A slider on a spherical surface across two horizontal directions, with friction against the motion.

    Formula: force = weight r / radius + friction weight z / yield_length with
    z' = r' - (|z| / yield_length)^sharpness max(0, z . r') z / |z|^2; r is the displacement of the second end relative
    to the first, a vector.

    z is the hysteretic displacement, m: ``solution.z["friction pendulum"]`` has its two components for each bearing.
    While the slider slides, z has the length yield_length and tends to the direction of the motion, so the friction has
    a circular yield surface. The period of a rigid mass is 2 pi sqrt(radius / g). The link has no events, so ensembles
    run it in lanes.

    Parameters
    ----------
    friction : float or array_like
        The coefficient of friction.
    radius : float or array_like
        Of the motion on the surface, m.
    weight : float or array_like
        The vertical force on the bearing, N.
    yield_length : float or array_like
        The displacement at which the slider begins to slide, m.
    sharpness : float or array_like
        A coefficient, at least 1: how suddenly the slider begins to slide.

    Raises
    ------
    ValueError
        For a value outside these ranges, or below 0; radius and yield_length must be positive.

    Notes
    -----
    Other codes: ``singleFPBearing`` of OpenSees with ``Coulomb`` friction, for displacements that are small relative to
    the radius; a large sharpness makes the same corner.

    Not included: a vertical force that changes, friction that depends on the velocity, terms of the second order in
    r / radius, and the end of the surface, for which a `Gap` is a stop. EIG-3, AB2 and RK2 need damping beside this
    link: see `BoucWen`.
    """

    friction: ArrayLike
    radius: ArrayLike
    weight: ArrayLike
    yield_length: ArrayLike = 1e-3
    sharpness: ArrayLike = 2.0

    nonnegative = ("friction", "weight")
    directions = 2
    state_size = 2
    source = (
        "Zayas, Low and Mahin, Earthquake Spectra 6 (1990) 317; Park, Wen and Ang, Earthquake Engineering and "
        "Structural Dynamics 14 (1986) 543"
    )
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(np.asarray(self.radius) > 0, "radius must be positive")
        self.require(np.asarray(self.yield_length) > 0, "yield_length must be positive")
        self.require(np.asarray(self.sharpness) >= 1, "sharpness must be at least 1")

    tension = pull_of_slider
    state_rate = within_circle
    ductility = distance_over_yield
