"""A ragdoll of 15 rigid bodies that falls down stairs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import eig3
from eig3 import drawing
from eig3.animation import Mechanism
from eig3.effects import Body, Gravity, LinearDamper, Link
from eig3.effects.coulomb_friction import on_plane
from eig3.effects.hertz import damped_push
from eig3.problem import Problem
from eig3.scene import RigidBody, Scene

G = 9.81
RISE, RUN, STEPS = 0.17, 0.29, 8  # of the stairs, which go down along x from x = 0, m
STIFFNESS, DAMPING, FRICTION, SLIP = 2e5, 1.0, 0.5, 0.05  # N/m^(3/2), s/m, -, m/s
START = np.array([-0.1, 0.0, 0.0])  # between the feet, m
LEVER, MUSCLE = 0.08, 60.0  # from a joint to the ends of a damper that bends with it, m; its damping, N s/m
LIGAMENT, SLACK, LOSS = 2e5, 1.3, 0.2  # N/m^(3/2); its length beside that at the start, for a ball joint; s/m


class Limb(NamedTuple):
    """A limb: its mass, kg, its radius, its upper and its lower end, m, and the limb above it."""

    mass: float
    radius: float
    first: tuple[float, float, float]
    last: tuple[float, float, float]
    above: str = ""


LIMBS = {
    "pelvis": Limb(11.0, 0.11, (0.0, 0.0, 1.05), (0.0, 0.0, 0.92)),
    "chest": Limb(23.0, 0.13, (0.0, 0.0, 1.45), (0.0, 0.0, 1.05), "pelvis"),
    "head": Limb(5.5, 0.10, (0.0, 0.0, 1.72), (0.0, 0.0, 1.48), "chest"),
}
for side, y in (("left", 1.0), ("right", -1.0)):
    LIMBS |= {
        f"{side} upper arm": Limb(2.2, 0.05, (0.0, 0.20 * y, 1.40), (0.0, 0.22 * y, 1.12), "chest"),
        f"{side} forearm": Limb(1.3, 0.04, (0.0, 0.22 * y, 1.12), (0.0, 0.22 * y, 0.87), f"{side} upper arm"),
        f"{side} hand": Limb(0.5, 0.04, (0.0, 0.22 * y, 0.87), (0.0, 0.22 * y, 0.70), f"{side} forearm"),
        f"{side} thigh": Limb(8.0, 0.08, (0.0, 0.10 * y, 0.92), (0.0, 0.10 * y, 0.50), "pelvis"),
        f"{side} shin": Limb(3.5, 0.05, (0.0, 0.10 * y, 0.50), (0.0, 0.10 * y, 0.10), f"{side} thigh"),
        f"{side} foot": Limb(1.1, 0.04, (0.0, 0.10 * y, 0.10), (0.18, 0.10 * y, 0.05), f"{side} shin"),
    }
BEHIND = {"forearm": 1.0, "shin": -1.0}  # hinges about y, and on which side along x a ligament stops them when straight


@dataclass(frozen=True, eq=False)
class Ligament(Link):
    """A string that pulls as Hertz's contact pushes, when it is longer than its length."""

    length: float

    @staticmethod
    @eig3.jit
    def tension(r, rate, length):
        return damped_push(r - length, rate, LIGAMENT, LOSS)


@dataclass(frozen=True, eq=False)
class Stairs(Body):
    """The contact of a sphere with stairs along y: with the tread below it, and with the step behind it."""

    radius: float

    @staticmethod
    @eig3.jit
    def force(x, v, radius):
        k = min(max(np.floor(x[0] / RUN), -1.0), STEPS - 1.0)
        tread = -RISE * (k + 1)
        load = damped_push(tread + radius - x[2], -v[2], STIFFNESS, DAMPING)
        grip = on_plane(v, FRICTION, load, SLIP, (0.0, 0.0, 1.0))
        fx, fy, fz = grip[0], grip[1], grip[2] + load
        if k >= 0:
            dx, dz = x[0] - k * RUN, max(0.0, x[2] - tread - RISE)
            r = np.sqrt(1e-12 + dx * dx + dz * dz)
            nx, nz = dx / r, dz / r
            load = damped_push(radius - r, -(v[0] * nx + v[2] * nz), STIFFNESS, DAMPING)
            grip = on_plane(v, FRICTION, load, SLIP, (nx, 0.0, nz))
            fx, fy, fz = fx + grip[0] + load * nx, fy + grip[1], fz + grip[2] + load * nz
        return fx, fy, fz


