"""Rules for the start of a run: it must not lie behind an event, which would never occur, and must keep constraints."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..kernels.loops.starts import held_kernel, starts_kernel
from .callbacks import Callback
from .events import EffectEvent, Event
from .guard import BadStartError

_AT_ONCE = 1e-9  # of the span: the motion is then far beyond the round-off of a located zero


class Rules:
    """The rules of the events and the constraints of a run; false if there are none.

    `table` is the table of the events for a kernel: see `eig3.kernels.protocol.Watch`. An effect has events in the
    vector form only. `project` is the projection of u and v onto the constraints, if there are any.
    """

    def __init__(self, events: Mapping[str, Event], table: np.ndarray, project: Callback | None) -> None:
        self._texts, self._project, rows = [], project, []
        for (name, event), row in zip(events.items(), table, strict=True):
            if isinstance(event, EffectEvent) and (event.rule or event.turns):
                self._texts.append((event.rule, name))
                rows.append((*row[:3], event.turns, bool(event.rule)))
        self._table = np.array(rows, dtype=np.int64)
        self._may_turn = not all(rule for rule, _ in self._texts)

    def __bool__(self) -> bool:
        return bool(self._texts) or self._project is not None

    def starts(
        self, n: int, span: tuple[float, float], u: Any, v: Any, params: np.ndarray, first: int | None = None
    ) -> tuple[Any, Any]:
        """Return u and v, which keep constraints, with the turns of links that move back at the start.

        There are n velocities without first-order unknowns. In an ensemble, whose first member has the number `first`,
        u and v have a first axis of members, and so have params that members do not share.

        Raises
        ------
        BadStartError
            If a start lies behind an event with a rule, or off the constraints.

        Warns
        -----
        UserWarning
            If velocities do not keep the constraints.
        """
        if self._project:
            u, v = self._held(self._project, span[0], u, v, params, first)
        if not self._texts:
            return u, v
        if self._may_turn:
            u, v = np.array(u, order="C"), np.array(v, order="C")
        count = 1 if first is None else len(u)
        sets, soon = count if params.ndim == 2 else 1, _AT_ONCE * (span[1] - span[0])
        values = params.ravel(), u.ravel(), v.ravel(), np.empty(u.size // count)
        i, k = starts_kernel()(self._table, span[0], soon, n, count, sets, *values)
        if k >= 0:
            rule, name = self._texts[k]
            who = "the start" if first is None else f"member {first + i}"
            raise BadStartError(f"{rule}, but {who} lies behind {name!r}: change u0, v0, t_span or params.")
        return u, v

    def _held(
        self, project: Callback, t: float, u: np.ndarray, v: np.ndarray, params: np.ndarray, first: int | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return u and v, or the nearest ones that keep the constraints; refuse a u that does not."""
        u, v, p = u.copy(), v.copy(), params.ravel().copy()  # the projection writes to p
        count = 1 if first is None else len(u)
        room = np.empty((2, u.size // count))
        sets = count if params.ndim == 2 else 1
        i, changed = held_kernel()(project.address, t, count, sets, p, u.ravel(), v.ravel(), *room)
        if i >= 0:
            who = "the start" if first is None else f"member {first + i}"
            raise BadStartError(
                f"u0 must keep the constraints, but {who} at t = {t:g} does not: change u0, t_span or params."
            )
        if changed:
            warnings.warn(
                "v0 does not keep the constraints: the run starts with the nearest velocities that do.", stacklevel=4
            )
        return u, v
