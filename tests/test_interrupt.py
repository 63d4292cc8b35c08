"""Ctrl-C and cancellation: the run ends soon, nothing is lost, and no result changes."""

import asyncio
import os
import signal
import threading
import time

import numpy as np
import pytest

import eig3
from eig3.kernels.compile.interrupt import DeferredInterrupt
from eig3.stepping.march import March

from .conftest import energy, harmonic, harmonic_vector

pytestmark = pytest.mark.usefixtures("python_handler")

STEP = 2.0**-10  # exact in binary, so that t = n STEP is exact too


@pytest.fixture(autouse=True, scope="module")
def compiled():
    """The time until Ctrl-C is for the run, not for the compiler."""
    eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=0.1, invariants={"e": energy})
    eig3.integrate(harmonic_vector, (0, 1), [1.0], [0.0], h=0.1)


@pytest.fixture(autouse=True)
def long(monkeypatch):
    """A short run is one call of a kernel, after which there is nothing to interrupt."""
    monkeypatch.setattr("eig3.run.short.MOST_SECONDS", 0.0)


@pytest.fixture
def after_begin(monkeypatch):
    """Call a function soon after the first steps of a run begin, however long the set-up takes."""
    timers = []

    def call(function):
        def begin(stepper, *arguments, **options):
            if not timers:
                timers.append(threading.Timer(0.2, function))
                timers[0].start()
            return take(stepper, *arguments, **options)

        take = March.take
        monkeypatch.setattr(March, "take", begin)

    yield call
    for timer in timers:
        timer.join()


@pytest.fixture
def ctrl_c_soon(after_begin):
    after_begin(press)


def press(*arguments, **options):
    os.kill(os.getpid(), signal.SIGINT)


def endless(form="scalar", **options):
    rhs, u0, v0 = (harmonic, 1.0, 0.0) if form == "scalar" else (harmonic_vector, np.ones(2), np.zeros(2))
    return eig3.integrate(rhs, (0, 2**40 * STEP), u0, v0, h=STEP, **{"save_every": 2**30, **options})


@pytest.mark.usefixtures("ctrl_c_soon")
@pytest.mark.parametrize(
    ("form", "options"),
    [("scalar", {}), ("scalar", {"save_every": None}), ("vector", {}), ("scalar", {"invariants": {"e": energy}})],
)
def test_ctrl_c_raises_with_the_run_up_to_then(form, options):
    begin = time.perf_counter()
    with pytest.raises(KeyboardInterrupt) as caught:
        endless(form, **options)
    run = caught.value.solution
    assert run.status is eig3.Status.INTERRUPTED
    assert "interrupted" in run.message
    assert time.perf_counter() - begin < 30  # the run would take an hour
    assert 0 < run.n_steps < 2**40
    assert run.t[-1] == run.n_steps * STEP
    assert run.n_rhs == 1 + run.n_steps
    again = eig3.Stepper(harmonic, 1.0, 0.0, h=STEP)
    again.advance(run.n_steps)
    np.testing.assert_array_equal(run.u[-1], np.broadcast_to(again.u, run.u[-1].shape))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_after_the_last_step_comes_with_the_complete_run(monkeypatch):
    run = KeyboardInterrupt()
    monkeypatch.setattr(eig3.Stepper, "note_pace", press)
    with pytest.raises(KeyboardInterrupt) as caught:
        run = eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=STEP)
    assert isinstance(run, KeyboardInterrupt)  # nothing was returned
    assert caught.value.solution.status is eig3.Status.COMPLETED
    assert caught.value.solution.t[-1] == 1


def test_an_interrupt_does_not_hide_a_divergence(monkeypatch):
    monkeypatch.setattr(eig3.Stepper, "note_pace", press)
    with pytest.raises(KeyboardInterrupt) as caught:
        eig3.integrate(harmonic, (0, 1e5), 1.0, 0.0, h=2.5)
    assert caught.value.solution.status is eig3.Status.DIVERGED