def person(push: float = 1.0) -> tuple[Scene, dict[str, RigidBody], np.ndarray]:
    """Return the scene, its bodies by name, and the numbers of the points at their ends.

    A person on the top step turns forward over the feet.
    """
    scene, bodies, ends = Scene(dimension=3), {}, []
    for name, limb in LIMBS.items():
        first, last = np.array(limb.first), np.array(limb.last)
        centre, length = (first + last) / 2, np.linalg.norm(last - first)
        inertia = np.full(3, limb.mass * (limb.radius**2 / 4 + length**2 / 12))
        inertia[np.argmax(np.abs(last - first))] = limb.mass * limb.radius**2 / 2
        spin = np.array([0.0, push, 0.0])
        body = scene.body(limb.mass, inertia, START + centre, velocity=np.cross(spin, centre), angular_velocity=spin)
        ends.append(body.at(START + np.stack([first, last])))
        scene.add(Stairs(limb.radius), ends[-1])
        bodies[name] = body
    for name, limb in LIMBS.items():
        if limb.above:
            connect(scene, name, bodies[name], bodies[limb.above])
    scene.add(Gravity((0.0, 0.0, -G)))
    return scene, bodies, np.array([pair.numbers for pair in ends])


def connect(scene: Scene, name: str, body: RigidBody, above: RigidBody) -> None:
    """Join a limb to the limb above it, with dampers that bend with the joint, and ligaments that stop it."""
    joint, up = START + LIMBS[name].first, np.array([0.0, 0.0, LEVER])
    forward, left = np.eye(3)[:2] * LEVER
    behind = BEHIND.get(name.split()[-1])
    if behind:
        body.revolute(above, joint, (0.0, 1.0, 0.0))
        sides, slack = [behind * forward], 1.0
    else:
        body.spherical(above, joint)
        sides, slack = [forward, -forward, left, -left], SLACK
    for side in [forward] if behind else [forward, left]:
        scene.add(LinearDamper(MUSCLE), above.at(joint + side), body.at(joint - up))
    for side in sides:
        scene.add(Ligament(slack * 2 * LEVER), above.at(joint + side + up), body.at(joint + side - up))


def ragdoll(push: float = 1.0, t_end: float = 3.0) -> Problem:
    """A person of 15 rigid bodies who falls down stairs of eight steps. The limbs pass through each other.

    Parameters
    ----------
    push : float
                Forward angular velocity at the start, rad/s.
    t_end : float
        s.
    """
    scene, bodies, ends = person(push)
    problem = scene.problem((0.0, t_end), name="ragdoll")
    return problem.with_(
        h=2e-4,
        view=from_the_side(problem.view, ends),
        source="masses of limbs after P. de Leva, Journal of Biomechanics 29 (1996)",
        draw=partial(draw, bodies=bodies),
    )


def edges() -> np.ndarray:
    """Return x and z of the edges of the stairs, from the top to the floor, m."""
    x = np.concatenate([[-0.6], np.repeat(RUN * np.arange(STEPS), 2), [RUN * (STEPS + 2)]])
    return np.column_stack([x, -RISE * np.repeat(np.arange(STEPS + 1), 2)])


@dataclass(frozen=True, eq=False)
class FromTheSide:
    """x and z of the points of a view, followed by the edges of the stairs."""

    places: Callable

    def __call__(self, t, u):
        return np.concatenate([self.places(t, u)[..., ::2], np.tile(edges(), (len(t), 1, 1))], axis=1)


def from_the_side(view: Any, ends: np.ndarray) -> Mechanism:
    """Return a view of the limbs, as lines between discs, and of the stairs."""
    count, profile = len(view.radii), len(edges())
    steps = count + np.arange(profile)
    radii = np.zeros(count + profile)
    radii[ends] = np.array([[limb.radius] for limb in LIMBS.values()])
    return Mechanism(
        places=FromTheSide(view.places),
        links=np.concatenate([ends, np.column_stack([steps[:-1], steps[1:]])]),
        hidden=np.flatnonzero(radii == 0),
        radii=radii,
        labels=("x (m)", "z (m)"),
    )


def draw(figure, solution, bodies):
    plane = drawing.picture(figure, aspect="equal")
    plane.plot(*edges().T, "k", label="stairs")
    for k, name in enumerate(("head", "pelvis", "left hand")):
        x, _, z = bodies[name].centre.positions(solution.u).T
        drawing.path(plane, x, z, f"C{k}", name)
    plane.set(xlabel="x (m)", ylabel="z (m)")
    drawing.legend(plane)
    speeds = np.stack([np.linalg.norm(body.centre.velocities(solution.v), axis=1) for body in bodies.values()])
    drawing.lines(drawing.time_panel(figure, "largest speed of a\nlimb (m/s)"), solution.t, speeds.max(axis=0))
    heights = np.stack([bodies[name].centre.positions(solution.u)[:, 2] for name in ("head", "pelvis")], axis=1)
    drawing.lines(drawing.time_panel(figure, "height (m)"), solution.t, heights, ["head", "pelvis"])
