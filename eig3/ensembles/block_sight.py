"""The events and the wanted times of members with tolerances that run in lanes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..kernels.adaptive_lanes import Rows
from ..kernels.lane_events import Sight
from ..kernels.loops.formulas import variable_formulas
from ..kernels.protocol import EVENT_VALUES, EVENTS, TERMINAL
from ..run.run import ended_by_event
from ..stepping.observer import Observer
from ..stepping.system import System
from .histories import Histories


class BlockSight:
    """What a block of members sees of events and of wanted times.

    Parameters
    ----------
    system : System
        Of the single run of a member.
    addresses : sequence of int
        Of the functions of the events, compiled for lanes.
    n : int
        The number of degrees of freedom.
    rows : Rows
    rtol : float
    histories : Histories
        Where the states at wanted times are written.
    numbers : ndarray of int
        The numbers of the members, which follow each other.

    Attributes
    ----------
    given : Sight
    look : LookWithin
        What the kernel gets.
    """

    def __init__(
        self,
        system: System,
        addresses: Sequence[int],
        n: int,
        rows: Rows,
        rtol: float,
        histories: Histories,
        numbers: np.ndarray,
    ) -> None:
        count, lanes, m = len(addresses), rows.lanes, len(numbers)
        formulas, times = variable_formulas(system.method.variable), histories.options.t_eval
        look = Observer(system, times, n, formulas.work_rows)
        look.follow_within(formulas, rtol)
        watch = look.watching.watch
        # There must be room for an event of each kind in each lane.
        log = np.empty((max(len(watch.log), 2 * lanes * count), 2 + 4 * n))
        self.look = look.arguments._replace(watch=watch._replace(log=log))
        mine = slice(numbers[0], numbers[-1] + 1) if times is not None else slice(0)
        steps = np.empty((0, 0)) if histories.steps is None else histories.steps[mine]
        self.given = Sight(
            np.array(addresses, dtype=np.int64),
            np.ones((count, lanes)),
            np.ones((count, lanes)),
            np.full(lanes, np.inf),
            np.zeros((lanes, EVENTS + EVENT_VALUES * count)),
            np.empty(len(log), dtype=np.int64),
            np.zeros(1, dtype=np.int64),
            steps,
            histories.u[mine],
            histories.v[mine],
            np.empty((m, 2)),
        )
        self._n, self._names, self._found = n, list(system.events), [(self.given.members[:0], log[:0])]

    def collect(self) -> None:
        """Take the occurrences out of the log."""
        count = int(self.given.logged[0])
        if count:
            self._found.append((self.given.members[:count].copy(), self.look.watch.log[:count].copy()))
            self.given.logged[0] = 0

    def store(self, numbers: np.ndarray, ended: np.ndarray, stopped: np.ndarray, histories: Histories) -> None:
        """Store the occurrences in the members of a mask that have ended, and how events stopped some of them."""
        for rows in (self.given.steps, self.given.u, self.given.v):
            if len(rows):
                rows[~ended] = np.nan
        member, found = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        valid = ended[member]
        member, found = numbers[member[valid]], found[valid]
        histories.note_events(member, found[:, 0], found[:, 1], found[:, 2:].reshape(len(found), 4, self._n))
        for i in np.flatnonzero(stopped).tolist():
            t, event = self.given.stops[i].tolist()
            status, message = ended_by_event(TERMINAL, self._names[int(event)], t)
            histories.judge(int(numbers[i]), status, message)
