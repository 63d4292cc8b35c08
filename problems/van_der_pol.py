"""u'' - mu (1 - u^2) u' + u = 0: Van der Pol's oscillator: slow phases alternate with jumps."""

from functools import partial

from eig3 import drawing
from eig3.animation import Portrait
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p):
    return p[0] * (1 - u * u) * v - u


def van_der_pol(mu: float = 10.0, u0: float = 2.0, v0: float = 0.0, t_end: float = 100.0) -> Problem:
    """Van der Pol's oscillator; u is dimensionless, and the natural frequency is 1 rad/s.

    Every motion except rest tends to the same limit cycle.

    Parameters
    ----------
    mu : float
        Coefficient of the damping, 1/s; at least 0. The damping is positive for abs(u) > 1 and negative for abs(u) < 1.
    u0, v0 : float
        Displacement (dimensionless) and velocity (1/s) at t = 0.
    t_end : float
        Duration, s. With the defaults it is five periods.

    Raises
    ------
    ValueError
        If mu is negative.

    Notes
    -----
    The period is 19.07837 s for mu = 10 and 162.83707 s for mu = 100. While u decreases slowly from 2 to 1, a
    disturbance of the velocity decays at a rate of up to 3 mu. This rate limits the step of an explicit method.
    """
    if not mu >= 0:
        raise ValueError(f"mu must not be negative, not {mu}.")
    return Problem(
        name="van_der_pol",
        rhs=rhs,
        u0=u0,
        v0=v0,
        params=(mu,),
        t_span=(0.0, t_end),
        units="-",
        source="Van der Pol, On relaxation-oscillations, Philosophical Magazine 2 (1926)",
        draw=partial(drawing.oscillator, units=("-", "1/s")),
        view=Portrait(("-", "1/s")),
    )
