"""The number of threads of BLAS, in which NumPy computes products and eigenvalues of matrices."""

from __future__ import annotations

import contextlib
import functools
import threading
from typing import Any


class _OneThread(contextlib.ContextDecorator):
    """Limit BLAS to one thread, if the package threadpoolctl is installed.

    Two threads win nothing for matrices of some hundred rows. Where another process needs a core, they wait for each
    other ten times as long as they compute.
    """

    def __init__(self) -> None:
        self._lock, self._users, self._limit = threading.Lock(), 0, None

    def __enter__(self) -> None:
        with self._lock:  # the limit is of the process: the last user restores what the first has found
            if not self._users:
                self._limit = _blas().limit(limits=1) if _blas() else None
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if self._limit and not self._users:
                self._limit.restore_original_limits()


one_blas_thread = _OneThread()


@functools.cache
def _blas() -> Any:
    try:
        from threadpoolctl import ThreadpoolController
    except ImportError:
        return None
    return ThreadpoolController().select(user_api="blas")
