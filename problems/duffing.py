"""u'' + delta u' + a u + b u^3 = gamma cos(omega t): Duffing's oscillator; zero terms are not compiled."""

from eig3 import drawing
from eig3.animation import Portrait
from eig3.functions.callbacks import jit
from eig3.math import cos
from eig3.problem import Problem


@jit
def undamped(t, u, v, p):
    return -u * (p[0] + p[1] * u * u)


@jit
def damped(t, u, v, p):
    return -u * (p[0] + p[1] * u * u) - p[2] * v


@jit
def forced(t, u, v, p):
    return p[3] * cos(p[4] * t) - u * (p[0] + p[1] * u * u)


@jit
def damped_forced(t, u, v, p):
    return p[3] * cos(p[4] * t) - u * (p[0] + p[1] * u * u) - p[2] * v


@jit
def energy(t, u, v, p):
    return v * v / 2 + u * u * (p[0] / 2 + p[1] * u * u / 4)


def duffing(
    delta: float = 0.3,
    a: float = -1.0,
    b: float = 1.0,
    gamma: float = 0.5,
    omega: float = 1.2,
    u0: float = 1.0,
    v0: float = 0.0,
    t_end: float = 50.0,
) -> Problem:
    """Duffing's oscillator; u is the displacement in m.

    With the defaults the potential has two wells, at u = -1 m and 1 m, and the motion between them is chaotic.

    Parameters
    ----------
    delta : float
        Damping coefficient per unit mass, 1/s; at least 0.
    a : float
        Linear stiffness per unit mass, 1/s^2.
    b : float
        Cubic stiffness per unit mass, 1/(m^2 s^2).
    gamma, omega : float
        Amplitude per unit mass (m/s^2) and frequency (rad/s) of the harmonic force.
    u0, v0 : float
        Displacement (m) and velocity (m/s) at t = 0.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        If delta is negative.

    Notes
    -----
    With the defaults, a difference of 1e-10 m in the displacement grows to 5e-6 m in 50 s and to 1 m in 100 s. After
    100 s, round-off errors reach the fourth decimal.
    """
    if not delta >= 0:
        raise ValueError(f"delta must not be negative, not {delta}.")
    is_damped, is_forced = bool(delta), bool(gamma)
    return Problem(
        name="duffing",
        rhs=((undamped, forced), (damped, damped_forced))[is_damped][is_forced],
        u0=u0,
        v0=v0,
        params=(a, b, delta, gamma, omega),
        t_span=(0.0, t_end),
        energy=None if is_damped or is_forced else energy,
        energy_unit="J/kg",
        source="Guckenheimer and Holmes, Nonlinear Oscillations, Dynamical Systems, and Bifurcations of Vector Fields, "
        "section 2.2",
        draw=drawing.oscillator,
        view=Portrait(),
    )
