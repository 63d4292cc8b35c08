"""The accelerations at many states, evaluated in compiled code."""

from __future__ import annotations

import numpy as np

from ..kernels.loops.accelerations import acceleration_kernel
from ..kernels.protocol import SCALAR, VECTOR
from .callbacks import Callback

_CHUNK_VALUES = 2**18  # values in the states of one call, after which Python can answer Ctrl-C


def accelerations(rhs: Callback, params: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Evaluate f(t_i, u_i, v_i) at each row of u and v.

    Parameters
    ----------
    rhs : Callback
    params : ndarray
        The parameters, from `guarded`.
    t : ndarray, shape (m,)
    u, v : ndarray, shape (m,) or (m, n)

    Returns
    -------
    ndarray
        Of the shape of u. An entry that rhs does not write is NaN.
    """
    kernel = acceleration_kernel(SCALAR if u.ndim == 1 else VECTOR)
    t, u, v = (np.ascontiguousarray(x, dtype=np.float64) for x in (t, u, v))
    a = np.full(u.shape, np.nan)
    rows = max(1, _CHUNK_VALUES // max(1, a[:1].size))
    for first in range(0, len(t), rows):
        chunk = slice(first, first + rows)
        kernel(rhs.address, params, t[chunk], u[chunk], v[chunk], a[chunk])
    return a
