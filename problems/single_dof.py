"""u'' + 2 xi omega u' + omega^2 u = F cos(omega_f t): the linear oscillator; zero terms are not compiled."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eig3 import drawing
from eig3.animation import Oscillator
from eig3.functions.callbacks import jit
from eig3.math import cos
from eig3.problem import Problem


@jit
def undamped(t, u, v, p):
    return -p[0] * p[0] * u


@jit
def damped(t, u, v, p):
    return -p[0] * (p[0] * u + 2 * p[1] * v)


@jit
def forced(t, u, v, p):
    return p[2] * cos(p[3] * t) - p[0] * p[0] * u


@jit
def damped_forced(t, u, v, p):
    return p[2] * cos(p[3] * t) - p[0] * (p[0] * u + 2 * p[1] * v)


@jit
def energy(t, u, v, p):
    return (v * v + p[0] * p[0] * u * u) / 2


def single_dof(
    omega: float = 4.0,
    xi: float = 0.0,
    force: float = 0.0,
    force_omega: float = 0.0,
    u0: float = 1.0,
    v0: float = 0.0,
    t_end: float = 1000.0,
) -> Problem:
    """The linear oscillator of the article, section 4.1; u is the displacement in m.

    Parameters
    ----------
    omega : float
        Natural frequency, rad/s.
    xi : float
        Damping ratio.
    force, force_omega : float
        Amplitude per unit mass (m/s^2) and frequency (rad/s) of the harmonic force.
    u0, v0 : float
        Displacement (m) and velocity (m/s) at t = 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        If omega is not positive.
    """
    if not omega > 0:
        raise ValueError(f"omega must be positive, not {omega}.")
    is_damped, is_forced = bool(xi), bool(force)
    return Problem(
        name="single_dof",
        rhs=((undamped, forced), (damped, damped_forced))[is_damped][is_forced],
        u0=u0,
        v0=v0,
        params=(omega, xi, force, force_omega),
        t_span=(0.0, t_end),
        energy=None if is_damped or is_forced else energy,
        energy_unit="J/kg",
        exact=partial(exact_solution, omega=omega, xi=xi, force=force, force_omega=force_omega, u0=u0, v0=v0),
        source="EIG-3 article, section 4.1",
        h=1e-2,
        draw=drawing.oscillator,
        view=Oscillator(),
    )


def exact_solution(
    t: ArrayLike, omega: float, xi: float, force: float, force_omega: float, u0: float, v0: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v at the times t: a particular solution plus a solution of the homogeneous equation."""
    t = np.asarray(t, dtype=np.float64)
    constants = (omega, xi, force, force_omega)
    (u_start, v_start), (u_forced, v_forced) = particular(0.0, *constants), particular(t, *constants)
    u_free, v_free = free(t, omega, xi, u0 - u_start, v0 - v_start)
    return u_forced + u_free, v_forced + v_free


def particular(t: float | np.ndarray, omega: float, xi: float, force: float, force_omega: float) -> tuple[Any, Any]:
    """A solution with the force, which grows with time at resonance without damping."""
    if xi == 0 and force_omega == omega:
        c = force / (2 * omega)
        return c * t * np.sin(omega * t), c * (np.sin(omega * t) + omega * t * np.cos(omega * t))
    response = force / (omega**2 - force_omega**2 + 2j * xi * omega * force_omega)
    wave = response * np.exp(1j * force_omega * t)
    return wave.real, (1j * force_omega * wave).real


def free(t: np.ndarray, omega: float, xi: float, u0: float, v0: float) -> tuple[np.ndarray, np.ndarray]:
    """The solution without the force that starts at u0 and v0."""
    if xi == 1:
        rate = v0 + omega * u0
        decay = np.exp(-omega * t)
        return (u0 + rate * t) * decay, (v0 - omega * rate * t) * decay
    root = np.sqrt(complex(xi * xi - 1))
    fast, slow = omega * (-xi - root), omega * (-xi + root)
    a = (v0 - slow * u0) / (fast - slow)
    b = u0 - a
    one, two = a * np.exp(fast * t), b * np.exp(slow * t)
    return (one + two).real, (fast * one + slow * two).real
