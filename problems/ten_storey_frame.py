"""A steel frame of ten storeys in an earthquake."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.problem import Problem

from .shear_building import shaking
from .yielding_frame import BAY, BAYS, BEAM, COLUMN, STOREY, joint

MAGNIFIED = 20  # displacements in pictures
STOREYS = 10


def ten_storey_frame(
    mass: float = 12e3, xi: float = 0.03, peak: float = 3.0, record: int = 1906, t_end: float = 30.0, work: bool = False
) -> Problem:
    """Return the plane frame of columns and beams on ground that moves as a record; u is relative to the ground.

    Parameters
    ----------
    mass : float
        Mass of a storey at each of its joints, kg, in addition to the mass of the members.
    xi : float
        Damping ratio at the first and the fifth sway frequency.
    peak : float
        Largest acceleration of the ground, m/s^2.
    record : int
        The seed of the record, at least 0: each number is another motion of the ground.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the ground and the damping.
    """
    from eig3.structures import Frame, Rayleigh, Section  # SciPy is needed by this problem only

    frame, column, beam = Frame(), Section(**COLUMN), Section(**BEAM)
    for level in range(STOREYS + 1):
        for line in range(BAYS + 1):
            frame.node(joint(level, line), line * BAY, level * STOREY)
            if level == 0:
                frame.support(joint(level, line))
                continue
            frame.mass(joint(level, line), mass, 0.05 * mass)
            frame.member(joint(level - 1, line), joint(level, line), column)
            if line:
                frame.member(joint(level, line - 1), joint(level, line), beam)

    t, a = shaking(max(t_end, 10.0), 0.01, peak, record)
    damping = Rayleigh(xi, 2 * np.pi * 0.75, 2 * np.pi * 8.0) if xi else None
    return frame.problem((0.0, t_end), ground=(t, a), damping=damping, work=work).with_(
        name="ten_storey_frame",
        source="a moment frame of steel; record: Kanai (1957) and Tajimi (1960)",
        h=1e-3,
        view=frame.view(MAGNIFIED),
        draw=partial(draw, view=frame.view(MAGNIFIED)),
    )


def draw(figure, solution, view):
    sway = [solution.labels.names.index(f"{joint(level, 0)}.ux") for level in range(1, STOREYS + 1)]
    largest = int(np.abs(solution.u[:, sway[-1]]).argmax())
    drawing.frame(figure, solution, view, largest)
    u = 1e3 * solution.u[:, sway]
    drawing.lines(
        drawing.time_panel(figure, "displacement (mm)"), solution.t, u[:, [9, 4, 0]], ["roof", "floor 5", "floor 1"]
    )
    drifts = np.diff(u, axis=1, prepend=0)[:, [0, 4, 9]]
    names = ["storey 1", "storey 5", "storey 10"]
    drawing.lines(drawing.time_panel(figure, "drift of the storey\n(mm)"), solution.t, drifts, names)
