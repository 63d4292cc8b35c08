"""Bouc and Wen's link with smooth hysteresis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..kernels.elementary import exp, log
from ..scene.effect import Link


@element
def tension_of_both(r, state, stiffness, rest_length, hardening):
    return stiffness * (hardening * (r - rest_length) + (1 - hardening) * state)


@element
def rate_of_stretch(rate, state, yield_length, sharpness, pinching):
    share = exp(sharpness * log(abs(state / yield_length)))  # a power would call the C library
    return rate * (1 - share * (1 - pinching + (pinching if rate * state > 0 else -pinching)))


@element
def over_yield_length(r, yield_length, rest_length):
    return abs(r - rest_length) / yield_length


@dataclass(frozen=True, eq=False)
class BoucWen(Link):
    """A link that yields smoothly, by Bouc and Wen: an isolator, a damper of steel, a member with plastic hinges.

    Formula: tension = stiffness (hardening (r - rest_length) + (1 - hardening) z), with
    z' = r' (1 - |z / yield_length|^sharpness (1 - pinching + pinching sign(r' z))); r is the distance of the ends.

    z is the hysteretic stretch, m: ``solution.z["bouc wen"]``. It follows r while the link is elastic, and its size
    tends to yield_length.

    Parameters
    ----------
    stiffness : float or array_like
        The elastic stiffness, N/m.
    yield_length : float or array_like
        The stretch at which the link would yield if it yielded suddenly, m.
    hardening : float or array_like
        The ratio of the stiffness after yield and the elastic stiffness, from 0 to 1.
    sharpness : float or array_like
        A coefficient, at least 1: how suddenly the link yields.
    pinching : float or array_like
        A coefficient from 0.5, with which unloading is elastic, to 1.
    rest_length : float or array_like
        m.

    Raises
    ------
    ValueError
        For a value outside these ranges.

    Notes
    -----
    Other codes: ``uniaxialMaterial BoucWen`` of OpenSees with Ao = 1, without degradation, and with
    beta = pinching / yield_length^n and gamma = (1 - pinching) / yield_length^n, where n = sharpness.

    Not included: degradation of strength and stiffness. EIG-3, AB2 and RK2 need damping beside this link, because its
    elastic force is a first-order unknown: see `Problem.critical_step`.
    """

    stiffness: ArrayLike
    yield_length: ArrayLike
    hardening: ArrayLike = 0.0
    sharpness: ArrayLike = 1.0
    pinching: ArrayLike = 0.5
    rest_length: ArrayLike = 0.0

    nonnegative = ("stiffness", "rest_length")
    source = "Wen, Journal of the Engineering Mechanics Division 102 (1976) 249"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(np.asarray(self.yield_length) > 0, "yield_length must be positive")
        self.require((np.asarray(self.hardening) >= 0) & (np.asarray(self.hardening) <= 1), "hardening must be 0 to 1")
        self.require(np.asarray(self.sharpness) >= 1, "sharpness must be at least 1")
        self.require((np.asarray(self.pinching) >= 0.5) & (np.asarray(self.pinching) <= 1), "pinching must be 0.5 to 1")

    tension = tension_of_both
    state_rate = rate_of_stretch
    ductility = over_yield_length
