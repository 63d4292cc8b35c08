"""Prepared runs: the numbers of `integrate`, few Python calls, threads and pickles."""

import copy
import ctypes
import gc
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import ClassVar

import numpy as np
import pytest

import eig3
from eig3 import problems
from eig3.run import short

from .conftest import assert_same, bounce, first_position, oscillator, oscillator_vector, position, spring, velocity

SPAN, P = (0.0, 1.0), np.array([3.0, 0.1])
U, V = np.array([1.0, 0.5, -0.5]), np.zeros(3)

energy = eig3.jit(lambda t, u, v, p: (p[0] * p[0] * u * u + v * v) / 2)


@eig3.jit
def both(t, u, v, p, out):
    out[0], out[1] = u, v


KINDS = {
    "scalar": (oscillator, {"h": 0.01}, 1.0, 0.0),
    "vector": (oscillator_vector, {"h": 0.01}, U, V),
    "scalar, rtol": (oscillator, {"rtol": 1e-6}, 1.0, 0.0),
    "vector, rtol": (oscillator_vector, {"rtol": 1e-6}, U, V),
}


def python_calls(function):
    """Count the calls of Python functions while `function` runs, itself included."""
    count = 0

    def profile(frame, event, argument):
        nonlocal count
        count += event == "call"

    for _ in range(3):  # the first runs compile, and measure the time of a step
        function()
    gc.disable()  # it calls functions of other packages
    sys.setprofile(profile)
    try:
        function()
    finally:
        sys.setprofile(None)
        gc.enable()
    return count - 1


