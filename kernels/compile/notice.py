"""Say that the compiler is at work, once it has taken a second: a user who waits wants to know for what."""

from __future__ import annotations

import logging
import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SECONDS = 1.0  # after which it is said; a pause of this length ends a series of compilations

_log = logging.getLogger("eig3")
_lock = threading.Lock()
_series = {"spent": 0.0, "ended": -math.inf, "is said": False}


@contextmanager
def announced(what: str) -> Iterator[None]:
    """Say what is compiled in this block if the series of compilations that it belongs to takes more than a second.

    It is said once in a series: in a line on stderr if that is a terminal or a notebook, and otherwise by the logger
    "eig3", at the level INFO.
    """
    begin = time.monotonic()
    with _lock:
        if begin - _series["ended"] > SECONDS:
            _series.update({"spent": 0.0, "is said": False})
        left = max(0.0, SECONDS - _series["spent"])
    timer = threading.Timer(left, _say, [what])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with _lock:
            _series["ended"] = time.monotonic()
            _series["spent"] += _series["ended"] - begin


def _say(what: str) -> None:
    with _lock:
        was_said, _series["is said"] = _series["is said"], True
    if was_said:
        return
    text = f"eig3 compiles {what}. The first run of new code waits some seconds. What can be kept is then on the disk."
    if sys.stderr is not None and (sys.stderr.isatty() or "ipykernel" in sys.modules):
        print(text, file=sys.stderr, flush=True)
    else:
        _log.info(text)
