"""A steel frame whose slender braces buckle in an earthquake."""

from functools import partial
from itertools import pairwise

import numpy as np

from eig3 import drawing
from eig3.problem import Problem

from .shear_building import shaking

MAGNIFIED = 10  # displacements in pictures
STOREYS, STOREY, BAY = 2, 3.0, 3.0  # m
PARTS = 6  # members of a brace: their chain buckles at 1.02 times Euler's load
STEEL = {"E": 2.1e11, "density": 7850.0}  # Pa, kg/m^3
COLUMN, BEAM = STEEL | {"A": 1.1e-2, "I": 1.1e-4}, STEEL | {"A": 5.4e-3, "I": 8.4e-5}  # m^2, m^4
BRACE = STEEL | {"A": 1.47e-3, "I": 1.37e-6}  # a square tube of 80 mm, 5 mm thick
EULER = np.pi**2 * BRACE["E"] * BRACE["I"] / (BAY**2 + STOREY**2)  # N


def braced_frame(
    mass: float = 300e3,
    camber: float = 0.002,
    xi: float = 0.05,
    peak: float = 0.6,
    record: int = 1906,
    t_end: float = 15.0,
    buckling: bool = True,
) -> Problem:
    """Return the plane frame with crossed braces on ground that moves as a record; u is relative to the ground.

    The storeys sway much more slowly than a brace bends, so that with these values a compressed brace buckles near
    Euler's load, where a linear brace carries twice as much. `brace_forces` has the forces.

    Parameters
    ----------
    mass : float
        Mass of a storey at each of its two joints, kg, in addition to the mass of the members: a braced bay holds many
        other bays.
    camber : float
        The deflection in the middle of a brace at rest, relative to its length. With 0, a brace stays straight beyond
        Euler's load.
    xi : float
        Damping ratio at the first frequency. The damping is proportional to the mass.
    peak : float
        Largest acceleration of the ground, m/s^2.
    record : int
        The seed of the record, at least 0: each number is another motion of the ground.
    t_end : float
        Duration, s.
    buckling : bool
        Allow large rotations of the members. Without, the frame is linear and no brace buckles.
    """
    from eig3.structures import Frame, Rayleigh, Section  # SciPy is needed by this problem only

    frame, column, beam, brace = Frame(), Section(**COLUMN), Section(**BEAM), Section(**BRACE)
    for level in range(STOREYS + 1):
        for line in "AB":
            frame.node(f"{level}{line}", *_place(f"{level}{line}"))
            if level:
                frame.mass(f"{level}{line}", mass)
                frame.member(f"{level - 1}{line}", f"{level}{line}", column)
            else:
                frame.support(f"{level}{line}", "ux uy")
        if level:
            frame.member(f"{level}A", f"{level}B", beam)
            _brace(frame, f"{level - 1}A", f"{level}B", camber, brace)
            _brace(frame, f"{level - 1}B", f"{level}A", camber, brace)

    omega = frame.modes(1).omega[0]
    by_mass = Rayleigh((xi, 0.5 * xi), omega, 2 * omega) if xi else None
    ground = shaking(max(t_end, 10.0), 0.01, peak, record) if peak else None
    problem = frame.problem((0.0, t_end), ground=ground, damping=by_mass, corotational=buckling)
    view = frame.view(MAGNIFIED)
    return problem.with_(
        name="braced_frame",
        source="a frame with slender braces on pins; record: Kanai (1957) and Tajimi (1960)",
        h=1e-4,
        view=view,
        draw=partial(draw, view=view, geometry=problem.geometry),
    )


def _place(joint: str) -> np.ndarray:
    return np.array([BAY * (joint[1] == "B"), STOREY * int(joint[0])])


def _brace(frame, start, end, camber, section):
    """Add a brace with pins at its ends; at rest, its axis is half a wave of a sine."""
    nodes = [start, *(f"{start}-{end}({k})" for k in range(1, PARTS)), end]
    first, along = _place(start), _place(end) - _place(start)
    across = camber * np.array([-along[1], along[0]])
    for k, name in enumerate(nodes[1:-1], 1):
        frame.node(name, *(first + along * k / PARTS + across * np.sin(np.pi * k / PARTS)))
    for k, (one, other) in enumerate(pairwise(nodes)):
        frame.member(one, other, section, releases=["start"] * (k == 0) + ["end"] * (k == PARTS - 1))


def brace_forces(geometry, u):
    """Return the tension of each brace, N, shape (s, 2 STOREYS), for displacements of the shape (s, n)."""
    first, second = np.array(geometry.links).reshape(STOREYS, -1, 2)[:, 3:].reshape(-1, 2).T  # after columns and beam
    rest, places = geometry.places(None, np.zeros((1, u.shape[1]))), geometry.places(None, u)
    before, after = (np.linalg.norm(x[:, second] - x[:, first], axis=-1) for x in (rest, places))
    return (BRACE["E"] * BRACE["A"] * (after / before - 1)).reshape(len(u), -1, PARTS).mean(axis=-1)


def draw(figure, solution, view, geometry):
    sway = [solution.labels.names.index(f"{level}A.ux") for level in range(1, STOREYS + 1)]
    forces = brace_forces(geometry, solution.u)[:, :2] / EULER
    largest = int(np.argmin(forces.min(axis=1)))
    drawing.frame(figure, solution, view, largest)
    drifts = 100 * np.diff(solution.u[:, sway], axis=1, prepend=0) / STOREY
    panel = drawing.time_panel(figure, "drift of the storey\n(% of its height)")
    drawing.lines(panel, solution.t, drifts, ["storey 1", "storey 2"])
    tensions = drawing.time_panel(figure, "tension of a brace\n(Euler's loads)")
    drawing.lines(tensions, solution.t, forces, ["from 0A to 1B", "from 0B to 1A"])
    tensions.axhline(-1, color="0.5", linestyle="--")