def test_a_motion_that_grew_is_not_complete_before_its_growth_is_judged(monkeypatch):
    monkeypatch.setattr(eig3.Stepper, "note_pace", press)
    with pytest.raises(KeyboardInterrupt) as caught:
        eig3.integrate(harmonic, (0, 210), 1.0, 0.0, h=2.1)
    assert caught.value.solution.status is eig3.Status.INTERRUPTED
    assert caught.value.solution.n_steps == 100


def test_an_interrupt_of_the_set_up_has_no_solution(monkeypatch):
    monkeypatch.setattr(eig3.stepping.march, "evaluation", press)
    with pytest.raises(KeyboardInterrupt) as caught:
        eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=0.1)
    assert caught.value.solution is None


DECAY = eig3.Problem("decay", harmonic, 1.0, 0.0, (), t_span=(0.0, 1.0))
WITHOUT_A_RUN = {
    "plan": ("eig3.planning.planner.Pilots", lambda: eig3.plan(DECAY, 1e-3)),
    "fit": ("eig3.fitting.fit.check_places", lambda: eig3.fit(DECAY, ([0.5], [1.0]), "u0", h=0.1)),
    "sensitivities": ("eig3.fitting.sensitivities.check_places", lambda: eig3.sensitivities(DECAY, "u0", h=0.1)),
    "prepare": ("eig3.run.prepare.remembered", lambda: eig3.prepare(harmonic, h=0.1)),
    "integrate": ("eig3.run.prepare.remembered", lambda: eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=0.3)),
}


@pytest.mark.parametrize("name", WITHOUT_A_RUN)
def test_an_interrupt_outside_a_run_has_the_attribute_too(name, monkeypatch):
    place, call = WITHOUT_A_RUN[name]
    monkeypatch.setattr(place, press)
    with pytest.raises(KeyboardInterrupt) as caught:
        call()
    assert caught.value.solution is None


def test_an_interrupt_while_a_file_is_written_has_the_attribute_too(monkeypatch, tmp_path):
    one = eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=0.1)
    many = eig3.ensemble(harmonic, (0, 1), [1.0], 0.0, h=0.1)
    monkeypatch.setattr(np, "savez", press)
    for each in (one, many):
        with pytest.raises(KeyboardInterrupt) as caught:
            each.save(tmp_path / "file")
        assert caught.value.solution is None
    assert not [*tmp_path.iterdir()]


def test_problems_hand_on_the_run_with_its_integrals(monkeypatch):
    monkeypatch.setattr(eig3.Stepper, "note_pace", press)
    problem = eig3.problems.shear_building()
    with pytest.raises(KeyboardInterrupt) as caught:
        problem.integrate(h=1e-3, t_end=0.01)
    assert caught.value.solution.u.shape[1] == np.size(problem.u0)
    assert set(caught.value.solution.z) == set(problem.z0)


@pytest.mark.usefixtures("ctrl_c_soon")
def test_a_handler_of_the_program_is_called_in_the_run_which_goes_on():
    cancel = threading.Event()
    signal.signal(signal.SIGINT, lambda *arguments: cancel.set())
    run = endless(cancel=cancel)
    assert run.status is eig3.Status.INTERRUPTED


@pytest.mark.usefixtures("ctrl_c_soon")
def test_an_exception_of_such_a_handler_ends_the_run():
    def stop(*arguments):
        raise SystemExit("stopped")

    signal.signal(signal.SIGINT, stop)
    with pytest.raises(SystemExit, match="stopped") as caught:
        endless()
    assert caught.value.solution.n_steps > 0


class StopError(Exception):
    """An exception that is not derived from KeyboardInterrupt."""


def stop(*arguments):
    raise StopError


@pytest.mark.usefixtures("ctrl_c_soon")
@pytest.mark.parametrize("options", [{}, {"invariants": {"e": energy}}])
def test_an_exception_of_a_handler_is_not_taken_for_one_of_rhs(options):
    signal.signal(signal.SIGINT, stop)
    with pytest.raises(StopError) as caught:
        endless(**options)
    run = caught.value.solution
    assert run.status is eig3.Status.INTERRUPTED
    again = eig3.Stepper(harmonic, 1.0, 0.0, h=STEP)
    again.advance(run.n_steps)
    assert run.u[-1] == again.u
    assert run.n_steps == 0 or all(drift < 1e-3 for drift in run.drift.values())


