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
    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if not ours:
        yield flag
        return

    def note(signum: int, frame: object) -> None:
        flag.raised = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, note)
    try:
        yield flag
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
