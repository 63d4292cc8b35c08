"""The states of the members in the lanes of a block, and the kernel that advances them."""

from __future__ import annotations

import numpy as np

from ..functions.guard import written_beyond
from ..kernels.lanes import BlockLayout
from ..kernels.protocol import DUE, EVALUATIONS, EVENTS, PART_END, SPACING, T_LOW, Steps
from ..result.memory import aligned
from ..stepping.followed import spacing_of
from ..stepping.march import Cancel
from ..stepping.run_options import NEVER
from ..stepping.slices import Slices
from .lane_observer import LaneObserver
from .lanewise import Setup
from .members import Members
from .named_lanes import NamedLanes

_GUARD_ROWS = 4  # of NaN on each side of u, v and a in the first evaluation
_ON_GRID = 1e-6  # of a step: an event that is nearer to the end of a step, but for round-off, is there


class LaneState:
    """One state in each lane.

    If the members have different steps, the kernel uses the step as the unit of time: its step is 1, its velocity h v.
    `members` are the members of each lane.

    Attributes
    ----------
    h : ndarray, shape (lanes,)
        The steps.
    index : int
        Number of steps taken.
    first_acceleration : ndarray, shape (n, lanes)
        The accelerations at the start.
    observer : LaneObserver
    seconds : float
        Time in the kernel, s.
    """

    def __init__(self, shared: Setup, everyone: Members, members: np.ndarray) -> None:
        layout, formulas = shared.layout, shared.method.formulas
        self.layout, self.t0, self.index, self.seconds = layout, everyone.t_span[0], 0, 0.0
        self.h = np.ascontiguousarray(everyone.steps[members])
        self._unit = self.h if layout.has_own_step else np.ones(layout.lanes)
        self._clock = (1.0, 0.0) if layout.has_own_step else (float(self.h[0]), self.t0)  # h and t0 of the kernel
        self._rhs, self._kernel = shared.rhs, shared.kernel
        self._callbacks = shared.rhs.address, shared.constrained_step.address if shared.constrained_step else None
        self._slices = Slices(shared.pace.seconds)
        self._method, self._counters = shared.method, np.zeros(EVENTS)
        self._set_numbers(everyone.first + members)
        self._counters[PART_END], self._counters[DUE] = NEVER, 1
        self._counters[SPACING] = spacing_of(shared.histories.options.functions.invariants_every)
        self._p = self._params(layout, everyone, members, shared.named)
        u, v = (np.ascontiguousarray(x[members].T) for x in (everyone.u0, everyone.v0))
        v *= self._unit
        a = self._first_evaluation(u, v)
        self.first_acceleration = a / self._unit**2
        self._state = aligned((formulas.state_rows(u.size), u.size))
        self._rows = self._state.reshape(-1, *u.shape)
        for row, values in zip(self._rows, (u, v, *formulas.start(u, v, a, self._clock[0])), strict=False):
            row[:] = values
        self.observer = LaneObserver(shared, everyone, members, self._unit)
        self.observer.begin(self._clock[1], u.ravel(), v.ravel(), self._p)
        self._searches = bool(shared.events)
        looks = shared.quantities or shared.events or shared.project
        self._look = self.observer.record if looks else None
        self._saves = {name: (shared.quantities[name][0].width, layout.lanes) for name in shared.histories.outputs}
        self._reserve(0)

    def _set_numbers(self, numbers: np.ndarray) -> None:
        """Give the method the number of the member in each lane."""
        self._numbers = numbers
        self._settings = np.array(self._method.settings_of(numbers.tolist()), dtype=np.float64)

    def _params(
        self, layout: BlockLayout, everyone: Members, members: np.ndarray, named: NamedLanes | None
    ) -> np.ndarray:
        """Return the array p of the kernel."""
        p = aligned((layout.size,))
        p[:] = np.nan  # rhs gets NaN if it reads beyond the parameters
        if layout.shared:
            p[: layout.shared] = everyone.params[0] if everyone.has_own_params else everyone.params
        if layout.own:
            own = everyone.params[members] if named is None else everyone.params[np.ix_(members, named.columns)]
            p[layout.shared : layout.params_size] = own.T.ravel()
        if layout.has_own_step:
            steps = p[layout.begin_of_steps :].reshape(-1, layout.lanes)
            steps[0], steps[1] = self.h, self.t0
        return p

    def _first_evaluation(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Evaluate rhs at the start, on arrays between guard values. An entry that rhs does not write stays NaN.

        Raises
        ------
        ValueError
            If rhs writes beyond the end of a.
        """
        buffers = np.full((3, len(u) + 2 * _GUARD_ROWS, self.layout.lanes), np.nan)
        inside = slice(_GUARD_ROWS, -_GUARD_ROWS)
        buffers[0, inside], buffers[1, inside] = u, v
        self._rhs.call(self._clock[1], *(x[inside].ravel() for x in buffers[:2]), self._p, buffers[2, inside].ravel())
        a = buffers[2, inside].copy()
        buffers[2, inside] = np.nan
        if not np.isnan(buffers[2]).all():
            raise written_beyond(len(u))
        return a

    @property
    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """u and v, of shape (n, lanes)."""
        return self._rows[0], self._rows[1] / self._unit

    @property
    def sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """The largest |u| and the largest |v| in each lane."""
        u, v = self.values
        return np.abs(u).max(axis=0), np.abs(v).max(axis=0)

    @property
    def is_finite(self) -> np.ndarray:
        """A mask of the lanes whose state is finite."""
        return np.isfinite(self._rows[:2]).all(axis=(0, 1))

    @property
    def n_rhs(self) -> np.ndarray:
        """Number of evaluations of rhs for the member in each lane, including the evaluation at the start."""
        return self.observer.evaluations + (1 + int(self._counters[EVALUATIONS]))

    def advance(self, target: int, every: int, stop: Cancel) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Advance to a step index, or less far if `stop` is set.

        Returns
        -------
        u, v : ndarray, shape (states, n, lanes)
            The states whose step index is a multiple of `every`. The next call overwrites them.
        outputs : dict of str to ndarray, shape (states, k, lanes)
            The values of the outputs in these states. The next call overwrites them too.

        Raises
        ------
        ValueError
            If a quantity has written beyond its values.
        """
        first, (h, t0) = self.index, self._clock
        if target // every - first // every > len(self._u):
            self._reserve(target // every - first // every)
        u, v = (x.reshape(-1, self._state.shape[1]) for x in (self._u, self._v))
        while self.index < target:
            steps, *begun = self._slices.begin(target - self.index)
            written = self.index // every - first // every
            given = Steps(h, t0, self._p, self.index, steps, every, written, u, v)
            taken, *_ = self._kernel(self._callbacks, self._state, self._settings, self._counters, given, self._look)
            self.seconds += self._slices.end(taken, *begun)
            self.index += taken
            if self._searches:
                self.observer.collect()
            if stop.is_set():
                break
        self.observer.check()
        states = self.index // every - first // every
        if self.layout.has_own_step:
            self._v[:states] /= self._unit
        return self._u[:states], self._v[:states], {name: rows[:states] for name, rows in self._outputs.items()}

    def _reserve(self, states: int) -> None:
        """Reserve space for saved states and their outputs."""
        self._u, self._v = np.empty((2, states, *self._rows.shape[1:]))
        self._outputs = {name: np.empty((states, *shape)) for name, shape in self._saves.items()}
        self.observer.save_in(self._outputs)

    def save(self) -> tuple[int, np.ndarray, np.ndarray, list[np.ndarray]]:
        """Return a copy of the states, for `restore`."""
        return self.index, self._state.copy(), self._counters.copy(), self.observer.save()

    def restore(self, saved: tuple[int, np.ndarray, np.ndarray, list[np.ndarray]]) -> None:
        """Go back to states that `save` has returned."""
        self.index, self._state[:], self._counters[:], observed = saved
        self.observer.restore(observed)

    def repeat(self, model: int, lanes: np.ndarray) -> None:
        """Copy a lane to the lanes of a mask."""
        self._rows[:, :, lanes] = self._rows[:, :, model, None]
        self.h[lanes] = self.h[model]
        layout = self.layout
        p = self._p[layout.shared if layout.own else layout.begin_of_steps :].reshape(-1, layout.lanes)
        p[:, lanes] = p[:, model, None]
        self._set_numbers(np.where(lanes, self._numbers[model], self._numbers))
        self.observer.rest(lanes)

    def extremes(self, name: str) -> np.ndarray:
        """The minimum and the maximum of a quantity so far, and the numbers of steps to their times: (4, k, lanes)."""
        return self.in_steps(self.observer.extremes(name))

    def in_steps(self, extremes: np.ndarray) -> np.ndarray:
        """Return extremes of all lanes with numbers of steps in place of times of the kernel.

        A number is no integer if the extreme is at an event within a step.
        """
        h, t0 = self._clock
        places = (extremes[T_LOW:] - t0) / h
        nearest = np.rint(places)
        return np.concatenate([extremes[:T_LOW], np.where(abs(places - nearest) < _ON_GRID, nearest, places)])

    def unwritten(self) -> np.ndarray:
        """Return a mask of shape (n, lanes): the entries of a that rhs did not write in the last step."""
        (u, v), (h, t0) = self._rows[:2], self._clock
        a, other = np.full_like(u, np.nan), np.zeros_like(u)
        try:
            for filled in (a, other):  # a method need not evaluate rhs at the end of a run
                self._rhs.call(t0 + (self.index - 1) * h, u.ravel(), v.ravel(), self._p, filled.ravel())
        except Exception:  # rhs may fail at a time at which the method does not evaluate it
            return np.zeros(u.shape, dtype=bool)
        return np.isnan(a) & (other == 0)  # a value that rhs computes may be NaN too
