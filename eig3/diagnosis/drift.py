"""Assess an invariant of a run: steady growth, and the drift relative to the terms of which it is the sum."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..kernels.protocol import PART, PART_END, PARTS
from ..stepping.stepper import Stepper
from ..stepping.variable_stepper import VariableStepper

_BEYOND = 10.0  # least reported drift, relative to the terms at the start
_SHOWN = 0.05  # and relative to the terms at the end: near an unstable position, the terms at the start are small
_STEPS = 10  # additional steps whose velocities count at the end
_PAIRS, _FEWEST = 6, 4  # the largest and the least number of parts of a run in which an invariant must grow
_NOTABLE = 1e-6  # least reported growth over the run, relative to the invariant
# Least reported growth of an energy minus the work, relative to the larger of both. The errors of the work also
# accumulate in a stable run, to 2 % at resonance with EIG-3 and omega h = 0.2.
_NOTABLE_BALANCE = 0.1
# An invariant below the first part of its terms is a small difference, such as an energy that is 0 at the start; but a
# motion that begins with little energy has grown by more than the second part of them.
_SMALL, _GROWN = 0.01, 0.1
_VISIBLE = 0.1  # least reported growth over the run, relative to the oscillation of the invariant in a part


def excess(march: Stepper | VariableStepper, k: int, h: float) -> float:
    """Return the drift of the invariant k relative to its terms at the start; 0.0 if it is not far beyond them.

    The terms are the value without velocities and the change by the velocities. Velocities enter by their magnitudes,
    with different weights, to avoid cancellation in a momentum. The work is a term of an energy minus the work. At the
    end, the velocities of some more steps are included, because the motion may be at a turning point. `march` is at the
    end of the run, and h is the step, or the mean step.
    """
    assert march.look
    look = march.look
    drift = look.drift_of(k)
    if not drift > _BEYOND * abs(look.start_of(k)):  # as in nearly all runs
        return 0.0
    at_start, at_end = _terms(march, k, march.t0, *march.start, 0.0), _terms_at_end(march, k, h)
    return drift / at_start if at_start > 0 and drift > max(_BEYOND * at_start, _SHOWN * at_end) else 0.0


def _terms(march: Stepper | VariableStepper, k: int, t: float, u: Any, v: Any, more: Any) -> float:
    """Return the size of the terms of an invariant at a state; 0.0 where it fails, as at other velocities."""
    look: Any = march.look
    invariant, work = look.followed.quantities[k].callback, look.followed.work[k]
    with np.errstate(over="ignore", invalid="ignore"):
        speeds = (np.abs(v) + np.abs(more)) * (1 + np.cos(np.arange(march.n) ** 2.0) / 2 if np.ndim(v) else 1.0)
        if work >= 0:
            speeds[work] = 0.0
        try:
            rest = invariant.call(t, u, 0 * speeds, march.p)
            return abs(rest) + abs(invariant.call(t, u, speeds, march.p) - rest) + float(look.most[k])
        except Exception:
            return 0.0


def _terms_at_end(march: Stepper | VariableStepper, k: int, h: float) -> float:
    """Return the size of the terms with the velocities of some more steps."""
    t, u, v = march.t, march.u, march.v
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            more = _STEPS * h * march.acceleration(t, u, v)
        except Exception:  # a function may fail where it ended the run
            return 0.0
    return _terms(march, k, t, u, v, more)


def growth(march: Stepper | VariableStepper, k: int, h: float) -> float:
    """Return the growth of the invariant k, e, over the run, relative to e; the arguments are as for `excess`.

    It is 0.0 if e did not grow steadily, and infinite if e overflowed. The growth of an energy minus the work is
    relative to the larger of the two, and the growth of a small difference of large terms to the terms at the end.

    The growth is steady if e grows from each of the last parts of the run to the next part. A part is longer by a fifth
    than the previous part: the parts then end in different phases of a periodic motion, and the last parts cover nearly
    all of the run. The growth is 0.0 if no velocity has changed its sign at least twice between the ends of parts: the
    run may then be shorter than a period, and the error of e only follows the motion.
    """
    look: Any = march.look
    column, start = look.column(k), look.start_of(k)
    low, high, forward, places = _last_parts(march, column)
    with np.errstate(invalid="ignore"):
        middle, width = (low + high) / 2, high - low
    n_finite = int(np.argmin(np.append(np.isfinite(middle), False)))  # number of parts before e overflows
    steady = (np.diff(middle[:n_finite]) > 0).all()
    turns = (forward[1:] != forward[:-1]).sum(axis=0)
    if (
        n_finite < _FEWEST / 2
        or len(middle) < _FEWEST
        or not steady
        or turns.max() < 2
        or np.isnan(look.steps[:, column]).any()
    ):
        return 0.0
    if n_finite < len(middle):
        return math.inf
    growth = float(middle[-1] - middle[0]) * march.index / (places[-1] - places[0])
    if look.followed.work[k] >= 0:
        size, notable = max(abs(start), float(look.most[k])), _NOTABLE_BALANCE
    else:
        size, notable = abs(start), _NOTABLE
    terms = _terms_at_end(march, k, h)
    size = (terms if size < _SMALL * terms and growth < _GROWN * terms else size) or growth
    if growth > size:
        # Such fast growth is not linear.
        growth = float(high[-1] - start)
    return growth / size if growth > max(notable * size, _VISIBLE * np.median(width)) else 0.0


def _last_parts(march: Stepper | VariableStepper, column: int) -> tuple[np.ndarray, ...]:
    """Return the lowest and the highest value in each of the last parts, the signs of v at their ends, and the step
    indices in their middle.

    An incomplete last part is merged with the previous part.
    """
    look, counters, index = march.look, march.counters, march.index
    assert look
    part = int(counters[PART])
    ends = [0, 1]
    while len(ends) < part + 2:
        ends.append(ends[-1] + max(1, ends[-1] // 5))  # the same division as in the kernel
    rows = np.arange(max(0, part + 1 - PARTS), part + 1) % PARTS
    (low, high), forward = look.parts[rows, :, column].T, look.forward[rows]
    if len(rows) > 1 and index < counters[PART_END]:
        low[-2], high[-2] = min(low[-2], low[-1]), max(high[-2], high[-1])
        low, high, forward = low[:-1], high[:-1], forward[:-1]
        del ends[-2]
    ends[-1] = index
    # Two parts together are long enough to contain some periods, and the last six such pairs are most of the run.
    pairs = min(_PAIRS, len(low) // 2)
    begin = len(low) - 2 * pairs
    low, high = np.minimum(low[begin::2], low[begin + 1 :: 2]), np.maximum(high[begin::2], high[begin + 1 :: 2])
    places = (np.array(ends[-2 * pairs - 1 : -2 : 2]) + ends[len(ends) - 2 * pairs + 1 :: 2]) / 2
    return low, high, forward, places
