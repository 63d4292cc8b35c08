"""A slow and a fast oscillator without coupling: the fast one limits the step, the slow one sets the duration."""

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from eig3 import drawing
from eig3.animation import Curves
from eig3.functions.callbacks import jit
from eig3.problem import Problem
from eig3.result.labels import Labels


@jit
def rhs(t, u, v, p, a):
    a[0] = -p[0] * p[0] * u[0]
    a[1] = -p[1] * p[1] * u[1]


@jit
def energy(t, u, v, p):
    slow, fast = p[0] * u[0], p[1] * u[1]
    return (v[0] * v[0] + v[1] * v[1] + slow * slow + fast * fast) / 2


def two_frequency_oscillator(
    omega: float = 1.0,
    omega_fast: float = 1000.0,
    u0: tuple[float, float] = (1.0, 1.0),
    t_end: float = 1000.0,
) -> Problem:
    """Two modes of vibration of a structure, released from rest; u is the displacements (slow, fast) in m.

    Parameters
    ----------
    omega, omega_fast : float
        Frequencies, rad/s.
    u0 : (float, float)
        Displacements at t = 0, m. With the defaults the slow mode has one millionth of the energy.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        If a frequency is not positive.
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
        energy_unit="J/kg",
        exact=partial(two_cosines, omega=np.array([omega, omega_fast]), u0=np.array(u0)),
        source="The linear part of Hairer, Lubich and Wanner, Geometric Numerical Integration, chapter XIII",
        draw=draw,
        view=Curves(Labels(("slow", "fast"))),
    )


def two_cosines(t: ArrayLike, omega: np.ndarray, u0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the displacements and velocities at the times t of two oscillators that start from rest at u0."""
    phase = np.asarray(t, dtype=np.float64)[..., None] * omega
    return u0 * np.cos(phase), -u0 * omega * np.sin(phase)


def draw(figure, solution):
    drawing.lines(drawing.time_panel(figure, "slow mode (m)"), solution.t, solution.u[:, 0])
    # dots, since the fast mode may have many periods between two saved states
    fast = drawing.time_panel(figure, "fast mode (m),\nsaved states")
    fast.plot(solution.t, solution.u[:, 1], linestyle="none", marker=".", markersize=2)
    drawing.first_periods(figure, solution, solution.v[:, 0])
