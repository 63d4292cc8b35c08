"""Slices: a run is asked often whether to stop, and how it is divided changes no result."""

import itertools
import time
from functools import partial

import numpy as np
import pytest

import eig3
from eig3.ensembles import lanewise
from eig3.kernels.loops import fixed, variable
from eig3.run import short
from eig3.stepping import slices

from .conftest import assert_same, first_position, harmonic, position

SLICE = 5e-4  # s, the duration of a slice
PER_STEP = 1e-7  # s

#: Where each kind of run gets its kernel.
KERNELS = (fixed, "kernel"), (variable, "kernel"), (lanewise, "wide_kernel"), (lanewise, "adaptive_kernel")


@eig3.jit
def oscillators(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -(1.0 + 0.1 * j) * u[j]


reversed_velocity = eig3.jit(lambda t, u, v, p: (u, -v))

CROSSINGS = {"crossing": eig3.Event(position)}
FIXED, TOLERANCES = {"h": 0.01}, {"rtol": 1e-6, "max_steps": 10**9}
KINDS = {
    "fixed": FIXED,
    "fixed with events": {**FIXED, "events": CROSSINGS},
    "tolerances": TOLERANCES,
    "tolerances with events": {**TOLERANCES, "events": CROSSINGS},
    "ensemble": FIXED,
    "ensemble with tolerances": TOLERANCES,
}


class Clock:
    """A clock of the process that only kernels advance, by a time per step."""

    def __init__(self):
        self.now = 1.0
        self.steps = 0
        self.longest = 0.0  # call of a kernel

    def read(self):
        return self.now

    def watch(self, kernel, slow_from):
        """Return a kernel whose steps take 1000 times as long from a number of steps on."""

        def watched(*arguments):
            result = kernel(*arguments)
            taken = result[0] if isinstance(result, tuple) else result  # of lanes with tolerances
            slow = min(taken, max(0, self.steps + taken - slow_from))
            seconds = PER_STEP * (taken + 999 * slow)
            self.now, self.steps = self.now + seconds, self.steps + taken
            self.longest = max(self.longest, seconds)
            return result

        return watched


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    for name in ("perf_counter", "thread_time"):
        monkeypatch.setattr(time, name, clock.read)
    return clock


def wrap_kernels(monkeypatch, wrap):
    kernel = fixed.kernel

    def wrapped(get, *arguments, **options):
        with pytest.MonkeyPatch.context() as inside:
            inside.setattr(fixed, "kernel", kernel)  # without wide vectors, an ensemble has a kernel from there too
            found = get(*arguments, **options)
        return wrap(found)

    for module, name in KERNELS:
        monkeypatch.setattr(module, name, partial(wrapped, getattr(module, name)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_rhs_that_becomes_1000_times_slower_delays_the_answer_by_1000_short_slices(monkeypatch, clock, kind):
    """A slice that was chosen for fast steps takes 1000 times as long, and those after it are short again."""

    @eig3.jit
    def rhs(t, u, v, p):  # of its own, because the time per step is known of a function that has run
        return -u

    wrap_kernels(monkeypatch, lambda kernel: clock.watch(kernel, slow_from=300_000))
    options = {**KINDS[kind], "save_every": None}
    if "ensemble" in kind:
        t_end, members = (4000, 2) if "h" in options else (836_000, 16)  # which is as many steps
        eig3.ensemble(rhs, (0, t_end), np.linspace(1.0, 2.0, members), 0.0, threads=1, **options)
    else:
        if "max_steps" in options:
            options["max_steps"] = 400_000
        eig3.integrate(rhs, (0, 4000 if "h" in options else 1e9), 1.0, 0.0, **options)
    assert clock.steps == pytest.approx(400_000, rel=0.01)
    assert clock.longest <= 1000 * SLICE * (1 + 1e-3)  # round-off of the clock


@pytest.mark.parametrize("save_every", [1000, None])
def test_a_long_run_with_tolerances_after_a_short_one_has_slices(monkeypatch, clock, save_every):
    """The steps of the short run say nothing about those of a run over another span, which needs few rows too."""
    rhs = eig3.jit(lambda t, u, v, p: -u)
    wrap_kernels(monkeypatch, lambda kernel: clock.watch(kernel, slow_from=10**9))
    for end in (1, 10_000):
        eig3.integrate(rhs, (0, end), 1.0, 0.0, method="rk8", rtol=1e-6, save_every=save_every)
    assert clock.steps > 3 * SLICE / PER_STEP
    assert clock.longest <= SLICE * (1 + 1e-3)  # round-off of the clock


def test_slices_are_short_on_a_busy_machine_and_long_beside_a_busy_thread(monkeypatch):
    """Another process interrupts a slice, and another thread keeps the interpreter after it, each for 4 ms."""
    now, busy, waits = [1.0], [1.0], [0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(time, "thread_time", lambda: busy[0])
    monkeypatch.setattr(slices, "_number_of_waits", lambda: waits[0])

    def durations(is_thread, idle=4e-3, every=1):
        some = slices.Slices(None)
        for k in range(20):
            steps, *begun = some.begin(2**60)
            has_waited = is_thread and k % every == 0
            busy[0] += steps * PER_STEP
            now[0] += steps * PER_STEP + idle * (has_waited or not is_thread)
            waits[0] += has_waited
            some.end(steps, *begun)
            yield some.steps * PER_STEP

    assert max(durations(is_thread=False)) <= SLICE
    assert max(durations(is_thread=True, every=3)) <= SLICE  # threads of an ensemble wait for each other now and then
    assert [*durations(is_thread=True)][-1] == pytest.approx(10 * 4e-3, rel=1e-3)
    assert [*durations(is_thread=True, idle=1.0)][-1] == pytest.approx(0.05, rel=1e-3)  # not without end


def test_steps_that_were_not_taken_do_not_count(clock):
    """A kernel ends early when its log of events is full: the time is that of the steps before."""
    some = slices.Slices(None)
    for _ in range(50):
        steps, *begun = some.begin(2**60)
        done = min(steps, 10)
        clock.now += done * PER_STEP
        some.end(done, *begun)
    assert some.steps <= 16 * 10


BOUNCES = {"bounce": eig3.Event(position, apply=reversed_velocity, direction=-1), "crossing": eig3.Event(position)}
DIVIDED = [
    {**FIXED, "events": BOUNCES},
    {**FIXED, "t_eval": np.linspace(0, 19, 7)},
    {**TOLERANCES, "events": BOUNCES},
    {**TOLERANCES, "events": CROSSINGS, "t_eval": np.linspace(0, 19, 7)},
    {**TOLERANCES, "save_every": 3, "outputs": {"u": position}},
    {**TOLERANCES, "save_every": None, "method": "eig3", "events": CROSSINGS},
]


@pytest.mark.parametrize("options", DIVIDED, ids=lambda options: " ".join(options))
def test_slices_of_one_step_give_the_same_bits(monkeypatch, options):
    whole = eig3.integrate(harmonic, (0, 20), 1.0, 0.5, **options)
    monkeypatch.setattr(slices, "_SECONDS", 1e-12)
    assert_same(whole, eig3.integrate(harmonic, (0, 20), 1.0, 0.5, **options))


@pytest.mark.parametrize("save_every", [1, 7, None])
def test_slices_of_one_step_give_the_same_ensemble(monkeypatch, save_every):
    """Also where a member diverges, and ends at its last finite state."""
    u0 = np.ones((20, 2))
    h = np.linspace(0.05, 0.1, 20)
    h[7] = 2.5  # above the critical step
    outputs = {"first": first_position}
    span = (0, 1500)
    options = {"h": h, "save_every": save_every, "outputs": outputs, "threads": 1}
    members = np.array([0, 7, 19])  # with others, the blocks would only take longer

    def ensemble():
        return eig3.ensemble(oscillators, span, u0[members], [0.0, 0.0], **{**options, "h": h[members]})

    whole = ensemble()
    assert [status.name for status in whole.status] == ["COMPLETED", "DIVERGED", "COMPLETED"]
    monkeypatch.setattr(slices, "_SECONDS", 2e-6)  # a few steps
    assert_same(whole, ensemble())


class StopError(Exception):
    """An exception of the handler of a signal."""


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "ensemble" not in kind])  # which runs in other threads
def test_an_exception_of_a_handler_after_a_kernel_is_raised(monkeypatch, kind):
    """Python calls the handler of a signal when a kernel returns. The exception is not one of rhs."""
    calls = itertools.count()

    def interrupted(kernel):
        def call(*arguments):
            result = kernel(*arguments)
            if next(calls) == 3:
                raise StopError
            return result

        return call

    wrap_kernels(monkeypatch, interrupted)
    monkeypatch.setattr(short, "MOST_SECONDS", 0.0)  # else a run that is fast here is one call
    monkeypatch.setattr(slices, "_SECONDS", 1e-4)
    with pytest.raises(StopError) as raised:
        eig3.integrate(harmonic, (0, 1000), 1.0, 0.0, **KINDS[kind])
    solution = raised.value.solution
    assert solution.status is eig3.Status.INTERRUPTED
    assert len(solution.t) == solution.n_steps + 1  # no state is lost
    assert np.isfinite(solution.u).all()
