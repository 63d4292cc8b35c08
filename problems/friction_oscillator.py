"""u'' + mu tanh(u' / v_s) + omega^2 u = 0: an oscillator with dry friction, smoothed over small speeds."""

import math

from eig3.callbacks import cached_jit
from eig3.problem import Problem


@cached_jit
def rhs(t, u, v, p):
    return -p[0] * p[0] * u - p[1] * math.tanh(v / p[2])


def friction_oscillator(
    omega: float = 1.0, mu: float = 0.1, v_s: float = 1e-3, u0: float = 1.05, v0: float = 0.0, t_end: float = 13.0
) -> Problem:
    """An oscillator with Coulomb's friction, whose amplitude falls by 2 mu / omega^2 every half period.

    Parameters
    ----------
    omega : float
        Natural frequency, rad/s.
    mu : float
        Force of friction by mass, m/s^2; not negative.
    v_s : float
        Speed at which the friction is tanh(1) = 0.76 of mu, m/s. Below it acts as a damper of rate mu / v_s, for which
        the step of an explicit method must be short. The mass does not stick: where the spring is weaker than mu it
        creeps.
    u0, v0 : float
        Displacement (m) and velocity (m/s) at t = 0.
    t_end : float
        Duration, s. With the other defaults the peaks are -0.85, 0.65, -0.45 and 0.25, and these are four half periods
        and a little more.

    Raises
    ------
    ValueError
        For omega or v_s that is not positive, or a negative mu.
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
        uses_velocity=True,
        source="Den Hartog, Mechanical Vibrations: free vibration with Coulomb's friction",
    )
