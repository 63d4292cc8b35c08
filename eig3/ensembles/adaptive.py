"""Members with tolerances that run in the lanes of SIMD registers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..functions.callbacks import Callback
from ..functions.quantities import Quantity
from ..kernels.adaptive_lanes import (
    ENDED,
    EVALUATED,
    OPEN,
    REACHED,
    REJECTED,
    RHS_AT_TIMES,
    TAKEN,
    TERMINATED,
    Block,
    Control,
    Ends,
    Rows,
    Starts,
    adaptive_kernel,
    compile_event,
    compile_rhs_at_times,
    rows_of,
)
from ..kernels.constraint_lanes import Straight
from ..kernels.lanes import Lanes, Layout
from ..kernels.protocol import EVENTS, SEARCHES
from ..result.memory import aligned
from ..run.prepare import Prepared
from ..stepping.march import NEVER, Cancel
from ..stepping.slices import Slices
from ..stepping.system import System
from ..stepping.tolerances import Tolerances
from .block_sight import BlockSight
from .histories import Histories
from .lanewise import FEWEST_MEMBERS, constrained_of, keeping_of, lanes_of
from .members import Members
from .single_members import Alone

LANES = 64
_MOST_DEGREES = 8  # with more, the stages of a block leave the first-level cache
_MOST_PARAMS = 64  # of a member, for the same reason


@dataclass(frozen=True, eq=False)
class Adaptive:
    """What the blocks of an ensemble with tolerances have in common.

    Attributes
    ----------
    kernel : callable
    rows : Rows
    rhs : Lanes
    project : Lanes or None
        The projection of states to the constraints, if there are any.
    events : list of Lanes
    members : Members
    system : System
    tolerances : Tolerances
    callback : Callback
        The right-hand side of one member.
    histories : Histories
    single : callable
        ``single(member, cancel)`` returns the `Solution` of a member.
    """

    kernel: Callable
    rows: Rows
    rhs: Lanes
    project: Lanes | None
    events: list[Lanes]
    members: Members
    system: System
    tolerances: Tolerances
    callback: Callback
    histories: Histories
    single: Callable[[int, Cancel], Any]

    @property
    def control(self) -> Control:
        """The span and the tolerances."""
        t, reads_time = self.tolerances, int(self.callback.reads_time)
        limits = t.h_first, t.h_max, t.max_steps, t.rtol, t.atol, int(t.is_relative)
        return Control(*self.members.t_span, *limits, reads_time)


def runs_in_lanes(members: Members, straight: Straight | None) -> bool:
    """Whether members with tolerances run in lanes. Most of the parameters of constraints are not read there."""
    has_many = members.has_own_params and members.params.shape[1] > _MOST_PARAMS and straight is None
    return members.n <= _MOST_DEGREES and not has_many and len(members) >= FEWEST_MEMBERS


def in_lanes(
    rhs: Any,
    callback: Callback,
    straight: Straight | None,
    members: Members,
    prepared: Prepared,
    events: Sequence[Quantity],
    histories: Histories,
    single: Callable[[int, Cancel], Any],
) -> Adaptive:
    """Compile what runs members in lanes. `prepared` is the single run of a member."""
    layout = Layout(members.form, members.n, LANES, members.params.shape[-1], not members.has_own_params, False)
    module, project = prepared.method.variable, None
    if straight:
        in_blocks = constrained_of(rhs, callback, layout, straight, RHS_AT_TIMES, compile_rhs_at_times)
        project = keeping_of(rhs, callback, layout, straight, False).function
    else:
        in_blocks = lanes_of(rhs, callback, layout, compile_rhs_at_times)
    searches = prepared.system.looks == SEARCHES
    return Adaptive(
        adaptive_kernel(module, members.form, members.n, LANES, SEARCHES if searches else 0),
        rows_of(module, members.n, LANES),
        in_blocks,
        project,
        [lanes_of(event.function, event.callback, layout, compile_event) for event in events],
        members,
        prepared.system,
        prepared.tolerances(members.n),
        callback,
        histories,
        single,
    )


class AdaptiveBlock:
    """Some members that pass through the lanes of a block.

    Those that the lanes leave run again as single runs.

    Parameters
    ----------
    shared : Adaptive
    numbers : ndarray of int
        The numbers of the members.
    """

    def __init__(self, shared: Adaptive, numbers: np.ndarray) -> None:
        self.shared, self.numbers = shared, numbers
        self.seconds = 0.0  # in the kernel

    def __len__(self) -> int:
        return len(self.numbers)

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        sight = self._sight() if self.shared.system.looks == SEARCHES else None
        ends = self._march(stop, sight)
        how, histories = ends.counts[:, ENDED], self.shared.histories
        reached = (how == REACHED) | (how == TERMINATED)
        t = np.full(len(how), self.shared.members.t_span[1])
        if sight:
            stopped = how == TERMINATED
            t[stopped] = sight.given.stops[stopped, 0]
        counts = (ends.counts[reached, column] for column in (TAKEN, REJECTED, EVALUATED))
        histories.reach(self.numbers[reached], t[reached], ends.u[reached], ends.v[reached], *counts)
        if sight:
            sight.store(self.numbers, reached, stopped, histories)
        left = Alone(self.numbers[~reached], histories, self.shared.single)
        left.run(stop)
        self.seconds += left.seconds

    def _sight(self) -> BlockSight:
        """Return what the lanes see."""
        shared = self.shared
        addresses = [event.address for event in shared.events]
        given = shared.system, addresses, shared.members.n, shared.rows, shared.tolerances.rtol
        return BlockSight(*given, shared.histories, self.numbers)

    def _march(self, stop: Cancel, sight: BlockSight | None) -> Ends:
        """Run the lanes in slices, so that they see `stop`."""
        shared, m = self.shared, len(self.numbers)
        members = shared.members
        params = members.params[self.numbers] if members.has_own_params else members.params[None]
        # the right-hand side of one member may write to the table of its constraints
        starts = Starts(members.u0[self.numbers], members.v0[self.numbers], params.copy())
        u, v = np.empty((2, m, members.n))
        ends = Ends(u, v, np.zeros((m, 4), dtype=np.int64))
        project = shared.project.address if shared.project else 0
        addresses, control = (shared.rhs.address, shared.callback.address, project), shared.control
        looks = (sight.given, sight.look) if sight else (None, None)
        block, slices = self._block(m), Slices(None)
        while block.place[OPEN] and not stop.is_set():
            count, *begun = slices.begin(NEVER)
            taken = shared.kernel(*addresses, count, control, block, starts, ends, *looks)
            self.seconds += slices.end(taken, *begun)
            if sight:
                sight.collect()
        return ends

    def _block(self, m: int) -> Block:
        """Return a block whose lanes have no member yet."""
        shared, members = self.shared, self.shared.members
        values = aligned((shared.rows.size,))
        values[shared.rows.times] = members.t_span[1]
        p = np.zeros(members.params.shape[-1] * LANES) if members.has_own_params else members.params
        numbers, place = np.full(LANES, -1, dtype=np.int64), np.array([0, m])
        return Block(values, p, numbers, place, np.zeros((len(shared.rows.names), members.n)), np.zeros(EVENTS))
