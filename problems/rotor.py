"""A disc on a shaft with a hardening stiffness, in the frame that rotates with it: gyroscopic forces and no damping."""

from eig3 import drawing
from eig3.animation import Mechanism, in_plane
from eig3.functions.callbacks import jit
from eig3.problem import Problem


@jit
def rhs(t, u, v, p, a):
    x, y = u[0], u[1]
    stiffness = p[0] * (1 + p[1] * (x * x + y * y)) - p[2] * p[2]
    a[0] = 2 * p[2] * v[1] - stiffness * x
    a[1] = -2 * p[2] * v[0] - stiffness * y


@jit
def energy(t, u, v, p):
    """Jacobi's integral per unit mass, m^2/s^2."""
    square = u[0] * u[0] + u[1] * u[1]
    return (v[0] * v[0] + v[1] * v[1] + (p[0] - p[2] * p[2]) * square + p[0] * p[1] * square * square / 2) / 2


def rotor(
    omega: float = 10.0,
    beta: float = 50.0,
    speed: float = 3.0,
    x0: float = 0.1,
    y0: float = 0.0,
    t_end: float = 60.0,
) -> Problem:
    """A disc on a massless shaft that turns at a constant speed, released from rest in the rotating frame.

    u is the place (x, y) of the disc in m, in axes that rotate with the shaft.

    Parameters
    ----------
    omega : float
        Natural frequency of small vibrations at standstill, rad/s.
    beta : float
        Relative growth of the stiffness with the square of the deflection, 1/m^2; at least 0.
    speed : float
        Angular velocity of the shaft, rad/s.
    x0, y0 : float
        Deflection at t = 0, m.
    t_end : float
        Duration, s.

    Raises
    ------
    ValueError
        If omega is not positive, or beta is negative.
    """
    if not omega > 0:
        raise ValueError(f"omega must be positive, not {omega}.")
    if not beta >= 0:
        raise ValueError(f"beta must not be negative, not {beta}.")
    return Problem(
        name="rotor",
        rhs=rhs,
        u0=(x0, y0),
        v0=(0.0, 0.0),
        params=(omega * omega, beta, speed),
        t_span=(0.0, t_end),
        energy=energy,
        energy_unit="J/kg",
        source="Jeffcott, Philosophical Magazine 37 (1919), 304-314, with a cubic stiffness",
        h=0.01 / omega,
        draw=draw,
        view=Mechanism(
            in_plane,
            trails=[0],
            marks=[((0, 0), "k+", 9, "")],
            labels=("x in turning axes (m)", "y in turning axes (m)"),
        ),
    )


def draw(figure, solution):
    labels = ("x in turning axes (m)", "y in turning axes (m)")
    drawing.plane(figure, {"path of the disc": solution.u.T}, labels)
    drawing.histories(figure, solution, ["x", "y"])
