"""Members with tolerances that run in the lanes of SIMD registers."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ..functions.callbacks import Callback
from ..kernels.adaptive_lanes import (
    ENDED,
    EVALUATED,
    REACHED,
    REJECTED,
    TAKEN,
    AdaptiveLanes,
    AdaptiveLayout,
    Block,
    Ends,
    Starts,
    compile_adaptive,
)
from ..kernels.loops.formulas import variable_formulas
from ..kernels.loops.pair import Pair, V_MOST
from ..kernels.protocol import EVENTS
from ..methods import Method
from ..result.memory import aligned
from ..stepping.march import Cancel
from ..stepping.tolerances import Tolerances
from .alone import Alone
from .histories import Histories
from .members import Members

LANES = 16
_MOST_DEGREES = 8  # with more, the stages of a block leave the first-level cache
_MOST_PARAMS = 64  # of a member, for the same reason
_FEWEST = 4  # members; for fewer, the lanes do not pay
_SLICE_SECONDS, _FIRST_STEPS = 0.02, 256

_known: WeakKeyDictionary[Any, dict[tuple, tuple[Any, AdaptiveLanes]]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class AdaptiveRun:
    """What the blocks of an ensemble with tolerances have in common.

    Attributes
    ----------
    lanes : AdaptiveLanes
    members : Members
    tolerances : Tolerances
    rhs_address : int
    histories : Histories
    single : callable
        ``single(member, cancel)`` returns the `Solution` of a member.
    """

    lanes: AdaptiveLanes
    members: Members
    tolerances: Tolerances
    rhs_address: int
    histories: Histories
    single: Callable[[int, Cancel], Any]


def layout_of(members: Members, method: Method, n_events: int) -> AdaptiveLayout | None:
    """Return the values of a block; None if the members should run one at a time."""
    k = members.params.shape[-1]
    is_pair = isinstance(variable_formulas(method.variable), Pair)
    is_large = members.n > _MOST_DEGREES or (members.has_own_params and k > _MOST_PARAMS)
    if not is_pair or is_large or len(members) < _FEWEST:
        return None
    return AdaptiveLayout(members.form, members.n, LANES, k, not members.has_own_params, n_events)


def adaptive_lanes_of(
    rhs: Any, callback: Callback, layout: AdaptiveLayout, method: Method, events: Sequence[tuple[Any, Callback]]
) -> AdaptiveLanes:
    """Call `compile_adaptive` for checked functions, at the first call only."""
    known = _known.setdefault(rhs, {})
    key = layout, method.variable, tuple(event for event, _ in events)
    current = callback.compiled, *(found.compiled for _, found in events)
    if key not in known or known[key][0] != current:  # the user may have compiled a function anew
        functions = [found.function for _, found in events]
        made = compile_adaptive(callback.function, layout, method.variable, callback.reads_time, functions)
        known[key] = current, made
    return known[key][1]


class AdaptiveBlock:
    """Some members that pass through the lanes of a block.

    Those that the lanes leave, such as members with events, run again as single runs.

    Parameters
    ----------
    run : AdaptiveRun
    numbers : ndarray of int
        The numbers of the members.
    """

    def __init__(self, run: AdaptiveRun, numbers: np.ndarray) -> None:
        self.run_of, self.numbers = run, numbers
        self.seconds = 0.0  # in the kernel

    def __len__(self) -> int:
        return len(self.numbers)

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        ends = self._march(stop)
        histories = self.run_of.histories
        reached = ends.counts[:, ENDED] == REACHED
        counts = (ends.counts[reached, column] for column in (TAKEN, REJECTED, EVALUATED))
        histories.reach(self.numbers[reached], ends.u[reached], ends.v[reached], *counts)
        left = Alone(self.numbers[~reached], histories, self.run_of.single)
        left.run(stop)
        self.seconds += left.seconds

    def _march(self, stop: Cancel) -> Ends:
        run, m = self.run_of, len(self.numbers)
        members, tolerances, (t0, t_end) = run.members, run.tolerances, run.members.t_span
        params = members.params[self.numbers] if members.has_own_params else members.params[None]
        starts = Starts(members.u0[self.numbers], members.v0[self.numbers], np.ascontiguousarray(params))
        ends = Ends(*np.empty((2, m, members.n)), np.zeros((m, 4), dtype=np.int64))
        block = self._block(m, t_end)
        steps = _FIRST_STEPS
        limits = tolerances.h_first, tolerances.h_max, tolerances.max_steps
        options = (*limits, tolerances.rtol, tolerances.atol, int(tolerances.is_relative))
        while block.place[1] and not stop.is_set():
            begin = time.perf_counter()
            run.lanes.call(run.rhs_address, steps, t0, t_end, *options, block, starts, ends)
            taken = time.perf_counter() - begin
            self.seconds += taken
            steps = max(1, int(steps * min(16.0, _SLICE_SECONDS / (taken + 1e-9))))
        return ends

    def _block(self, m: int, t_end: float) -> Block:
        lanes, n = self.run_of.lanes, self.run_of.members.n
        values = aligned((lanes.size,))
        values[lanes.times] = t_end  # each lane looks for a member
        numbers = np.full(LANES, -1, dtype=np.int64)
        return Block(values, numbers, np.array([0, m]), np.zeros((V_MOST + 1, n)), np.zeros(EVENTS))
