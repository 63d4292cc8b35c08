"""u'' = k max(0, -u)^(3/2): a ball that hits a wall and bounces back; the contact force is not smooth."""

import math

from eig3 import drawing
from eig3.animation import Oscillator
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p):
    delta = max(0.0, -u)
    return p[0] * delta * math.sqrt(delta)


@jit
def energy(t, u, v, p):
    delta = max(0.0, -u)
    return v * v / 2 + 2 / 5 * p[0] * delta * delta * math.sqrt(delta)


def hertz_impact(k: float = 1e6, speed: float = 1.0, t_end: float | None = None) -> Problem:
    """Hertz's impact of a unit mass on a wall, from the first contact; u is the gap in m, and -u the indentation.

    The contact lasts t_c = 2.94328 delta_max / speed, where the largest indentation is
    delta_max = (5 speed^2 / (4 k))^(2/5). The mass leaves the wall with the speed of its approach.

    Parameters
    ----------
    k : float
        Contact stiffness per unit mass, 1/(m^(1/2) s^2): the force per unit mass is k indentation^(3/2).
    speed : float
        Speed of the approach, m/s.
    t_end : float, optional
        Duration, s; 2 t_c if not given.

    Raises
    ------
    ValueError
        If k or speed is not positive.

    Notes
    -----
    The force has no second derivative where the contact begins and ends, so that no method has an order above 5/2
    across these points. Import the duration of the contact with
    ``from eig3.problems.hertz_impact import contact_time``: in `eig3.problems`, `hertz_impact` is the function.
    """
    for name, value in (("k", k), ("speed", speed)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}.")
    return Problem(
        name="hertz_impact",
        rhs=rhs,
        u0=0.0,
        v0=-speed,
        params=(k,),
        t_span=(0.0, 2 * contact_time(k, speed) if t_end is None else t_end),
        energy=energy,
        energy_unit="J/kg",
        source="Hertz, Über die Berührung fester elastischer Körper (1881); Johnson, Contact Mechanics, chapter 11",
        draw=drawing.oscillator,
        view=Oscillator("floor"),
    )


def largest_indentation(k: float, speed: float) -> float:
    """The indentation at which the contact stores all the kinetic energy of the approach, m."""
    return (5 * speed**2 / (4 * k)) ** 0.4


def contact_time(k: float, speed: float) -> float:
    """The duration of the contact, s: 2.94328 delta_max / speed.

    The factor is twice the integral of dx / sqrt(1 - x^(5/2)) from 0 to 1, a beta function.
    """
    return 0.8 * math.sqrt(math.pi) * math.gamma(0.4) / math.gamma(0.9) * largest_indentation(k, speed) / speed
