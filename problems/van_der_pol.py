"""u'' - mu (1 - u^2) u' + u = 0: Van der Pol's oscillator, which relaxes slowly and then jumps."""

from eig3.callbacks import cached_jit
from eig3.problem import Problem


@cached_jit
def rhs(t, u, v, p):
    return p[0] * (1 - u * u) * v - u


def van_der_pol(mu: float = 10.0, u0: float = 2.0, v0: float = 0.0, t_end: float = 100.0) -> Problem:
    """Van der Pol's oscillator, which tends to one periodic motion from every start but rest.

    Parameters
    ----------
    mu : float
        Damping where u is large and its opposite where u is small; time is counted so that the frequency without it
        is 1. Not negative. While u creeps from 2 to 1 the velocity decays at rates up to 3 mu, and the step of an
        explicit method must be short for that. The periods are 19.07837 for mu = 10 and 162.83707 for mu = 100.
    u0, v0 : float
        Displacement and velocity at t = 0.
    t_end : float
        Duration. With the defaults it is five periods.

    Raises
    ------
    ValueError
        For a negative mu.
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
        uses_velocity=True,
        source="Van der Pol, On relaxation-oscillations, Philosophical Magazine 2 (1926)",
    )
