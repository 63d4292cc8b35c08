"""A slow and a fast oscillator that do not touch each other: the fast one sets the step, the slow one the duration."""

from collections.abc import Callable

import numpy as np

from eig3.callbacks import cached_jit
from eig3.problem import Problem


@cached_jit
def rhs(t, u, v, p, a):
    a[0] = -p[0] * p[0] * u[0]
    a[1] = -p[1] * p[1] * u[1]


@cached_jit
def energy(t, u, v, p):
    slow, fast = p[0] * u[0], p[1] * u[1]
    return (v[0] * v[0] + v[1] * v[1] + slow * slow + fast * fast) / 2


def two_frequency_oscillator(
    omega: float = 1.0,
    omega_fast: float = 1000.0,
    u0: tuple[float, float] = (1.0, 1.0),
    t_end: float = 1000.0,
) -> Problem:
    """Two modes of vibration of a structure, displaced and let go; u is (slow, fast).

    Parameters
    ----------
    omega, omega_fast : float
        Frequencies, rad/s.
    u0 : (float, float)
        Displacements at t = 0, m. With the defaults all but a millionth of the energy is in the fast mode.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For a frequency that is not positive.
    """
    for name, value in (("omega", omega), ("omega_fast", omega_fast)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}.")
    return Problem(
        name="two_frequency_oscillator",
        rhs=rhs,
        u0=u0,
        v0=(0.0, 0.0),
        params=(omega, omega_fast),
        t_span=(0.0, t_end),
        energy=energy,
        exact=two_cosines(np.array([omega, omega_fast]), np.array(u0)),
        uses_velocity=False,
        source="The linear part of Hairer, Lubich and Wanner, Geometric Numerical Integration, chapter XIII",
    )


def two_cosines(omega: np.ndarray, u0: np.ndarray) -> Callable:
    """``exact(t) -> (u, v)`` from rest at u0."""

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phase = np.asarray(t, dtype=np.float64)[..., None] * omega
        return u0 * np.cos(phase), -u0 * omega * np.sin(phase)

    return exact
