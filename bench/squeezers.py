"""Andrews' squeezer mechanism at equal error: EIG-3, RK4 and RK8, exudyn and MuJoCo."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from eig3 import problems
from eig3.problems.squeezer import INERTIAS, LENGTH, MASSES, START, STIFFNESS, TORQUE, A, B, C, mechanism, places

from . import equal_error
from .rivals import exudyn, mujoco

T_END = 0.03  # s
ERROR = 1e-5  # rad, of angles up to 16 rad
#: The angles beta, Theta, gamma, Phi, delta, Omega and epsilon at T_END: the test set for initial value problem solvers
#: of the University of Bari, and E. Hairer and G. Wanner, section VII.7.
END = (
    *(0.1581077119629904e2, -0.1575637105984298e2, 0.4082224013073101e-1, -0.5347301163226948),
    *(0.5244099658805304, 0.5347301163226948, 0.1048080741042263e1),
)
_NOTE = """Each method takes the fewest steps, among 50, 100, 200, ..., with which all seven bodies are turned as in the
published solution, within 1e-5 rad. exudyn has angles of the bodies and constraints of their joints, and its implicit
trapezoidal rule. MuJoCo has angles between the bodies and soft constraints for the three joints that close loops, which
are as stiff as its steps allow. Runge-Kutta methods evaluate several times a step."""


class Linkage(NamedTuple):
    """Rigid bodies in the plane, joined by hinges.

    Attributes
    ----------
    bodies : list of (mass, inertia, centre, angle)
    joints : list of (first, second, place)
        The numbers of two bodies, or None for the ground.
    spring : (base, body, hook, stiffness, length)
        Between a place on the ground and one on a body.
    torque : float
        On the first body.
    """

    bodies: list
    joints: list
    spring: tuple
    torque: float


def linkage() -> Linkage:
    """Return the mechanism at its start."""
    centres, (crank, middle, lever, arm, hook), angles = places(START)
    joints = [(0, None, np.zeros(2)), (0, 1, crank), (1, 2, middle), (1, 3, middle), (1, 5, middle)]
    joints += [(3, 4, lever), (5, 6, arm), (2, None, B), (4, None, A), (6, None, A)]
    bodies = list(zip(MASSES, INERTIAS, centres, angles, strict=True))
    return Linkage(bodies, joints, (C, 2, hook, STIFFNESS, LENGTH), TORQUE)


def run_here(method: str, steps: int) -> tuple[float, np.ndarray]:
    """Return the seconds of a run here, and the angles of the bodies at its end."""
    solution = problems.squeezer().integrate(h=T_END / steps, t_end=T_END, method=method, save_every=None)
    return solution.kernel_seconds, np.array([body.rotation(solution.u)[-1] for body in mechanism()[1]])


def error_of(angles: np.ndarray) -> float:
    """Return the largest error of the angles of the bodies, which are known up to whole turns."""
    apart = angles - places(END)[2]
    return float(np.abs((apart + np.pi) % (2 * np.pi) - np.pi).max())


def rows(repeats: int) -> list[list[str]]:
    """Return the rows of the table."""
    contenders: dict[str, equal_error.Run] = {
        name: partial(run_here, name.lower().replace("-", "")) for name in ("EIG-3", "RK4", "RK8")
    }
    for name, rival in (("exudyn", exudyn), ("MuJoCo", mujoco)):
        if rival.is_there():
            contenders[name] = partial(rival.Linkage(linkage()).run, T_END)
    return equal_error.rows(contenders, error_of, ERROR, repeats)


def table(repeats: int) -> str:
    """Return the table. Each run is repeated, and the runs take turns."""
    return equal_error.page(equal_error.HEADS, rows(repeats), _NOTE)
