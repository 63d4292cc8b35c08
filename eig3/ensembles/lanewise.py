"""Decide how the members of an ensemble run: in lanes, or one at a time."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

from ..callbacks import Callback
from ..kernels.lanes import Lanes, Layout, compile_invariant, compile_rhs
from ..methods import Method
from .members import Members

MOST_DEGREES = 24  # with more degrees of freedom, a member alone is as fast as in lanes
_CACHE = 2**15  # bytes of the first-level cache for the rows of a block
_MOST_LANES, _LEAST_LANES = 128, 32

# The references are weak, so that a program that makes many functions does not keep all of them in memory.
_known: WeakKeyDictionary[Any, dict[tuple, tuple[Any, Lanes]]] = WeakKeyDictionary()


def layout_of(members: Members, method: Method) -> Layout | None:
    """Return the arrays of a block; None if the members should run one at a time.

    More lanes keep the vector units busy for longer in each loop, as long as the rows stay in the cache. The number
    does not depend on the number of members.
    """
    if method.is_implicit or members.n > MOST_DEGREES:
        return None
    lanes, rows = _MOST_LANES, members.n * method.formulas.own_rows
    while lanes > _LEAST_LANES and 8 * rows * lanes > _CACHE:
        lanes //= 2
    k = members.params.shape[-1]
    return Layout(members.form, members.n, lanes, k, not members.has_own_params, members.has_own_step)


def lanes_of(function: Any, callback: Callback, kind: str, layout: Layout) -> Lanes:
    """Compile a checked function for a layout, at the first call only."""
    known = _known.setdefault(function, {})
    key = kind, layout
    if key not in known or known[key][0] is not callback.compiled:  # the user may have compiled the function anew
        compile_it = compile_rhs if kind == "rhs" else compile_invariant
        known[key] = callback.compiled, compile_it(function.py_func, layout)
    return known[key][1]
