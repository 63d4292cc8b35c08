"""A steel frame of five storeys whose beams and columns yield at plastic hinges in an earthquake."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import ElasticPlastic
from eig3.problem import Problem

from .shear_building import shaking

MAGNIFIED = 10  # displacements in pictures
STOREYS, BAYS = 5, 3
STOREY, BAY = 3.3, 6.0  # m
STEEL = {"E": 2.1e11, "density": 7850.0}  # Pa, kg/m^3
COLUMN, BEAM = STEEL | {"A": 2.4e-2, "I": 8.0e-4}, STEEL | {"A": 1.2e-2, "I": 4.8e-4}  # m^2, m^4
RIGID = 10.0  # the elastic stiffness of a hinge relative to the stiffness 6 E I / L of its member


def yielding_frame(
    mass: float = 12e3,
    moment: float = 3e5,
    hardening: float = 0.01,
    xi: float = 0.03,
    peak: float = 6.0,
    record: int = 1906,
    t_end: float = 20.0,
    work: bool = False,
) -> Problem:
    """Return the plane frame of columns and beams on ground that moves as a record; u is relative to the ground.

    Beams yield at both ends, and columns at the ground. ``z["elastic plastic"]`` has the plastic rotations of the
    hinges, rad, and the outputs "moments" and "rotations" their moments, N m, and their rotations.

    Parameters
    ----------
    mass : float
        Mass of a storey at each of its joints, kg, in addition to the mass of the members.
    moment : float
        The yield moment of beams, N m. Columns have twice this moment.
    hardening : float
        The ratio of the stiffness of a hinge after yield and before.
    xi : float
        Damping ratio at the first and the third sway frequency of the elastic frame.
    peak : float
        Largest acceleration of the ground, m/s^2.
    record : int
        The seed of the record, at least 0: each number is another motion of the ground.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the ground and the damping.
    """
    from eig3.structures import Frame, Rayleigh, Section, link_forces, link_stretches  # these need SciPy

    column, beam = Section(**COLUMN), Section(**BEAM)
    of_column = hinge(column, STOREY, 2 * moment, hardening)
    of_beam = hinge(beam, BAY, moment, hardening)
    frame = Frame()
    for level in range(STOREYS + 1):
        for line in range(BAYS + 1):
            frame.node(joint(level, line), line * BAY, level * STOREY)
            if level == 0:
                frame.support(joint(level, line))
                continue
            frame.mass(joint(level, line), mass)
            at_ground = {"start": of_column} if level == 1 else {}
            frame.member(joint(level - 1, line), joint(level, line), column, hinges=at_ground)
            if line:
                both = {"start": of_beam, "end": of_beam}
                frame.member(joint(level, line - 1), joint(level, line), beam, hinges=both)

    t, a = shaking(max(t_end, 10.0), 0.01, peak, record)
    sway = frame.modes(3).omega
    damping = Rayleigh(xi, sway[0], sway[2]) if xi else None
    problem = frame.problem((0.0, t_end), ground=(t, a), damping=damping, work=work)
    view = frame.view(MAGNIFIED)
    return problem.with_(
        name="yielding_frame",
        source="a moment frame with plastic hinges; record: Kanai (1957) and Tajimi (1960)",
        h=2e-4,
        outputs={"moments": link_forces(problem), "rotations": link_stretches(problem)},
        output_units={"moments": "N m", "rotations": "rad"},
        view=view,
        draw=partial(draw, view=view, of_column=of_column, of_beam=of_beam),
    )


def hinge(section, length, moment, hardening):
    """Return a plastic hinge of a member."""
    return ElasticPlastic(RIGID * 6 * section.E * section.I / length, moment, hardening)


def joint(level: int, line: int) -> str:
    """Return the name of a joint."""
    return f"{level}{'ABCD'[line]}"


def draw(figure, solution, view, of_column, of_beam):
    plastic = 1e3 * solution.z["elastic plastic"]
    rotations = np.abs(plastic).max(axis=0)
    sway = [solution.labels.names.index(f"{joint(level, 0)}.ux") for level in range(1, STOREYS + 1)]
    largest = int(np.abs(solution.u[:, sway[-1]]).argmax())
    note = f"; largest plastic rotation {rotations.max():.0f} mrad"
    picture, shape = drawing.frame(figure, solution, view, largest, note)
    ends = [name.split(".") for name in solution.labels.names if ".rz_" in name]
    for (member, end), rotation in zip(ends, rotations, strict=True):
        start, stop = (4 * int(node[0]) + "ABCD".index(node[1]) for node in member.split("-"))
        near, far = shape[[start, stop] if end == "rz_start" else [stop, start]]
        picture.plot(*(0.92 * near + 0.08 * far), "o", color="C3", markersize=np.sqrt(3 * rotation))
    drifts = 100 * np.diff(solution.u[:, sway], axis=1, prepend=0)[:, [0, 2, 4]] / STOREY
    names = ["storey 1", "storey 3", "storey 5"]
    drawing.lines(drawing.time_panel(figure, "drift of the storey\n(% of its height)"), solution.t, drifts, names)
    chosen = {"column A at the ground": ("0A-1A", of_column), "beam AB, floor 1": ("1A-1B", of_beam)}
    columns = [ends.index([member, "rz_start"]) for member, _ in chosen.values()]
    drawing.lines(drawing.time_panel(figure, "plastic rotation\n(mrad)"), solution.t, plastic[:, columns], [*chosen])
    loops = {}
    for (name, (member, of_end)), k in zip(chosen.items(), columns, strict=True):
        turned = solution.u[:, solution.labels.names.index(f"{member}.rz_start")]
        if name.startswith("beam"):  # the joint turns too
            turned = turned - solution.u[:, solution.labels.names.index(f"{member[:2]}.rz")]
        of_law = of_end.stiffness, of_end.yield_force, of_end.hardening, 0.0
        loops[name] = 1e3 * turned, 1e-3 * np.vectorize(of_end.tension)(turned, 1e-3 * plastic[:, k], *of_law)
    drawing.plane(figure, loops, ("rotation of the hinge (mrad)", "moment of the hinge (kN m)"), aspect="auto")
