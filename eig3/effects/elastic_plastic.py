"""An elastic-plastic link with kinematic hardening."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link

_INSIDE = 1e-12  # of the yield force: after a turn, the link is elastic beyond round-off


@element
def tension_within(r, state, stiffness, yield_force, hardening, rest_length):
    """The elastic tension, within the two lines of yielding."""
    middle = hardening * stiffness * (r - rest_length)
    half = (1 - hardening) * yield_force
    return min(middle + half, max(middle - half, stiffness * (r - rest_length - state)))


@element
def yield_or_turn(r, rate, state, stiffness, yield_force, hardening, rest_length):
    """Negative while the link yields further; it becomes positive where the link turns."""
    middle = hardening * stiffness * (r - rest_length)
    beyond = stiffness * (r - rest_length - state) - middle
    half = (1 - hardening) * yield_force
    if beyond > half:
        return -rate
    return rate if beyond < -half else half - abs(beyond)


@element
def plastic_stretch(r, state, stiffness, yield_force, hardening, rest_length):
    inside = (1 - _INSIDE) * yield_force
    tension = tension_within(r, state, stiffness, inside, hardening, rest_length)
    return r - rest_length - tension / stiffness


@element
def over_yield(r, stiffness, yield_force, rest_length):
    return abs(r - rest_length) * stiffness / yield_force


@dataclass(frozen=True, eq=False)
class ElasticPlastic(Link):
    """A spring that yields at a force, with kinematic hardening: a brace, a damper of steel, friction beside a spring.

    Formula: tension = stiffness (r - rest_length - s), but within hardening stiffness (r - rest_length) plus and minus
    (1 - hardening) yield_force; r is the distance of the ends. s is the plastic stretch, m, which is set where the rate
    of r changes its sign while the link yields.

    The link turns from yielding to unloading at an event: ``solution.events["elastic plastic 0"]`` has the times and
    states, and the method starts anew there. So EIG-3 keeps its second order with a fixed step. Methods of higher order
    fall to about the second, and tolerances hold. Several of these links between the same points make Iwan's model.

    Parameters
    ----------
    stiffness : float or array_like
        The elastic stiffness, N/m.
    yield_force : float or array_like
        N.
    hardening : float or array_like
        The ratio of the stiffness after yield and the elastic stiffness, from 0 to below 1.
    rest_length : float or array_like
        m.

    Raises
    ------
    ValueError
        For a value outside these ranges, or stiffness or yield_force that is not positive.

    Notes
    -----
    Other codes: ``uniaxialMaterial Steel01`` of OpenSees, and ``ElasticPP`` without hardening.

    Not included: isotropic hardening.
    """

    stiffness: ArrayLike
    yield_force: ArrayLike
    hardening: ArrayLike = 0.0
    rest_length: ArrayLike = 0.0

    nonnegative = ("rest_length",)
    crossing = 1
    source = "Prager, in one dimension"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(np.asarray(self.stiffness) > 0, "stiffness must be positive")
        self.require(np.asarray(self.yield_force) > 0, "yield_force must be positive")
        self.require((np.asarray(self.hardening) >= 0) & (np.asarray(self.hardening) < 1), "hardening must be 0 to 1")

    tension = tension_within
    event = yield_or_turn
    state_after = plastic_stretch
    ductility = over_yield
