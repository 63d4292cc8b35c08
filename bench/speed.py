"""Measure the time per step (ns) of kernels on the article's problems in both modes."""

import argparse
from collections.abc import Callable, Sequence

from eig3.command_line import add_methods
from eig3.methods import METHODS
from eig3.problem import Problem

from . import loops, text
from .choices import add_repeats, choose
from .environment import in_words
from .timing import Storage, medians

SUMMARY = "ns/step of every method in both modes"
MODES = ("pointer", "inline")
HEADER = ["problem, method", *MODES]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_methods(parser)
    add_repeats(parser, 9)


def benchmark(*, methods: Sequence[str] | None = None, repeats: int = 9, write: Callable[[str], None] = print) -> None:
    """Print the table of these methods, or of all if None."""
    chosen = choose(methods, loops.METHODS)
    write(f"Machine: {in_words()}")
    write(f"ns/step with every state stored: medians of {repeats} interleaved runs of {loops.N_STEPS} steps.\n")
    problems = [(build(), h) for build, h in loops.ARTICLE_PROBLEMS]
    rows = [
        compare(problem, h, name, repeats)
        for problem, h in problems
        for name in chosen
        if not (METHODS[name]().ignores_velocity and problem.uses_velocity)
    ]
    write(text.table(HEADER, rows))


def compare(problem: Problem, h: float, name: str, repeats: int) -> list[str]:
    """The row of one method on one problem."""
    storage = Storage.for_steps(problem, loops.N_STEPS)
    runs = {mode: loops.kernel_loop(problem, h, name, storage, inline=mode == "inline") for mode in MODES}
    title = f"{problem.name}, {METHODS[name]().label}"
    return [title, *(f"{1e9 * s / loops.N_STEPS:.1f}" for s in medians(runs, repeats, title).values())]
