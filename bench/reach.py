"""How long each method and rival takes to reach an accuracy, which of them is the fastest, and the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .rivals import RIVALS
from .sweep import Point, WorkPrecisionSet

_USEFUL = 0.11  # a larger error counts for nothing
_IN_A_ROW = 3  # settings below a target


@dataclass(frozen=True)
class Reach:
    """What a method or rival needs for a target: seconds, and its step or tolerance.

    With `at_most`, its first setting is already enough.
    """

    method: str
    label: str
    seconds: float
    setting: float
    at_most: bool

    @property
    def is_rival(self) -> bool:
        return self.method in RIVALS


def reach(result: WorkPrecisionSet, method: str, metric: str, target: float) -> Reach | None:
    """Interpolate, in logarithms, where the error of a method or rival falls below `target`, and not by chance.

    A setting counts if the next two finer ones are below the target too, as far as they were tried. None if there is no
    such setting, or if the truth is not certain enough to say so. All points belong to one mode.
    """
    if not result.is_claimed(metric, target):
        return None
    points = [point for point in result.of(method) if point.stable and metric in point.errors]
    usable = sorted(points, key=lambda point: -point.setting)
    reached = [point.errors[metric] <= target for point in usable]
    first = next((i for i in range(len(usable)) if all(reached[i : i + _IN_A_ROW])), None)
    if first is None:
        return None
    if first == 0:
        return Reach(method, usable[0].label, usable[0].time, usable[0].setting, True)
    one, two = usable[first - 1], usable[first]
    if one.errors[metric] <= target:  # by chance
        return Reach(method, two.label, two.time, two.setting, False)
    fraction = math.log(one.errors[metric] / target) / math.log(one.errors[metric] / max(two.errors[metric], 1e-300))

    def between(a: float, b: float) -> float:
        return a ** (1 - fraction) * b**fraction

    return Reach(method, one.label, between(one.time, two.time), between(one.setting, two.setting), False)


@dataclass(frozen=True)
class Contest:
    """All methods and rivals that reach one target, the fastest first.

    Attributes
    ----------
    target : float
    reached : sequence of Reach
    is_claimed : bool
        Whether the truth is certain enough to tell who reaches the target.
    """

    target: float
    reached: Sequence[Reach]
    is_claimed: bool

    def of(self, is_chosen: Callable[[str], bool]) -> Reach | None:
        """The fastest of the methods and rivals whose names are chosen."""
        return next((found for found in self.reached if is_chosen(found.method)), None)

    @property
    def fastest(self) -> Reach | None:
        return self.reached[0] if self.reached else None

    @property
    def ours(self) -> Reach | None:
        """The fastest method of the library."""
        return self.of(lambda method: method not in RIVALS)

    @property
    def rival(self) -> Reach | None:
        return self.of(RIVALS.__contains__)

    @property
    def next_own(self) -> Reach | None:
        """The fastest method of the library that is not the fastest of all."""
        return next((found for found in self.reached[1:] if not found.is_rival), None)

    @property
    def next_rival(self) -> Reach | None:
        """The fastest rival that is not the fastest of all."""
        return next((found for found in self.reached[1:] if found.is_rival), None)

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
    found = []
    for target in result.targets:
        reached = [one for method in result.methods if (one := reach(result, method, metric, target))]
        reached.sort(key=lambda one: one.seconds)
        found.append(Contest(target, reached, result.is_claimed(metric, target)))
    return found


def front(result: WorkPrecisionSet, metric: str) -> list[Point]:
    """The runs than which no other run is both faster and more accurate, the fastest first."""
    points = sorted((p for p in result.points if p.stable and metric in p.errors), key=lambda p: p.time)
    found: list[Point] = []
    for point in points:
        if point.errors[metric] < (found[-1].errors[metric] if found else _USEFUL):
            found.append(point)
    return found