@pytest.fixture
def always_short(monkeypatch):
    """Let no other process on the machine make a run look long."""
    monkeypatch.setattr(short, "MOST_SECONDS", 1e9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_prepared_run_makes_few_python_calls(kind, always_short):
    rhs, options, u0, v0 = KINDS[kind]
    prepared = eig3.prepare(rhs, **options)
    most = 26 if "rtol" in options else 23  # with tolerances, the kernel is called once more for the last step
    assert python_calls(lambda: prepared(SPAN, u0, v0, P)) <= most


FOLLOWED = {
    "plain": {},
    "energy": {"invariants": {"energy": energy}},
    "event": {"events": {"zero": eig3.Event(position)}},
}


@pytest.mark.parametrize("followed", FOLLOWED)
@pytest.mark.parametrize("options", [{"h": 0.01}, {"rtol": 1e-6}], ids=["h", "rtol"])
def test_integrate_makes_few_python_calls(options, followed, always_short):
    options = {**options, **FOLLOWED[followed], "params": P}
    most = 105 if followed != "plain" else 51 if "h" in options else 54  # plain: 46 and 49 in a new process
    assert python_calls(lambda: eig3.integrate(oscillator, SPAN, 1.0, 0.0, **options)) <= most


def test_options_that_are_remembered_are_those_of_the_same_types():
    eig3.integrate(oscillator, SPAN, 1.0, 0.0, h=1.0, save_every=1, params=P)
    with pytest.raises(ValueError, match=r"^save_every must be"):
        eig3.integrate(oscillator, SPAN, 1.0, 0.0, h=1.0, save_every=True, params=P)
    with pytest.raises(TypeError) as error:
        eig3.integrate(oscillator, SPAN, 1.0, 0.0, h=1.0, inline=1, params=P)
    assert error.value.__context__ is None  # the option is checked twice, and a user reads one error


def test_times_that_change_in_an_object_with_a_hash_are_the_new_ones():
    """As a tensor of PyTorch, whose hash is its identity."""

    class Tensor:
        values: ClassVar[list[float]] = [0.25, 1.0]

        def __array__(self, dtype=None, copy=None):
            return np.array(self.values)

    times = Tensor()
    for first in (0.25, 0.5):
        times.values[0] = first
        assert eig3.integrate(oscillator, SPAN, 1.0, 0.0, h=1.0, t_eval=times, params=P).t[0] == first


def test_a_method_that_is_defined_again_is_the_new_one():
    def label_in_a_run(text):
        class Again(eig3.Method):
            name: ClassVar[str] = "again"
            label: ClassVar[str] = text
            kernel: ClassVar[str] = eig3.RK4.kernel
            order: ClassVar[int] = 4

        return [
            eig3.integrate(oscillator, SPAN, 1.0, 0.0, h=1.0, method="again", params=P).method.label for _ in range(2)
        ]

    try:
        assert [label_in_a_run("first"), label_in_a_run("second")] == [["first"] * 2, ["second"] * 2]
    finally:
        eig3.METHODS.pop("again", None)


OPTIONS = {
    "plain": {},
    "every seventh": {"save_every": 7},
    "ends": {"save_every": None},
    "times": {"t_eval": np.linspace(0.0, 1.0, 7)},
    "outputs": {"outputs": {"u": position, "both": (both, 2)}, "invariants": {"energy": energy}},
    "events": {"events": {"zero": eig3.Event(position, apply=bounce)}, "outputs": {"both": (both, 2)}, "save_every": 3},
    "terminal": {"events": {"zero": eig3.Event(position, terminal=True)}},
    "terminal with a reset": {
        "events": {"zero": eig3.Event(position, apply=bounce, terminal=True)},
        "outputs": {"both": (both, 2)},
        "save_every": 3,
    },
    "terminal at times": {
        "events": {"zero": eig3.Event(position, apply=bounce, terminal=True)},
        "outputs": {"both": (both, 2)},
        "t_eval": np.linspace(0.0, 1.0, 7),
    },
    "inline": {  # the quantities and the method of test_pairs, which compiles the same loop
        "inline": True,
        "invariants": {"energy": energy},
        "outputs": {"force": spring},
        "events": {"zero": eig3.Event(position, apply=bounce)},
    },
}


STEPS = {"ab3": {"h": 2.0**-7, "method": "ab3"}, "rk8": {"h": 2.0**-7, "method": "rk8"}}
STEPS["rk5"] = {"rtol": 1e-7, "method": "rk5"}


@pytest.mark.parametrize(
    ("options", "steps"),  # one inlined loop with a fixed step: another method would only compile another one
    [(o, s) for o in OPTIONS for s in STEPS if (o, s) != ("inline", "rk8")],
)
def test_a_short_run_has_the_numbers_of_a_long_one(options, steps, monkeypatch):
    """Also what is found later: notes, accelerations, and a run that goes on."""
    prepared = eig3.prepare(oscillator, **STEPS[steps], **OPTIONS[options])
    monkeypatch.setattr(short, "MOST_SECONDS", 0.0)
    long = prepared(SPAN, 1.0, 0.0, P)
    monkeypatch.setattr(short, "MOST_SECONDS", 1e9)
    for run in (prepared(SPAN, 1.0, 0.0, P), prepared(SPAN, 1.0, 0.0, P)):
        assert_same(run, long)
        np.testing.assert_array_equal(run.a, long.a)
        assert run.message == long.message
        if long.can_go_on:
            assert_same(run.extend(2.0), long.extend(2.0))


@pytest.mark.parametrize("kind", KINDS)
def test_it_has_the_numbers_of_integrate(kind):
    rhs, options, u0, v0 = KINDS[kind]
    prepared = eig3.prepare(rhs, **options)
    for scale in (1.0, 2.0):
        assert_same(prepared(SPAN, scale * u0, v0, P), eig3.integrate(rhs, SPAN, scale * u0, v0, params=P, **options))


def test_threads_share_a_prepared_run():
    prepared = eig3.prepare(
        oscillator_vector, h=1e-3, invariants={"first": first_position}, outputs={"u": first_position}
    )
    starts = [U * (1 + k) for k in range(40)]
    with ThreadPoolExecutor(8) as pool:
        runs = [*pool.map(lambda u0: prepared((0.0, 2.0), u0, V, P), starts)]
    for u0, run in zip(starts, runs, strict=True):
        alone = prepared((0.0, 2.0), u0, V, P)
        assert_same(run, alone)


def test_a_prepared_run_of_a_problem_can_be_pickled():
    prepared = problems.duffing().prepare(rtol=1e-7)
    copied = pickle.loads(pickle.dumps(prepared))
    assert_same(copied(), prepared())
    assert_same(copied(u0=0.5), prepared(u0=0.5))
    assert copied().labels == problems.duffing().labels


def test_integrals_are_those_of_the_problem():
    problem = problems.shear_building(work=True)
    prepared = problem.prepare(h=2.0**-10)
    run, whole = prepared((0.0, 0.125)), problem.integrate(h=2.0**-10, t_end=0.125)
    np.testing.assert_array_equal(run.z["work"], whole.z["work"])
    assert run.u.shape[1] == np.size(problem.u0)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((SPAN, U, V, P), ValueError, "^u0 must be a number, because rhs has the scalar form"),
        ((SPAN, 1.0, np.nan, P), ValueError, "^v0 must be finite"),
        (((1.0, 0.0), 1.0, 0.0, P), ValueError, "^t_span must end after it starts"),
        ((SPAN, 1.0, 0.0, "a"), TypeError, "^params must be made of real numbers"),
        ((SPAN, 1.0, 0.0), ValueError, "it reads beyond the end of p"),
    ],
)
def test_errors_of_a_call(arguments, error, message):
    prepared = eig3.prepare(oscillator, h=0.01)
    for _ in range(2):
        with pytest.raises(error, match=message):
            prepared(*arguments)
        prepared(SPAN, 1.0, 0.0, P)


