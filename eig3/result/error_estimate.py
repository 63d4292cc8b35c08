"""Estimate the error of a run from the same run with other steps, by Richardson extrapolation.

If the error of u is e for the steps h, it is about e r^p for the steps r h, with the order p. The run differs by
e (1 - r^p) from a finer run, and by e (c^p - 1) from a coarser run with the steps c h: the ratio of the two differences
gives p, and then the difference from the finer run gives e. Two coarser runs take less time, and give e if p is the
order of the method. With tolerances, the ratio is the factor by which a tolerance ten times smaller divides the error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..functions.extremes import Extremes
from .status import Status

_LOWEST, _HIGHEST = 0.25, 30.0  # range of the observed orders
_BELOW = 0.6  # least difference between the order of the method and an observed order that is reported as lower
_ABOVE = 1.5  # with a higher observed order, the coarser run is not yet or no longer a measure
_LEAST_ORDER = 1.0  # kinks and jumps lower the order to about 1; a lower one is chaos, or chance
_LEAST_RATIO = 2.0  # least factor by which the error decreases with a tenth of the tolerance
_ROUND_OFF = 1e-12  # smaller differences, relative to the motion, may be round-off
_SMALL = 1e-6  # a degree of freedom that moves less, relative to the largest motion, has no own scale
_CONVERGING = 0.2  # the orders are measured up to this difference from the coarser run, relative to the motion
_ROUNDING = 2 * np.finfo(float).eps  # relative error of a path by round-off; all runs may have it, as of coefficients
_NEAR_ROUND_OFF = "The differences of the runs are near round-off: shorter steps do not help."
_AT_REST = "Nothing moves in the compared runs either: only a shorter step can see a shorter load."
_STEPS = {"two thirds of": 2 / 3, "half": 1 / 2, "twice": 2.0, "four times": 4.0}  # of compared runs, as ratios
_CLEAR = 0.1  # largest difference from the order of the method with which coarser runs alone give the error
_SURE = 0.2  # and with which the ratio of the errors holds for other parameters too
_IN_PROPORTION = 0.95  # least cosine of the angle between two differences; smooth motions show 0.98 and more
_HARDLY = 1e-2  # a degree of freedom that moves less, relative to the largest motion, has hardly begun to move
_NO_DIGIT = 0.5  # an error of this fraction of the motion: no digit is right
_FEW_COLUMNS = 16
_MANY_STEPS = 100  # fewer steps may not be more with a smaller tolerance
_FEW_MORE = 0.3  # a smaller part of the further steps that the order lets expect is hardly a change
_WINDOWS = 16  # parts of the run whose orders are compared
_GROWING = 1e-10, 0.1  # range of the relative errors in which a rate of growth is measured,
_FEWEST = 8  # from at least this number of states
_FEW_STATES = 64  # fewer saved states hardly show up to when digits are right
_SMALL_ERROR, _LARGE_DRIFT = 0.01, 0.1  # relative: an estimated error and a drift that contradict each other


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate of the error of a run: its values minus the exact values.

    Attributes
    ----------
    t : ndarray, shape (m,)
        The times of the saved states.
    u, v : ndarray, shape (m,) or (m, n)
        After the end of the compared run, they are NaN, or infinite if it failed. NaN in u for what only events change.
    outputs, z : dict of str to ndarray
        As in the solution. Members of an ensemble with tolerances have them if they save only their ends, or with
        `t_eval`.
    drift : dict of str to float
    extremes : dict of str to Extremes
        Without the errors of peaks between the ends of two steps.
    events : dict of str to ndarray
        The errors of the times of the occurrences that both runs have.
    order : float or None
        The order that the run shows; None with tolerances, or if no coarser run could be compared.
    reliable_until : float or None
        The last saved time at which a digit of u is right, or -inf; None if it is the end. A run that has saved few
        states is repeated with more states to find it.
    by : str
        What the run was compared with.
    coarser : float or None
        The error with twice the step, or with ten times the tolerance, divided by this error; None if it is not known.
    notes : tuple of str
        Sentences that the user should read.
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    by: str
    outputs: dict[str, np.ndarray] = field(default_factory=dict)
    z: dict[str, np.ndarray] = field(default_factory=dict)
    drift: dict[str, float] = field(default_factory=dict)
    extremes: dict[str, Extremes] = field(default_factory=dict)
    events: dict[str, np.ndarray] = field(default_factory=dict)
    order: float | None = None
    reliable_until: float | None = None
    coarser: float | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def largest(self) -> dict[str, float]:
        """The largest absolute error of u, v, and of each other quantity and event time, by name."""
        arrays = {"u": self.u, "v": self.v, **self.outputs, **self.z, **self.drift, **self.events}
        return {name: _largest(values) for name, values in arrays.items()}

    def __str__(self) -> str:
        order = "" if self.order is None else f", which show the order {self.order:.1f}"
        what, until = f"error of u at most {_largest(self.u):.2g}", self.reliable_until
        if until is not None:
            largest = _largest(self.u[self.t <= until])
            what = f"error of u at most {largest:.2g} up to t = {until:.4g}" if largest else "no digit of u is right"
        return f"{what} (estimated from {self.by}{order})"

    __repr__ = __str__


@dataclass(frozen=True)
class Companion:
    """A run with other steps, and the states that both runs have.

    Attributes
    ----------
    solution : Solution
    ratio : float
        Its step, or its tolerance, divided by the step or the tolerance of the run.
    rows, own : ndarray of int
        The rows of the states in the run, and in the companion.
    u, v : ndarray
        The states of the companion.
    is_fixed : bool
        Whether both runs have a fixed step.
    """

    solution: Any
    ratio: float
    rows: np.ndarray
    own: np.ndarray | None
    u: np.ndarray
    v: np.ndarray
    is_fixed: bool

    @property
    def name(self) -> str:
        """The run in words, such as "a run with half the step"."""
        if not self.is_fixed:
            return f"a run with {'a tenth of' if self.ratio < 1 else 'ten times'} the tolerance"
        return f"a run with {min(_STEPS, key=lambda step: abs(_STEPS[step] - self.ratio))} the step"

    @classmethod
    def at_same_steps(cls, solution: Any, other: Any, ratio: float) -> Companion:
        """Return a companion with a fixed step, some of whose states are at the same times."""
        least = 1e-3 * min(solution.h, other.h)
        if len(other.t) == len(solution.t) and np.abs(other.t - solution.t).max() <= least:
            rows = np.arange(len(other.t))
            return cls(other, ratio, rows, rows, other.u, other.v, is_fixed=True)
        between = solution.t[min(1, len(solution.t) - 1)] - solution.t[0] or 1.0  # equal, but for the last state
        rows = np.minimum(np.rint((other.t - solution.t[0]) / between).astype(np.intp), len(solution.t) - 1)
        if (np.abs(other.t - solution.t[rows]) > least).any():  # not with equal distances, as with t_eval
            rows = np.minimum(np.searchsorted(solution.t, other.t - least), len(solution.t) - 1)
        own = np.flatnonzero(np.abs(other.t - solution.t[rows]) <= least)
        if len(own) < len(rows):
            return cls(other, ratio, rows[own], own, other.u[own], other.v[own], is_fixed=True)
        return cls(other, ratio, rows, own, other.u, other.v, is_fixed=True)

    @classmethod
    def at_same_times(cls, solution: Any, other: Any, ratio: float) -> Companion:
        """Return a companion with tolerances, which has saved its states at the times of the run up to its end."""
        if len(other.t) == len(solution.t):
            rows = np.arange(len(other.t))
            return cls(other, ratio, rows, rows, other.u, other.v, is_fixed=False)
        rows = np.flatnonzero(np.isin(solution.t, other.t) & ~_are_at_resets(solution.t))
        own = np.searchsorted(other.t, solution.t[rows])
        return cls(other, ratio, rows, own, other.u[own], other.v[own], is_fixed=False)

    @classmethod
    def between_steps(cls, solution: Any, other: Any, ratio: float) -> Companion:
        """Return a companion with tolerances, whose states are interpolated."""
        if len(other.t) == len(solution.t) and (other.t == solution.t).all():  # t_eval
            return cls.at_same_times(solution, other, ratio)
        rows = np.flatnonzero((solution.t <= other.t[-1]) & ~_are_at_resets(solution.t))
        u, v = other._interpolated(solution.t[rows])
        return cls(other, ratio, rows, None, u, v, is_fixed=False)

    def with_end(self, solution: Any) -> Companion:
        """Return a companion that has a state at the end of the run too, if a terminal event ended both."""
        other, last = self.solution, len(solution.t) - 1
        if not solution.status is other.status is Status.TERMINATED or _last_event(solution).t[-1] != solution.t[-1]:
            return self
        end, a = _last_event(other), solution.a
        dt = solution.t[-1] - end.t[-1]  # of the order of the error
        state = end.u_after[-1] + dt * end.v_after[-1], end.v_after[-1] + dt * (np.nan if a is None else a[-1])
        before = slice(np.searchsorted(self.rows, last))
        u, v = (np.append(x[before], [y], axis=0) for x, y in zip((self.u, self.v), state, strict=True))
        return replace(self, rows=np.append(self.rows[before], last), u=u, v=v)


def _last_event(solution: Any) -> Any:
    """Return the occurrences of the event that occurred last."""
    return max(filter(len, solution.events.values()), key=lambda found: found.t[-1])


def _are_at_resets(t: np.ndarray) -> np.ndarray:
    """Return which states are before and after a reset. There a companion has one state, before or after its reset."""
    is_next = t[1:] == t[:-1]
    return np.append(is_next, False) | np.append(False, is_next)


def estimate(solution: Any, fine: Companion, coarse: Companion | None, coarser: float | None = None) -> ErrorEstimate:
    """Return the error of a solution by a finer and by a coarser run.

    If `coarser` is known, see `ErrorEstimate`, `fine` may be a coarser run, and another one only gives its name.
    """
    fine, coarse = fine.with_end(solution), coarse and coarse.with_end(solution)
    order = solution.method.order if fine.is_fixed else None
    scale = _scale(solution)
    first = (_at(fine.rows, solution.u) - fine.u) / scale
    is_tiny = bool(np.abs(first).max(initial=0.0) < _ROUND_OFF)
    notes: list[str] = []
    differences = None
    if coarser is None and coarse is not None and coarse.solution.success:
        differences = Differences.of(solution, fine, coarse, scale)
    seen = differences and differences.ratio()
    if coarser is not None:
        observed, factor = order and math.log2(coarser), 1 / (1 - (coarser if fine.ratio > 1 else 1 / coarser))
    elif order is None:
        observed, factor = None, _by_tolerances(seen, is_tiny, notes)
        coarser = seen
    else:
        observed, factor = _by_order(seen, fine, coarse, order, is_tiny, notes)
        if observed is not None and differences and abs(observed - order) <= _SURE and differences.are_in_proportion:
            coarser = 2**observed
        if differences and coarse and not is_tiny and observed is not None and observed < order - _BELOW:
            notes.append(_lower(solution.method.label, differences, (coarse.ratio, fine.ratio), observed, order))
    if order is None and _is_limited(solution, fine):
        notes.append(
            "A tenth of the tolerance takes hardly more steps: stability or h_max limits them, not the tolerance."
        )
    if not fine.solution.success:
        notes.append(f"The compared run, {fine.name}, ended early: {fine.solution.message}")

    def errors(values: np.ndarray, others: np.ndarray) -> np.ndarray:
        rows = fine.rows[: len(others)]
        found = _at(rows, values) - others
        found *= factor
        return _everywhere(solution.t, rows, found, np.nan if fine.solution.success else np.inf)

    u = errors(solution.u, fine.u)
    u[..., np.isinf(scale)] = np.nan
    if _NEAR_ROUND_OFF not in notes and _is_near_round_off(solution, u):
        notes.append(_NEAR_ROUND_OFF)
    if not (np.any(solution.u) or np.any(fine.u)):
        notes = [_AT_REST if each == _NEAR_ROUND_OFF else each for each in notes]
    until, note = _reliable_until(solution, u if fine.solution.success else np.where(np.isinf(u), np.nan, u), scale)
    notes += [note] if note else []
    own, other = fine.own, fine.solution
    at_states = own is not None
    if not at_states and (solution.outputs or solution.z):
        notes.append("The compared run has saved other times, so that outputs and z have no errors: give t_eval.")
    events, counts = _of_events(solution, other, factor)
    notes += counts
    return ErrorEstimate(
        t=solution.t,
        u=u,
        v=errors(solution.v, fine.v),
        by=fine.name if coarse is None else f"{fine.name} and {coarse.name}",
        outputs={name: errors(x, other.outputs[name][own]) for name, x in solution.outputs.items() if at_states},
        z={name: errors(x, other.z[name][own]) for name, x in solution.z.items() if at_states},
        drift={name: factor * (x - other.drift[name]) for name, x in solution.drift.items()},
        extremes={
            name: Extremes(*(factor * (np.asarray(x) - y) for x, y in zip(each, other.extremes[name], strict=True)))
            for name, each in solution.extremes.items()
        },
        events=events,
        order=observed,
        reliable_until=until,
        coarser=coarser,
        notes=tuple(notes),
    )


def clear_estimate(solution: Any, near: Companion, far: Companion) -> ErrorEstimate | None:
    """Return the error of a solution by two coarser runs, if these show the order of the method; otherwise None.

    Their differences from the solution must be in proportion too: with kinks, any ratio may occur by chance.
    """
    reaches_end = near.rows[-1] == len(solution.t) - 1
    if not (near.solution.success and far.solution.success and reaches_end):
        return None
    differences = Differences.of(solution, near, far, _scale(solution))
    seen = differences.ratio()
    observed = None if seen is None else float(_order(seen, far.ratio, near.ratio))
    if observed is None or abs(observed - solution.method.order) > _CLEAR or not differences.is_whole:
        return None
    if not differences.are_in_proportion or differences.products.sum() < 0:
        return None
    error = estimate(solution, near, far, coarser=near.ratio**observed)
    return None if error.notes else error


def losses(solution: Any, error: ErrorEstimate, starts: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each invariant whose drift is large although the estimated error is small.

    A method may damp a fast motion away in all compared runs, which then agree. `starts` are the values of the
    invariants at the start.
    """
    if error.reliable_until is not None or _is_large(solution, error):
        return
    for name, start in starts.items():
        drift, found = solution.drift[name], solution.extremes[name]
        is_large = 0 < abs(start) >= max(abs(found.low), abs(found.high)) / 2  # and no difference of larger numbers
        if is_large and drift >= _LARGE_DRIFT * abs(start):
            yield (
                f"{name} changes by {100 * drift / abs(start):.2g} %, which the estimated error of u does not show: "
                f"{solution.method.label} may have damped a fast motion away in all compared runs, or {name} is no "
                "invariant of this motion; compare with a much shorter step."
            )


