"""States within the steps of a run with tolerances, from the continuous extension of its steps."""

from __future__ import annotations

import numpy as np

from ..functions.callbacks import Callback
from ..functions.guard import guarded
from ..kernels.loops.extension import extension_kernel
from ..kernels.loops.formulas import variable_formulas
from ..kernels.protocol import SCALAR, VECTOR


def states_between(
    rhs: Callback, params: np.ndarray, pair: str, t: np.ndarray, u: np.ndarray, v: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v, shape (k,) or (k, n), at k times, from a history with the states after all m steps.

    `pair` is the file of methods with the formulas of the steps. Two equal times of t, shape (m,), belong to the states
    before and after a jump. At the time of a state of the history, u and v are this state; at the time of a jump, the
    state after it. The call copies the params, because a scene stores neighbour lists in them.
    """
    left = np.searchsorted(t, times, side="right") - 1
    found = u[left], v[left]
    inside = np.flatnonzero(t[left] < times)
    if len(inside):
        inside = inside[np.argsort(left[inside], kind="stable")]  # the steps are evaluated in order
        rows = [np.ascontiguousarray(x, dtype=np.float64).reshape(len(t), -1) for x in (u, v)]
        n = rows[0].shape[1]
        out = np.empty((2, len(inside), n))
        kernel, formulas = extension_kernel(pair, SCALAR if u.ndim == 1 else VECTOR), variable_formulas(pair)
        work = np.empty((formulas.rows + 2 * formulas.terms, n))
        t = np.ascontiguousarray(t)
        kernel(rhs.address, guarded(params), t, *rows, left[inside], times[inside], *out, work)
        for x, values in zip(found, out, strict=True):
            x[inside] = values.reshape(x[inside].shape)
    return found