def test_errors_of_prepare():
    with pytest.raises(ValueError, match=r"^give h for a fixed step, or rtol for tolerances"):
        eig3.prepare(oscillator)
    with pytest.raises(TypeError, match="rhs must be compiled"):
        eig3.prepare(lambda t, u, v, p: -u, h=0.1)
    with pytest.raises(ValueError, match="h and rtol exclude each other"):
        eig3.prepare(oscillator, h=0.1, rtol=1e-3)


@eig3.jit
def fails_later(t, u, v, p):
    if t > 0.5:
        raise ValueError("too late")
    return -u


def test_an_exception_has_the_run_up_to_then():
    prepared = eig3.prepare(fails_later, h=2.0**-7)
    for _ in range(3):
        with pytest.raises(ValueError, match="too late") as caught:
            prepared(SPAN, 1.0, 0.0)
        assert caught.value.solution.status is eig3.Status.INTERRUPTED
        assert 0.4 < caught.value.solution.t[-1] <= 0.5 + 2.0**-7
        assert prepared((0.0, 0.25), 1.0, 0.0).success


@pytest.mark.parametrize("kind", KINDS)
def test_all_uses_of_a_method_share_kernels(kind):
    """With a fixed step, one for bare runs, one that follows quantities, one that searches too; with tolerances, one.

    Each takes seconds to compile, once.
    """
    rhs, steps, u0, v0 = KINDS[kind]
    of_vector = np.ndim(u0) > 0
    height = first_position if of_vector else position
    uses = [
        {},
        {"save_every": None},
        {"t_eval": [0.5, 1.0]},
        {"invariants": {"a": height}},
        {"outputs": {"b": height}, "save_every": 3},
        {"events": {"zero": eig3.Event(height)}},
        {"events": {"zero": eig3.Event(height, terminal=True)}, "invariants": {"a": height}},
    ]
    kernels, own = set(), eig3.jit(rhs.py_func)  # systems of another function know the kernels of other tests
    for use in uses:
        prepared = eig3.prepare(own, **steps, **use)
        prepared(SPAN, u0, v0, P)
        calls = [kernel.call for kernel in prepared.system.kernels.values()]
        kernels.update(getattr(call, "compiled", call) for call in calls)
    assert len(kernels) == (1 if "rtol" in steps else 3)


@pytest.fixture
def change():
    """Options of a caller, who changes what is in them after a call."""
    given = {
        "h": None,
        "rtol": np.array(1e-3),
        "atol": [[np.array(1e-3)], [1e-3]],
        "t_eval": [0.25, 0.5],
        "events": {"zero": eig3.Event(position)},
        "invariants": {"energy": energy},
        "outputs": {"u": position},
    }

    def make():
        given["rtol"][...] = given["atol"][0][0][...] = given["atol"][1][0] = 1e-12
        given["t_eval"][:] = [0.3, 0.9]
        given["events"] |= {"wall": given["events"].pop("zero")}
        given["invariants"].clear()
        given["outputs"]["v"] = velocity

    return given, make


def assert_same_at_times(one, other):
    assert_same(one, other)
    assert list(one.events) == list(other.events) == ["zero"]


