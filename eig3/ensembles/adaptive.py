"""Members with tolerances that run in the lanes of SIMD registers."""

from __future__ import annotations

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
from ..kernels.lane_observation import END_TIME
from ..kernels.protocol import EVENTS, Span
from ..result.memory import aligned
from ..stepping.march import Cancel, Rows
from ..stepping.run_options import NEVER
from ..stepping.slices import Slices
from ..stepping.tolerances import longest_way
from .adaptive_observer import AdaptiveObserver
from .lanewise import Setup
from .single_members import Alone

_NO_ROWS = Rows(np.empty(0), np.empty(0), np.empty((0, 0)), np.empty((0, 0)))


class AdaptiveBlock(Alone):
    """Some members, with consecutive numbers, that run one after another in the lanes of a block.

    Members that the lanes cannot complete run again as single runs.
    """

    def __init__(self, shared: Setup, numbers: np.ndarray) -> None:
        super().__init__(numbers, shared.histories, shared.single)
        self.shared, self._tolerances = shared, shared.prepared.tolerances(shared.layout.n)

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        shared, histories = self.shared, self.histories
        observer = AdaptiveObserver(shared, self.numbers, self._tolerances.rtol) if shared.observes else None
        ends = self._march(stop, observer)
        how = ends.counts[:, ENDED]
        reached, stopped = (how == REACHED) | (how == TERMINATED), how == TERMINATED
        chosen = self.numbers[reached]
        t = observer.record.ends[reached, END_TIME] if observer else np.full(len(chosen), histories.members.t_span[1])
        histories.reach(chosen, t, *(ends.counts[reached, column] for column in (TAKEN, REJECTED, EVALUATED)))
        if observer:
            observer.store(reached, stopped, ends.u, ends.v)
        else:
            members = histories.members
            first = members.t_span[0], 0.0, members.u0[chosen], members.v0[chosen]
            no_step = np.full(len(chosen), np.nan)  # the kernel does not keep the last step
            last = t, no_step, ends.u[reached], ends.v[reached]
            histories.save_rows(chosen, first, self.numbers[:0], [x[:0] for x in last], last)
        self.run_alone(self.numbers[~reached], stop)

    def _march(self, stop: Cancel, observer: AdaptiveObserver | None) -> Trajectories:
        """Run the lanes in slices, and check `stop` between them."""
        shared, members, numbers = self.shared, self.histories.members, self.numbers
        params = members.params[numbers] if members.has_own_params else members.params[None]
        counts = np.zeros((len(numbers), 4), dtype=np.int64)
        # the right-hand side of one member may write to the table of its constraints
        h_max = self._tolerances.h_max
        longest = self.single.longest[numbers] if h_max == np.inf else np.full(len(numbers), h_max)
        trajectories = Trajectories(members.u0[numbers], members.v0[numbers], params.copy(), longest, counts)
        callback, project = shared.prepared.system.callback, shared.project.address if shared.project else 0
        addresses = shared.rhs.address, callback.address, project
        block, span, slices = self._block(), self._span(int(callback.reads_time), observer), Slices(None)
        while block.place[OPEN] and not stop.is_set():
            count, *begun = slices.begin(NEVER)
            taken = shared.kernel(*addresses, count, span, block, trajectories, observer and observer.record)
            self.seconds += slices.end(taken, *begun)
            if observer:
                observer.collect()
        return trajectories

    def _span(self, reads_time: int, observer: AdaptiveObserver | None) -> Span:
        """Return the span, the tolerances, and the rows for states."""
        members = self.histories.members
        t, every, rows = self._tolerances, observer.every if observer else 0, observer.rows if observer else _NO_ROWS
        steps = members.params.reshape(-1)[:0], 0, t.max_steps, every, 0
        reach = longest_way(self.shared.prepared.system.cutoffs, t, members.params)
        limits = t.h_max, t.rtol, t.atol, int(t.is_relative), 1, reads_time, *reach
        return Span(*members.t_span, *steps, *limits, *rows)

    def _block(self) -> Block:
        """Return a block whose lanes have no member yet."""
        members, lanes = self.histories.members, self.shared.layout.lanes
        rows, h_first = rows_of(self.shared.method.variable, members.n, lanes), self._tolerances.h_first
        values = aligned((rows.size,))
        values[rows.times] = members.t_span[1]
        p = np.zeros(members.params.shape[-1] * lanes) if members.has_own_params else members.params
        numbers, place = np.full(lanes, -1, dtype=np.int64), np.array([0, len(self.numbers)])
        return Block(values, p, numbers, place, np.zeros((len(rows.names), members.n)), np.zeros(EVENTS), h_first)
