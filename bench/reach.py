"""How long each method and rival takes to reach an accuracy, which of them is the fastest, and the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from .rivals import RIVALS
from .sweep import Point, WorkPrecisionSet

_USEFUL = 0.11  # a larger error counts for nothing


@dataclass(frozen=True)
class Reach:
    """What a method needs for a target: seconds and setting. With `at_most`, its first setting is already enough."""

    seconds: float
    setting: float
    at_most: bool


def reach(result: WorkPrecisionSet, method: str, metric: str, target: float) -> Reach | None:
    """Interpolate, in logarithms, where the error of a method or rival first falls below `target`.

    None if it never does, or if the truth is not certain enough to say so. The points are those of one mode.
    """
    if not result.is_claimed(metric, target):
        return None
    points = (point for point in result.of(method) if point.stable and metric in point.errors)
    usable = sorted(points, key=lambda point: -point.setting)
    first = next((i for i, point in enumerate(usable) if point.errors[metric] <= target), None)
    if first is None:
        return None
    if first == 0:
        return Reach(usable[0].time, usable[0].setting, True)
    one, two = usable[first - 1], usable[first]
    fraction = math.log(one.errors[metric] / target) / math.log(one.errors[metric] / max(two.errors[metric], 1e-300))

    def between(a: float, b: float) -> float:
        return a ** (1 - fraction) * b**fraction

    return Reach(between(one.time, two.time), between(one.setting, two.setting), False)


@dataclass(frozen=True)
class Fastest:
    """The label of the fastest of some methods or rivals, and its seconds."""

    label: str
    seconds: float


@dataclass(frozen=True)
class Contest:
    """The fastest method of the library and the fastest rival for one target; None where none reaches it."""

    target: float
    ours: Fastest | None
    rival: Fastest | None

    @property
    def ratio(self) -> float | None:
        """The time of our method over the time of the rival; None without a rival, infinite if only it is there."""
        if self.rival is None:
            return None
        return self.ours.seconds / self.rival.seconds if self.ours else math.inf

    @property
    def is_lost(self) -> bool:
        """Whether a rival is ahead."""
        return self.ratio is not None and self.ratio > 1


def contests(result: WorkPrecisionSet, metric: str) -> list[Contest]:
    """One contest for each target."""
    ours, rivals = (lambda m: m not in RIVALS), (lambda m: m in RIVALS)
    return [
        Contest(target, fastest(result, metric, target, ours), fastest(result, metric, target, rivals))
        for target in result.targets
    ]


def fastest(result: WorkPrecisionSet, metric: str, target: float, is_chosen: Callable[[str], bool]) -> Fastest | None:
    """The fastest of the chosen methods and rivals to reach the target; None if none does."""
    found = [
        Fastest(label, reached.seconds)
        for method, label in result.methods.items()
        if is_chosen(method) and (reached := reach(result, method, metric, target))
    ]
    return min(found, key=lambda f: f.seconds, default=None)


def front(result: WorkPrecisionSet, metric: str) -> list[Point]:
    """The runs than which no other run is both faster and more accurate, the fastest first."""
    points = sorted((p for p in result.points if p.stable and metric in p.errors), key=lambda p: p.time)
    found: list[Point] = []
    for point in points:
        if point.errors[metric] < (found[-1].errors[metric] if found else _USEFUL):
            found.append(point)
    return found
