"""A frame on isolators in an earthquake, between the walls of its moat."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import BoucWen, Gap
from eig3.problem import Problem

from .shear_building import shaking
from .yielding_frame import BAY, BEAM, COLUMN, STOREY

MAGNIFIED = 5  # displacements in pictures
STOREYS, LINES = 5, "ABC"
G = 9.81  # m/s^2
WALL_STIFFNESS, WALL_DAMPING = 5e7, 5e5  # N/m, N s/m


def isolated_building(
    mass: float = 20e3,
    period: float = 2.5,
    strength: float = 0.05,
    gap: float = 0.2,
    xi: float = 0.03,
    peak: float = 5.0,
    record: int = 1906,
    t_end: float = 20.0,
    work: bool = False,
) -> Problem:
    """Return the plane frame on an isolator below each column; u is relative to the ground, which moves as a record.

    Parameters
    ----------
    mass : float
        Mass of a storey, and of the base, at each column, kg, in addition to the mass of the members.
    period : float
        The period of a rigid building on isolators that have yielded, s.
    strength : float
        The force of the isolators at the displacement 0 while they yield, relative to the weight.
    gap : float
        The distance of the base to the walls of the moat, m.
    xi : float
        Damping ratio at the first and the third sway frequency of the frame on a fixed base.
    peak : float
        Largest acceleration of the ground, m/s^2.
    record : int
        The seed of the record, at least 0: each number is another motion of the ground.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the ground, the damping, the isolators and the walls.
    """
    from eig3.structures import Frame, Rayleigh, Section  # SciPy is needed by this problem only

    fixed, frame = (_frame(Frame, Section, mass, directions) for directions in ("", "uy rz"))
    isolator = _isolator((STOREYS + 1) * mass, period, strength)
    wall = Gap(WALL_STIFFNESS, gap, damping=WALL_DAMPING)
    columns = [f"0{line}.ux" for line in LINES]
    links = [(isolator, None, columns), (wall, None, columns[0]), (wall, columns[-1], None)]
    t, a = shaking(max(t_end, 10.0), 0.01, peak, record)
    sway = fixed.modes(3).omega
    damping = Rayleigh(xi, sway[0], sway[2]) if xi else None
    view = frame.view(MAGNIFIED)
    return frame.problem((0.0, t_end), ground=(t, a), damping=damping, links=links, work=work).with_(
        name="isolated_building",
        source="a frame on lead-rubber bearings by Bouc and Wen; record: Kanai (1957) and Tajimi (1960)",
        h=4e-4,
        view=view,
        draw=partial(draw, view=view, isolator=isolator, gap=gap),
    )


def _frame(frame_class, section, mass, directions):
    """Return the frame whose base is fixed in some directions, or in all."""
    frame, column, beam = frame_class(), section(**COLUMN), section(**BEAM)
    for level in range(STOREYS + 1):
        for number, line in enumerate(LINES):
            frame.node(f"{level}{line}", number * BAY, level * STOREY)
            frame.mass(f"{level}{line}", mass)
            if number:
                frame.member(f"{level}{LINES[number - 1]}", f"{level}{line}", beam)
            if level:
                frame.member(f"{level - 1}{line}", f"{level}{line}", column)
            else:
                frame.support(f"{level}{line}", directions)
    return frame


def _isolator(mass, period, strength):
    """Return the isolator that carries a mass: ten times as stiff before it yields as afterwards."""
    stiffness, hardening = 10 * mass * (2 * np.pi / period) ** 2, 0.1
    return BoucWen(stiffness, strength * mass * G / ((1 - hardening) * stiffness), hardening, sharpness=2.0)


def draw(figure, solution, view, isolator, gap):
    base, roof = (solution.u[:, solution.labels.names.index(f"{level}A.ux")] for level in (0, STOREYS))
    largest = int(np.abs(base).argmax())
    drawing.frame(figure, solution, view, largest)
    loops = drawing.picture(figure)
    z = solution.z["bouc wen"][:, 0]
    force = isolator.stiffness * (isolator.hardening * base + (1 - isolator.hardening) * z)
    loops.plot(1e3 * base, 1e-3 * force, linewidth=0.8, label="isolator")
    loops.set(xlabel="displacement of the base (mm)", ylabel="force of an isolator (kN)")
    for side in (-1, 1):
        loops.axvline(1e3 * side * gap, color="0.5", linestyle="--", label="walls" if side > 0 else "")
    drawing.legend(loops)
    motions = 1e3 * np.column_stack([base, roof - base])
    drawing.lines(
        drawing.time_panel(figure, "displacement (mm)"), solution.t, motions, ["base", "roof relative\nto the base"]
    )
