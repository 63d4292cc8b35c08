"""Hertz's law for two round bodies in contact."""

import math

from ..kernels.compile.jit import element


@element
def push(d, stiffness):
    """The force at an indentation d. It is 0 where d is negative, because the bodies are apart."""
    d = max(0.0, d)
    return stiffness * d * math.sqrt(d)


@element
def damped_push(d, rate, stiffness, damping):
    """The force at an indentation d that grows at a rate. The bodies never pull each other."""
    return push(d, stiffness) * max(0.0, 1 + damping * rate)


@element
def stored(d, stiffness):
    """The energy of the elastic contact."""
    return 2 / 5 * max(0.0, d) * push(d, stiffness)
