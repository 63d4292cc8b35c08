"""Scenes, and the same systems written by hand.

Each system by hand is in the fastest form that we know: loops that reuse the force of the last spring, the x of all
masses before the y of all masses, and sizes that the compiler knows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import eig3
from eig3.effects import (
    Coulomb,
    CoulombFriction,
    Gravity,
    HardeningSpring,
    HarmonicForce,
    HertzContact,
    LennardJones,
    LinearDamper,
    LinearSpring,
    Link,
    Morse,
    Motion,
    PlaneContact,
    QuadraticDrag,
    RotatingFrame,
    SampledAcceleration,
    SampledMotion,
    SofteningSpring,
    SupportMotion,
)
from eig3.problem import Problem
from eig3.scene import Points, Scene
from eig3.scene.effect import Effect

#: Masses of a rod or a string, and of a rope.
ROD, ROPE = 200, 2000
#: A scene, a fixed point of it, and the pairs of points that its links connect.
Parts = tuple[Scene, Points, tuple[Points, Points]]


@eig3.jit
def pendulum_by_hand(t, u, v, p, a):
    k, length, m, g = p[0], p[1], p[2], p[3]
    r = math.sqrt(u[0] * u[0] + u[1] * u[1])
    pull = k * (r - length) / (r * m)
    a[0] = -pull * u[0]
    a[1] = -pull * u[1] - g


@eig3.jit
def rod_by_hand(t, u, v, p, a):
    k, length, w, end = p[0], p[1], p[2], p[3]
    before = k * (u[0] - length)
    for j in range(ROD - 1):
        after = k * (u[j + 1] - u[j] - length)
        a[j] = (after - before) * w
        before = after
    a[ROD - 1] = (k * (end - u[ROD - 1] - length) - before) * w


@eig3.jit
def string_by_hand(t, u, v, p, a):
    k, length, w = p[0], p[1], p[2]
    n = ROD
    bx = by = bz = 0.0
    for i in range(n - 1):
        dx, dy, dz = u[i + 1] - u[i], u[n + i + 1] - u[n + i], u[2 * n + i + 1] - u[2 * n + i]
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        pull = k * (r - length) / r * w
        fx, fy, fz = pull * dx, pull * dy, pull * dz
        a[i], a[n + i], a[2 * n + i] = fx - bx, fy - by, fz - bz
        bx, by, bz = fx, fy, fz
    a[n - 1], a[2 * n - 1], a[3 * n - 1] = -bx, -by, -bz


@eig3.jit
def rope_by_hand(t, u, v, p, a):
    k, length, c, w, g = p[0], p[1], p[2], p[3], p[4]
    n = ROPE
    bx = by = bz = 0.0
    for i in range(n - 1):
        dx, dy, dz = u[i + 1] - u[i], u[n + i + 1] - u[n + i], u[2 * n + i + 1] - u[2 * n + i]
        ex, ey, ez = v[i + 1] - v[i], v[n + i + 1] - v[n + i], v[2 * n + i + 1] - v[2 * n + i]
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        pull = (k * (r - length) + c * (dx * ex + dy * ey + dz * ez) / r) / r * w
        fx, fy, fz = pull * dx, pull * dy, pull * dz
        a[i], a[n + i], a[2 * n + i] = fx - bx, fy - by, fz - bz - g
        bx, by, bz = fx, fy, fz
    a[n - 1], a[2 * n - 1], a[3 * n - 1] = -bx, -by, -bz - g


@dataclass(frozen=True)
class ScenePair:
    """A scene, and the same system by hand."""

    title: str
    build: Callable[[], Parts]
    effects: tuple[type, ...]
    by_hand: Any
    params: tuple[float, ...]
    h: float

    def problems(self) -> tuple[Problem, Problem]:
        """The problem of the scene, and the problem by hand."""
        scene = self.build()[0].problem((0.0, 1.0))
        hand = Problem(
            name="by hand", rhs=self.by_hand, u0=scene.u0, v0=scene.v0, params=self.params, t_span=scene.t_span
        )
        return scene, hand


def pendulum() -> Parts:
    scene = Scene(2)
    pivot, bob = scene.fixed((0.0, 0.0)), scene.mass(1.0, (0.75, 0.0))
    scene.add(LinearSpring(98.1, 0.5), pivot, bob)
    scene.add(Gravity((0.0, -9.81)))
    return scene, pivot, (pivot, bob)


def rod() -> Parts:
    scene = Scene(1)
    start, end = scene.fixed([0.0, ROD + 1.0])
    masses = scene.mass(0.5, np.arange(1.0, ROD + 1) + 0.1 * np.sin(np.arange(ROD)))
    for a, b in ((start, masses[0]), (masses[:-1], masses[1:]), (masses[-1], end)):
        scene.add(LinearSpring(1.0, 1.0), a, b)
    return scene, start, (masses[:-1], masses[1:])


def string() -> Parts:
    scene, far, links = _row(ROD)
    scene.add(LinearSpring(1.0, 1.0), *links)
    return scene, far, links


def rope() -> Parts:
    scene, far, links = _row(ROPE)
    scene.add(LinearSpring(1.0, 1.0), *links)
    scene.add(LinearDamper(0.1), *links)
    scene.add(Gravity((0.0, 0.0, -9.81)))
    return scene, far, links


def _row(n: int) -> Parts:
    """Masses in a row in space, slightly out of line, without links."""
    scene = Scene(3)
    places = 0.05 * np.random.default_rng(0).standard_normal((n, 3))
    places[:, 0] += np.arange(n)
    masses = scene.mass(0.5, places)
    return scene, scene.fixed((0.0, 0.0, 9.0)), (masses[:-1], masses[1:])


SCENE_PAIRS = (
    ScenePair(
        "spring pendulum, Cartesian", pendulum, (LinearSpring, Gravity), pendulum_by_hand, (98.1, 0.5, 1.0, 9.81), 1e-4
    ),
    ScenePair("200 masses in a line, springs", rod, (LinearSpring,), rod_by_hand, (1.0, 1.0, 2.0, ROD + 1.0), 0.1),
    ScenePair("200 masses in space, springs", string, (LinearSpring,), string_by_hand, (1.0, 1.0, 2.0), 0.01),
    ScenePair(
        "2000 in space, springs, dampers, gravity",
        rope,
        (LinearSpring, LinearDamper, Gravity),
        rope_by_hand,
        (1.0, 1.0, 0.1, 2.0, 9.81),
        0.01,
    ),
)


@eig3.jit
def swing(t):
    return 0.1 * math.sin(t), 0.1 * math.cos(t)


def others(dimension: int) -> Iterator[Effect]:
    """Every effect that a scene of this dimension can have, at zero strength.

    Effects with an event or with a state are left out: they would add these to every scene. So are cells, which need
    more points, contacts with friction and torques, which need bodies that turn, and constraints, which are no forces.
    """
    up, record = np.eye(dimension)[-1], ([0.0, 1.0, 2.0], [0.0, 0.0, 0.0])
    yield Gravity(0.0 * up)
    yield LinearSpring(0.0, 1.0)
    yield LinearDamper(0.0)
    yield QuadraticDrag(0.0)
    yield HarmonicForce(0.0 * up, 2.0)
    yield HardeningSpring(0.0, 0.1, 1.0)
    yield PlaneContact(0.0, up, -50.0)
    yield HertzContact(0.0, 0.5)
    yield LennardJones(0.0, 0.1, 0.5)
    yield Coulomb(0.0, cutoff=0.5)
    yield Morse(0.0, 1.0, 1.0)
    yield CoulombFriction(0.0, 9.81)
    if dimension > 1:
        yield RotatingFrame(0.0 * (np.ones(1) if dimension == 2 else up))
    yield SampledMotion(*record, up)
    yield SampledAcceleration(*record, up)
    yield SupportMotion(swing, 0.0 * up)
    yield SofteningSpring(0.0, 1.0, 1.0)


def crowded(pair: ScenePair) -> tuple[Scene, int]:
    """The scene with all effects that it does not name, at zero strength; and the number of those effects."""
    scene, support, links = pair.build()
    added = [effect for effect in others(scene.dimension) if type(effect) not in pair.effects]
    for effect in added:
        _place(scene, effect, support, links)
    return scene, len(added)


def _place(scene: Scene, effect: Any, support: Points, links: tuple[Points, Points]) -> None:
    scene.add(effect, *((support,) if isinstance(effect, Motion) else links if isinstance(effect, Link) else ()))
    if isinstance(effect, SampledMotion):
        scene.add(LinearSpring(0.0), support, links[1])  # something must be connected to the moving point
