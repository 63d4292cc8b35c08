"""`eig3 bench scenes`: what the compiled code of a scene costs, beside the same system written by hand.

Every system by hand is in its fastest form that we know: loops that keep the force of the last spring, coordinates one
after the other, and sizes that the compiler knows.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import eig3
from eig3 import effects
from eig3.effects import (
    Body,
    CoulombFriction,
    Gravity,
    HardeningSpring,
    HarmonicForce,
    LinearDamper,
    LinearSpring,
    Link,
    MassContact,
    Motion,
    PlaneContact,
    QuadraticDrag,
    RotatingFrame,
    SampledAcceleration,
    SampledMotion,
    SofteningSpring,
    SupportMotion,
)
from eig3.kernels.jit import VECTOR
from eig3.problem import Problem
from eig3.scene import Points, Scene, codegen
from eig3.scene.effect import Effect
from eig3.stepper import Stepper

from . import text
from .environment import in_words
from .timing import interleave

_SECONDS = 0.05  # of a timed run
_ROD, _ROPE = 200, 2000  # masses


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
    for j in range(_ROD - 1):
        after = k * (u[j + 1] - u[j] - length)
        a[j] = (after - before) * w
        before = after
    a[_ROD - 1] = (k * (end - u[_ROD - 1] - length) - before) * w


@eig3.jit
def string_by_hand(t, u, v, p, a):
    k, length, w = p[0], p[1], p[2]
    n = _ROD
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
    n = _ROPE
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
class Case:
    """A scene, and the same system by hand."""

    title: str
    build: Callable[[], tuple[Scene, Points, tuple[Points, Points]]]  # the scene, a fixed point of it, and its links
    effects: tuple[type, ...]
    by_hand: Any
    params: tuple[float, ...]
    h: float

    def problems(self) -> tuple[Problem, Problem]:
        """The scene's and that by hand."""
        scene = self.build()[0].problem((0.0, 1.0))
        hand = Problem(
            name="by hand",
            rhs=self.by_hand,
            u0=scene.u0,
            v0=scene.v0,
            params=self.params,
            t_span=scene.t_span,
            uses_velocity=scene.uses_velocity,
        )
        return scene, hand


def pendulum() -> tuple[Scene, Points, tuple[Points, Points]]:
    scene = Scene(2)
    pivot, bob = scene.fixed((0.0, 0.0)), scene.mass(1.0, (0.75, 0.0))
    scene.add(LinearSpring(98.1, 0.5), pivot, bob)
    scene.add(Gravity((0.0, -9.81)))
    return scene, pivot, (pivot, bob)


def rod() -> tuple[Scene, Points, tuple[Points, Points]]:
    scene = Scene(1)
    start, end = scene.fixed([0.0, _ROD + 1.0])
    masses = scene.mass(0.5, np.arange(1.0, _ROD + 1) + 0.1 * np.sin(np.arange(_ROD)))
    for a, b in ((start, masses[0]), (masses[:-1], masses[1:]), (masses[-1], end)):
        scene.add(LinearSpring(1.0, 1.0), a, b)
    return scene, start, (masses[:-1], masses[1:])


def string() -> tuple[Scene, Points, tuple[Points, Points]]:
    scene, far, links = _row(_ROD)
    scene.add(LinearSpring(1.0, 1.0), *links)
    return scene, far, links


def rope() -> tuple[Scene, Points, tuple[Points, Points]]:
    scene, far, links = _row(_ROPE)
    scene.add(LinearSpring(1.0, 1.0), *links)
    scene.add(LinearDamper(0.1), *links)
    scene.add(Gravity((0.0, 0.0, -9.81)))
    return scene, far, links


def _row(n: int) -> tuple[Scene, Points, tuple[Points, Points]]:
    """Masses in space, a fixed point, and the pairs of neighbours."""
    scene = Scene(3)
    places = 0.05 * np.random.default_rng(0).standard_normal((n, 3))
    places[:, 0] += np.arange(n)
    masses = scene.mass(0.5, places)
    return scene, scene.fixed((0.0, 0.0, 9.0)), (masses[:-1], masses[1:])


