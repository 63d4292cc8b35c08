"""u'' + S tanh u = 0: a mass on a spring that becomes softer under load."""

import math

from eig3 import drawing
from eig3.animation import Oscillator
from eig3.functions.callbacks import jit
from eig3.math import tanh
from eig3.problem import Problem


@jit
def rhs(t, u, v, p):
    return -p[0] * tanh(u)


@jit
def energy(t, u, v, p):
    # ln(cosh(u)) in a form that does not overflow for large u
    return v * v / 2 + p[0] * (abs(u) + math.log1p(math.exp(-2 * abs(u))) - math.log(2.0))


def softening_spring(S: float = 100.0, u0: float = 4.0, v0: float = 0.0, t_end: float = 140.0) -> Problem:
    """The elastic softening spring of the article, section 4.3; u is the displacement in m.

    Parameters
    ----------
    S : float
        Largest spring force per unit mass, m/s^2.
    u0, v0 : float
        Displacement (m) and velocity (m/s) at t = 0. With the defaults the period is 1.1418763 s.
    t_end : float
        Duration, s.
    """
    return Problem(
        name="softening_spring",
        rhs=rhs,
        u0=u0,
        v0=v0,
        params=(S,),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="J/kg",
        source="EIG-3 article, section 4.3, after Xie",
        h=1e-3,
        draw=drawing.oscillator,
        view=Oscillator(),
    )
