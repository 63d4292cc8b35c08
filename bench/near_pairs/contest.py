"""Tables of the time of a point and step: of a scene, and of others that compute the same motion."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from .. import text
from ..timing import interleave

POINT_STEPS = 2_000_000  # that are timed together
STEPS = 200  # of a run, for all numbers of points: these move apart, so that later steps take less time
_ENOUGH = 5.0  # seconds
SCENE = "scene"

#: Something that takes a number of steps from the same start, and returns its seconds.
Run = Callable[[int], float]
#: The name of a contestant, and its number of cores.
Who = tuple[str, int]


@dataclass(frozen=True)
class Contest:
    """The runs of the same number of points. There is one of the scene for each number of cores.

    Attributes
    ----------
    n : int
        Number of points.
    runs : dict of Who to Run
    rounds : int
        How many runs follow each other to be timed.
    """

    n: int
    runs: Mapping[Who, Run]
    rounds: int

    @classmethod
    def of(cls, n: int, runs: Mapping[Who, Run], cost: int = 1) -> Contest:
        """Return a contest of points whose step takes about `cost` times as long as the step of a sphere."""
        return cls(n, runs, max(1, POINT_STEPS // (cost * n * STEPS)))

    def ns(self, repeats: int, where: str) -> dict[Who, float]:
        """Return the ns of a point and step: medians of interleaved runs."""
        runs = {_label(who): partial(self._seconds, run) for who, run in self.runs.items()}
        found = interleave(runs, repeats, f"{self.n} {where}", _ENOUGH)
        unit = 1e9 / (self.n * STEPS * self.rounds)
        return {who: unit * statistics.median(found[_label(who)]) for who in self.runs}

    def _seconds(self, run: Run) -> float:
        return sum(run(STEPS) for _ in range(self.rounds))


def table(points: str, contests: Sequence[Contest], repeats: int) -> str:
    """Return the table of contests, and a line for each that the scene does not win.

    The ratios are to the time of the scene on as many cores.
    """
    found = {contest.n: contest.ns(repeats, points) for contest in contests}
    everyone = dict.fromkeys(who for ns in found.values() for who in ns)
    header = [f"ns of a step, for each of the {points}", *(cell for n in found for cell in (str(n), "scene / this"))]
    rows = [[_label(who), *(cell for ns in found.values() for cell in _cells(ns, who))] for who in everyone]
    lost = [line for n, ns in found.items() for line in _lost(points, n, ns)]
    return "\n\n".join([text.table(header, rows), *lost])


def _label(who: Who) -> str:
    return f"{who[0]}, {'one core' if who[1] == 1 else f'{who[1]} cores'}"


def _ratio(ns: Mapping[Who, float], who: Who) -> float:
    return ns[SCENE, who[1]] / ns[who]


def _cells(ns: Mapping[Who, float], who: Who) -> tuple[str, str]:
    if who not in ns:
        return "-", "-"
    return text.number(ns[who]), text.ratio(_ratio(ns, who)) if who[0] != SCENE else ""


def _lost(points: str, n: int, ns: Mapping[Who, float]) -> list[str]:
    """Say who is faster than the scene on as many cores."""
    faster = [f"{_label(who)} ({_ratio(ns, who):.2f})" for who in ns if ns[who] < ns[SCENE, who[1]]]
    return [f"Faster than the scene with {n} {points}: {', '.join(faster)}."] if faster else []
