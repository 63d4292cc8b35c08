"""A bar between fixed ends, lumped to n masses, with a pulse that runs along it: the step is limited by stability."""

from collections.abc import Callable

import numpy as np

from eig3.callbacks import cached_jit
from eig3.problem import Problem


@cached_jit
def rhs(t, u, v, p, a):
    n, k = u.size, p[0]
    a[0] = k * (u[1] - 2 * u[0])
    for j in range(1, n - 1):
        a[j] = k * (u[j - 1] - 2 * u[j] + u[j + 1])
    a[n - 1] = k * (u[n - 2] - 2 * u[n - 1])


@cached_jit
def energy(t, u, v, p):
    """Of the unit of mass that one lump has."""
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
    """An elastic bar at rest, displaced by a Gaussian pulse.

    Parameters
    ----------
    n : int
        Masses, at n equal distances length / (n + 1); two at least.
    length : float
        m.
    wave_speed : float
        sqrt(E / rho), m/s. The default is steel's, and the pulse passes the bar ten times.
    centre, width : float
        Of the pulse, as parts of the length: exp(-((x / length - centre) / width)^2 / 2).
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        For fewer than two masses.

    Notes
    -----
    `exact` is the solution for the n masses, by their modes of vibration. `continuum` is d'Alembert's for the bar,
    0.003 from the former with the defaults. Central difference and EIG-3(1, 1/2), whose positions are the same, give
    d'Alembert's when the step is their stability limit length / (n + 1) / wave_speed: their errors in time and in space
    cancel. RK4, which integrates the masses more closely, does not come nearer to the bar than they do.
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
        exact=standing_waves(u0, lumped_frequencies(n, length, wave_speed), np.zeros(n)),
        continuum=travelling_waves(x * length, length, wave_speed, centre, width),
        uses_velocity=False,
        source="d'Alembert; the lumped frequencies are those of Lagrange's loaded string",
    )


def gaussian_pulse(n: int, centre: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """The places of n masses as parts of the length, and the displacement there."""
    if n < 2:
        raise ValueError(f"n must be at least 2, not {n}.")
    x = np.arange(1, n + 1) / (n + 1)
    return x, odd_pulse(x, centre, width)


def odd_pulse(x: np.ndarray, centre: float, width: float) -> np.ndarray:
    """The pulse continued oddly and with period 2, as reflections at fixed ends ask."""
    x = (x + 1) % 2 - 1
    places = [(sign, sign * centre + k) for k in (-2, 0, 2) for sign in (1, -1)]
    return np.sum([sign * np.exp(-(((x - place) / width) ** 2) / 2) for sign, place in places], axis=0)


def stiffness(n: int, length: float, wave_speed: float) -> float:
    """Of the spring between two masses, by mass (1/s^2)."""
    return (wave_speed * (n + 1) / length) ** 2


def lumped_frequencies(n: int, length: float, wave_speed: float) -> np.ndarray:
    """2 c / dx sin(k pi / (2 (n + 1))), k = 1 to n, in rad/s."""
    return 2 * stiffness(n, length, wave_speed) ** 0.5 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))


def standing_waves(u0: np.ndarray, omega: np.ndarray, xi: np.ndarray) -> Callable:
    """``exact(t) -> (u, v)`` from rest at u0: every sine mode an oscillator of frequency omega and damping ratio xi."""
    amplitudes = sine_transform(u0)
    root = np.sqrt((xi * xi - 1).astype(complex))
    root[root == 0] = 1e-12  # critical damping: its two modes are told apart by less than shows
    fast, slow = omega * (-xi - root), omega * (-xi + root)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        t = np.asarray(t, dtype=np.float64)[..., None]
        one, two = amplitudes * np.exp(fast * t) / (slow - fast), amplitudes * np.exp(slow * t) / (slow - fast)
        u, v = (slow * one - fast * two).real, (slow * fast * (one - two)).real
        return sine_transform(u), sine_transform(v)

    return exact


def sine_transform(x: np.ndarray) -> np.ndarray:
    """sqrt(2 / (n + 1)) sum_j x_j sin(j k pi / (n + 1)), its own inverse, by the FFT of the odd continuation."""
    n = x.shape[-1]
    wall = np.zeros((*x.shape[:-1], 1))
    odd = np.concatenate([wall, x, wall, -x[..., ::-1]], axis=-1)
    return -np.fft.rfft(odd).imag[..., 1 : n + 1] / np.sqrt(2 * (n + 1))


def travelling_waves(x: np.ndarray, length: float, wave_speed: float, centre: float, width: float) -> Callable:
    """``continuum(t) -> (u, v)``, d'Alembert's two waves at the places x."""

    def slope(z: np.ndarray) -> np.ndarray:
        z = (z + 1) % 2 - 1
        places = [(sign, sign * centre + k) for k in (-2, 0, 2) for sign in (1, -1)]
        return np.sum(
            [-sign * (z - q) / width**2 * np.exp(-(((z - q) / width) ** 2) / 2) for sign, q in places], axis=0
        )

    def continuum(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        way = wave_speed * np.asarray(t, dtype=np.float64)[..., None]
        right, left = (x - way) / length, (x + way) / length
        u = (odd_pulse(right, centre, width) + odd_pulse(left, centre, width)) / 2
        return u, wave_speed / length * (slope(left) - slope(right)) / 2

    return continuum
