"""The part of a run that a film shows, its speed, and the states in its frames."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..result.solution import Solution

#: A function that computes positions at times, shape (m,), from displacements, shape (m, n).
Places = Callable[[np.ndarray, np.ndarray], np.ndarray]

RATE = 20  # frames a second
_SECONDS = 8.0  # about the duration of a film
_REAL_TIME = 6.0, 10.0  # motions of this duration, s, are shown in real time
_PERIODS = 2.0, 16.0  # least and largest number of periods that a film shows
_FACTORS = 1, 1.5, 2, 3, 4, 5, 6, 8, 10  # times powers of ten: the possible ratios of the speeds of film and motion
_UNITS = (1e-15, "fs"), (1e-12, "ps"), (1e-9, "ns"), (1e-6, "µs"), (1e-3, "ms"), (1.0, "s")
_PATH, _MOST = 10, 20_000  # least number of points on a path between two frames; most saved states on a path
_VALUES = 1_000_000  # displacements that are interpolated at a time
_VISIBLE = 0.02  # an error above this fraction of the largest motion is visible in a film


@dataclass(frozen=True, eq=False)
class Film:
    """The states that an animation shows.

    Attributes
    ----------
    solution : Solution
        The visible part of the run.
    speed : float
        Seconds of the motion in a second of the film.
    t : ndarray, shape (frames,)
        The time of each frame.
    u, v : ndarray, shape (frames,) or (frames, n)
        The state in each frame, as ``solution.at`` interpolates it.
    clock : (float, str)
        The time in seconds of the unit in which the film shows the time, and this unit; "" for a time without unit.
    """

    solution: Solution
    speed: float
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    clock: tuple[float, str] = (1.0, "s")

    @classmethod
    def of(cls, solution: Solution, *, has_seconds: bool = True) -> Film:
        """Choose the part of a run to show: all of it, or the first periods of a run with very many periods.

        `has_seconds` says whether the unit of time is the second.

        Raises
        ------
        ValueError
            If the motion cannot be read from the saved states.
        """
        if len(solution.t) < 2:
            raise ValueError(
                "solution has no motion to show, because it has fewer than two states: integrate to a later t_end, or "
                "with a smaller step if the run failed."
            )
        if not is_resolved(solution):
            raise ValueError(
                "solution must have states closer together to be animated, because the motion between two of them "
                "cannot be known from them: integrate with a smaller save_every, or to an earlier t_end."
            )
        speed, t = _frames(solution)
        start, end = t[0], t[-1]
        count = np.searchsorted(solution.t, end) + 1
        units = [(scale, unit) for scale, unit in _UNITS if end - start < 500 * scale] or [_UNITS[-1]]
        u, v = solution._interpolated(t)
        return cls(solution._first(count), speed, t, u, v, units[0] if has_seconds else (1.0, ""))

    @cached_property
    def times(self) -> np.ndarray:
        """Times that are dense enough for a smooth curve, including the times of the frames."""
        saved = self.solution.t[self.solution.t <= self.t[-1]]
        saved = saved[:: 1 + len(saved) // _MOST]
        between = np.linspace(self.t[0], self.t[-1], _PATH * (len(self.t) - 1) + 1)
        return np.unique(np.concatenate([saved, between, self.t]))

    def path(self, shown: Places = lambda t, u: u) -> np.ndarray:
        """Return the displacements at `times`, or ``shown(t, u)`` of them.

        `shown` gets some of the times in each call. Only its return values are kept, because the displacements at all
        times may exceed the memory.
        """
        count = max(1, _VALUES // self.u[:1].size)
        parts = (self.times[k : k + count] for k in range(0, len(self.times), count))
        return np.concatenate([np.array(shown(t, self.solution._interpolated(t)[0])) for t in parts])

    def rows(self, i: int, seconds: float = math.inf) -> slice:
        """Return the rows of `times` up to frame i, from that many seconds of the film before it on."""
        first, last = self.t[i] - seconds * self.speed, self.t[i]
        begin, end = np.searchsorted(self.times, [first, last])
        return slice(begin, end + 1)


def shown_duration(duration: float, periods: float) -> float:
    """Return the shown duration of a motion: 8 s if these contain 2 to 16 periods, otherwise at most 16 periods."""
    least, most = _PERIODS
    if periods <= most:
        return duration
    period = duration / periods
    return _SECONDS if least * period <= _SECONDS <= most * period else most * period


def film_speed(duration: float) -> float:
    """Return the speed of a film of 6 to 10 s, in seconds of the motion a second.

    Motions of this duration are shown in real time; other speeds are round factors.
    """
    if _REAL_TIME[0] <= duration <= _REAL_TIME[1]:
        return 1.0
    speed = duration / _SECONDS
    slower = speed < 1
    factor = 1 / speed if slower else speed
    power = 10.0 ** math.floor(math.log10(factor))
    factor = power * min(_FACTORS, key=lambda x: abs(math.log(x * power / factor)))
    return 1 / factor if slower else factor


def excursions(solution: Solution) -> float:
    """Return the number of periods: how often the motion goes through its range and back."""
    u = solution.u.reshape(len(solution.t), -1)
    size = np.linalg.norm(np.ptp(u, axis=0))
    return float(np.linalg.norm(np.diff(u, axis=0), axis=1).sum() / (2 * size)) if size > 0 else 0.0


def _frames(solution: Solution) -> tuple[float, np.ndarray]:
    """Return the speed of a film of a run, and the times of its frames."""
    start, end = solution.t[0], solution.t[-1]
    end = min(end, start + shown_duration(end - start, excursions(solution)))
    speed = film_speed(end - start)
    return speed, np.linspace(start, end, 1 + round((end - start) / speed * RATE))


def is_resolved(solution: Solution) -> bool:
    """Return whether a film can show the motion between the saved states.

    The motion between two states must usually be shorter than its whole range, and the interpolation must have no
    visible error in a frame. A failed run is always shown.
    """
    if not solution.success:
        return True
    u, v = (x.reshape(len(solution.t), -1) for x in (solution.u, solution.v))
    way = np.linalg.norm(v[:-1], axis=1) * np.diff(solution.t)
    if np.median(way) > np.linalg.norm(np.ptp(u, axis=0)):
        return False
    return bool((solution._errors(_frames(solution)[1])[1] < _VISIBLE).all())
