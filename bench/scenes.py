"""Measure the time per step (ns) of scenes and of the same systems by hand, and what each further effect costs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from eig3.command_line import Files, add_out
from eig3.problem import Problem
from eig3.stepping.stepper import Stepper

from . import near_pairs, pictures, rods, squeezers, text
from .choices import add_repeats
from .environment import in_words
from .scene_pairs import SCENE_PAIRS, crowded
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


def benchmark(*, repeats: int = 9, out: Path | None = None, write: Callable[[str], None] = print) -> None:
    """Print the tables; draw the second one in `out`."""
    write(f"Machine: {in_words()}")
    write(f"ns/step of EIG-3, no states stored: medians of {repeats} interleaved runs.\n")
    write("## A scene and the same system by hand\n")
    write(text.table(["scene", "pointer", "by hand", "ratio", "inline", "by hand", "ratio"], by_hand(repeats)))
    write("\n## Every other effect present, at zero strength\n")
    rows = zero_strength(repeats)
    write(text.table(["scene", "effects", "ns/step", "with all", "ns/step", "ratio"], rows))
    write("\n## Points that come near each other\n")
    write(near_pairs.tables(_SPHERES, _ARGON, min(repeats, 5)))
    write("\n## Chains of rods at equal error\n")
    write(rods.table(_RODS, min(repeats, 5)))
    write("\n## Andrews' squeezer mechanism at equal error\n")
    write(squeezers.table(min(repeats, 5)))
    if out is not None:
        files = Files(out, "eig3 bench")
        files.finish(write, pictures.draw({"scenes.png": partial(_bars, rows)}, files))


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


def measure(problems: Mapping[str, tuple[Problem, float, bool]], repeats: int) -> dict[str, float]:
    """ns/step of each (problem, h, inline), in interleaved runs from the start of the problem."""
    starts = {name: problem.stepper(h=h, inline=inline) for name, (problem, h, inline) in problems.items()}
    steps = {name: _steps(start) for name, start in starts.items()}
    runs = {name: kernel_run(start, steps[name]) for name, start in starts.items()}
    return {name: 1e9 * seconds / steps[name] for name, seconds in medians(runs, repeats, "scenes").items()}


def _steps(start: Stepper) -> int:
    """The number of steps that take `_SECONDS`, at least 200."""
    return max(200, round(200 * _SECONDS / kernel_run(start, 200)()))


def _bars(rows: list[list[str]]) -> Figure:
    figure = pictures.new_figure(8, 3.5)
    axes = figure.subplots()
    ratios = axes.barh([row[0] for row in rows], [float(row[-1]) for row in rows], color="C0")
    axes.bar_label(ratios, padding=4)
    axes.invert_yaxis()
    axes.margins(x=0.1)
    axes.set_xlabel("time of a step with every other effect at zero strength / without (-)")
    return figure
