"""Events: zeros of a function of the state, which a run locates, records and applies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..keywords import with_suggestions
from .checks import check_names, shown


@with_suggestions()
@dataclass(frozen=True)
class Event:
    """A function g(t, u, v, p) whose zeros a run locates.

    Parameters
    ----------
    g : jitted function
        ``g(t, u, v, p) -> float``, with u and v as in the right-hand side. The event occurs where g changes its sign.
    direction : {-1, 0, 1}
        1 for changes from negative to positive only, -1 for changes from positive to negative only, 0 for both.
    terminal : bool
        Whether the run ends at the first occurrence. Its status is then TERMINATED.
    apply : jitted function, optional
        The change of the state, such as an impact. For one degree of freedom ``apply(t, u, v, p) -> (u, v)`` returns
        the new state. For n degrees of freedom ``apply(t, u, v, p)`` writes it to u and v.

    Raises
    ------
    ValueError
        If direction is not -1, 0 or 1, or terminal is not True or False.

    Notes
    -----
    Give a run its events by name, as in ``eig3.integrate(..., events={"impact": eig3.Event(height, direction=-1,
    apply=bounce)})``. ``solution.events["impact"]`` then has the occurrences.

    The run compares the signs of g at both ends of each step, and locates a zero within the step. It misses an even
    number of zeros in one step: take a shorter step, or h_max with tolerances. A zero at the start is not an
    occurrence. A zero exactly at the end of the span is not an occurrence either, because the sign has not changed.

    Only the motion causes an event. If the `apply` of another event changes the sign of g, this is not an occurrence,
    and g has its new sign afterwards. Simultaneous events occur in the order of the dictionary, unless round-off
    separates their times; each `apply` gets the state after the previous `apply`.

    `apply` changes the state at an instant: it cannot hold a body on a stop against gravity, which needs a force. If
    the new state is at a zero of g with a velocity, it may move to either side. Without a velocity it rests there: if
    it is then pushed to the opposite side, the run ends with the status ZENO.
    """

    g: Any
    direction: int = 0
    terminal: bool = False
    apply: Any = None

    def __post_init__(self) -> None:
        is_real = isinstance(self.direction, int | float | np.integer | np.floating)
        if not is_real or isinstance(self.direction, bool | np.timedelta64) or self.direction not in (-1, 0, 1):
            raise ValueError(f"direction must be -1, 0 or 1, not {self.direction!r}.")
        if not isinstance(self.terminal, bool):
            raise ValueError(f"terminal must be True or False, not {self.terminal!r}.")


@dataclass(frozen=True)
class EffectEvent(Event):
    """An event of an effect.

    Parameters
    ----------
    rule : str
        What must hold at the start of a run, in an error; empty if the start may lie behind the event.
    turns : bool
        Whether the event is the turn of a link that yields. Then only a start beyond yield with a velocity back breaks
        the rule. Without a rule, such a link turns at the start.
    is_of_state : bool
        Whether the event changes the state of the effect alone. If a run must not start behind it, a reset of another
        event that moves g there, such as an impact, causes it too.
    """

    rule: str = ""
    turns: bool = False
    is_of_state: bool = False

    @property
    def follows_resets(self) -> bool:
        """Whether a reset of another event causes it too."""
        return self.is_of_state and bool(self.rule or self.turns)


def check_events(events: Any) -> dict[str, Event]:
    """Return the events by name, in a dictionary that the caller cannot change."""
    if events is None:
        return {}
    if not isinstance(events, Mapping):
        raise TypeError("events must be a dictionary of names and events, such as {'impact': eig3.Event(g)}.")
    for name, event in events.items():
        if not isinstance(event, Event):
            raise TypeError(f"events[{name!r}] must be an eig3.Event, not {shown(event)}: write eig3.Event(g).")
    check_names(events, "events")
    return dict(events)
