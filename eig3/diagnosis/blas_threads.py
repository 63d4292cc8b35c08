"""The number of threads of BLAS, in which NumPy computes products and eigenvalues of matrices."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Compute in one thread, also as a decorator, if the package threadpoolctl is installed.

    Two threads win nothing for matrices of some hundred rows. Where another process needs a core, they wait for each
    other ten times as long as they compute.
    """
    blas = _blas()
    with blas.limit(limits=1) if blas else contextlib.nullcontext():
        yield


@functools.cache
def _blas() -> Any:
    try:
        from threadpoolctl import ThreadpoolController
    except ImportError:
        return None
    return ThreadpoolController().select(user_api="blas")
