"""Rules of effects for the start of a run: it must not lie behind an event that would then never occur."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..kernels.loops.starts import starts_kernel
from .callbacks import Callback
from .events import EffectEvent, Event

_AT_ONCE = 1e-9  # of the span: the motion is then far beyond the round-off of a located zero


class Rules:
    """The rules of the events of a run; false if there are none.

    Parameters
    ----------
    events : dict of str to Event
    functions : iterable of Callback
        The compiled function g of each event. An effect has events in the vector form only.
    """

    def __init__(self, events: Mapping[str, Event], functions: Iterable[Callback]) -> None:
        self._texts, table = [], []
        for (name, event), g in zip(events.items(), functions, strict=True):
            if isinstance(event, EffectEvent) and event.rule:
                self._texts.append((event.rule, name))
                table.append((g.address, event.direction, event.turns))
        self._table = np.array(table, dtype=np.int64)

    def __bool__(self) -> bool:
        return bool(self._texts)

    def check(
        self, n: int, span: tuple[float, float], u: Any, v: Any, params: np.ndarray, first: int | None = None
    ) -> None:
        """Raise a ValueError if a start lies behind an event.

        Parameters
        ----------
        n : int
            The number of velocities without first-order unknowns.
        span : (float, float)
        u, v, params : ndarray
            With a first axis of members for an ensemble, or params without it if all members share them.
        first : int, optional
            The number of the first member, for an ensemble.
        """
        count = 1 if first is None else len(u)
        sets, soon = count if params.ndim == 2 else 1, _AT_ONCE * (span[1] - span[0])
        values = params.ravel(), u.ravel(), v.ravel(), np.empty(u.size // count)
        i, k = starts_kernel()(self._table, span[0], soon, n, count, sets, *values)
        if k >= 0:
            rule, name = self._texts[k]
            who = "the start" if first is None else f"member {first + i}"
            raise ValueError(f"{rule}, but {who} lies behind {name!r}: change u0, v0, t_span or params.")
