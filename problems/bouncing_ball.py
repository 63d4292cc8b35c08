"""u'' = -g: a ball that falls on a floor and bounces lower each time; the impacts are events."""

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from eig3 import drawing
from eig3.animation import Oscillator
from eig3.functions.callbacks import jit
from eig3.functions.events import Event
from eig3.problem import Problem


@jit
def rhs(t, u, v, p):
    return -p[0]


@jit
def height(t, u, v, p):
    return u


@jit
def bounce(t, u, v, p):
    return 0.0, -p[1] * v


def bouncing_ball(restitution: float = 0.8, h0: float = 1.0, g: float = 9.81, t_end: float | None = None) -> Problem:
    """A ball dropped on a floor, with an event "impact" that reverses its velocity; u is its height in m.

    Each flight takes `restitution` times as long as the flight before. Infinitely many impacts therefore occur before
    the time sqrt(2 h0 / g) (1 + restitution) / (1 - restitution), and the ball then rests.

    Parameters
    ----------
    restitution : float
        Coefficient of restitution: the speed after an impact divided by the speed before it; positive, and at most 1.
    h0 : float
        Height at t = 0, where the ball is at rest, m.
    g : float
        Gravitational acceleration, m/s^2.
    t_end : float, optional
        Duration, s; until the middle of the flight after 30 impacts if not given.

    Raises
    ------
    ValueError
        If restitution, h0 or g is not positive, or if restitution is above 1.

    Notes
    -----
    Import the times of the impacts with ``from eig3.problems.bouncing_ball import impact_times``: in `eig3.problems`,
    `bouncing_ball` is the function.
    """
    if not 0 < restitution <= 1:
        raise ValueError(f"restitution must be positive and at most 1, not {restitution}.")
    for name, value in (("h0", h0), ("g", g)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}.")
    return Problem(
        name="bouncing_ball",
        rhs=rhs,
        u0=h0,
        v0=0.0,
        params=(g, restitution),
        t_span=(0.0, float(impact_times(31, restitution, h0, g)[-2:].mean()) if t_end is None else t_end),
        exact=partial(flights, restitution=restitution, h0=h0, g=g),
        source="a textbook example of events; Johnson, Contact Mechanics, section 11.5, for the restitution",
        h=1e-4,
        draw=drawing.oscillator,
        view=Oscillator("floor"),
        events={"impact": Event(height, direction=-1, apply=bounce)},
    )


def impact_times(k: int, restitution: float, h0: float, g: float) -> np.ndarray:
    """Return the times of the first k impacts, s."""
    return math.sqrt(2 * h0 / g) * (1 + 2 * _sum(np.arange(1, k + 1), restitution))


def flights(t: ArrayLike, restitution: float, h0: float, g: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the height and the velocity at the times t; the fall at the start is the second half of a flight 0."""
    fall = math.sqrt(2 * h0 / g)
    t = np.asarray(t, dtype=np.float64) / fall
    if restitution == 1:
        k = np.floor((t + 1) / 2)
        rests = np.zeros(t.shape, dtype=bool)
    else:
        part = restitution - (t - 1) * (1 - restitution) / 2  # restitution^k at the impact k
        rests = part <= 0
        k = np.floor(np.log(np.where(rests, 1.0, part)) / math.log(restitution))
    speed = restitution**k
    s = t - (1 + 2 * _sum(k, restitution))
    u, v = h0 * s * (2 * speed - s), g * fall * (speed - s)
    return np.where(rests, 0.0, u), np.where(rests, 0.0, v)


def _sum(k: np.ndarray, restitution: float) -> np.ndarray:
    """The sum of restitution^j for j from 1 to k - 1; for k = 0 it is -1."""
    return k - 1 if restitution == 1 else (restitution - restitution**k) / (1 - restitution)
