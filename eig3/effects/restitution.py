"""Newton's law of restitution for the events of effects."""

from ..kernels.compile.jit import element


@element
def rebound(rate, restitution, rest_speed):
    """Return the rate of a distance after an impact. The rate of points that move apart does not change."""
    return rate if rate >= 0 else max(-restitution * rate, min(-rate, rest_speed))
