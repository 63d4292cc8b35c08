"""Andrews' squeezer mechanism: seven bodies in the plane that a motor turns against a spring."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import LinearSpring, Torque
from eig3.problem import Problem
from eig3.scene import RigidBody, Scene

MASSES = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498  # kg
INERTIAS = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5  # kg m^2
A, B, C = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])  # on the ground, m
D, DA, E, EA, RR, RA = 28e-3, 115e-4, 2e-2, 1421e-5, 7e-3, 92e-5
SA, SB, SC, SD, TA, TB = 1874e-5, 1043e-5, 18e-3, 2e-2, 2308e-5, 916e-5
U, UA, UB, ZF, ZT, FA = 4e-2, 1228e-5, 449e-5, 2e-2, 4e-2, 1421e-5
STIFFNESS, LENGTH, TORQUE = 4530.0, 0.07785, 0.033  # N/m, m, N m

#: The angles beta, Theta, gamma, Phi, delta, Omega and epsilon at the start, rad.
START = (
    *(-0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885885),
    *(0.487364979543842550, -0.222668390165885885, 1.23054744454982119),
)


def _way(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _across(angle: float) -> np.ndarray:
    return np.array([np.sin(angle), -np.cos(angle)])


def places(angles: tuple[float, ...]) -> tuple[list[np.ndarray], list[np.ndarray], list[float]]:
    """Return the centres of the bodies, their joints, and the angles by which they are turned."""
    beta, theta, gamma, phi, delta, omega, epsilon = angles
    crank = RR * _way(beta)
    bar, lever = beta + theta, A + ZT * _way(delta)
    arm = A + U * _across(epsilon)
    centres = [
        RA * _way(beta),
        crank - DA * _way(bar),
        B + SA * _across(gamma) + SB * _way(gamma),
        lever + (E - EA) * _across(phi + delta),
        A + TA * _way(delta) - TB * _across(delta),
        arm + (ZF - FA) * _way(omega + epsilon),
        A + UA * _across(epsilon) - UB * _way(epsilon),
    ]
    joints = [crank, crank - D * _way(bar), lever, arm, B + SD * _way(gamma) + SC * _across(gamma)]
    return centres, joints, [beta, bar, gamma, phi + delta, delta, omega + epsilon, epsilon]


def mechanism() -> tuple[Scene, list[RigidBody]]:
    """Return the scene and its seven bodies."""
    scene = Scene(dimension=2)
    centres, (crank, middle, lever, arm, hook), angles = places(START)
    given = zip(MASSES, INERTIAS, centres, angles, strict=True)
    bodies = [scene.body(*values) for values in given]
    first, bar, third, fourth, fifth, sixth, seventh = bodies
    first.revolute(None, (0.0, 0.0))
    first.revolute(bar, crank)
    for body in (third, fourth, sixth):
        bar.revolute(body, middle)
    third.revolute(None, B)
    fifth.revolute(None, A)
    seventh.revolute(None, A)
    fourth.revolute(fifth, lever)
    sixth.revolute(seventh, arm)
    scene.add(LinearSpring(STIFFNESS, LENGTH), scene.fixed(C), third.at(hook))
    scene.add(Torque(TORQUE), first.axes)
    return scene, bodies


def squeezer(t_end: float = 0.03) -> Problem:
    """Andrews' squeezer mechanism, which starts at rest and accelerates.

    Parameters
    ----------
    t_end : float
        s.
    """
    scene, bodies = mechanism()
    return scene.problem((0.0, t_end), name="squeezer").with_(
        h=1e-6,
        source="E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., section VII.7",
        draw=partial(draw, bodies=bodies),
    )


def draw(figure, solution, bodies):
    angles = [np.unwrap(body.rotation(solution.u)) for body in bodies]
    crank = drawing.time_panel(figure, "angle of the crank\n(rad)")
    drawing.lines(crank, solution.t, angles[0])
    others = [2, 4, 6]
    rest = drawing.time_panel(figure, "angle since the start\n(rad)")
    drawing.lines(rest, solution.t, np.column_stack([angles[k] - angles[k][0] for k in others]), ["K3", "K5", "K7"])
    drawing.plane(figure, {f"path of K{k + 1}": bodies[k].centre.positions(solution.u).T for k in (1, 3, 5)})
