"""u'' + mu tanh(u' / v_s) + omega^2 u = 0: an oscillator with dry friction, made smooth at low speeds."""

import math

from eig3 import drawing
from eig3.animation import Oscillator
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p):
    return -p[0] * p[0] * u - p[1] * math.tanh(v / p[2])


def friction_oscillator(
    omega: float = 1.0, mu: float = 0.1, v_s: float = 1e-3, u0: float = 1.05, v0: float = 0.0, t_end: float = 13.0
) -> Problem:
    """An oscillator with Coulomb friction; u is the displacement in m.

    The amplitude decreases by 2 mu / omega^2 in every half period.

    Parameters
    ----------
    omega : float
        Natural frequency, rad/s.
    mu : float
        Friction force per unit mass, m/s^2; at least 0.
    v_s : float
        Speed at which the friction reaches tanh(1) = 0.76 of mu, m/s. At lower speeds it acts as a viscous damper of
        rate mu / v_s, which limits the step of an explicit method. The mass never sticks: where the spring force is
        smaller than the friction force, it moves slowly.
    u0, v0 : float
        Displacement (m) and velocity (m/s) at t = 0.
    t_end : float
        Duration, s. The default is slightly more than four half periods; with the other defaults, the peaks are at
        -0.85, 0.65, -0.45 and 0.25 m.

    Raises
    ------
    ValueError
        If omega or v_s is not positive, or if mu is negative.
    """
    for name, value in (("omega", omega), ("v_s", v_s)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}.")
    if not mu >= 0:
        raise ValueError(f"mu must not be negative, not {mu}.")
    return Problem(
        name="friction_oscillator",
        rhs=rhs,
        u0=u0,
        v0=v0,
        params=(omega, mu, v_s),
        t_span=(0.0, t_end),
        source="Den Hartog, Mechanical Vibrations: free vibration with Coulomb's friction",
        draw=drawing.oscillator,
        view=Oscillator(),
    )
