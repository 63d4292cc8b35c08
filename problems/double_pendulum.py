"""Two point masses on two rods that swing in a plane: both accelerations depend on both velocities."""

import math
from functools import partial

import numpy as np

from eig3 import drawing
from eig3.animation import Mechanism
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p, a):
    m1, m2, l1, l2, g = p[0], p[1], p[2], p[3], p[4]
    m, sine, cosine = m1 + m2, math.sin(u[0] - u[1]), math.cos(u[0] - u[1])
    sine1, sine2 = math.sin(u[0]), math.sin(u[1])
    pull1, pull2 = l1 * v[0] * v[0], l2 * v[1] * v[1]
    inertia = m1 + m2 * sine * sine
    a[0] = -(m2 * sine * (pull1 * cosine + pull2) + g * (m * sine1 - m2 * sine2 * cosine)) / (l1 * inertia)
    a[1] = (sine * (m * pull1 + m2 * pull2 * cosine) + m * g * (sine1 * cosine - sine2)) / (l2 * inertia)


@jit
def energy(t, u, v, p):
    m1, m2, l1, l2, g = p[0], p[1], p[2], p[3], p[4]
    speed1, speed2 = l1 * v[0], l2 * v[1]
    kinetic = (m1 + m2) / 2 * speed1 * speed1 + m2 / 2 * speed2 * speed2 + m2 * speed1 * speed2 * math.cos(u[0] - u[1])
    return kinetic - (m1 + m2) * g * l1 * math.cos(u[0]) - m2 * g * l2 * math.cos(u[1])


def double_pendulum(
    m1: float = 1.0,
    m2: float = 1.0,
    l1: float = 1.0,
    l2: float = 1.0,
    g: float = 9.81,
    theta1: float = 1.5,
    theta2: float = 1.0,
    t_end: float = 100.0,
) -> Problem:
    """The double pendulum, released from rest; u is the angles of the two rods from the vertical in rad.

    Parameters
    ----------
    m1, m2 : float
        Masses, kg; the first hangs from the support.
    l1, l2 : float
        Lengths of the massless rods, m.
    g : float
        Acceleration of gravity, m/s^2.
    theta1, theta2 : float
        Angles at t = 0, rad.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        If a mass or a length is not positive.

    Notes
    -----
    With the default angles the motion is nearly regular for 100 s: a difference of 1e-10 rad grows to 1e-8 rad. Later
    it is chaotic. With theta1 = theta2 = 2 it is chaotic from the start: the same difference grows to 1 rad in 20 s.
    """
    for name, value in (("m1", m1), ("m2", m2), ("l1", l1), ("l2", l2)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}.")
    return Problem(
        name="double_pendulum",
        rhs=rhs,
        u0=(theta1, theta2),
        v0=(0.0, 0.0),
        params=(m1, m2, l1, l2, g),
        t_span=(0.0, t_end),
        energy=energy,
        units="rad",
        source="Landau and Lifshitz, Mechanics, section 5, problem 1",
        h=1e-3,
        draw=partial(draw, l1=l1, l2=l2),
        view=Mechanism(partial(places, lengths=(l1, l2)), links=[(0, 1), (1, 2)], fixed=[0], trails=[2]),
    )


def places(t, u, lengths):
    """Return the places of the support and of the two masses, m."""
    rods = np.asarray(lengths)[:, None] * np.stack([np.sin(u), -np.cos(u)], axis=-1)
    return np.concatenate([np.zeros_like(rods[:, :1]), np.cumsum(rods, axis=1)], axis=1)


def draw(figure, solution, l1, l2):
    theta1, theta2 = solution.u.T
    x1, y1 = l1 * np.sin(theta1), -l1 * np.cos(theta1)
    x2, y2 = x1 + l2 * np.sin(theta2), y1 - l2 * np.cos(theta2)
    plane = drawing.picture(figure, aspect="equal")
    drawing.path(plane, x2, y2, "C1", "path of mass 2")
    drawing.path(plane, x1, y1, "C0", "path of mass 1")
    plane.plot([0, x1[0], x2[0]], [0, y1[0], y2[0]], "k", linewidth=1, label="rods at the start")
    plane.set(xlabel="x (m)", ylabel="y (m)")
    drawing.legend(plane)
    names = [r"$\theta_1$", r"$\theta_2$"]
    drawing.lines(drawing.time_panel(figure, "angle (rad)"), solution.t, solution.u, names)
    drawing.lines(drawing.time_panel(figure, "angular velocity\n(rad/s)"), solution.t, solution.v, names)
