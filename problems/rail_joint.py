"""A railway wheel that rolls over a dipped joint, with a Hertz contact between wheel and rail."""

import dataclasses
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

import eig3
from eig3 import drawing
from eig3.animation import Magnified
from eig3.effects import Gravity, LinearDamper, LinearSpring, Link
from eig3.effects.hertz import push
from eig3.problem import Problem
from eig3.scene import Scene

G = 9.81
MAGNIFIED = 50  # displacements in the animation
REACH = 0.5  # height of the wheel's centre above the rail when they touch, m


@dataclass(frozen=True, eq=False)
class RollingContact(Link):
    """Hertz's contact of a wheel with a rail whose surface dips by the same angle on both sides of a joint.

    Parameters
    ----------
    stiffness : float
        N/m^(3/2).
    contact_distance : float
        The distance of the centres at which they touch far from the joint, m.
    speed : float
        m/s.
    start : float
        The distance of the wheel from the joint at t = 0, m.
    half : float
        Length of the dip on each side of the joint, m.
    angle : float
        Slope of the rail's end, rad. Each side of the dip is a parabola, and its depth is half * angle / 2.
    """

    stiffness: ArrayLike
    contact_distance: ArrayLike
    speed: ArrayLike
    start: ArrayLike
    half: ArrayLike
    angle: ArrayLike

    nonnegative = ("stiffness", "contact_distance")
    source = "Hertz (1881); the dipped joint of Jenkins and others (1974)"

    @staticmethod
    @eig3.jit
    def tension(t, r, stiffness, contact_distance, speed, start, half, angle):
        closeness = max(0.0, 1 - abs(speed * t - start) / half)
        return -push(contact_distance - half * angle / 2 * closeness * closeness - r, stiffness)


def rail_joint(
    speed: float = 40.0,
    angle: float = 5e-3,
    wheel: float = 600.0,
    car: float = 6000.0,
    contact: float = 9e10,
    rail: float = 60.0,
    sleeper: float = 180.0,
    t_end: float = 0.15,
    work: bool = False,
) -> Problem:
    """A wheel that rolls over a dipped joint; u has the heights of sleeper, rail, wheel and car.

    The track is a linear model of what acts at the contact: the rail on the pad and the sleeper on the bed. The surface
    moves under the wheel, which reaches the joint after 1 m.

    Parameters
    ----------
    speed : float
        m/s.
    angle : float
        Slope of each rail's end at the joint, rad.
    wheel, car : float
        Half the mass of a wheelset, and the mass on its suspension, kg.
    contact : float
        Hertz's stiffness, N/m^(3/2).
    rail, sleeper : float
        Masses of rail and sleeper that move with the contact, kg.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the contact and the dampers.
    """
    scene = Scene(dimension=1)
    ground = scene.fixed(0.0)
    masses = np.array([sleeper, rail, wheel, car])
    carried = G * np.cumsum(masses[::-1])[::-1]  # weight on the spring below each mass, N
    stiffness = np.array([60e6, 200e6, np.nan, 1e6])  # of bed, pad, contact (not linear) and suspension, N/m
    lengths = np.array([0.3, 0.2, REACH, 0.5])
    squeeze = carried / stiffness
    squeeze[2] = (carried[2] / contact) ** (2 / 3)
    column = scene.mass(masses, np.cumsum(lengths - squeeze))
    tie, head, centre, body = column
    scene.add(Gravity(-G))
    for k, damping, below, above in ((0, 80e3, ground, tie), (1, 50e3, tie, head), (3, 20e3, centre, body)):
        scene.add(LinearSpring(stiffness[k], lengths[k]), below, above)
        scene.add(LinearDamper(damping), below, above)
    meeting = RollingContact(contact, REACH, speed, start=1.0, half=0.5, angle=angle)
    scene.add(meeting, head, centre)

    problem = scene.problem((0.0, t_end), name="rail_joint", work=work)
    return problem.with_(
        source="Jenkins and others, The effect of track and vehicle parameters on wheel/rail vertical dynamic forces "
        "(1974), with two layers of track",
        h=1e-5,
        draw=partial(draw, meeting=meeting, weight=carried[2]),
        view=partial(view, mechanism=problem.view, meeting=meeting),
    )


def view(figure, film, mechanism, meeting):
    """Show wheel and track from the side, with magnified displacements; the rail passes below the wheel."""
    from matplotlib.patches import Circle, Rectangle

    start = mechanism.places(film.t[:1], film.u[:1])[0]
    places = Magnified(mechanism.places, MAGNIFIED, start)
    is_contact = [k for k, ends in enumerate(mechanism.links.tolist()) if ends == [2, 3]]
    links = np.delete(mechanism.links, is_contact, axis=0)
    labels = "x from the wheel (m)", "height (m)"
    note = f"vertical displacements {MAGNIFIED} times as large"
    move = replace(mechanism, places=places, links=links, springs=range(len(links)), labels=labels, note=note)(
        figure, film
    )
    (axes,) = figure.axes
    axes.set(xlim=(-1.25, 1.25), ylim=(-0.1, 1.75))
    y = places(film.t, film.u)[:, :, 1]
    x = np.linspace(-3, 3, 601)
    wheel = axes.add_patch(Circle((0, 0), REACH, fill=False, color="0.35", linewidth=2))
    sleeper = axes.add_patch(Rectangle((-0.13, 0), 0.26, 0.08, color="0.6"))
    car = axes.add_patch(Rectangle((-0.6, 0), 1.2, 0.15, color="C0", zorder=2))
    (rail,) = axes.plot(x, 0 * x, color="k", linewidth=2)

    def show(i):
        move(i)
        closeness = np.maximum(0, 1 - abs(meeting.speed * film.t[i] + x - meeting.start) / meeting.half)
        rail.set_ydata(y[i, 2] - MAGNIFIED * meeting.half * meeting.angle / 2 * closeness**2)
        sleeper.set_y(y[i, 1] - 0.08)
        wheel.center = 0, y[i, 3]
        car.set_y(y[i, 4])

    return show


def draw(figure, solution, meeting, weight):
    t = solution.t
    heights = solution.u[:, [1, 0, 2, 3]]
    names = ["rail", "sleeper", "wheel", "car"]
    above = drawing.time_panel(figure, "height above rest\n(mm)")
    drawing.lines(above, t, 1e3 * (heights - heights[0]), names)
    constants = dataclasses.astuple(meeting)
    force = [-meeting.tension(*at, *constants) for at in zip(t, heights[:, 2] - heights[:, 0], strict=True)]
    below = drawing.time_panel(figure, "contact force (kN)")
    below.axhline(1e-3 * weight, color="0.6", label="at rest")
    drawing.lines(below, t, 1e-3 * np.array(force), ["rolling"])
    for axes in (above, below):
        axes.axvline(meeting.start / meeting.speed, color="k", linestyle=":", linewidth=1, label="at the joint")
        drawing.legend(axes)
