"""What is said while the compiler is at work."""

import io
import logging
import math
import sys
import threading

import numba
import pytest

import eig3
from eig3.kernels.compile import jit, notice
from eig3.kernels.compile.numba_internals import compile_for

SAID = "eig3 compiles {}. The first run of new code waits some seconds. What can be kept is then on the disk."


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def heard(monkeypatch):
    """An event that is set when something is said. The series of compilations begins anew, and so does the next one."""
    heard, say = threading.Event(), notice._say

    def hear(what):
        say(what)
        heard.set()

    monkeypatch.setattr(notice, "_say", hear)
    monkeypatch.setattr(notice, "_series", {"spent": 0.0, "ended": -math.inf, "is said": False})
    return heard


@pytest.fixture
def at_once(monkeypatch):
    monkeypatch.setattr(notice, "SECONDS", 0.0)


def said(caplog):
    return [record.getMessage() for record in caplog.records if record.name == "eig3"]


def test_a_long_compilation_is_announced_on_a_terminal(heard, at_once, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with notice.announced("the function rhs"):
        assert heard.wait(60)
    assert sys.stderr.getvalue() == SAID.format("the function rhs") + "\n"


def test_a_notebook_announces_it_as_a_terminal_does(heard, at_once, monkeypatch):
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with notice.announced("the function rhs"):
        assert heard.wait(60)
    assert sys.stderr.getvalue() == SAID.format("the function rhs") + "\n"


def test_without_a_terminal_a_logger_announces_it(heard, at_once, caplog, capfd):
    caplog.set_level(logging.INFO, "eig3")
    with notice.announced("the function rhs"):
        assert heard.wait(60)
    assert said(caplog) == [SAID.format("the function rhs")]
    assert capfd.readouterr() == ("", "")


def test_a_program_without_stderr_can_compile(heard, at_once, monkeypatch, caplog):
    caplog.set_level(logging.INFO, "eig3")
    monkeypatch.setattr(sys, "stderr", None)
    with notice.announced("the function rhs"):
        assert heard.wait(60)
    assert said(caplog) == [SAID.format("the function rhs")]


@pytest.mark.parametrize("pause", [0.0, 2.0])
def test_a_series_of_short_compilations_is_announced_once(heard, monkeypatch, caplog, pause):
    """The clock and the timer are those of the test: the third compilation is announced after the last 0.2 s."""
    clock, delays = [0.0], []

    class Timer(threading.Timer):
        def __init__(self, delay, *arguments):
            delays.append(delay)
            super().__init__(0.0 if delay < 0.4 else 3600.0, *arguments)

    monkeypatch.setattr(notice.threading, "Timer", Timer)
    monkeypatch.setattr(notice.time, "monotonic", lambda: clock[0])
    caplog.set_level(logging.INFO, "eig3")
    for k in range(5):
        with notice.announced(f"the function f{k}"):
            if k == 2 and not pause:
                assert heard.wait(60)
            clock[0] += 0.4
        clock[0] += pause
    if pause:
        assert delays == [1.0] * 5
        assert said(caplog) == []
    else:
        assert delays == pytest.approx([1.0, 0.6, 0.2, 0.0, 0.0])
        assert said(caplog) == [SAID.format("the function f2")]


def test_what_takes_less_than_a_second_is_not_announced(heard, caplog, monkeypatch):
    caplog.set_level(logging.INFO, "eig3")
    monkeypatch.setattr(notice, "SECONDS", 3600.0)
    with notice.announced("the function rhs"):
        pass
    assert not heard.is_set()
    assert said(caplog) == []


def test_every_compilation_is_announced(heard, at_once, caplog, monkeypatch):
    """The compiler of this test waits until it is announced, and then compiles."""
    caplog.set_level(logging.INFO, "eig3")

    @eig3.jit
    def stiffness(x):
        return 2 * x

    def compile_slowly(function, arguments):
        assert heard.wait(60)
        compile_for(function, arguments)

    monkeypatch.setattr(jit, "compile_for", compile_slowly)
    result = jit.compiled(stiffness, (numba.float64,))
    assert said(caplog) == [SAID.format("the function stiffness")]
    assert numba.njit(lambda x: stiffness(x))(3.0) == 6.0
    monkeypatch.setattr(notice.threading, "Timer", None)  # what is compiled is not announced again
    assert jit.compiled(stiffness, (numba.float64,)) is result