def may_be_lost(solution: Any, error: ErrorEstimate) -> bool:
    """Return whether no digit may be right before the end, although the error in a few states may not show it."""
    return bool(error.notes) and len(solution.t) < min(_FEW_STATES, solution.n_steps) and _is_large(solution, error)


def _is_large(solution: Any, error: ErrorEstimate) -> bool:
    scale = _scale(solution)
    return bool(error.largest["u"] >= _SMALL_ERROR * np.max(scale, where=np.isfinite(scale), initial=0.0))


def _scale(solution: Any) -> Any:
    """Return the size of the motion of each degree of freedom; infinity for what only events change."""
    u, only = solution.u, written(solution)
    sizes = np.where(only, 0.0, _largest_of_each(u) if len(u) else np.zeros(u.shape[1:]))
    largest = float(np.max(sizes, initial=0.0))
    return np.where(only, np.inf, np.maximum(sizes, max(_SMALL * largest, np.finfo(float).tiny)))


def written(solution: Any) -> Any:
    """Return which degrees of freedom are states that only events change, such as whether a string is broken.

    They have no unit, and do not move. An event that is a little late leaves them as different as they can be.
    """
    axis, units = solution.t.ndim - 1, solution.labels.units if solution.labels else ""
    if isinstance(units, str) or not solution.events:
        return np.zeros(np.delete(solution.u.shape, axis), dtype=bool)
    return ~np.any(np.abs(solution.v) > 0, axis=axis) & (np.array(units) == "-")


