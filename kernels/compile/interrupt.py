"""Ctrl-C while Numba compiles, and while a run advances.

Python calls the handler of Ctrl-C between any two instructions of the main thread, and the handler raises
KeyboardInterrupt there. In Numba's compiler, this leaves objects that LLVM frees twice, and the process crashes. In a
run, it leaves a history that is half updated. So the handler has to wait until it does no harm.
"""

from __future__ import annotations

import sys

# The functions of the module signal convert to enums, which takes 10 microseconds a run.
from _signal import getsignal, signal  # type: ignore[import-not-found]
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from signal import SIGINT, default_int_handler
from threading import get_ident, main_thread
from typing import Any, TypeVar

_Function = TypeVar("_Function", bound=Callable[..., Any])


def with_solution(function: _Function) -> _Function:
    """Decorate a function whose KeyboardInterrupt has the attribute `solution`: None if no run has given it one."""

    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        try:
            return function(*arguments, **options)
        except KeyboardInterrupt as error:
            if not hasattr(error, "solution"):
                error.solution = None  # type: ignore[attr-defined]
            raise

    return call  # type: ignore[return-value]


@contextmanager
def keeping(solution: Any) -> Iterator[None]:
    """A block after a run whose exceptions have this run as their attribute `solution`."""
    try:
        yield
    except BaseException as error:
        error.solution = solution  # type: ignore[attr-defined]
        raise


class DeferredInterrupt:
    """A block in which Ctrl-C waits until the end of the outermost block, where it raises KeyboardInterrupt as usual.

    A block that lasts should ask `is_set`. Nothing changes in threads other than the main thread, because Python calls
    handlers only in the main thread, and in programs that ignore Ctrl-C or leave it to the system. If a program has
    installed a handler, that handler is called instead.
    """

    def __init__(self) -> None:
        self._handler: Any = None  # the handler that this block replaces; None for an inner block
        self._is_noted = False

    def __enter__(self) -> DeferredInterrupt:
        if get_ident() == main_thread().ident:
            before = getsignal(SIGINT)
            if isinstance(before, DeferredInterrupt):
                return before
            if callable(before):
                self._handler = before
                signal(SIGINT, self)
        return self

    def __exit__(self, *error: object) -> None:
        if self._handler is not None:
            if getsignal(SIGINT) is self:  # the program's handler may have set another one
                signal(SIGINT, self._handler)
            self._deliver()

    def __call__(self, signum: int, frame: object) -> None:
        """Note the signal: within the block, this object is the handler."""
        self._is_noted = True

    def is_set(self) -> bool:
        """Return whether Ctrl-C should end the work now."""
        if self._is_noted and self._handler is not default_int_handler:
            self._deliver()
        return self._is_noted

    def forget(self) -> None:
        """Forget the signal."""
        self._is_noted = False

    def _deliver(self) -> None:
        if self._is_noted:
            self._is_noted = False
            self._handler(SIGINT, sys._getframe())
