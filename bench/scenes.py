"""Measure the time per step (ns) of scenes and of the same systems by hand, and what each further effect costs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import eig3
from eig3 import effects
from eig3.command_line import Files, add_out
from eig3.effects import Body
from eig3.functions.callbacks import jit
from eig3.kernels.compile.jit import compiled
from eig3.kernels.protocol import VECTOR
from eig3.problem import Problem
from eig3.scene import Scene, codegen
from eig3.stepping.stepper import Stepper

from . import near_pairs, pictures, rods, squeezers, text
from .choices import add_repeats
from .environment import in_words
from .scene_pairs import ROD, SCENE_PAIRS, crowded, growing
from .timing import kernel_run, medians

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUMMARY = "ns/step of scenes, compared with code by hand"
_SECONDS = 0.05  # of a timed run
_SPHERES, _ARGON = (1000, 10_000, 100_000), 10  # numbers of spheres, and cells of the lattice of argon along an edge
_RODS = (10, 100, 1000)


def add_options(parser: argparse.ArgumentParser) -> None:
    add_repeats(parser, 9)
    add_out(parser, "write scenes.png there")


def run(options: argparse.Namespace) -> None:
    benchmark(repeats=options.repeats, out=options.out)


def benchmark(*, repeats: int = 9, out: Path | None = None, write: Callable[[str], None] = print) -> None:
    """Print the tables; draw the last one in `out`."""
    write(f"Machine: {in_words()}")
    write(f"ns/step of EIG-3, no states stored: medians of {repeats} interleaved runs.\n")
    write("## A scene and the same system by hand\n")
    write(text.table(["scene", "pointer", "by hand", "ratio", "inline", "by hand", "ratio"], by_hand(repeats)))
    write("\n## What an effect that is not named adds\n")
    write("Instructions of the compiled right-hand side, before and after the catalogue gets another effect.\n")
    write(text.table(["scene", "by hand", "scene", "with a larger catalogue", "the same text"], instructions()))
    write("\n## Every other effect present, at zero strength\n")
    write(text.table(["scene", "effects", "ns/step", "with all", "ns/step", "ratio"], zero_strength(repeats)))
    write(f"\n## Time against the number of effects: {ROD} masses in space\n")
    names, ns = more_and_more(repeats)
    labels = [f"+ {name}" if k else name for k, name in enumerate(names)]
    write(text.table(["effect", "effects", "ns/step"], [[x, str(k + 1), f"{ns[k]:.0f}"] for k, x in enumerate(labels)]))
    write("\n## Points that come near each other\n")
    write(near_pairs.tables(_SPHERES, _ARGON, min(repeats, 5)))
    write("\n## Chains of rods at equal error\n")
    write(rods.table(_RODS, min(repeats, 5)))
    write("\n## Andrews' squeezer mechanism at equal error\n")
    write(squeezers.table(min(repeats, 5)))
    if out is not None:
        files = Files(out, "eig3 bench")
        files.finish(write, pictures.draw({"scenes.png": partial(_bars, labels, ns)}, files))


def by_hand(repeats: int) -> list[list[str]]:
    """The rows of scenes and of the same systems by hand."""
    rows = []
    for pair in SCENE_PAIRS:
        scene, hand = pair.problems()
        ns = measure(
            {
                f"{pair.title}, {name}{', inline' * inline}": (problem, pair.h, inline)
                for inline in (False, True)
                for name, problem in (("scene", scene), ("by hand", hand))
            },
            repeats,
        )
        a, b, c, d = ns.values()
        rows.append([pair.title, f"{a:.1f}", f"{b:.1f}", f"{a / b:.2f}", f"{c:.1f}", f"{d:.1f}", f"{c / d:.2f}"])
    return rows


def instructions() -> list[list[str]]:
    """The rows of instruction counts, before and after an effect is added to the catalogue."""
    rows = []
    for pair in SCENE_PAIRS:
        before = assembly(pair.problems()[0].rhs)
        _enlarge_the_catalogue()
        codegen._functions.cache_clear()
        after = assembly(pair.problems()[0].rhs)
        counts = [str(count) for count in (len(assembly(pair.by_hand)), len(before), len(after))]
        rows.append([pair.title, *counts, "yes" if before == after else "NO"])
    return rows


def assembly(rhs: Any) -> list[str]:
    """The instructions of a right-hand side without names of functions, since their numbers differ from run to run."""
    rhs = jit(rhs.py_func, cache=False)  # code from the disk has no text
    compiled(rhs, VECTOR.rhs.args)
    lines = (line.strip() for line in rhs.inspect_asm(VECTOR.rhs.args).splitlines())
    return [
        line for line in lines if line and not line.startswith((".", "#")) and "_ZN" not in line and ":" not in line
    ]


def _enlarge_the_catalogue() -> None:
    """Define and use a new effect, and remove it again."""

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
    """The rows of scenes with every other effect at zero strength."""
    rows = []
    for pair in SCENE_PAIRS:
        scene, others = crowded(pair)
        lean, full = pair.problems()[0], scene.problem((0.0, 1.0))
        a, b = measure({"lean": (lean, pair.h, False), "with all": (full, pair.h, False)}, repeats).values()
        named = len(pair.effects)
        rows.append([pair.title, str(named), f"{a:.1f}", str(named + others), f"{b:.1f}", f"{b / a:.1f}"])
    return rows


def more_and_more(repeats: int) -> tuple[list[str], list[float]]:
    """The names of the effects as they are added one by one, and ns/step with each."""
    problems = dict(growing())
    ns = measure({name: (problem, 1e-3, False) for name, problem in problems.items()}, repeats)
    return list(ns), list(ns.values())


def measure(problems: Mapping[str, tuple[Problem, float, bool]], repeats: int) -> dict[str, float]:
    """ns/step of each (problem, h, inline), in interleaved runs from the start of the problem."""
    starts = {name: problem.stepper(h=h, inline=inline) for name, (problem, h, inline) in problems.items()}
    steps = {name: _steps(start) for name, start in starts.items()}
    runs = {name: kernel_run(start, steps[name]) for name, start in starts.items()}
    return {name: 1e9 * seconds / steps[name] for name, seconds in medians(runs, repeats, "scenes").items()}


def _steps(start: Stepper) -> int:
    """The number of steps that take `_SECONDS`, at least 200."""
    return max(200, round(200 * _SECONDS / kernel_run(start, 200)()))


def _bars(labels: list[str], ns: list[float]) -> Figure:
    figure = pictures.new_figure(8, 4.5)
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
    axes.set_title(f"{ROD} masses in space: each effect adds its own time")
    return figure
