"""A quarter of a car on a sampled road: the wheel on the tyre and the body on the suspension."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.animation import coils
from eig3.effects import Gravity, LinearDamper, LinearSpring, SampledMotion
from eig3.problem import Problem
from eig3.result.memory import record_places
from eig3.scene import Scene

G = 9.81
AXLE, SEAT = 0.3, 0.8  # heights at rest, m
MAGNIFIED = 5  # displacements in the animation


def road(length: float, spacing: float, roughness: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a road profile after ISO 8608, distances and heights, m, which is level at the start.

    It is a sum of waves of random phase from 0.011 to 2.83 cycles/m, the range of the standard, with the spectrum
    roughness (n / n0)^-2 where n0 = 0.1 cycles/m.
    """
    rng = np.random.default_rng(seed)
    n = np.geomspace(0.011, 2.83, 200)
    x = record_places(length, spacing, each=3 * n.nbytes)
    width = np.gradient(n)
    amplitude = np.sqrt(2 * roughness * (n / 0.1) ** -2 * width)
    z = np.cos(2 * np.pi * np.outer(x, n) + rng.uniform(0, 2 * np.pi, n.size)) @ amplitude
    return x, (z - z[0]) * np.minimum(1, x / 5)  # the roughness grows to its value over the first 5 m


def quarter_car(
    body: float = 300.0,
    wheel: float = 40.0,
    suspension: float = 18e3,
    damper: float = 1.2e3,
    tyre: float = 180e3,
    speed: float = 20.0,
    roughness: float = 64e-6,
    t_end: float = 10.0,
    work: bool = False,
) -> Problem:
    """A quarter of a car that drives over a random road; u is the height of the wheel and of the body.

    Parameters
    ----------
    body, wheel : float
        Sprung and unsprung mass, kg.
    suspension, tyre : float
        Stiffness, N/m; the tyre never leaves the road.
    damper : float
        Damping of the suspension, N s/m.
    speed : float
        m/s.
    roughness : float
        Spectral density of the road at 0.1 cycles/m, m^3. The middle of class A (very good) is 16e-6; the middle of
        class B (good) is 64e-6.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the road and the damper.
    """
    x, z = road(max(speed * t_end, 10.0), 0.05, roughness, seed=8608)
    scene = Scene(dimension=1)
    ground = scene.fixed(0.0)
    axle = scene.mass(wheel, AXLE)
    seat = scene.mass(body, SEAT)
    sag = G * body / suspension, G * (body + wheel) / tyre  # at rest under gravity
    scene.add(Gravity(-G))
    scene.add(LinearSpring(tyre, AXLE + sag[1]), ground, axle)
    scene.add(LinearSpring(suspension, SEAT - AXLE + sag[0]), axle, seat)
    scene.add(LinearDamper(damper), axle, seat)
    scene.add(SampledMotion(x / speed, z), ground)

    return scene.problem((0.0, t_end), name="quarter_car", work=work).with_(
        source="the quarter-car model of vehicle dynamics; road: ISO 8608",
        h=2e-5,
        draw=partial(draw, times=x / speed, profile=z, tyre=tyre, weight=G * (body + wheel)),
        view=partial(view, speed=speed, distances=x, profile=z),
    )


def view(figure, film, speed, distances, profile):
    """Show the car on the road that passes below it, with magnified displacements."""
    from matplotlib.patches import Circle, Rectangle

    u = np.array([AXLE, SEAT]) + MAGNIFIED * (film.u - [AXLE, SEAT])
    axes = figure.add_subplot(aspect="equal")
    axes.set(xlim=(-0.9, 0.9), ylim=(-0.2, 1.2), xlabel="x from the axle (m)", ylabel="height (m)")
    figure.supxlabel(f"vertical displacements {MAGNIFIED} times as large", fontsize="medium", color="0.35")
    wheel = axes.add_patch(Circle((0, 0), AXLE, fill=False, color="0.35", linewidth=3))
    body = axes.add_patch(Rectangle((-0.5, 0), 1.0, 0.2, color="C0"))
    (spring,) = axes.plot([], [], color="0.35", linewidth=1.2, marker="o", markevery=[0])
    x = np.linspace(-1, 1, 201)
    (road,) = axes.plot(x, 0 * x, color="k", linewidth=1.5)

    def show(i):
        wheel.center = 0, u[i, 0]
        body.set_y(u[i, 1])
        spring.set_data(*coils(*([[0, y]] for y in u[i]), 0.1)[0].T)
        road.set_ydata(MAGNIFIED * np.interp(speed * film.t[i] + x, distances, profile))

    return show


def draw(figure, solution, times, profile, tyre, weight):
    t, (wheel, body) = solution.t, solution.u.T
    below = np.interp(t, times, profile)
    heights = np.column_stack([wheel - AXLE, body - SEAT, below])
    drawing.lines(drawing.time_panel(figure, "height above rest\n(mm)"), t, 1e3 * heights, ["wheel", "body", "road"])
    squeeze = AXLE + weight / tyre - wheel + below
    loads = drawing.time_panel(figure, "force of tyre\non road (kN)")
    loads.axhline(1e-3 * weight, color="0.6", label="at rest")
    drawing.lines(loads, t, 1e-3 * tyre * squeeze, ["driving"])
