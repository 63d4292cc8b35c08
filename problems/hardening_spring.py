"""u'' + S1 u (1 + S2 u^2) = 0: a mass on a spring that becomes stiffer under load."""

from eig3 import drawing
from eig3.animation import Oscillator
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p):
    return -p[0] * u * (1 + p[1] * u * u)


@jit
def energy(t, u, v, p):
    return v * v / 2 + p[0] * u * u / 2 + p[0] * p[1] * u**4 / 4


def hardening_spring(
    S1: float = 100.0, S2: float = 10.0, u0: float = 1.5, v0: float = 0.0, t_end: float = 15.15328
) -> Problem:
    """The elastic hardening spring of the article, section 4.2; u is the displacement in m.

    Parameters
    ----------
    S1 : float
        Stiffness per unit mass at u = 0, 1/s^2.
    S2 : float
        Coefficient of the cubic term, 1/m^2.
    u0, v0 : float
        Displacement (m) and velocity (m/s) at t = 0.
    t_end : float
        Duration, s. With the other defaults the period is 0.1515328 s, and the default duration is 100 periods.
    """
    return Problem(
        name="hardening_spring",
        rhs=rhs,
        u0=u0,
        v0=v0,
        params=(S1, S2),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="J/kg",
        source="EIG-3 article, section 4.2, after Xie",
        h=1e-4,
        draw=drawing.oscillator,
        view=Oscillator(),
    )
