"""What a right-hand side remembers of its run, such as the springs between grains that stick to each other."""

from __future__ import annotations

from typing import Any, NamedTuple


class History(NamedTuple):
    """Two compiled functions of (t, u, v, p), which return a number and change what a run remembers, in its p.

    A trial state, such as a stage of a method or the end of a step that is rejected, changes nothing.

    Attributes
    ----------
    begin : jitted function
        It forgets all. It is called at the start of a run, before the right-hand side.
    advance : jitted function
        It goes on to a state. It is called at the end of each step, and at events.
    """

    begin: Any
    advance: Any


def history_of(rhs: Any) -> History | None:
    """Return the history of a right-hand side, or None. It travels with the Python function to other processes."""
    return getattr(getattr(rhs, "py_func", None), "history", None)
