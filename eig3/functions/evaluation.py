"""Evaluate a function at many states in compiled code."""

from __future__ import annotations

import numpy as np

from ..kernels.loops.evaluation import rows_kernel
from ..kernels.protocol import SCALAR, VECTOR
from .callbacks import Callback
from .guard import guarded

_CHUNK_VALUES = 2**18  # values in the states of one call, after which Python can handle Ctrl-C


def accelerations(
    rhs: Callback, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray, count: int | None = None
) -> np.ndarray:
    """Evaluate f(t_i, u_i, v_i) at each row of u and v; an entry that rhs does not write is NaN.

    The call copies the params, because a scene stores neighbour lists in them. `count` is the number of values that a
    function with the arguments of rhs writes, if it is not n.
    """
    a = np.full(u.shape if count is None else (len(u), count), np.nan)
    _evaluate(rhs, "rhs", params, t, u, v, a)
    return a


def energies(energy: Callback, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Evaluate an invariant at each row of u and v, as `accelerations` does; the result has the shape (m,)."""
    values = np.empty(len(t))
    _evaluate(energy, "invariant", params, t, u, v, values)
    return values


def _evaluate(
    function: Callback, kind: str, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray, values: np.ndarray
) -> None:
    kernel, own = rows_kernel(SCALAR if u.ndim == 1 else VECTOR, kind), guarded(params)
    t, u, v = (np.ascontiguousarray(x, dtype=np.float64) for x in (t, u, v))
    u, v, values = (x.reshape(len(t), x[:1].size) for x in (u, v, values))
    rows = max(1, _CHUNK_VALUES // max(1, u.shape[1]))
    for first in range(0, len(t), rows):
        chunk = slice(first, first + rows)
        kernel(function.address, own, t[chunk], u[chunk], v[chunk], values[chunk])
