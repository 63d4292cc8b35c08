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

    def check(self, n: int, span: tuple[float, float], u: Any, v: Any, params: np.ndarray) -> None:
        """Raise a ValueError if a start with n velocities, besides first-order unknowns, lies behind an event."""
        _, k = self._missed(n, span, u, v, params, 1, 1)
        if k >= 0:
            raise self._error(k, "the start")

    def check_members(self, n: int, members: Any) -> None:
        """Raise a ValueError if the start of one of some `Members` lies behind an event."""
        u, v, params = (x.ravel() for x in (members.u0, members.v0, members.params))
        count = len(members)
        i, k = self._missed(n, members.t_span, u, v, params, count, count if members.has_own_params else 1)
        if k >= 0:
            raise self._error(k, f"member {members.first + i}")

    def _missed(self, n: int, span: tuple[float, float], u: Any, v: Any, params: Any, count: int, sets: int) -> Any:
        soon, scratch = _AT_ONCE * (span[1] - span[0]), np.empty(u.size // count)
        return starts_kernel()(self._table, span[0], soon, n, count, sets, params, u, v, scratch)

    def _error(self, k: int, who: str) -> ValueError:
        rule, name = self._texts[k]
        return ValueError(f"{rule}, but {who} lies behind {name!r}: change u0, v0, t_span or params.")
