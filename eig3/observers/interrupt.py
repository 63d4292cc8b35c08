"""Ctrl-C during a run.

Ctrl-C sets a flag that is checked between chunks, so that the state is never half updated.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator


class Flag:
    """Whether an interrupt came."""

    raised = False


@contextlib.contextmanager
def deferred_interrupt() -> Iterator[Flag]:
    """Within, the first Ctrl-C only raises the flag; the second raises KeyboardInterrupt as always.

    Python delivers signals to the main thread only. In other threads, and where a program has its own handler, nothing
    changes.
    """
    flag = Flag()

    def note(signum: int, frame: object) -> None:
        flag.raised = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    before = signal.signal(signal.SIGINT, note)
    if before is not signal.default_int_handler:
        signal.signal(signal.SIGINT, before)
        yield flag
        return
    try:
        yield flag
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
