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
    """A force that oscillates.

    Formula: force = amplitude cos(omega t + phase).

    Parameters
    ----------
    amplitude : array_like, shape (dimension,)
        N.
    omega : float or array_like
        Angular frequency, rad/s.
    phase : float or array_like
        rad; -pi/2 makes it a sine.

    Notes
    -----
    Other codes: OpenSees: a nodal load with ``timeSeries Trig``, a sine with the period 2 pi / omega and the shift
    phase + pi / 2. LAMMPS: ``fix addforce`` with an equal-style variable.

    Not included: a begin and an end of the load, and sampled loads: `eig3.linear` takes records of forces.
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
