"""A harmonic force."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..math import cos
from ..scene.effect import Body
from .vector import scale


@dataclass(frozen=True, eq=False)
class HarmonicForce(Body):
    """The force amplitude cos(omega t + phase).

    Parameters
    ----------
    amplitude : array_like, shape (dimension,)
        N.
    omega : float or array_like
        Angular frequency, rad/s.
    phase : float or array_like
        rad; -pi/2 makes it a sine.
    """

    amplitude: ArrayLike
    omega: ArrayLike
    phase: ArrayLike = 0.0

    vectors = ("amplitude",)
    source = "the load of a driven oscillator"

    @staticmethod
    @element
    def force(t, amplitude, omega, phase):
        return scale(cos(omega * t + phase), amplitude)