CASES = (
    Case(
        "spring pendulum, Cartesian",
        pendulum,
        (LinearSpring, Gravity),
        pendulum_by_hand,
        (98.1, 0.5, 1.0, 9.81),
        1e-4,
    ),
    Case("200 masses in a line, springs", rod, (LinearSpring,), rod_by_hand, (1.0, 1.0, 2.0, _ROD + 1.0), 0.1),
    Case("200 masses in space, springs", string, (LinearSpring,), string_by_hand, (1.0, 1.0, 2.0), 0.01),
    Case(
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


def catalogue(dimension: int, strength: float) -> Iterator[Effect]:
    """Every effect of the catalogue that such a scene can have, with so much of its usual strength."""
    up = np.eye(dimension)[-1]
    yield Gravity(-9.81 * strength * up)
    yield LinearSpring(1.0 * strength, 1.0)
    yield LinearDamper(0.1 * strength)
    yield QuadraticDrag(0.01 * strength)
    yield HarmonicForce(strength * up, 2.0)
    yield HardeningSpring(1.0 * strength, 0.1, 1.0)
    yield PlaneContact(10.0 * strength, up, -50.0)
    yield MassContact(10.0 * strength, 0.5)
    yield CoulombFriction(0.1 * strength, 9.81)
    if dimension > 1:
        yield RotatingFrame(strength * 0.01 * (np.ones(1) if dimension == 2 else up))
    yield SampledMotion([0.0, 1.0, 2.0], [0.0, 0.1 * strength, 0.0], up)
    yield SampledAcceleration([0.0, 1.0, 2.0], [0.0, 0.1 * strength, 0.0], up)
    yield SupportMotion(swing, strength * up)
    yield SofteningSpring(1.0 * strength, 1.0, 1.0)  # last: its tanh takes more than all others together


def crowded(case: Case) -> tuple[Scene, int]:
    """The scene with every effect that it does not name, at no strength; and how many those are."""
    scene, support, links = case.build()
    others = [effect for effect in catalogue(scene.dimension, 0.0) if type(effect) not in case.effects]
    for effect in others:
        _place(scene, effect, support, links)
    return scene, len(others)


def _place(scene: Scene, effect: Any, support: Points, links: tuple[Points, Points]) -> None:
    scene.add(effect, *((support,) if isinstance(effect, Motion) else links if isinstance(effect, Link) else ()))
    if isinstance(effect, SampledMotion):
        scene.add(LinearSpring(0.0), support, links[1])  # else nothing would stand on what moves


def growing() -> Iterator[tuple[str, Problem]]:
    """Two hundred masses in space with one more effect each time."""
    every = list(catalogue(3, 1.0))
    for count, last in enumerate(every, 1):
        scene, support, links = _row(_ROD)
        for effect in every[:count]:
            _place(scene, effect, support, links)
        yield last.title, scene.problem((0.0, 1.0))


def run(*, repeats: int = 9, out: Path | None = None, write: Callable[[str], None] = print) -> None:
    """Print the four tables; draw the last in `out`."""
    write(f"Machine: {in_words()}")
    write(f"ns/step of EIG-3, no states stored: medians of {repeats} interleaved runs.\n")
    write("## A scene beside the same system by hand\n")
    write(text.table(["scene", "pointer", "by hand", "ratio", "inline", "by hand", "ratio"], by_hand(repeats)))
    write("\n## What an effect that is not named adds\n")
    write("Instructions of the compiled right-hand side, before and after another effect enters the catalogue.\n")
    write(text.table(["scene", "by hand", "scene", "with a larger catalogue", "the same text"], instructions()))
    write("\n## Every other effect present, at no strength\n")
    write(text.table(["scene", "effects", "ns/step", "with all", "ns/step", "ratio"], zero_strength(repeats)))
    write(f"\n## Time against the number of effects: {_ROD} masses in space\n")
    names, ns = more_and_more(repeats)
    labels = [f"+ {name}" if k else name for k, name in enumerate(names)]
    write(text.table(["effect", "effects", "ns/step"], [[x, str(k + 1), f"{ns[k]:.0f}"] for k, x in enumerate(labels)]))
    text.status("")
    if out is not None:
        write(f"\nWritten to {out}: {_draw(labels, ns, out)}")


def by_hand(repeats: int) -> list[list[str]]:
    rows = []
    for case in CASES:
        scene, hand = case.problems()
        ns = measure(
            {
                f"{case.title}, {name}{', inline' * inline}": (problem, case.h, inline)
                for inline in (False, True)
                for name, problem in (("scene", scene), ("by hand", hand))
            },
            repeats,
        )
        a, b, c, d = ns.values()
        rows.append([case.title, f"{a:.1f}", f"{b:.1f}", f"{a / b:.2f}", f"{c:.1f}", f"{d:.1f}", f"{c / d:.2f}"])
    return rows


def instructions() -> list[list[str]]:
    rows = []
    for case in CASES:
        before = assembly(case.problems()[0].rhs)
        _enlarge_the_catalogue()
        codegen._functions.cache_clear()
        after = assembly(case.problems()[0].rhs)
        counts = [str(count) for count in (len(assembly(case.by_hand)), len(before), len(after))]
        rows.append([case.title, *counts, "yes" if before == after else "NO"])
    return rows


def assembly(rhs: Any) -> list[str]:
    """The instructions of a right-hand side, without the names of functions, which are numbered in each process."""
    rhs.compile(VECTOR.rhs.args)
    lines = (line.strip() for line in rhs.inspect_asm(VECTOR.rhs.args).splitlines())
    return [
        line for line in lines if line and not line.startswith((".", "#")) and "_ZN" not in line and ":" not in line
    ]


def _enlarge_the_catalogue() -> None:
    @dataclass(frozen=True, eq=False)
    class Wind(Body):
        speed: float

        @staticmethod
        @eig3.jit
        def force(v, speed):
            return speed - v[0], -v[1]

    vars(effects)["Wind"] = Wind
    scene = Scene(2)
    scene.mass(1.0, (0.0, 0.0))
    scene.add(Wind(1.0))
    scene.problem((0.0, 1.0)).integrate(h=0.1)
    del vars(effects)["Wind"]


def zero_strength(repeats: int) -> list[list[str]]:
    rows = []
    for case in CASES:
        scene, others = crowded(case)
        lean, full = case.problems()[0], scene.problem((0.0, 1.0))
        a, b = measure({"lean": (lean, case.h, False), "with all": (full, case.h, False)}, repeats).values()
        named = len(case.effects)
        rows.append([case.title, str(named), f"{a:.1f}", str(named + others), f"{b:.1f}", f"{b / a:.1f}"])
    return rows


def more_and_more(repeats: int) -> tuple[list[str], list[float]]:
    problems = dict(growing())
    ns = measure({name: (problem, 1e-3, False) for name, problem in problems.items()}, repeats)
    return list(ns), list(ns.values())


def measure(problems: Mapping[str, tuple[Problem, float, bool]], repeats: int) -> dict[str, float]:
    """ns/step of each (problem, h, inline), in interleaved runs from the same start."""
    starts = {name: problem.stepper(h=h, inline=inline) for name, (problem, h, inline) in problems.items()}
    steps = {name: _steps(start) for name, start in starts.items()}

    def runner(name: str) -> Callable[[], float]:
        def advance() -> float:
            stepper = starts[name].fork()
            stepper.advance(steps[name])
            return stepper.seconds

        return advance

    seconds = interleave({name: runner(name) for name in starts}, repeats, text.status)
    return {name: 1e9 * statistics.median(times) / steps[name] for name, times in seconds.items()}


def _steps(start: Stepper) -> int:
    trial = start.fork()
    trial.advance(200)
    return max(200, round(200 * _SECONDS / trial.seconds))


def _draw(labels: list[str], ns: list[float], out: Path) -> str:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return f"nothing{text.NO_PICTURES}"
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(labels))
    axes.barh(places, ns, color="C0")
    axes.set_yticks(places, labels)
    axes.invert_yaxis()
    for place, value in zip(places, ns, strict=True):
        axes.annotate(
            f"{value:.0f}", (value, place), xytext=(4, 0), textcoords="offset points", va="center", fontsize=9
        )
    axes.margins(x=0.1)
    axes.set_xlabel("time of a step (ns), EIG-3")
    axes.set_title(f"{_ROD} masses in space: each effect that is named adds its own time")
    figure.savefig(out / "scenes.png", dpi=130)
    return "scenes.png"
