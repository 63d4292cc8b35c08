"""Hertz's law of two round bodies that press on each other."""

import math

from ..kernels.jit import element


@element
def push(d, stiffness):
    """The force at an indentation d, and none where d is negative: the bodies are apart."""
    d = max(0.0, d)
    return stiffness * d * math.sqrt(d)


@element
def damped_push(d, rate, stiffness, damping):
    """The force where d grows at a rate; the bodies never pull each other."""
    return push(d, stiffness) * max(0.0, 1 + damping * rate)


@element
def stored(d, stiffness):
    """The energy of the elastic contact."""
    return 2 / 5 * max(0.0, d) * push(d, stiffness)
