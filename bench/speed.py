"""Measure the time per step (ns) of kernels on the article's problems in both modes, and of loops by hand."""

import argparse
from collections.abc import Callable, Sequence

from eig3.command_line import add_methods
from eig3.methods import METHODS
from eig3.problem import Problem

from . import loops, text
from .choices import add_repeats, choose
from .environment import in_words
from .timing import Storage, medians

SUMMARY = "ns/step of every method, compared with loops written by hand"
MODES = ("pointer", "inline")
HEADER = ["problem, method", "pointer", "by hand", "ratio", "inline", "by hand", "ratio"]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_methods(parser)
    add_repeats(parser, 9)


def run(options: argparse.Namespace) -> None:
    benchmark(methods=options.methods, repeats=options.repeats)


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
    ratios = [float(row[i]) for row in rows for i in (3, 6) if row[i] != "-"]
    if ratios:
        write(f"\nRatio of the kernel to the loop by hand: {min(ratios):.2f} to {max(ratios):.2f}.")


def compare(problem: Problem, h: float, name: str, repeats: int) -> list[str]:
    """The row of one method on one problem, with dashes where no loop is written by hand."""
    by_hand = loops.by_hand(problem, name)
    storage = Storage.for_steps(problem, loops.N_STEPS)
    runs = {}
    for mode in MODES:
        runs[mode] = loops.kernel_loop(problem, h, name, storage, inline=mode == "inline")
        if by_hand:
            runs[f"{mode} by hand"] = loops.hand_loop(problem, h, by_hand, storage, inline=mode == "inline")
    title = f"{problem.name}, {METHODS[name]().label}"
    ns = {key: 1e9 * seconds / loops.N_STEPS for key, seconds in medians(runs, repeats, title).items()}
    row = [title]
    for mode in MODES:
        ours, theirs = ns[mode], ns.get(f"{mode} by hand")
        row += [f"{ours:.1f}", *([f"{theirs:.1f}", f"{ours / theirs:.2f}"] if theirs else ["-", "-"])]
    return row
