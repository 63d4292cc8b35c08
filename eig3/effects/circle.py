"""Smooth yielding in the plane within a circle, for isolators."""

from math import sqrt

from ..kernels.compile.jit import element
from ..kernels.elementary import exp, log

_TINY = 1e-300  # the direction of a state of length 0 has no meaning, and no effect


@element
def within_circle(rate, state, yield_length, sharpness):
    """The rate of a hysteretic stretch: its part along the state decays as the state reaches the circle."""
    square = _TINY + state[0] * state[0] + state[1] * state[1]
    along = max(0.0, rate[0] * state[0] + rate[1] * state[1])  # 0 while the link unloads: it is elastic
    share = exp(sharpness / 2 * log(square / (yield_length * yield_length))) * along / square
    return rate[0] - share * state[0], rate[1] - share * state[1]


@element
def pull_of_both(r, state, stiffness, strength, yield_length):
    """The force of a spring and of what yields beside it."""
    share = strength / yield_length
    return stiffness * r[0] + share * state[0], stiffness * r[1] + share * state[1]


@element
def distance_over_yield(r, yield_length):
    return sqrt(r[0] * r[0] + r[1] * r[1]) / yield_length
