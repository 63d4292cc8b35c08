"""The bar of `elastic_bar` with viscous damping: the force depends on the velocity, which lowers the critical step."""

import numpy as np

from eig3.animation import Profile
from eig3.functions.callbacks import jit
from eig3.problem import Problem

from .elastic_bar import drawing_of_bar, gaussian_pulse, lumped_frequencies, standing_waves, stiffness


@jit
def rhs(t, u, v, p, a):
    n, k, c = u.size, p[0], p[1]
    a[0] = k * (u[1] - 2 * u[0]) + c * (v[1] - 2 * v[0])
    for j in range(1, n - 1):
        a[j] = k * (u[j - 1] - 2 * u[j] + u[j + 1]) + c * (v[j - 1] - 2 * v[j] + v[j + 1])
    a[n - 1] = k * (u[n - 2] - 2 * u[n - 1]) + c * (v[n - 2] - 2 * v[n - 1])


def damped_bar(
    n: int = 1000,
    length: float = 1.0,
    wave_speed: float = 5000.0,
    xi: float = 0.1,
    centre: float = 0.3,
    width: float = 0.05,
    t_end: float = 0.002,
) -> Problem:
    """A bar of a Kelvin-Voigt material that starts from rest with a displacement in the form of a Gaussian pulse.

    The stress is E (strain + tau strain rate). u is the displacements of the masses, in units of the height of the
    pulse.

    Parameters
    ----------
    n, length, wave_speed, centre, width, t_end
        As for `elastic_bar`.
    xi : float
        Damping ratio at the frequency 2 wave_speed (n + 1) / length, which is above all natural frequencies of the n
        masses; at least 0. The damping ratio of a mode is proportional to its frequency.

    Raises
    ------
    ValueError
        If n is less than 2 or xi is negative.

    Notes
    -----
    `exact` is the solution for the n masses, and `continuum` is the solution for the bar, both by modal superposition.
    """
    if not xi >= 0:
        raise ValueError(f"xi must not be negative, not {xi}.")
    x, u0 = gaussian_pulse(n, centre, width)
    highest = 2 * stiffness(n, length, wave_speed) ** 0.5
    lumped = lumped_frequencies(n, length, wave_speed)
    continuous = np.arange(1, n + 1) * np.pi * wave_speed / length
    return Problem(
        name="damped_bar",
        rhs=rhs,
        u0=u0,
        v0=np.zeros(n),
        params=[stiffness(n, length, wave_speed), 2 * xi / highest * stiffness(n, length, wave_speed)],
        t_span=(0.0, t_end),
        exact=standing_waves(u0, lumped, xi * lumped / highest),
        continuum=standing_waves(u0, continuous, xi * continuous / highest),
        units="pulse heights",
        source="Kelvin-Voigt bar, by modal superposition",
        draw=drawing_of_bar(x * length),
        view=Profile(x * length, "x (m)", "pulse heights"),
    )
