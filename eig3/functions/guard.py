"""Arrays between guard values, to detect a right-hand side that reads or writes out of bounds.

Numba does not check indices. Each array therefore has guard values before and after it, which are NaN. If rhs reads a
guard value, the result is NaN; if rhs writes to a guard value, this is detected after the evaluation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..kernels.loops.evaluation import guarded_kernel
from ..kernels.protocol import SCALAR, Form
from .callbacks import Callback

GUARD_VALUES = 64  #: number of guard values on each side of an array
_DESCRIBED = {"p": "params", "u": "u0", "v": "v0"}


class BadStartError(ValueError):
    """A run cannot start from a state."""


class NotFiniteAtStartError(BadStartError):
    """The right-hand side is not finite at the start."""


class ReadsBeyondError(NotFiniteAtStartError):
    """The right-hand side is not finite at the start, because it reads beyond the end of an array."""


def guarded(values: np.ndarray, guards: float = np.nan) -> np.ndarray:
    """Return a copy of a 1-D array, with guard values before and after it in memory."""
    buffer = np.empty(values.size + 2 * GUARD_VALUES)
    buffer.fill(guards)  # np.full takes four times as long for so few values
    inside = buffer[GUARD_VALUES : GUARD_VALUES + values.size]
    inside[:] = values
    return inside


def beyond(inside: np.ndarray) -> bool:
    """Return whether a function has written to the guard values around an array from `guarded`."""
    guards = inside.base
    assert guards is not None
    return not (are_untouched(guards[:GUARD_VALUES]) and are_untouched(guards[-GUARD_VALUES:]))


def are_untouched(guards: np.ndarray) -> bool:
    """Return whether guard values are still NaN."""
    return bool(np.isnan(guards).all())


#: The largest |u|, |v| and |a| of a state, or of the state in each lane.
Sizes = tuple[Any, Any, Any]


def evaluation(rhs: Callback, form: Form, t: float, u: Any, v: Any, p: np.ndarray) -> tuple[Any, Sizes]:
    """Evaluate f(t, u, v), and return a and the sizes; `p` comes from `guarded`.

    An entry of a that rhs does not write is NaN. The size of an array is infinite if one of its values is not finite.

    Raises
    ------
    ValueError
        If rhs writes beyond the end of a.
    """
    if form is SCALAR:
        a = rhs.call(t, u, v, p)
        return a, (abs(u), abs(v), abs(a))
    guards = np.empty((3, u.size + 2 * GUARD_VALUES))
    u_size, v_size, a_size, is_within = guarded_kernel()(rhs.address, t, u, v, p, guards)
    if not is_within:
        raise written_beyond(u.size)
    return guards[0, GUARD_VALUES:-GUARD_VALUES], (u_size, v_size, a_size)


def not_finite(rhs: Callback, form: Form, t: float, u: Any, v: Any, p: np.ndarray, a: Any) -> NotFiniteAtStartError:
    """Return the error of a right-hand side whose value a is not finite at the start."""
    names = _read_beyond(rhs, form, t, u, v, p)
    if names:
        sizes = ", ".join(f"{name} ({np.size({'p': p, 'u': u, 'v': v}[name])} values)" for name in names)
        remedy = " and ".join(_DESCRIBED[name] for name in names)
        return ReadsBeyondError(
            f"{_not_finite(a)}, because it reads beyond the end of {sizes}; give {remedy} all the values it reads."
        )
    j = unwritten(rhs, t, u, v, p, a) if form is not SCALAR else None
    if j is not None:
        return NotFiniteAtStartError(
            f"{_not_finite(a)}, because it does not write a[{j}], or adds to it before: write a[{j}] = ..., or all in "
            "a[:] = ..., and not a = ..., which makes another array."
        )
    return NotFiniteAtStartError(not_finite_at_start(a))


def unwritten(rhs: Callback, t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> int | None:
    """Return an index j such that rhs does not write a[j], or first reads it, if any; `a` is from an `evaluation`.

    This takes one evaluation: a value that rhs computes may be NaN too.
    """
    other = np.zeros(u.size)
    rhs.call(t, u, v, p, other)
    found = np.flatnonzero(np.isnan(a) & np.isfinite(other))
    return int(found[0]) if found.size else None


def is_finite_at_start(rhs: Callback, form: Form, t: float, u: Any, v: Any, p: np.ndarray) -> bool:
    """Return whether f(t, u, v) is finite; `p` need not come from `guarded`."""
    _, (_, _, size) = evaluation(rhs, form, t, u, v, guarded(p))
    return math.isfinite(size)


def not_finite_at_start(a: Any) -> str:
    """Return the message that the acceleration at the start, a float or an array of shape (n,), is not finite."""
    return f"{_not_finite(a)}; it must give a finite acceleration for every degree of freedom, a[j] in the vector form."


def _not_finite(a: Any) -> str:
    values = np.atleast_1d(a)
    bad = int(np.argmin(np.isfinite(values)))
    return f"rhs gives {values[bad]} for degree of freedom {bad} at the start"


def written_beyond(n: int) -> ValueError:
    """Return the error of a right-hand side that writes beyond the end of a."""
    return ValueError(f"rhs writes beyond the end of a, which has {n} entries, one for each value of u0.")


def _read_beyond(rhs: Callback, form: Form, t: float, u: Any, v: Any, p: np.ndarray) -> list[str]:
    """Return the names of the arrays beyond which rhs reads.

    For such an array, the result is finite if the guard values of all arrays are zero, but not if the guard values of
    this array are NaN.
    """
    given = {"p": p} if form is SCALAR else {"p": p, "u": u, "v": v}
    names = [*given]

    def is_finite(zeroed: list[str]) -> bool:
        filled = {name: guarded(x, 0.0 if name in zeroed else np.nan) for name, x in given.items()}
        state = filled.get("u", u), filled.get("v", v), filled["p"]
        try:
            if form is SCALAR:
                return math.isfinite(rhs.call(t, *state))
            a = guarded(np.full(u.size, np.nan))
            rhs.call(t, *state, a)
            return bool(np.isfinite(a).all()) and not beyond(a)
        except Exception:
            return False

    if not is_finite(names):
        return []
    return [name for name in names if not is_finite([other for other in names if other != name])]
