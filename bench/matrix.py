"""The matrix of problems and accuracies: who is the fastest, and how far ahead of the others."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import text
from .modes import MODES
from .reach import Contest, Reach, contests
from .sweep import WorkPrecisionSet

AT_MOST = "\N{LESS-THAN OR EQUAL TO}"
IN_WORDS = {"trajectory": "in the trajectory", "energy": "in the energy", "continuum": "against the continuous bar"}


@dataclass(frozen=True)
class Row:
    """The contests of one problem, one for each target."""

    name: str
    title: str
    contests: Sequence[Contest]

    def at(self, target: float) -> Contest | None:
        """The contest for a target; None if the problem was not measured for it."""
        return next((contest for contest in self.contests if contest.target == target), None)


@dataclass(frozen=True)
class Matrix:
    """The rows of all problems that have the metric and were measured in the mode."""

    metric: str
    mode: str
    targets: Sequence[float]
    rows: Sequence[Row]

    @classmethod
    def of(cls, results: Sequence[WorkPrecisionSet], metric: str, mode: str) -> Matrix:
        rows = [
            Row(result.name, result.title, contests(result.in_mode(mode), metric))
            for result in results
            if metric in result.metrics and mode in result.modes
        ]
        targets = sorted({contest.target for row in rows for contest in row.contests}, reverse=True)
        return cls(metric, mode, targets, rows)

    def answer(self, target: float) -> str:
        """Which methods are the fastest to reach the target, and where a rival is ahead, in a few sentences."""
        begin = f"To reach an error of {power(target)} {IN_WORDS[self.metric]}, counting {MODES[self.mode].words}"
        held = [(row, contest) for row in self.rows if (contest := row.at(target)) and contest.reached]
        if not held:
            return f"{begin}, no method that was measured is accurate enough, or the truth is not known so well."
        if len(self.rows) == 1:
            return f"{begin}, {_of_one(held[0][1])}"
        won = [contest for _, contest in held if contest.ours and not contest.is_lost]
        lost = [(row, contest) for row, contest in held if contest.is_lost]
        labels = Counter(abbreviated(contest.ours.label) for contest in won if contest.ours)
        counted = ", ".join(f"{label} ({count})" for label, count in labels.most_common())
        all_reach = len(held) == len(self.rows)
        problems = f"the {len(held)} problems{'' if all_reach else f' on which it is reached, of {len(self.rows)}'}"
        if not any(contest.rival for _, contest in held):
            return f"{begin}, the fastest methods of eig3 on {problems}, are {counted}; no rival was measured."
        counted = f": {counted}" if counted else ""
        sentences = [f"{begin}, a method of eig3 is the fastest on {len(won)} of {problems}{counted}."]
        leads = [1 / contest.ratio for contest in won if contest.ratio and contest.rival and not contest.rival.at_most]
        if leads:
            sentences.append(f"The best rival takes {times(statistics.median(leads))} times as long there (median).")
        if lost:
            sentences.append(f"A rival is ahead on {len(lost)}: {', '.join(_lost(*one) for one in lost)}.")
        return " ".join(sentences)


def _of_one(contest: Contest) -> str:
    first = contest.reached[0]
    others = ((contest.next_own, "the next method of eig3"), (contest.next_rival, "the best rival"))
    behind = [
        f"{who}, {one.label}, takes {'at most ' * one.at_most}{times(one.seconds / first.seconds)} times as long"
        for one, who in others
        if one
    ]
    sentence = f"{first.label} is the fastest, with {in_units(first.seconds)}"
    return f"{sentence}; {' and '.join(behind)}." if behind else f"{sentence}."


def _lost(row: Row, contest: Contest) -> str:
    how = f"{times(contest.ratio)} times" if contest.ours and contest.ratio else "no method of eig3 gets there"
    return f"{abbreviated(contest.reached[0].label)} on {short(row.title)} ({how})"


def short(title: str) -> str:
    """The title of a problem without its details."""
    return title.partition(",")[0]


def in_units(seconds: float) -> str:
    """A time with three digits in s, ms or \N{MICRO SIGN}s."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= 0.9995 * size:
            return f"{text.number(seconds / size)} {unit}"
    return f"{text.number(1e6 * seconds)} \N{MICRO SIGN}s"


def times(ratio: float) -> str:
    """A ratio with the digits that matter."""
    return f"{ratio:.2f}" if ratio < 1.095 else f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"


def lead(first: Reach, other: Reach) -> str:
    """How many times as long the other takes; at most so long if its first setting is already accurate enough."""
    return f"{AT_MOST * other.at_most}\N{MULTIPLICATION SIGN}{times(other.seconds / first.seconds)}"


def abbreviated(label: str) -> str:
    """The label of a method for a narrow cell."""
    return label.replace(", tolerances", " tol.").replace(", fixed point", " f.p.").replace(", Newton", " N.")


def power(target: float) -> str:
    """A small number such as 1e-6 or 1.5e-3, as short as can be."""
    return np.format_float_scientific(target, trim="-", exp_digits=1)
