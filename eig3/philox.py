"""Random numbers for random forces: see `eig3.kernels.philox`."""

from __future__ import annotations

import math

import numpy as np

from .kernels.elementary import inlined, sqrt
from .kernels.philox import normal

_ZERO = np.uint64(0)
_JUST_AFTER = 1 + 2.0**-50  # a time i h, and its quotient by dt, may be rounded down by four units in the last place


@inlined
def noise(seed: int, member: int, k: int) -> float:
    """Return a normal random number, of mean 0 and variance 1, that depends only on its three arguments.

    In a right-hand side, ``amplitude * eig3.noise(seed, p.member, int(t / dt))`` is noise that is constant over each
    dt. `eig3.white_noise` computes the amplitude from a spectral density.

    Parameters
    ----------
    seed, member, k : int
        Whole numbers of at least 0, which may be floats up to 2^53.

    Returns
    -------
    float
        NaN if an argument is NaN or infinite: the run then ends, as with any acceleration that is NaN.

    Notes
    -----
    The random bits are the bits of ``np.random.Philox(key=[seed, member], counter=[k, 0, 0, 0])``, transformed to a
    normal number as by Box and Muller (1958).
    """
    number = normal(np.uint64(seed), np.uint64(member), np.uint64(k), _ZERO, _ZERO)
    return number + 0 * (seed + member + k)  # without a branch, for members in lanes


@inlined
def white_noise(seed: int, member: int, t: float, dt: float, S: float) -> float:
    """Return white noise of a spectral density at the time t, which is constant between multiples of dt.

    Parameters
    ----------
    seed, member : int
        As for `eig3.noise`.
    t : float
        The time, of at least 0, s.
    dt : float
        The time over which the noise is constant, s. Choose h so that steps end at its multiples, such as h = dt / 2.
    S : float
        The spectral density, two-sided and over angular frequencies: the variance of a signal is the integral of its
        density over all omega from minus to plus infinity, in rad/s. For accelerations, S is in (m/s^2)^2 s.

    Returns
    -------
    float
        ``sqrt(2 pi S / dt) * eig3.noise(seed, member, k)``, where k is t / dt rounded down; NaN if it is infinite.

    Notes
    -----
    The density of the noise at omega is S sinc(omega dt / 2)^2, with sinc(x) = sin(x) / x: within 1 % of S up to omega
    dt = 0.35. The one-sided density over frequencies in Hz is 4 pi S. The noise jumps at the multiples of dt: at a
    given dt, the errors of all methods are proportional to the step h.
    """
    k = t / dt * _JUST_AFTER
    return sqrt(2 * math.pi * S / dt) * noise(seed, member, int(k)) + 0 * k