def test_options_that_change_later_do_not_matter(change):
    """Not for a prepared run, nor for its copy, nor for one to a later end, which looks at the times again."""
    options, make = change
    run = eig3.prepare(oscillator, **options)
    before = [run((0.0, t_end), 1.0, 0.0, P) for t_end in (1.0, 2.0)]
    make()
    for each in (run, pickle.loads(pickle.dumps(run)), copy.deepcopy(run)):
        for t_end, expected in zip((1.0, 2.0), before, strict=True):
            assert_same_at_times(each((0.0, t_end), 1.0, 0.0, P), expected)
            expected.extend(3.0)


def test_options_that_change_later_do_not_matter_to_other_code(change):
    """The functions are remembered by what the dictionaries had."""
    options, make = change
    before = eig3.integrate(oscillator, SPAN, 1.0, 0.0, params=P, **options)
    make()
    fresh = {"events": {"zero": eig3.Event(position)}, "invariants": {"energy": energy}, "outputs": {"u": position}}
    fresh |= {"rtol": 1e-3, "atol": 1e-3, "t_eval": [0.25, 0.5]}
    assert_same_at_times(eig3.integrate(oscillator, SPAN, 1.0, 0.0, params=P, **fresh), before)


def test_options_that_change_later_do_not_matter_to_an_ensemble(change):
    options, make = change
    runs = eig3.ensemble(oscillator, SPAN, [1.0, 2.0], 0.0, params=P[None], **options)
    longer = runs.extend(2.0)
    make()
    again = runs.extend(2.0)
    assert_same(again, longer)
    assert [list(again.events), list(again.drift), list(again.outputs)] == [["zero"], ["energy"], ["u"]]


# A function outside of Numba, which the compiled rhs calls: what it returns may change at any time.
LOAD = [0.0, 0]  # its value, and how often it was called
FORCE = ctypes.CFUNCTYPE(ctypes.c_double)(lambda: (LOAD.__setitem__(1, LOAD[1] + 1), LOAD[0])[1])

loaded = eig3.jit(lambda t, u, v, p: FORCE() - p[0] * u)


@pytest.mark.parametrize("options", [{"h": 0.125}, {"rtol": 1e-4}, {"h": 0.125, "t_eval": [0.3, 1.0]}], ids=str)
def test_what_is_found_later_of_a_short_run_takes_no_step_again(options, always_short):
    prepared = eig3.prepare(loaded, method="rk8", **options)
    LOAD[0] = 1.0
    run = [prepared(SPAN, 1.0, 0.0, P) for _ in range(3)][-1]
    u, LOAD[1] = run.u.copy(), 0
    state = run._state
    assert LOAD[1] == 0
    assert state["stepper"]["index"] > 0
    LOAD[0] = 2.0
    further = {"t_eval": [1.5]} if "t_eval" in options else {}
    longer = run.extend(1.5, **further)
    np.testing.assert_array_equal(longer.u[: len(u) - 1], u[:-1])  # a last step to the end is taken again
    assert isinstance(run.notes, tuple)


pushed = eig3.jit(lambda t, u, v, p: t - u)


@pytest.mark.parametrize("options", [{"h": 0.01}, {"rtol": 1e-6}])
def test_a_run_from_rest_is_done_once(options, always_short, monkeypatch):
    """Fixed steps stop in the middle to measure its size, and tolerances before the last step, which is shortened."""
    tried = []
    at_once = short.at_once
    monkeypatch.setattr(short, "at_once", lambda *given: tried.append(at_once(*given)) or tried[-1])
    prepared = eig3.prepare(pushed, **options)
    for _ in range(3):  # the first run measures the time of a step
        run = prepared((0, 10), 0.0, 0.0)
    assert len(tried) >= 2
    assert None not in tried
    monkeypatch.setattr(short, "MOST_SECONDS", 0.0)
    assert_same(run, prepared((0, 10), 0.0, 0.0))
    assert_same(run.extend(12.0), prepared((0, 12), 0.0, 0.0))


pushed_and_pulled = eig3.jit(lambda t, u, v, p: t - 1.01e4 * u)


def test_a_run_from_rest_that_grows_because_of_its_step_ends_as_diverged():
    """omega h = 2.01, so u grows by 1.2 a step and is not beyond the range of floats: also after 1000 more steps."""
    prepared = eig3.prepare(pushed_and_pulled, h=0.02)
    runs = [prepared((0, 10), 0.0, 0.0) for _ in range(3)]
    assert [run.status for run in runs] == [eig3.Status.DIVERGED] * 3
