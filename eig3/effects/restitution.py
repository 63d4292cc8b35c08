"""Newton's law of restitution for the events of effects."""

from ..kernels.compile.jit import element


@element
def rebound(rate, restitution, rest_speed):
    """Return the rate of a distance after an impact. Points that move apart already do not strike each other."""
    return rate if rate >= 0 else max(-restitution * rate, min(-rate, rest_speed))
