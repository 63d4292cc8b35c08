"""A bar between fixed ends, lumped to n masses, along which a pulse travels: stability limits the step."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from eig3 import drawing
from eig3.animation import Profile
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p, a):
    n, k = u.size, p[0]
    a[0] = k * (u[1] - 2 * u[0])
    for j in range(1, n - 1):
        a[j] = k * (u[j - 1] - 2 * u[j] + u[j + 1])
    a[n - 1] = k * (u[n - 2] - 2 * u[n - 1])


@jit
def energy(t, u, v, p):
    """Energy per mass of one lump, with u in pulse heights, 1/s^2."""
    n, k = u.size, p[0]
    kinetic, stretched = 0.0, u[0] * u[0] + u[n - 1] * u[n - 1]
    for j in range(n):
        kinetic += v[j] * v[j]
    for j in range(1, n):
        stretched += (u[j] - u[j - 1]) * (u[j] - u[j - 1])
    return (kinetic + k * stretched) / 2


def elastic_bar(
    n: int = 1000,
    length: float = 1.0,
    wave_speed: float = 5000.0,
    centre: float = 0.3,
    width: float = 0.05,
    t_end: float = 0.002,
) -> Problem:
    """An elastic bar that starts from rest with a displacement in the form of a Gaussian pulse.

    u is the displacements of the masses, in units of the height of the pulse.

    Parameters
    ----------
    n : int
        Number of masses, at least 2. Neighbours are length / (n + 1) apart.
    length : float
        Length of the bar, m.
    wave_speed : float
        sqrt(E / rho), m/s. The default is the value of steel.
    centre, width : float
        Centre and width of the pulse as fractions of the length: u = exp(-((x / length - centre) / width)^2 / 2).
    t_end : float
        Duration, s. With the defaults, the pulse travels along the bar ten times.

    Raises
    ------
    ValueError
        If n is less than 2.

    Notes
    -----
    `exact` is the solution for the n masses, by modal superposition. `continuum` is d'Alembert's solution for the bar;
    with the defaults, the two differ by 0.003. Central difference and EIG-3(1, 1/2), which have the same displacements,
    give d'Alembert's solution if the step is their critical step length / (n + 1) / wave_speed: their errors in time
    cancel the errors of the lumping in space. RK4 has a smaller error for the n masses, but not for the bar.
    """
    x, u0 = gaussian_pulse(n, centre, width)
    return Problem(
        name="elastic_bar",
        rhs=rhs,
        u0=u0,
        v0=np.zeros(n),
        params=[stiffness(n, length, wave_speed)],
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="1/s^2",
        exact=standing_waves(u0, lumped_frequencies(n, length, wave_speed), np.zeros(n)),
        continuum=partial(
            travelling_waves, x=x * length, length=length, wave_speed=wave_speed, centre=centre, width=width
        ),
        units="pulse heights",
        source="d'Alembert; the lumped frequencies are from Lagrange's loaded string",
        draw=drawing_of_bar(x * length),
        view=Profile(x * length, "x (m)", "pulse heights"),
    )


def drawing_of_bar(x: np.ndarray) -> Callable:
    """Return ``draw(figure, solution)`` for masses at the places x (m)."""
    return partial(drawing.field, places=x, label="x (m)", units=("pulse heights", "pulse heights/s"))


def gaussian_pulse(n: int, centre: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of n masses as fractions of the length, and the displacements there."""
    if n < 2:
        raise ValueError(f"n must be at least 2, not {n}.")
    x = np.arange(1, n + 1) / (n + 1)
    return x, odd_pulse(x, centre, width)


def odd_pulse(x: np.ndarray, centre: float, width: float) -> np.ndarray:
    """The pulse, continued as an odd function of period 2: the fixed ends reflect it with the opposite sign."""
    x = (x + 1) % 2 - 1
    places = [(sign, sign * centre + k) for k in (-2, 0, 2) for sign in (1, -1)]
    return np.sum([sign * np.exp(-(((x - place) / width) ** 2) / 2) for sign, place in places], axis=0)


def slope(x: np.ndarray, centre: float, width: float) -> np.ndarray:
    """The derivative of `odd_pulse`."""
    x = (x + 1) % 2 - 1
    places = [(sign, sign * centre + k) for k in (-2, 0, 2) for sign in (1, -1)]
    return np.sum([-sign * (x - q) / width**2 * np.exp(-(((x - q) / width) ** 2) / 2) for sign, q in places], axis=0)


def stiffness(n: int, length: float, wave_speed: float) -> float:
    """Stiffness of the spring between two masses, per mass of one lump, 1/s^2."""
    return (wave_speed * (n + 1) / length) ** 2


def lumped_frequencies(n: int, length: float, wave_speed: float) -> np.ndarray:
    """Natural frequencies 2 c / dx sin(k pi / (2 (n + 1))) for k = 1 to n, rad/s."""
    return 2 * stiffness(n, length, wave_speed) ** 0.5 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))


def standing_waves(u0: np.ndarray, omega: np.ndarray, xi: np.ndarray) -> Callable:
    """Return ``exact(t) -> (u, v)`` from rest at u0: each sine mode has a frequency omega and a damping ratio xi."""
    root = np.sqrt((xi * xi - 1).astype(complex))
    root[root == 0] = 1e-12  # critical damping: separates the two equal roots by a negligible amount
    fast, slow = omega * (-xi - root), omega * (-xi + root)
    return partial(modes, amplitudes=sine_transform(u0), fast=fast, slow=slow)


def modes(t: ArrayLike, amplitudes: np.ndarray, fast: np.ndarray, slow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v at the times t of the sum of all modes, each with two exponents and an amplitude at the start."""
    t = np.asarray(t, dtype=np.float64)[..., None]
    one, two = amplitudes * np.exp(fast * t) / (slow - fast), amplitudes * np.exp(slow * t) / (slow - fast)
    u, v = (slow * one - fast * two).real, (slow * fast * (one - two)).real
    return sine_transform(u), sine_transform(v)


def sine_transform(x: np.ndarray) -> np.ndarray:
    """sqrt(2 / (n + 1)) sum_j x_j sin(j k pi / (n + 1)), by the FFT of the odd continuation; it is its own inverse."""
    n = x.shape[-1]
    wall = np.zeros((*x.shape[:-1], 1))
    odd = np.concatenate([wall, x, wall, -x[..., ::-1]], axis=-1)
    return -np.fft.rfft(odd).imag[..., 1 : n + 1] / np.sqrt(2 * (n + 1))


def travelling_waves(
    t: ArrayLike, x: np.ndarray, length: float, wave_speed: float, centre: float, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v at the times t of d'Alembert's two waves at the places x."""
    way = wave_speed * np.asarray(t, dtype=np.float64)[..., None]
    right, left = (x - way) / length, (x + way) / length
    u = (odd_pulse(right, centre, width) + odd_pulse(left, centre, width)) / 2
    return u, wave_speed / length * (slope(left, centre, width) - slope(right, centre, width)) / 2
