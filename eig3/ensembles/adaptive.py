"""Members with tolerances that run in the lanes of SIMD registers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.adaptive_lanes import (
    ENDED,
    EVALUATED,
    OPEN,
    REACHED,
    REJECTED,
    TAKEN,
    TERMINATED,
    Block,
    Trajectories,
    rows_of,
)
from ..kernels.lane_events import Sight
from ..kernels.loops.formulas import variable_formulas
from ..kernels.protocol import EVENT_VALUES, EVENTS, SEARCHES, Span
from ..result.memory import aligned
from ..stepping.march import Cancel
from ..stepping.observer import Observer
from ..stepping.run_options import NEVER
from ..stepping.slices import Slices
from .lanewise import Setup
from .single_members import Alone

_NONE, _NO_STATES = np.empty(0), np.empty((0, 0))


class AdaptiveBlock(Alone):
    """Some members that run one after another in the lanes of a block.

    Members that the lanes cannot complete run again as single runs.

    Parameters
    ----------
    shared : Setup
    numbers : ndarray of int
        The consecutive numbers of the members.
    """

    def __init__(self, shared: Setup, numbers: np.ndarray) -> None:
        super().__init__(numbers, shared.histories, shared.single)
        self.shared, self._tolerances = shared, shared.prepared.tolerances(shared.layout.n)

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        shared, histories = self.shared, self.histories
        looks = self._looks() if shared.prepared.system.looks == SEARCHES else (None, None)
        ends = self._march(stop, *looks)
        how = ends.counts[:, ENDED]
        reached, stopped = (how == REACHED) | (how == TERMINATED), how == TERMINATED
        t = np.full(len(how), histories.members.t_span[1])
        if looks[0]:
            t[stopped] = looks[0].stops[stopped, 0]
        counts = (ends.counts[reached, column] for column in (TAKEN, REJECTED, EVALUATED))
        histories.reach(self.numbers[reached], t[reached], ends.u[reached], ends.v[reached], *counts)
        if looks[0]:
            self._store(looks[0], reached, stopped)
        self.run_alone(self.numbers[~reached], stop)

    def _march(self, stop: Cancel, sight: Sight | None, look: Any) -> Trajectories:
        """Run the lanes in slices, and check `stop` between them."""
        shared, members, numbers = self.shared, self.histories.members, self.numbers
        params = members.params[numbers] if members.has_own_params else members.params[None]
        counts = np.zeros((len(numbers), 4), dtype=np.int64)
        # the right-hand side of one member may write to the table of its constraints
        trajectories = Trajectories(members.u0[numbers], members.v0[numbers], params.copy(), counts)
        callback, project = shared.prepared.system.callback, shared.project.address if shared.project else 0
        block, span, slices = self._block(), self._span(int(callback.reads_time)), Slices(None)
        while block.place[OPEN] and not stop.is_set():
            count, *begun = slices.begin(NEVER)
            addresses = shared.rhs.address, callback.address, project
            taken = shared.kernel(*addresses, count, span, block, trajectories, sight, look)
            self.seconds += slices.end(taken, *begun)
            if sight and sight.logged[0]:
                logged = slice(sight.logged[0])
                self._found.append((sight.members[logged].copy(), look.watch.log[logged].copy()))
                sight.logged[0] = 0
        return trajectories

    def _span(self, reads_time: int) -> Span:
        """Return the span and the tolerances."""
        members = self.histories.members
        t = self._tolerances
        steps = members.params.reshape(-1)[:0], 0, t.max_steps, 0, 0
        limits = t.h_max, t.rtol, t.atol, int(t.is_relative), 1, reads_time
        return Span(*members.t_span, *steps, *limits, _NONE, _NONE, _NO_STATES, _NO_STATES)

    def _block(self) -> Block:
        """Return a block whose lanes have no member yet."""
        members, lanes = self.histories.members, self.shared.layout.lanes
        rows, h_first = rows_of(self.shared.method.variable, members.n, lanes), self._tolerances.h_first
        values = aligned((rows.size,))
        values[rows.times] = members.t_span[1]
        p = np.zeros(members.params.shape[-1] * lanes) if members.has_own_params else members.params
        numbers, place = np.full(lanes, -1, dtype=np.int64), np.array([0, len(self.numbers)])
        return Block(values, p, numbers, place, np.zeros((len(rows.names), members.n)), np.zeros(EVENTS), h_first)

    def _looks(self) -> tuple[Sight, Any]:
        """Return the events and the times of t_eval for the lanes, and the observer of a single run."""
        shared, histories, n, lanes = self.shared, self.histories, self.histories.members.n, self.shared.layout.lanes
        count, m, system = len(shared.events), len(self.numbers), shared.prepared.system
        formulas, times = variable_formulas(shared.method.variable), histories.options.t_eval
        observer = Observer(system, times, n, formulas.work_rows)
        observer.look_within(formulas, self._tolerances.rtol)
        watch = observer.watch
        # There must be space for an event of each kind in each lane.
        log = np.empty((max(len(watch.log), 2 * lanes * count), 2 + 4 * n))
        mine = slice(self.numbers[0], self.numbers[-1] + 1) if times is not None else slice(0)
        sight = Sight(
            np.array([event.address for event in shared.events], dtype=np.int64),
            np.ones((count, lanes)),
            np.ones((count, lanes)),
            np.full(lanes, np.inf),
            np.zeros((lanes, EVENTS + EVENT_VALUES * count)),
            np.empty(len(log), dtype=np.int64),
            np.zeros(1, dtype=np.int64),
            _NO_STATES if histories.steps is None else histories.steps[mine],
            histories.u[mine],
            histories.v[mine],
            np.empty((m, 2)),
        )
        self._found = [(sight.members[:0], log[:0])]  # the members and the rows of the occurrences so far
        return sight, observer.arguments._replace(watch=watch._replace(log=log))

    def _store(self, sight: Sight, ended: np.ndarray, stopped: np.ndarray) -> None:
        """Store the occurrences in the ended members of a mask, and the events that stopped members."""
        for rows in (sight.steps, sight.u, sight.v):
            if len(rows):
                rows[~ended] = np.nan
        member, found = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        valid = ended[member]
        self.histories.note_events(self.numbers[member[valid]], found[valid])
        t, event = sight.stops[stopped].T
        self.histories.end_by_events(self.numbers[stopped], event, t)
