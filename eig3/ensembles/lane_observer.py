"""The observer of each fixed step in the lanes of a block: invariants, outputs and events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..functions.guard import are_untouched
from ..kernels.lanes import Lanes
from ..kernels.loops.fixed import work_rows
from ..kernels.loops.lane_search import (
    END_EVENT,
    END_STATE,
    END_STEP,
    END_TIME,
    IDLE,
    SEARCHED,
    LaneWatch,
)
from ..kernels.loops.zeros import LAST, SIDE
from ..kernels.protocol import (
    ADDRESS,
    COLUMN,
    EVENT_COLUMNS,
    EVENT_VALUES,
    EVENTS,
    HIGH,
    LOW,
    OUT,
    ROWS,
    WIDTH,
    WORK,
    Follow,
    Look,
    Watch,
)
from ..stepping.observer import Observer
from .lanewise import Setup
from .members import Members

_GUARD_ROWS = 4  # of NaN on each side of the values of a quantity
_NONE = np.empty((2, 0))
_LOG_ROWS = 4096  # least number of occurrences in the log of a block
_NO_WATCH = Watch(
    np.empty((0, EVENT_COLUMNS), dtype=np.int64), _NONE, np.empty(0), np.empty(0), _NONE, _NONE, _NONE, _NONE
)


class Values:
    """Functions of the state, with their numbers of values, that are evaluated in all lanes, and their extremes."""

    def __init__(self, functions: Sequence[tuple[Lanes, int]], lanes: int) -> None:
        self._functions = functions
        self.table = np.zeros((len(functions), 6), dtype=np.int64)
        column, place = 0, _GUARD_ROWS * lanes
        for k, (function, count) in enumerate(functions):
            self.table[k, [ADDRESS, WIDTH, COLUMN, OUT, WORK]] = function.address, lanes * count, column, place, -1
            column, place = column + lanes * count, place + lanes * (count + _GUARD_ROWS)
        self.numbers = np.full(place + 4 * column, np.nan)  # all values that change during the run
        self.out, self.extremes = self.numbers[:place], self.numbers[place:].reshape(4, column)
        self.extremes[LOW], self.extremes[HIGH] = np.inf, -np.inf

    def follow(self, invariants: int, project: int = 0) -> Follow:
        """Return the argument of the kernel."""
        arrays = self.table, self.out, self.extremes, _NONE, _NONE.reshape(0, 2, 0), _NONE, np.empty(0)
        return Follow(*arrays, invariants, project=project)

    def evaluate(self, t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray) -> None:
        """Evaluate the functions, with the values of the kernel."""
        for k, (function, _) in enumerate(self._functions):
            function.call(t, u, v, p, self.of(k), *self.extremes[:, self.columns(k)])

    def of(self, k: int) -> np.ndarray:
        """The values of a function in the latest state."""
        begin = int(self.table[k, OUT])
        return self.out[begin : begin + int(self.table[k, WIDTH])]

    def columns(self, k: int) -> slice:
        begin = int(self.table[k, COLUMN])
        return slice(begin, begin + int(self.table[k, WIDTH]))


class LaneObserver:
    """The quantities and the events of the members in the lanes of a block.

    `members` are the members of each lane, and `unit` the factors of v in the kernel.

    Attributes
    ----------
    record : Look
        The argument of the kernel.
    numbers : tuple of ndarray
        All values that change during the run.
    start : dict of str to ndarray, shape (k, lanes)
        The values of the quantities at the start.
    """

    def __init__(self, shared: Setup, everyone: Members, members: np.ndarray, unit: np.ndarray) -> None:
        self._lanes, self._quantities = shared.layout.lanes, [q for q, _ in shared.quantities.values()]
        functions = [(function, quantity.width) for quantity, function in shared.quantities.values()]
        self._rows, self._values = {name: k for k, name in enumerate(shared.quantities)}, Values(functions, self._lanes)
        invariants, project = len(shared.histories.drift), shared.project.address if shared.project else 0
        follow, self._watch = self._values.follow(invariants, project), None
        if shared.events:
            self._watch = self._watching(shared, everyone, members, unit)
        self.record = Look(self._watch or _NO_WATCH, follow)
        self.numbers: tuple[np.ndarray, ...] = (self._values.numbers,)
        if self._watch:
            watch = self._watch
            changing = self._g.numbers, watch.counters, watch.doing, watch.evaluations, watch.ends, watch.last
            self.numbers += (*changing, watch.extremes)
        self._found: list[tuple[np.ndarray, np.ndarray]] = []  # the lanes and the rows of the log so far

    def _watching(self, shared: Setup, everyone: Members, members: np.ndarray, unit: np.ndarray) -> LaneWatch:
        """Return the part of the argument of the kernel for events."""
        system, n, lanes, count = shared.prepared.system, everyone.n, self._lanes, len(shared.places)
        self._g = Values(shared.events, lanes)
        alone = Observer(system, None, n, work_rows(shared.method.formulas, system.method.order))
        look = alone.arguments
        log = np.empty((max(_LOG_ROWS, 4 * count), 2 + 4 * n))
        own = shared.named.columns if shared.named else np.arange(everyone.params.shape[-1])
        own = own if everyone.has_own_params else own[:0]
        may_search = not (shared.project or shared.constrained_step or look.follow.advance)
        width = self._values.extremes.shape[1]
        self._alone = alone, system.callback  # whose memory the kernel reads
        return LaneWatch(
            look=look._replace(watch=look.watch._replace(log=log)),
            rhs=system.callback.address,
            may_search=int(may_search),
            t0=everyone.t_span[0],
            p=np.array(everyone.params[members[0]] if everyone.has_own_params else everyone.params),
            own=own,
            first_own=shared.layout.shared,
            values=self._g.follow(0),
            places=np.array([self._g.table[k, OUT] + lanes * j for k, j in shared.places], dtype=np.int64),
            columns=np.array([self._g.table[k, COLUMN] + lanes * j for k, j in shared.places], dtype=np.int64),
            has_crossed=np.zeros(lanes),
            doing=np.full(lanes, SEARCHED),
            h=np.ascontiguousarray(everyone.steps[members]),
            unit=unit.astype(float),
            before=np.empty((2, n * lanes)),
            counters=np.zeros((lanes, EVENTS + EVENT_VALUES * count)),
            evaluations=np.zeros(lanes),
            n_logged=np.zeros(1, dtype=np.int64),
            lane_of_row=np.empty(len(log), dtype=np.int64),
            ends=np.full((END_STATE + 2 * n, lanes), np.nan),
            last=np.empty(width),
            extremes=np.empty((4, width)),
        )

    def begin(self, t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray) -> None:
        """Observe the start, with the values of the kernel."""
        self._values.evaluate(t, u, v, p)
        self.check()
        self.start = {name: self.latest(name).copy() for name in self._rows}
        if self._watch:
            self._g.evaluate(t, u, v, p)
            values = self._watch.counters[:, EVENTS:].reshape(self._lanes, -1, EVENT_VALUES)
            values[..., LAST] = -np.inf
            for k, (place, column) in enumerate(zip(self._watch.places, self._watch.columns, strict=True)):
                g = values[:, k, SIDE] = self._g.out[place : place + self._lanes]
                self._g.extremes[LOW, column : column + self._lanes] = np.where(g == 0, np.nan, g)

    def save_in(self, rows: Mapping[str, np.ndarray]) -> None:
        """Make the kernel write the values in saved states to these arrays, of shape (states, k, lanes)."""
        for name, array in rows.items():
            self._values.table[self._rows[name], ROWS] = array.ctypes.data

    def check(self) -> None:
        """Raise a ValueError if a function has written beyond its values."""
        guards, end, table, out = _GUARD_ROWS * self._lanes, 0, self._values.table, self._values.out
        for k, quantity in enumerate(self._quantities):
            begin, end = end, int(table[k, OUT] + table[k, WIDTH])
            if not (are_untouched(out[begin : begin + guards]) and are_untouched(out[end : end + guards])):
                raise quantity.written_beyond()

    def latest(self, name: str) -> np.ndarray:
        """The values of a quantity in the latest state, shape (k, lanes)."""
        return self._values.of(self._rows[name]).reshape(-1, self._lanes)

    def extremes(self, name: str) -> np.ndarray:
        """The minimum and the maximum so far, and their times in the kernel, shape (4, k, lanes)."""
        return self._values.extremes[:, self._values.columns(self._rows[name])].reshape(4, -1, self._lanes)

    def doing(self, what: float) -> np.ndarray | bool:
        """Return a mask of the lanes that do something: see `eig3.kernels.loops.lane_search.SEARCHED`."""
        return self._watch.doing == what if self._watch else what == SEARCHED

    def rest(self, lanes: np.ndarray) -> None:
        """Do not look for events in the lanes of a mask."""
        if self._watch:
            self._watch.doing[lanes] = IDLE
            self._g.extremes[LOW].reshape(-1, self._lanes)[:, lanes] = 0.0

    @property
    def evaluations(self) -> np.ndarray:
        """The evaluations of the right-hand side in the searches of each lane."""
        return self._watch.evaluations.astype(np.int64) if self._watch else np.zeros(self._lanes, dtype=np.int64)

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The time, the event, the step index, u and v, shape (n, lanes), where events have ended members."""
        assert self._watch
        ends, n = self._watch.ends, (len(self._watch.ends) - END_STATE) // 2
        states = ends[END_STATE : END_STATE + n], ends[END_STATE + n :]
        return ends[END_TIME], ends[END_EVENT], ends[END_STEP], *states

    def at_end(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The values and the extremes of a quantity there, as `latest` and `extremes`."""
        assert self._watch
        columns = self._values.columns(self._rows[name])
        last, extremes = self._watch.last[columns], self._watch.extremes[:, columns]
        return last.reshape(-1, self._lanes), extremes.reshape(4, -1, self._lanes)

    def collect(self) -> None:
        """Take the occurrences out of the log."""
        if self._watch and self._watch.n_logged[0]:
            some = slice(int(self._watch.n_logged[0]))
            self._found.append((self._watch.lane_of_row[some].copy(), self._watch.look.watch.log[some].copy()))
            self._watch.n_logged[0] = 0

    def found(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the lanes and the rows of the occurrences since the last call, in their order."""
        while self._found:
            yield self._found.pop(0)

    def save(self) -> list[np.ndarray]:
        """Return a copy of what changes, for `restore`."""
        return [x.copy() for x in self.numbers]

    def restore(self, saved: list[np.ndarray]) -> None:
        """Go back to what `save` has returned."""
        for x, before in zip(self.numbers, saved, strict=True):
            x[...] = before
        self._found.clear()
