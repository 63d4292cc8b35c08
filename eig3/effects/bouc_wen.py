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
def tension_of_degrading(r, state, stiffness, rest_length, hardening):
    return tension_of_both(r, state[0], stiffness, rest_length, hardening)


@element
def rates_of_degrading(rate, state, stiffness, yield_length, hardening, sharpness, pinching, deltaA, deltaNu, deltaEta):
    z, energy = state
    share = exp(sharpness * log(abs(z / yield_length))) * (1 - pinching + (pinching if rate * z > 0 else -pinching))
    A, nu, eta = 1 - deltaA * energy, 1 + deltaNu * energy, 1 + deltaEta * energy
    return rate * (A - nu * share) / eta, (1 - hardening) * stiffness * z * rate


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

    If deltaA, deltaNu or deltaEta is not 0, it degrades: z' = r' (A - nu |z / yield_length|^sharpness (...)) / eta with
    A = 1 - deltaA e, nu = 1 + deltaNu e and eta = 1 + deltaEta e. e is the energy that the hysteretic part
    absorbs, e' = (1 - hardening) stiffness z r', J, and the state has two numbers, z and e.

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
    deltaA, deltaNu, deltaEta : float or array_like
        How fast the tangent stiffness and the strength, the strength alone, and the stiffness alone decay, 1/J.

    Raises
    ------
    ValueError
        For a value outside these ranges.

    Notes
    -----
    Other codes: ``uniaxialMaterial BoucWen`` of OpenSees with Ao = 1, and with beta = pinching / yield_length^n and
    gamma = (1 - pinching) / yield_length^n, where n = sharpness.

    Not included: slip, as in ``BWBN``. EIG-3, AB2 and RK2 need damping beside this link, because its
    elastic force is a first-order unknown: see `Problem.critical_step`.
    """

    stiffness: ArrayLike
    yield_length: ArrayLike
    hardening: ArrayLike = 0.0
    sharpness: ArrayLike = 1.0
    pinching: ArrayLike = 0.5
    rest_length: ArrayLike = 0.0
    deltaA: ArrayLike = 0.0  # noqa: N815 - as in OpenSees
    deltaNu: ArrayLike = 0.0  # noqa: N815
    deltaEta: ArrayLike = 0.0  # noqa: N815

    nonnegative = ("stiffness", "deltaA", "deltaNu", "deltaEta")
    source = (
        "Wen, Journal of the Engineering Mechanics Division 102 (1976) 249; Baber and Noori, Journal of Engineering "
        "Mechanics 111 (1985) 1010"
    )
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(np.asarray(self.yield_length) > 0, "yield_length must be positive")
        self.require((np.asarray(self.hardening) >= 0) & (np.asarray(self.hardening) <= 1), "hardening must be 0 to 1")
        self.require(np.asarray(self.sharpness) >= 1, "sharpness must be at least 1")
        self.require((np.asarray(self.pinching) >= 0.5) & (np.asarray(self.pinching) <= 1), "pinching must be 0.5 to 1")

    @property
    def degrades(self):
        return any(np.any(x) for x in (self.deltaA, self.deltaNu, self.deltaEta))

    @property
    def state_size(self):
        return 2 if self.degrades else 1

    @property
    def tension(self):
        return tension_of_degrading if self.degrades else tension_of_both

    @property
    def state_rate(self):
        return rates_of_degrading if self.degrades else rate_of_stretch

    ductility = over_yield_length
