"""Invariants and outputs along a run, which the kernel evaluates in every state: values, extremes, drift and growth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..functions.checks import reals
from ..functions.extremes import Extremes
from ..functions.guard import CELLS, are_untouched
from ..functions.quantities import Functions, Quantity
from ..kernels.protocol import COLUMN, HIGH, OUT, PART, PART_END, PARTS, ROWS, T_HIGH, T_LOW, Follow, Form, Within
from .samples import within_steps

_PAIRS, _FEWEST = 6, 4  # the largest and the least number of parts in which an invariant must grow to grow steadily
_NOTABLE = 1e-6  # least growth over the run that is noted, relative to the invariant
# The same of an energy less the work, relative to the larger of both. The errors of the work add up in a stable run
# too, to 2 % at resonance with EIG-3 and omega h = 0.2.
_NOTABLE_BALANCE = 0.1
_VISIBLE = 0.1  # least growth over the run that is noted, relative to the oscillation of the invariant in a part


class Followed:
    """The quantities that runs of a system follow, and where each has its place in the arrays of a `Follower`.

    Attributes
    ----------
    quantities : list of Quantity
        The invariants, then the outputs.
    invariants, outputs : dict of str to int
        The number of each quantity, by its name.
    work : list of int
        For each quantity, the degree of freedom whose velocity is the work that it takes away, or -1.
    writing : list of int
        The numbers of the quantities that write their values.
    columns : int
        The number of values of all quantities.
    advance : int
        The address of the function that advances the history of a right-hand side, or 0.
    project : int
        The address of the function that moves a state to the nearest one which keeps the constraints, or 0.
    """

    def __init__(self, functions: Functions, form: Form, advance: int = 0, project: int = 0) -> None:
        invariants, outputs = functions.quantities(form)
        self.advance, self.project = advance, project
        self.functions = functions
        self.quantities: list[Quantity] = [*invariants.values(), *outputs.values()]
        self.invariants = {name: k for k, name in enumerate(invariants)}
        self.outputs = {name: len(invariants) + k for k, name in enumerate(outputs)}
        self.work = [-1] * len(self.quantities)
        for name, k in self.invariants.items():
            work = functions.work_in(name)
            self.work[k] = -1 if work is None else work
        self.writing = [k for k, quantity in enumerate(self.quantities) if quantity.shape]
        self.table = np.zeros((len(self.quantities), 6), dtype=np.int64)
        self.columns, size = 0, CELLS
        for k, quantity in enumerate(self.quantities):
            width = quantity.width if quantity.shape else 0
            self.table[k] = quantity.callback.address, width, self.columns, size, 0, self.work[k]
            self.columns += quantity.width
            size += quantity.width + CELLS
        self._out_size = size
        self._places: dict[int, tuple[int, list[tuple[int, int, tuple[int, ...]]]]] = {}
        self._idle: dict[int, Follower] = {}

    @property
    def is_needed(self) -> bool:
        """Whether a run does something after each step."""
        return bool(self.quantities or self.advance or self.project)

    def follower(self, n: int) -> Follower:
        """Return a follower for a run. Runs without quantities share one for each n, in which nothing changes."""
        if self.quantities:
            return Follower(self, n)
        if n not in self._idle:
            self._idle[n] = Follower(self, n)
        return self._idle[n]

    def places(self, n: int) -> tuple[int, list[tuple[int, int, tuple[int, ...]]]]:
        """Return the size of `Follower.numbers`; and the begin, the end and the shape of each array there."""
        if n not in self._places:
            size, places = 0, []
            for shape in self._shapes(n).values():
                places.append((size, size + math.prod(shape), shape))
                size += math.prod(shape)
            self._places[n] = size, places
        return self._places[n]

    def _shapes(self, n: int) -> dict[str, tuple[int, ...]]:
        columns = self.columns
        return {
            "out": (self._out_size,),
            "extremes": (4, columns),
            "steps": (2, columns),
            "parts": (PARTS, 2, columns),
            "forward": (PARTS, n),
            "most": (len(self.quantities),),
            "start": (columns,),
            "before": (columns,),
        }


class Follower:
    """The quantities along one run.

    Parameters
    ----------
    followed : Followed
    n : int
        The number of degrees of freedom.

    Attributes
    ----------
    numbers : ndarray
        All that changes along the run. The other arrays are views of it.
    """

    def __init__(self, followed: Followed, n: int, numbers: np.ndarray | None = None) -> None:
        self.followed, self._n, (size, places) = followed, n, followed.places(n)
        self.numbers = np.zeros(size) if numbers is None else numbers
        self.table, arrays = followed.table.copy(), []
        for begin, end, shape in places:
            arrays.append(self.numbers[begin:end].reshape(shape))
        self.out, self.widest, self.steps, self.parts, self.forward, self.most, *others = arrays
        self.start, self.before = others  # the values at the start, and before the next step
        self.within: Within | None = None

    def begin(self, t: float, u: Any, v: Any, p: np.ndarray) -> None:
        """Evaluate the quantities at the start.

        Raises
        ------
        ValueError
            If a function does not write all of its values, or writes beyond them.
        """
        if not self.followed.quantities:
            return
        self.out.fill(np.nan)
        for k, quantity in enumerate(self.followed.quantities):
            values = self.values(k)
            quantity.at_start(t, u, v, p, values)
            self.start[self._columns(k)] = values
        self.before[:] = self.start
        self.widest[T_LOW] = self.widest[T_HIGH] = t
        for lowest, highest in (self.widest[: HIGH + 1], self.steps, self.parts[0]):
            lowest[:] = highest[:] = self.start

    def look_within(self, formulas: Any, rtol: float) -> None:
        """Let the extremes be those within steps of variable length too.

        An invariant that is nearly constant takes few evaluations: smaller relative changes than rtol within a step
        are not looked at.
        """
        if self.within is not None and not self.followed.quantities:
            return
        floors = np.zeros(len(self.followed.quantities))
        floors[: len(self.followed.invariants)] = rtol
        self._formulas, self._rtol = formulas, rtol
        self.within = within_steps(self.before, self._n, formulas, floors)

    def check(self) -> None:
        """Raise a ValueError if a function has written beyond its values."""
        for k in self.followed.writing:
            quantity, begin = self.followed.quantities[k], int(self.followed.table[k, OUT])
            end = begin + quantity.width
            if not (are_untouched(self.out[begin - CELLS : begin]) and are_untouched(self.out[end : end + CELLS])):
                raise quantity.written_beyond()

    def save_in(self, rows: Mapping[str, np.ndarray]) -> None:
        """Let the kernel write the values of outputs in saved states to these arrays, of shape (rows, width)."""
        for name, array in rows.items():
            self.table[self.followed.outputs[name], ROWS] = array.__array_interface__["data"][0]

    def record(self) -> Follow:
        """The arguments of the kernel."""
        arrays = self.table, self.out, self.widest, self.steps, self.parts, self.forward, self.most
        return Follow(*arrays, self.followed.advance, self.followed.project)

    def fork(self) -> Follower:
        """Return an independent copy, which saves no values."""
        if not self.followed.quantities:
            return self
        other = Follower(self.followed, self._n, self.numbers.copy())
        if self.within is not None:
            other.look_within(self._formulas, self._rtol)
        return other

    def checked(self, numbers: Any) -> np.ndarray:
        """Return numbers that come from a file, if they can be those of this follower."""
        numbers = reals(numbers, "the numbers of quantities")
        if numbers.shape != self.numbers.shape:
            raise ValueError("the numbers of the invariants and outputs have another shape.")
        return numbers

    def values(self, k: int) -> np.ndarray:
        """The values of a quantity in the latest state, shape (width,)."""
        begin = int(self.followed.table[k, OUT])
        return self.out[begin : begin + self.followed.quantities[k].width]

    def present_outputs(self) -> dict[str, Any]:
        """Return the values of each output in the latest state."""
        result = {}
        for name, k in self.followed.outputs.items():
            result[name] = self.values(k) if self.followed.quantities[k].shape else self.values(k)[0]
        return result

    def _columns(self, k: int) -> slice:
        begin = int(self.followed.table[k, COLUMN])
        return slice(begin, begin + self.followed.quantities[k].width)

    def extremes(self) -> dict[str, Extremes]:
        """The extremes of each invariant and output so far."""
        result = {}
        for name, k in (*self.followed.invariants.items(), *self.followed.outputs.items()):
            rows = self.widest[:, self._columns(k)]
            has_shape = bool(self.followed.quantities[k].shape)
            result[name] = Extremes(*(row.copy() if has_shape else float(row[0]) for row in rows))
        return result

    def drift(self) -> dict[str, float]:
        """The maximum of |e_n - e_0| of each invariant over the ends of steps and the events; NaN if e became NaN."""
        return {name: self.drift_of(k) for name, k in self.followed.invariants.items()}

    def drift_of(self, k: int) -> float:
        """The drift of one invariant."""
        (low, high), start = self.steps[:, self._column(k)], self.start[self._column(k)]
        return float(np.maximum(start - low, high - start))

    def start_of(self, k: int) -> float:
        """The value of an invariant at the start."""
        return float(self.start[self._column(k)])

    def growth(self, name: str, tally: np.ndarray, index: int) -> float:
        """The growth of an invariant e over the run, relative to e.

        It is 0.0 if e did not grow steadily, and infinite if e overflowed. The growth of an energy less the work is
        relative to the larger of the two, of which it is the difference.

        The growth is steady if e grows from each of the last parts of the run to the next. A part is longer by a fifth
        than the part before it, so that the parts do not all end in the same phase of a periodic motion, and the last
        ones cover nearly all of the run. It is 0.0 if no velocity has changed its sign at least twice from one end of a
        part to the next: the run may then be shorter than a period, and the error of e only follows the motion.

        Parameters
        ----------
        name : str
        tally : ndarray
        index : int
            Number of steps taken.
        """
        k = self.followed.invariants[name]
        column, is_balance = self._column(k), self.followed.work[k] >= 0
        start = self.start_of(k)
        low, high, forward, places = self._last_parts(column, tally, index)
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
            or np.isnan(self.steps[:, column]).any()
        ):
            return 0.0
        if n_finite < len(middle):
            return math.inf
        growth = float(middle[-1] - middle[0]) * index / (places[-1] - places[0])
        if is_balance:
            size, notable = max(abs(start), float(self.most[k])) or growth, _NOTABLE_BALANCE
        else:
            size, notable = abs(start) or growth, _NOTABLE
        if growth > size:
            # So fast a growth is not as in a straight line.
            growth = float(high[-1] - start)
        return growth / size if growth > max(notable * size, _VISIBLE * np.median(width)) else 0.0

    def _last_parts(self, column: int, tally: np.ndarray, index: int) -> tuple[np.ndarray, ...]:
        """Return the lowest and the highest value in each of the last parts, the signs of v at their ends, and the step
        indices in their middle.

        The part in which the run ended is one with the part before it, unless it is complete.
        """
        part = int(tally[PART])
        ends = [0, 1]
        while len(ends) < part + 2:
            ends.append(ends[-1] + max(1, ends[-1] // 5))  # as the kernel divides the run
        rows = np.arange(max(0, part + 1 - PARTS), part + 1) % PARTS
        (low, high), forward = self.parts[rows, :, column].T, self.forward[rows]
        if len(rows) > 1 and index < tally[PART_END]:
            low[-2], high[-2] = min(low[-2], low[-1]), max(high[-2], high[-1])
            low, high, forward = low[:-1], high[:-1], forward[:-1]
            del ends[-2]
        ends[-1] = index
        # Two parts together are long enough to hold some periods, and the last six such pairs are most of the run.
        pairs = min(_PAIRS, len(low) // 2)
        begin = len(low) - 2 * pairs
        low, high = np.minimum(low[begin::2], low[begin + 1 :: 2]), np.maximum(high[begin::2], high[begin + 1 :: 2])
        places = (np.array(ends[-2 * pairs - 1 : -2 : 2]) + ends[len(ends) - 2 * pairs + 1 :: 2]) / 2
        return low, high, forward, places

    def _column(self, k: int) -> int:
        return int(self.followed.table[k, COLUMN])