def test_an_alarm_ends_a_run(after_begin):
    before = signal.signal(signal.SIGALRM, stop)
    after_begin(lambda: os.kill(os.getpid(), signal.SIGALRM))
    try:
        with pytest.raises(StopError) as caught:
            endless()
    finally:
        signal.signal(signal.SIGALRM, before)
    assert 0 < caught.value.solution.n_steps < 2**40


def test_a_handler_that_sets_another_one_is_not_put_back(monkeypatch):
    def once(*arguments):
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    signal.signal(signal.SIGINT, once)
    monkeypatch.setattr(eig3.Stepper, "note_pace", press)
    assert eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=STEP).success
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_a_dear_invariant_does_not_delay_the_answer(after_begin):
    @eig3.jit
    def dear(t, u, v, p):
        e = u
        for _ in range(10000):
            e = 0.5 * (e + v)
        return e

    eig3.integrate(harmonic, (0, 1), 1.0, 0.0, h=0.1, invariants={"e": dear})
    after_begin(press)
    begin = time.perf_counter()
    with pytest.raises(KeyboardInterrupt) as caught:
        eig3.integrate(harmonic, (0, 2**20 * STEP), 1.0, 0.0, h=STEP, invariants={"e": dear})
    assert time.perf_counter() - begin < 10  # the whole run takes half a minute
    assert caught.value.solution.n_steps > 0


def test_the_interrupt_comes_at_the_end_of_the_outer_block():
    reached = []

    def blocks():
        with DeferredInterrupt() as outer:
            with DeferredInterrupt() as inner:
                press()
                reached.append("inner")
            reached.append("outer")
            assert outer is inner
            assert outer.is_set()
        reached.append("after")

    with pytest.raises(KeyboardInterrupt):
        blocks()
    assert reached == ["inner", "outer"]
    with DeferredInterrupt() as block:
        assert not block.is_set()


def test_programs_that_ignore_ctrl_c_go_on_to_do_so():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with DeferredInterrupt():
        press()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_a_run_in_a_thread_is_cancelled(after_begin):
    async def main():
        cancel = threading.Event()
        after_begin(cancel.set)
        return await asyncio.to_thread(endless, cancel=cancel)

    run = asyncio.run(main())
    assert run.status is eig3.Status.INTERRUPTED
    assert 0 < run.n_steps < 2**40


def test_cancel_must_be_an_event():
    with pytest.raises(TypeError, match=r"cancel must be a threading.Event, not True\."):
        endless(cancel=True)


def test_a_long_advance_is_cancelled_with_the_state_of_its_steps():
    cancel = threading.Event()
    stepper = eig3.Stepper(harmonic, 1.0, 0.0, h=STEP)
    timer = threading.Timer(0.1, cancel.set)
    timer.start()
    taken = stepper.advance(2**40, cancel=cancel)
    assert 0 < taken == stepper.index < 2**40
    assert not stepper.failed
    again = eig3.Stepper(harmonic, 1.0, 0.0, h=STEP)
    again.advance(taken)
    assert stepper.u == again.u


def test_a_second_thread_cannot_use_a_stepper_at_the_same_time():
    cancel = threading.Event()
    stepper = eig3.Stepper(harmonic, 1.0, 0.0, h=STEP)
    thread = threading.Thread(target=stepper.advance, args=(2**40,), kwargs={"cancel": cancel})
    try:
        thread.start()
        while not stepper._lock.locked():
            time.sleep(0.001)
        for use in (lambda: stepper.advance(1), stepper.back, stepper.fork):
            with pytest.raises(RuntimeError, match=r"this stepper is in use: .* fork\(\)"):
                use()
    finally:
        cancel.set()
        thread.join()
    stepper.advance(1)
