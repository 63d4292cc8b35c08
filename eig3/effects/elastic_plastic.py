"""An elastic-plastic link with kinematic and isotropic hardening."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link

_AT_REST = 1e-300  # in place of a rate of 0
INSIDE = 1e-12  # of the yield force: after a turn, the link is elastic beyond round-off


@element
def tension_within(r, state, stiffness, yield_force, hardening, rest_length):
    """The elastic tension, within the two lines of yielding."""
    middle = hardening * stiffness * (r - rest_length)
    half = (1 - hardening) * yield_force
    return min(middle + half, max(middle - half, stiffness * (r - rest_length - state)))


@element
def falling(rate):
    """The negative of a rate, which is negative at rest too: a link that is released beyond its yield then turns."""
    return -rate if rate != 0.0 else -_AT_REST


@element
def inside(part):
    """Positive for a part of the yield force below 1. After a turn it is 1, far above the round-off of any rate."""
    return (1 - part) / INSIDE


@element
def yield_or_turn(r, rate, state, stiffness, yield_force, hardening, rest_length):
    """Negative while the link yields further; it becomes positive where the link turns."""
    middle = hardening * stiffness * (r - rest_length)
    beyond = stiffness * (r - rest_length - state) - middle
    half = (1 - hardening) * yield_force
    if beyond > half:
        return falling(rate)
    return falling(-rate) if beyond < -half else inside(abs(beyond) / half)


@element
def plastic_stretch(r, state, stiffness, yield_force, hardening, rest_length):
    within = (1 - INSIDE) * yield_force
    tension = tension_within(r, state, stiffness, within, hardening, rest_length)
    return r - rest_length - tension / stiffness


@element
def beyond_yield(r, state, stiffness, yield_force, hardening, isotropic, rest_length):
    """The force from the middle of the elastic range, its part beyond yield, both without further yielding, and H."""
    plastic, accumulated = state
    modulus = hardening * stiffness / (1 - hardening)
    force = stiffness * (r - rest_length - plastic) - (1 - isotropic) * modulus * plastic
    return force, abs(force) - yield_force - isotropic * modulus * accumulated, modulus


@element
def plastic_and_accumulated(r, state, stiffness, yield_force, hardening, isotropic, rest_length):
    force, beyond, modulus = beyond_yield(r, state, stiffness, yield_force, hardening, isotropic, rest_length)
    more = max(0.0, beyond) / (stiffness + modulus)
    return state[0] + (more if force > 0 else -more), state[1] + more


@element
def tension_of_both_hardenings(r, state, stiffness, yield_force, hardening, isotropic, rest_length):
    plastic, _ = plastic_and_accumulated(r, state, stiffness, yield_force, hardening, isotropic, rest_length)
    return stiffness * (r - rest_length - plastic)


@element
def yield_or_turn_of_both(r, rate, state, stiffness, yield_force, hardening, isotropic, rest_length):
    force, beyond, _ = beyond_yield(r, state, stiffness, yield_force, hardening, isotropic, rest_length)
    if beyond > 0:
        return falling(rate if force > 0 else -rate)
    return inside(abs(force) / (abs(force) - beyond))


@element
def both_after(r, state, stiffness, yield_force, hardening, isotropic, rest_length):
    within = (1 - INSIDE) * yield_force
    return plastic_and_accumulated(r, state, stiffness, within, hardening, isotropic, rest_length)


@element
def over_yield(r, stiffness, yield_force, rest_length):
    return abs(r - rest_length) * stiffness / yield_force


def require_yield(law: Link) -> None:
    """Refuse a stiffness, a yield force or a hardening with which a link cannot yield."""
    stiffness, yield_force, hardening = (
        np.asarray(getattr(law, name)) for name in ("stiffness", "yield_force", "hardening")
    )
    law.require(stiffness > 0, "stiffness must be positive")
    law.require(yield_force > 0, "yield_force must be positive")
    law.require((hardening >= 0) & (hardening < 1), "hardening must be 0 to 1")


@dataclass(frozen=True, eq=False)
class ElasticPlastic(Link):
    """A spring that yields at a force and hardens: a brace, a damper of steel, friction beside a spring.

    Formula: tension = stiffness (r - rest_length - s), but within hardening stiffness (r - rest_length) plus and minus
    (1 - hardening) yield_force; r is the distance of the ends. s is the plastic stretch, m, which is set where the rate
    of r changes its sign while the link yields, and at the start if the link is released at rest beyond its yield.

    This hardening is kinematic: the elastic range moves and keeps its size. If isotropic is not 0, the state has two
    numbers, s and the accumulated plastic stretch p. With H = hardening stiffness / (1 - hardening), the tension minus
    (1 - isotropic) H s stays within plus and minus yield_force + isotropic H p. So the slope after yield is the same,
    and the elastic range grows.

    The link turns from yielding to unloading at an event: ``solution.events["elastic plastic 0"]`` has the times and
    states, and the method starts anew there. So EIG-3 keeps its second order with a fixed step. Methods of higher order
    fall to about the second, and tolerances hold. Several of these links between the same points make Iwan's model.
    Beside a `Gap` and a `Cable`, the link is a bolted joint: it slips at the yield force until the bolts bear.

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
    isotropic : float or array_like
        The ratio of the isotropic part and the whole hardening, from 0, kinematic, to 1.

    Raises
    ------
    ValueError
        For a value outside these ranges, or stiffness or yield_force that is not positive.

    Notes
    -----
    Other codes: ``uniaxialMaterial Steel01`` of OpenSees, ``ElasticPP`` without hardening, and ``Hardening`` with
    H_iso = isotropic H and H_kin = (1 - isotropic) H. isotropic is ``BETA`` of ``MAT_PLASTIC_KINEMATIC`` in LS-DYNA.

    Not included: hardening that saturates, as in Chaboche's model, and a1 to a4 of ``Steel01``.
    """

    stiffness: ArrayLike
    yield_force: ArrayLike
    hardening: ArrayLike = 0.0
    rest_length: ArrayLike = 0.0
    isotropic: ArrayLike = 0.0

    crossing = 1
    at_start = "yield_force must not be exceeded at the start by a link that moves back"
    turns = True
    source = "Prager, in one dimension; Simo and Hughes, Computational Inelasticity, Springer (1998), section 1.4"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_yield(self)
        self.require((np.asarray(self.isotropic) >= 0) & (np.asarray(self.isotropic) <= 1), "isotropic must be 0 to 1")

    @property
    def hardens_isotropically(self):
        return bool(np.any(self.isotropic))

    @property
    def state_size(self):
        return 2 if self.hardens_isotropically else 1

    @property
    def tension(self):
        return tension_of_both_hardenings if self.hardens_isotropically else tension_within

    @property
    def event(self):
        return yield_or_turn_of_both if self.hardens_isotropically else yield_or_turn

    @property
    def state_after(self):
        return both_after if self.hardens_isotropically else plastic_stretch

    ductility = over_yield
