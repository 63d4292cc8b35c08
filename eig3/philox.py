"""Random numbers for forces that are noise: see `eig3.kernels.philox`."""

from __future__ import annotations

import math

import numpy as np

from .kernels.elementary import inlined, sqrt
from .kernels.philox import normal

_ZERO = np.uint64(0)
_JUST_AFTER = 1 + 2.0**-50  # a time i h, and its quotient by dt, may be rounded down by four units in the last place


@inlined
def noise(seed: int, member: int, k: int) -> float:
    """Return a normal random number, of mean 0 and variance 1, that depends on nothing but its three arguments.

    In a right-hand side, ``amplitude * eig3.noise(seed, p.member, int(t / dt))`` is noise that is constant over times
    of dt. `eig3.white_noise` has the amplitude that belongs to a spectral density.

    Parameters
    ----------
    seed, member, k : int
        Whole numbers of at least 0, which may be floats up to 2^53.

    Returns
    -------
    float
        NaN if one of them is NaN or infinite: a run refuses it, as each acceleration that is NaN.

    Notes
    -----
    The bits are those of ``np.random.Philox(key=[seed, member], counter=[k, 0, 0, 0])``, and the number is that of Box
    and Muller (1958).
    """
    number = normal(np.uint64(seed), np.uint64(member), np.uint64(k), _ZERO, _ZERO)
    return number + 0 * (seed + member + k)  # without a branch, so that members run in lanes


@inlined
def white_noise(seed: int, member: int, t: float, dt: float, S: float) -> float:
    """Return white noise of a spectral density at the time t: it is constant from each multiple of dt to the next.

    Parameters
    ----------
    seed, member : int
        As for `eig3.noise`.
    t : float
        The time, of at least 0, s.
    dt : float
        The time over which the noise is constant, s. Let steps end at its multiples, such as with h = dt / 2.
    S : float
        The spectral density, two-sided and over angular frequencies: the variance of a signal is the integral of its
        density over all omega from minus to plus infinity, in rad/s. For accelerations, S is in (m/s^2)^2 s.

    Returns
    -------
    float
        ``sqrt(2 pi S / dt) * eig3.noise(seed, member, k)``, where k is t / dt rounded down; NaN if it is infinite.

    Notes
    -----
    The density of the noise at omega is S sinc(omega dt / 2)^2, with sinc(x) = sin(x) / x: within 1 % of S up to
    omega dt = 0.35. A one-sided density over frequencies in Hz, such as that of a record, is 4 pi S. The noise jumps at
    the multiples of dt: at a given dt, the errors of all methods fall with the step h to the first power.
    """
    k = t / dt * _JUST_AFTER
    return sqrt(2 * math.pi * S / dt) * noise(seed, member, int(k)) + 0 * k
