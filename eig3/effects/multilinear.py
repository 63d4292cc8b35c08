"""Iwan's link: elastic-plastic elements in parallel, from the points of a backbone curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba.extending import overload
from numpy.typing import ArrayLike

from ..kernels.compile.jit import OPTIONS, element
from ..scene.effect import Link
from .elastic_plastic import INSIDE, falling, inside


def after_turn(s, state, stretches):
    """The plastic stretches of the elements after a turn at the stretch s."""
    limits = (1 - INSIDE) * np.asarray(stretches[: len(state)])
    return tuple((s - np.clip(s - np.asarray(state), -limits, limits)).tolist())


@overload(after_turn, jit_options={"forceinline": True, **OPTIONS})
def _after_turn(s, state, stretches):
    if state.count == 1:
        return lambda s, state, stretches: (plastic(s, state[0], stretches[0]),)
    return lambda s, state, stretches: (
        plastic(s, state[0], stretches[0]),
        *after_turn(s, state[1:], stretches[1:]),
    )


@element
def plastic(s, state, stretch):
    within = (1 - INSIDE) * stretch
    return s - min(within, max(-within, s - state))


@element
def tension_of_elements(r, state, stretches, forces, rest_length):
    s, total, stiffness = r - rest_length, 0.0, forces[0] / stretches[0]
    for i in range(len(state)):
        after = (forces[i + 1] - forces[i]) / (stretches[i + 1] - stretches[i])
        total += (stiffness - after) * min(stretches[i], max(-stretches[i], s - state[i]))
        stiffness = after
    return total + stiffness * s


@element
def first_yields_or_turns(r, rate, state, stretches, forces, rest_length):
    """Negative while the first element yields further; positive where it turns, and with it all others that yield."""
    elastic = r - rest_length - state[0]
    if elastic > stretches[0]:
        return falling(rate)
    return falling(-rate) if elastic < -stretches[0] else inside(abs(elastic) / stretches[0])


@element
def plastic_stretches(r, state, stretches, rest_length):
    return after_turn(r - rest_length, state, stretches)


@element
def over_first(r, stretches, rest_length):
    return abs(r - rest_length) / stretches[0]


@dataclass(frozen=True, eq=False)
class Multilinear(Link):
    """A link that yields along the points of a backbone curve, by Iwan: soil, joints, and members that crack and yield.

    Formula: tension = k_n s + sum over i of (k_i - k_(i+1)) (s - p_i), but s - p_i within plus and minus stretches[i];
    k_i is the slope of the backbone curve up to its point (stretches[i], forces[i]), and s = r - rest_length; r is the
    distance of the ends. p_i is the plastic stretch of an element, m, which is set where the rate of r changes its sign
    while the link yields.

    Beyond the last point the slope stays. The link follows Masing's rules: a branch that unloads is the backbone curve
    with twice its size, and follows an earlier branch from the point where both meet. The link turns at an event:
    ``solution.events["multilinear 0"]`` has the times and states. EIG-3 keeps its second order with a fixed step, and
    tolerances hold.

    Parameters
    ----------
    stretches : array_like, shape (n,) or (links, n)
        Of the n points, from the yield stretch on, in increasing order, m; at least three.
    forces : array_like, shape (n,) or (links, n)
        Of the points, N. The slope decreases from point to point.
    rest_length : float or array_like
        m.

    Raises
    ------
    ValueError
        For fewer than three points, stretches that do not increase, or slopes that increase or are negative.

    Notes
    -----
    Other codes: ``uniaxialMaterial MultiLinear`` of OpenSees.

    Not included: isotropic hardening, and different curves for tension and compression. For two points, and one slope
    after yield, take `ElasticPlastic`.
    """

    stretches: ArrayLike
    forces: ArrayLike
    rest_length: ArrayLike = 0.0

    vectors = ("stretches", "forces")
    crossing = 1
    at_start = "stretches must not be exceeded at the start by a link that moves back"
    turns = True
    source = "Iwan, Journal of Applied Mechanics 33 (1966) 893"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        stretches, forces = (np.atleast_1d(np.asarray(x, dtype=float)) for x in (self.stretches, self.forces))
        self.require(
            stretches.shape[-1] >= 3, "stretches must have at least three points; for two, take ElasticPlastic"
        )
        self.require(stretches.shape[-1:] == forces.shape[-1:], "forces must have as many points as stretches")
        widths = np.diff(stretches, prepend=0.0)
        self.require(widths > 0, "stretches must be positive and increase")
        slopes = np.diff(forces, prepend=0.0) / widths
        self.require(slopes[..., 0] > 0, "forces must be positive")
        self.require(slopes >= 0, "forces must not decrease")
        self.require(np.diff(slopes) <= 1e-12 * slopes[..., :1], "forces must have slopes that decrease")

    @property
    def state_size(self) -> Any:  # type: ignore[override]  # one for each element
        return np.shape(self.stretches)[-1] - 1

    def components(self, vector: str, dimension: int) -> int:
        return np.shape(self.stretches)[-1]

    tension = tension_of_elements
    event = first_yields_or_turns
    state_after = plastic_stretches
    ductility = over_first
