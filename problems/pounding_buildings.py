"""Two buildings of three storeys that strike each other in an earthquake."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.effects import LinearDamper, LinearSpring, MassImpact, SampledMotion
from eig3.problem import Problem
from eig3.scene import Scene

from .shear_building import quake, view_of_buildings


def pounding_buildings(
    gap: float = 0.03,
    restitution: float = 0.65,
    m: tuple[float, float] = (20e3, 20e3),
    stiffness: tuple[float, float] = (6e6, 18e6),
    damping: tuple[float, float] = (60e3, 60e3),
    peak: float = 3.0,
    record: int = 1906,
    t_end: float = 20.0,
    work: bool = False,
) -> Problem:
    """Two shear buildings with a gap between floors of the same height; u has the floors' positions from the left.

    At rest the facing walls are at -gap in the left building and at 0 in the right one. Where two floors meet they
    strike each other, as an event: ``solution.events["mass impact 2"]`` has the impacts of the third floors.

    Parameters
    ----------
    gap : float
        m.
    restitution : float
        Coefficient of restitution: the relative speed of two floors after an impact divided by the speed before it.
    m : (float, float)
        Mass of a floor of the left and of the right building, kg.
    stiffness : (float, float)
        Stiffness of the columns of a storey, N/m. With the defaults the longest periods are 0.82 and 0.47 s.
    damping : (float, float)
        Damping of a storey, N s/m.
    peak : float
        Largest acceleration of the ground, before the slow part is removed, m/s^2.
    record : int
        The seed of the record, at least 0: each number is another motion of the ground.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the ground, the dampers and the impacts.
    """
    t, x = quake(max(t_end, 10.0), 0.01, peak, record)
    scene = Scene(dimension=1)
    buildings = []
    for k, place in enumerate((-gap, 0.0)):
        ground = scene.fixed(place)
        floors = scene.mass(m[k], np.full(3, place))
        for below, above in ((ground, floors[0]), (floors[:-1], floors[1:])):
            scene.add(LinearSpring(stiffness[k]), below, above)
            scene.add(LinearDamper(damping[k]), below, above)
        scene.add(SampledMotion(t, x), ground)
        buildings.append(floors)
    scene.add(MassImpact(restitution=restitution), *buildings)

    return scene.problem((0.0, t_end), name="pounding_buildings", work=work).with_(
        source="after S. A. Anagnostopoulos, Pounding of buildings in series during earthquakes, Earthquake "
        "Engineering and Structural Dynamics 16 (1988), 443-456, with rigid impacts in place of impact elements; "
        "record: Kanai (1957) and Tajimi (1960)",
        h=1e-4,
        draw=partial(draw, gap=gap),
        view=view_of_buildings([(-gap, 0.0), (0.0, 1.0)], t, x),
    )


def draw(figure, solution, gap):
    left, right = solution.u[:, :3] + gap, solution.u[:, 3:6]
    floors = drawing.time_panel(figure, "displacement of the\nthird floor (mm)")
    drawing.lines(floors, solution.t, 1e3 * np.column_stack([left[:, 2], right[:, 2] + gap]), ["left", "right + gap"])
    gaps = drawing.time_panel(figure, "gap (mm)")
    drawing.lines(gaps, solution.t, 1e3 * (gap + right - left), ["storey 1", "storey 2", "storey 3"])
    impacts = drawing.time_panel(figure, "speed of impact\n(m/s)")
    for k, found in enumerate(solution.events.values()):
        speed = found.v[:, k] - found.v[:, 3 + k]
        impacts.plot(found.t, speed, marker=".", linestyle="none", label=f"storey {k + 1}")
    drawing.legend(impacts)
