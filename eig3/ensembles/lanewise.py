"""Decide how the members of an ensemble run: in lanes, or one at a time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from ..functions.callbacks import Callback
from ..kernels.compile.numba_internals import options_of
from ..kernels.constraint_lanes import Straight, compile_constrained, compile_keeping
from ..kernels.lanes import Lanes, Layout
from ..methods import Method
from .members import Members

FEWEST_MEMBERS = 16  # with tolerances; for fewer, lanes do not pay
MOST_DEGREES = 24  # with more degrees of freedom, a member alone is as fast as in lanes
_CACHE = 2**15  # bytes of the first-level cache for the rows of a block
ROWS_FOLLOWED = 5  # of each value that is followed: it, its extremes and their times
_MOST_LANES, _LEAST_LANES = 512, 32
_FEW_LANES = 64  # enough for fast loops: blocks are not made smaller than this for the sake of more threads
_FEWEST_LANES = 16  # the compiler cannot use vectors for fewer
_BLOCKS = 2  # of a thread, at least

# The references are weak, so that a program that makes many functions does not keep all of them in memory.
_known: WeakKeyDictionary[Any, dict[tuple, tuple[Any, Lanes]]] = WeakKeyDictionary()


class Keeping(NamedTuple):
    """The function of a block that keeps the constraints.

    Attributes
    ----------
    function : Lanes
    is_leap : bool
        Whether it is a step of EIG-3, and not a projection after each step.
    """

    function: Lanes
    is_leap: bool


def layout_of(members: Members, method: Method, more_rows: int, threads: int) -> Layout | None:
    """Return the arrays of a block; None if the members should run one at a time.

    What is evaluated in each step reads or writes `more_rows` rows.

    More lanes keep the vector units busy for longer in each loop, as long as the rows stay in the cache and each thread
    has blocks to run. A member's numbers do not depend on the number of lanes.
    """
    if method.is_implicit or members.n > MOST_DEGREES or (method.is_stochastic and members.has_own_step):
        return None  # the noise of a step depends on its length
    lanes, rows = _MOST_LANES, members.n * method.formulas.own_rows + more_rows
    while lanes > _LEAST_LANES and 8 * rows * lanes > _CACHE:
        lanes //= 2
    while lanes > _FEW_LANES and _BLOCKS * threads * lanes > len(members):
        lanes //= 2
    while lanes > _FEWEST_LANES and lanes >= 2 * len(members):  # a lane without a member takes as long
        lanes //= 2
    k = members.params.shape[-1]
    return Layout(members.form, members.n, lanes, k, not members.has_own_params, members.has_own_step)


def lanes_of(
    function: Any, callback: Callback, layout: Layout, compile_it: Callable[..., Lanes], *arguments: Any
) -> Lanes:
    """Call ``compile_it(function, layout, *arguments)`` for a checked function, at the first call only."""
    own = getattr(getattr(function, "py_func", None), "in_lanes", None)  # the reactions of a scene
    python = own.py_func if own else callback.function
    make = partial(compile_it, python, layout, *arguments)
    return _remembered(function, callback, (compile_it, layout, arguments), make)


def constrained_of(rhs: Any, callback: Callback, layout: Layout, straight: Straight, *how: Any) -> Lanes:
    """Compile the right-hand side of a scene with constraints, at the first call only.

    `how` are the signature, and the function that compiles the forces.
    """
    make = partial(compile_constrained, straight, layout, *how)
    return _remembered(rhs, callback, (compile_constrained, layout, how), make)


def keeping_of(rhs: Any, callback: Callback, layout: Layout, straight: Straight, is_leap: bool) -> Keeping:
    """Compile what keeps these constraints, at the first call only."""
    make = partial(compile_keeping, straight, layout, is_leap)
    return Keeping(_remembered(rhs, callback, (compile_keeping, layout, is_leap), make), is_leap)


def _remembered(function: Any, callback: Callback, key: tuple, make: Callable[[bool], Lanes]) -> Lanes:
    known = _known.setdefault(function, {})
    if key not in known or known[key][0] is not callback.compiled:  # the user may have compiled the function anew
        is_checked = bool(options_of(function).get("boundscheck"))
        known[key] = callback.compiled, make(is_checked)
    return known[key][1]
