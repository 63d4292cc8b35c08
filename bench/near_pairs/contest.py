"""Tables of the time of a point and step: of a scene, and of others that compute the same motion."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from .. import text
from ..timing import interleave

POINT_STEPS = 2_000_000  # of a timed run
_LEAST = 100  # steps of a run: lists are made anew some times
_ENOUGH = 5.0  # seconds
SCENE = "scene, one core"

#: Something that takes a number of steps from the same start, and returns its seconds.
Run = Callable[[int], float]


@dataclass(frozen=True)
class Contest:
    """The runs of the same number of points, by name. The first one is that of the scene."""

    n: int
    runs: Mapping[str, Run]
    steps_of_a_run: int

    @classmethod
    def of(cls, n: int, runs: Mapping[str, Run], cost: int = 1) -> Contest:
        """Return a contest of points whose step takes about `cost` times that of a sphere."""
        return cls(n, runs, max(_LEAST, POINT_STEPS // (cost * n)))

    def ns(self, repeats: int, where: str) -> dict[str, float]:
        """Return the ns of a point and step, by name: medians of interleaved runs."""
        runs = {name: partial(run, self.steps_of_a_run) for name, run in self.runs.items()}
        found = interleave(runs, repeats, f"{self.n} {where}", _ENOUGH)
        unit = 1e9 / (self.n * self.steps_of_a_run)
        return {name: unit * statistics.median(seconds) for name, seconds in found.items()}


def table(points: str, contests: Sequence[Contest], repeats: int) -> str:
    """Return the table of contests, and a line for each that the scene does not win."""
    found = {contest.n: contest.ns(repeats, points) for contest in contests}
    names = list(dict.fromkeys(name for ns in found.values() for name in ns))
    header = [f"ns of a step, for each of the {points}", *(cell for n in found for cell in (str(n), "scene / this"))]
    rows = [[name, *(cell for ns in found.values() for cell in _cells(ns, name))] for name in names]
    return "\n".join([text.table(header, rows), *(line for n, ns in found.items() for line in _lost(points, n, ns))])


def _cells(ns: Mapping[str, float], name: str) -> tuple[str, str]:
    if name not in ns:
        return "-", "-"
    return text.number(ns[name]), text.number(ns[SCENE] / ns[name]) if name != SCENE else ""


def _lost(points: str, n: int, ns: Mapping[str, float]) -> list[str]:
    """Say who is faster than the scene."""
    others = [name for name in ns if not name.startswith("scene")]
    faster = [f"{name} ({ns[SCENE] / ns[name]:.2f})" for name in others if ns[name] < ns[SCENE]]
    return [f"Faster than the scene with {n} {points}: {', '.join(faster)}."] if faster else []
