"""Ctrl-C as a flag, looked at between native chunks, so that it never falls between two halves of a bookkeeping."""

import contextlib
import signal
import threading
from collections.abc import Iterator


class Flag:
    """Whether an interrupt came."""

    raised = False


@contextlib.contextmanager
def deferred_interrupt() -> Iterator[Flag]:
    """Within, the first Ctrl-C only raises the flag; the second is a KeyboardInterrupt as ever.

    Python delivers signals to the main thread alone: elsewhere, and where a program has a handler of its own, nothing
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