def _largest_of_each(u: np.ndarray) -> Any:
    """Return the largest |u| of each degree of freedom, without NaN and without temporary arrays of this size."""
    if u.ndim == 2 and u.shape[1] < _FEW_COLUMNS:  # NumPy takes ten times as long to reduce short rows
        return np.array([_largest(x) for x in u.T])
    return np.fmax(np.fmax.reduce(u, axis=0), -np.fmin.reduce(u, axis=0))


def _at(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return some rows of an array: a view, if they have equal distances."""
    distance = int(rows[1] - rows[0]) if len(rows) > 1 else 0
    if distance and rows[-1] - rows[0] == distance * (len(rows) - 1):  # the rows increase
        found = values[rows[0] : rows[-1] + 1 : distance]
        if distance == 1 or (np.diff(rows) == distance).all():
            return found
    return values[rows]


class Differences(NamedTuple):
    """The differences of a run from a finer and from a coarser run, in the states that all three have.

    Attributes
    ----------
    t : ndarray, shape (k,)
    fine, coarse : ndarray, shape (k,)
        Norms of the differences relative to the size of the motion.
    products : ndarray, shape (k,)
        Their scalar products.
    is_whole : bool
        Whether the coarser run is the same motion up to its end.
    """

    t: np.ndarray
    fine: np.ndarray
    coarse: np.ndarray
    products: np.ndarray
    is_whole: bool

    @classmethod
    def of(cls, solution: Any, fine: Companion, coarse: Companion, scale: Any) -> Differences:
        """Compare up to the time after which the coarser run is another motion."""
        rows, *both = np.intersect1d(fine.rows, coarse.rows, assume_unique=True, return_indices=True)
        relative = [
            ((_at(rows, solution.u) - _at(some, other.u)) / scale).reshape(len(rows), np.size(scale))
            for other, some in zip((fine, coarse), both, strict=True)
        ]
        norms = [np.sqrt(np.einsum("ij,ij->i", x, x)) for x in relative]
        apart = np.flatnonzero(~(norms[1] < _CONVERGING))
        count = apart[0] if len(apart) and apart[0] > 1 else len(rows)
        products = np.einsum("ij,ij->i", *(x[:count] for x in relative))
        is_whole = not len(apart) and len(rows) > 1
        return cls(solution.t[rows[:count]], norms[0][:count], norms[1][:count], products, is_whole)

    def ratio(self, some: slice = slice(None)) -> float | None:
        """The ratio of the differences in some of the states; None if it is not known."""
        fine, coarse = (float(np.linalg.norm(x[some])) for x in (self.fine, self.coarse))
        if not len(self.t[some]) or not math.isfinite(coarse):
            return None
        return coarse / fine if fine else math.inf

    @property
    def are_in_proportion(self) -> bool:
        """Whether the differences from two runs have one direction, or opposite ones, as in a smooth motion."""
        sizes = float(np.linalg.norm(self.fine) * np.linalg.norm(self.coarse))
        return abs(float(self.products.sum())) >= _IN_PROPORTION * sizes


def _by_tolerances(seen: float | None, is_tiny: bool, notes: list[str]) -> float:
    """Return the factor of the differences from the run with smaller tolerances."""
    if seen is None or not math.isfinite(seen):
        return 1.0
    if seen >= _LEAST_RATIO:
        return 1 / (1 - 1 / seen)
    if is_tiny:
        notes.append(_NEAR_ROUND_OFF)
        return 1.0
    notes.append(
        f"A tenth of the tolerance divides the error by {seen:.2g} only: the estimate is rough. The motion may be "
        "chaotic or have kinks, or no step may have seen a short event."
    )
    return 1 / (1 - 1 / _LEAST_RATIO)


def _is_near_round_off(solution: Any, u: np.ndarray) -> bool:
    """Return whether round-off of the size and the path of the motion may be larger than these errors."""
    span = solution.t[-1] - solution.t[0]
    paths = _largest_of_each(solution.u) + span * _largest_of_each(solution.v)
    return bool(np.all(_largest_of_each(u) <= _ROUNDING * paths))


def _is_limited(solution: Any, fine: Companion) -> bool:
    """Return whether a smaller tolerance hardly shortens the steps: then it may not reduce the error either."""
    if solution.n_steps < _MANY_STEPS or fine.ratio > 1:
        return False
    expected = fine.ratio ** (-1 / solution.method.order) - 1
    return bool(fine.solution.n_steps / solution.n_steps - 1 < _FEW_MORE * expected)


def _by_order(
    seen: float | None, fine: Companion, coarse: Companion | None, order: int, is_tiny: bool, notes: list[str]
) -> tuple[float | None, float]:
    """Return the observed order and the factor of the differences from the finer run."""
    observed = None if seen is None or coarse is None else float(_order(seen, coarse.ratio, fine.ratio))
    is_known = observed is not None and observed <= order + _ABOVE
    if is_tiny and not (is_known and observed and observed >= order - _BELOW):
        notes.append(_NEAR_ROUND_OFF)
        return (observed if is_known else None), 1.0
    if coarse is not None and not is_known:
        notes.append(
            f"{coarse.name.capitalize()} does not follow the motion: the step is near the limit of stability, or long "
            "for the motion, and the order is not known."
        )
        observed = None
    return observed, 1 / (1 - fine.ratio ** max(_LEAST_ORDER, observed or order))


def _order(seen: Any, c: Any, r: Any) -> Any:
    """Solve (c^p - 1) / |1 - r^p| = seen for p, for numbers or arrays of shape (m,)."""
    low, high = np.full(np.shape(seen), _LOWEST), np.full(np.shape(seen), _HIGHEST)
    for _ in range(50):
        middle = (low + high) / 2
        is_low = (c**middle - 1) / np.abs(1 - r**middle) < seen
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    return low


class PlainErrors(NamedTuple):
    """The largest errors of the members of an ensemble for which `estimate` has no note, computed together.

    Attributes
    ----------
    chosen : ndarray of bool, shape (m,)
        These members.
    largest : dict of str to ndarray, shape (m,)
        As in `ErrorEstimate`; NaN for other members.
    order : ndarray, shape (m,)
    """

    chosen: np.ndarray
    largest: dict[str, np.ndarray]
    order: np.ndarray

    @classmethod
    def of(cls, solution: Any, fine: tuple[Any, float], coarse: tuple[Any, float] | None = None) -> PlainErrors:
        """Compare ensembles, each with its ratio. No member is chosen if their states are at different times."""
        m = len(solution)
        nothing = cls(np.zeros(m, dtype=bool), {}, np.full(m, np.nan))
        others = [fine, *filter(None, [coarse])]
        has_coarse = coarse is not None or solution.steps is not None
        if solution.events or not (has_coarse and all(_are_at_same_times(solution, x) for x, _ in others)):
            return nothing
        u = solution.u.reshape(*solution.u.shape[:2], -1)
        sizes = np.abs(u).max(axis=1)
        scale = np.maximum(sizes, np.maximum(_SMALL * sizes.max(axis=1, keepdims=True), np.finfo(float).tiny))
        with np.errstate(all="ignore"):  # members that failed
            relative = [(u - x.u.reshape(u.shape)) / scale[:, None] for x, _ in others]
            near, distances = relative[0], [np.sqrt(np.einsum("ijk,ijk->ij", x, x)) for x in relative]
            of_each = np.abs(near).max(axis=1)
            largest = of_each.max(axis=1)
            chosen = np.logical_and.reduce([solution.success, *(x.success for x, _ in others)])
            factor, order = np.ones(m), np.full(m, np.nan)
            if coarse is not None:
                seen = np.divide(*(np.sqrt(np.einsum("ij,ij->i", x, x)) for x in reversed(distances)))
                factor, order, is_clear = _factors(solution, seen, fine, coarse)
                chosen &= is_clear & (largest >= _ROUND_OFF) & (distances[1] < _CONVERGING).all(axis=1)
            span, speeds = solution.t[:, -1:] - solution.t[:, :1], np.abs(solution.v).reshape(u.shape).max(axis=1)
            is_seen = factor[:, None] * of_each * scale > _ROUNDING * (sizes + span * speeds)
            chosen &= (largest * factor < _NO_DIGIT) & is_seen.any(axis=1)
            pairs = {name: (getattr(solution, name), getattr(fine[0], name)) for name in ("u", "v")}
            for kind in ("outputs", "z", "drift"):
                pairs |= {name: (x, getattr(fine[0], kind)[name]) for name, x in getattr(solution, kind).items()}
            errors = {
                name: np.where(chosen, factor * _largest_of_members(x - y), np.nan) for name, (x, y) in pairs.items()
            }
        return cls(chosen, errors, np.where(chosen, order, np.nan))


def _largest_of_members(values: np.ndarray) -> Any:
    """Return the largest size of the values of each member, without NaN: an output may be 0 / 0 at the start."""
    return np.fmax.reduce(np.abs(values).reshape(len(values), -1), axis=1, initial=0.0)


def _factors(solution: Any, seen: np.ndarray, fine: tuple, coarse: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the factors of the differences from the finer ensemble, the orders, and whether they are clear."""
    if solution.steps is not None:
        return 1 / (1 - 1 / seen), np.full(len(seen), np.nan), (seen >= _LEAST_RATIO) & np.isfinite(seen)
    order, (r, c) = solution.method.order, (x.h / solution.h for x, _ in (fine, coarse))
    observed = _order(seen, c, r)
    is_clear = (observed >= order - _BELOW) & (observed <= order + _ABOVE)
    return np.abs(1 / (1 - r ** np.maximum(_LEAST_ORDER, observed))), observed, is_clear


def _are_at_same_times(one: Any, other: Any) -> bool:
    """Whether two ensembles have saved their states at the same times, but for round-off."""
    if one.t.shape != other.t.shape:
        return False
    least = 1e-3 * np.minimum(one.h, other.h)[:, None] if one.steps is None else 0.0
    return bool((np.abs(one.t - other.t) <= least).all())


def _lower(label: str, differences: Differences, ratios: tuple[float, float], observed: float, order: int) -> str:
    """Describe an order below the order of the method."""
    t = differences.t
    begin = t[0]
    for some in _windows(len(t)):
        seen = differences.ratio(some)
        if seen and _order(seen, *ratios) >= order - _BELOW:
            begin = t[min(some.stop, len(t) - 1)]
    since = "" if begin in (t[0], t[-1]) else f" from t = {begin:.4g} on"
    return (
        f"The run shows the order {observed:.1f}{since}, and {label} has the order {order}. It is lower if rhs has "
        "kinks or jumps, as from contacts, friction, impacts and records with corners, if h is still long for the "
        "motion, or if round-off is near."
    )


def _windows(count: int) -> Iterator[slice]:
    """Yield the parts of the common states."""
    edges = np.unique(np.linspace(0, count, _WINDOWS + 1).astype(int))
    return (slice(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _everywhere(t: np.ndarray, rows: np.ndarray, errors: np.ndarray, after: float) -> np.ndarray:
    """Return the errors of all saved states: interpolated between the common states, and `after` after the last."""
    if len(rows) == len(t):
        return errors
    found = np.full((len(t), *errors.shape[1:]), after)
    distances = np.diff(rows)
    if len(distances) and (distances == distances[0]).all():
        k, changes = int(distances[0]), np.diff(errors, axis=0)
        for j in range(k):
            found[rows[0] + j : rows[-1] : k] = errors[:-1] + (j / k) * changes
        found[rows[-1]] = errors[-1]
    elif len(rows):
        inside = slice(rows[0], rows[-1] + 1)
        columns = errors.reshape(len(rows), -1).T
        values = [np.interp(t[inside], t[rows], column) for column in columns]
        found[inside] = np.stack(values, axis=1).reshape(found[inside].shape)
    return found


def _reliable_until(solution: Any, u: np.ndarray, scale: Any) -> tuple[float | None, str]:
    """Return the last time at which a digit is right, and a sentence about the growth of the error.

    The error is compared with the motion up to each time: an angle may turn over many times later. A degree of freedom
    that has hardly begun to move, such as at the front of a wave, is compared with the others.
    """
    largest = _largest_of_each(u) / _with_others(np.atleast_1d(scale))
    if not np.fmax.reduce(largest, axis=None, initial=0.0) >= _NO_DIGIT:
        return None, ""
    t = solution.t
    relative = np.fmax.reduce(np.abs(u / _motion_until(solution.u, scale)).reshape(len(t), -1), axis=1)
    wrong = np.flatnonzero(relative >= _NO_DIGIT)
    if not len(wrong):
        return None, ""
    until = float(t[wrong[0] - 1]) if wrong[0] else -math.inf
    largest = np.maximum.accumulate(np.nan_to_num(relative[: wrong[0]]))
    some = np.flatnonzero((largest > _GROWING[0]) & (largest < _GROWING[1]))
    sentence = f"No digit of u is right after t = {until:.4g}."
    if wrong[0] <= 1:
        sentence = f"No digit of u is right at t = {t[wrong[0]]:.4g}, and no state is saved that shows since when."
    if len(some) < _FEWEST or t[some[0]] <= t[0]:
        return until, sentence
    log = np.log(largest[some])
    (rate, _), by_rate = _line(t[some], log)
    (_, _), by_power = _line(np.log(t[some] - t[0]), log)
    if by_rate < by_power:
        sentence += f" The error grows like exp({rate:.2g} t): the motion is sensitive to its start, or chaotic."
    return until, sentence


def _with_others(scale: Any) -> Any:
    """Return the scales of degrees of freedom, of which each is at least a part of the largest."""
    finite = np.max(scale, axis=-1, where=np.isfinite(scale), initial=0.0, keepdims=True)
    return np.maximum(scale, _HARDLY * finite)


def _motion_until(u: np.ndarray, scale: Any) -> np.ndarray:
    """Return the size of the motion up to each state, with the shape of u; at least a part of the whole motion."""
    sizes = np.abs(u).reshape(len(u), -1)
    np.maximum.accumulate(sizes, axis=0, out=sizes)
    sizes[:, np.atleast_1d(np.isinf(scale))] = np.inf
    return np.maximum(_with_others(sizes), _HARDLY * _with_others(np.atleast_1d(scale))).reshape(u.shape)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the line through some points, and the sum of its squared distances."""
    line, residuals, *_ = np.polyfit(x, y, 1, full=True)
    return line, float(np.sum(residuals))


def _of_events(solution: Any, other: Any, factor: float) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the errors of the times of events, and a sentence about each event whose counts differ."""
    errors, notes = {}, []
    for name, found in solution.events.items():
        others = other.events[name].t
        both = min(len(found.t), len(others))
        errors[name] = factor * (found.t[:both] - others[:both])
        if len(found.t) != len(others):
            notes.append(f"{name} occurs {len(found.t)} times, and {len(others)} times in the compared run.")
    return errors, notes


def _largest(values: Any) -> float:
    values = np.asarray(values)
    most, least = (each.reduce(values, axis=None, initial=0.0) for each in (np.fmax, np.fmin))
    return float(max(most, -least))
