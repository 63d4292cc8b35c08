"""Ctrl-C during a run.

Ctrl-C sets a flag, which is checked between chunks. So the state is never half updated.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator


class Flag:
    """Whether Ctrl-C was pressed."""

    raised = False


@contextlib.contextmanager
def deferred_interrupt() -> Iterator[Flag]:
    """Let the first Ctrl-C only set the flag; the second one raises KeyboardInterrupt as usual.

    Nothing changes in threads other than the main thread, because Python delivers signals only to the main thread, and
    in programs that have their own handler of SIGINT.
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
