"""`eig3.integrate`: saved states, invariants, the end of a run, and errors."""

import contextlib
import dataclasses
import pickle
import re
import sys
import threading

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3 import integrate
from eig3.result import memory
from eig3.run.fixed_run import divide

from .conftest import coupled, first_position, oscillator, oscillator_vector, position

PARAMS = (3.0, 0.0)


def oscillate(t_end=10.0, **options):
    options = {"h": 0.01, "params": PARAMS, **options}
    return integrate(oscillator, (0, t_end), 1.0, 0.0, **options)


oscillator_energy = eig3.jit(lambda t, u, v, p: v * v / 2 + p[0] * p[0] * u * u / 2)

# Saved states ------------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(n=st.integers(1, 300), every=st.integers(1, 400))
def test_save_every_keeps_every_kth_state_and_the_last(n, every):
    whole = oscillate(t_end=n * 0.01)
    some = oscillate(t_end=n * 0.01, save_every=every)
    kept = sorted({*range(0, n + 1, every), n})
    np.testing.assert_array_equal(some.u, whole.u[kept])
    np.testing.assert_array_equal(some.v, whole.v[kept])
    np.testing.assert_array_equal(some.t, whole.t[kept])
    assert whole.n_steps == some.n_steps == n


def test_save_every_none_keeps_the_ends():
    run = integrate(coupled, (0, 5), [1.0, 2.0, 3.0], [0.0] * 3, h=0.01, params=(1, 2, 3), save_every=None)
    assert run.u.shape == run.v.shape == (2, 3)
    assert run.t.tolist() == [0, 5]


def test_history_starts_with_the_given_state():
    run = integrate(coupled, (2, 5), [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], h=0.01, params=(1, 2, 3))
    assert run.u[0].tolist() == [1, 2, 3]
    assert run.v[0].tolist() == [4, 5, 6]
    assert (run.t[0], run.t[-1]) == (2, 5)


@given(span=st.floats(1e-3, 1e6), h=st.floats(1e-4, 1e7))
def test_steps_fill_the_span_and_are_no_longer_than_asked(span, h):
    n, step = divide(0.0, span, h)
    assert n >= 1
    assert step <= h * (1 + 2e-12)
    assert n * step == pytest.approx(span, rel=1e-15)
    assert n == 1 or span / (n - 1) > h  # no step more than needed


@pytest.mark.parametrize(("span", "h", "n"), [(1000, 1e-4, 10**7), (100, 1e-6, 10**8), (0.3, 0.1, 3), (1.0, 0.3, 4)])
def test_a_step_that_divides_the_span_is_kept(span, h, n):
    assert divide(0.0, span, h)[0] == n


@pytest.mark.parametrize("t0", [0.0, -1e3, 1e6, 1e9])
def test_a_step_that_divides_the_span_is_kept_at_late_times(t0):
    """The span has the round-off of its ends, such as 1.2e-10 at t = 1e6."""
    options = {"params": PARAMS, "h": 0.3}
    for end, n in ((t0 + 0.3, 1), (t0 + 2.1, 7)):
        alone = integrate(oscillator, (t0, end), 1.0, 0.0, **options)
        members = eig3.ensemble(oscillator, (t0, end), np.ones(3), 0.0, **options)
        assert [alone.n_steps, *members.n_steps] == [n] * 4


def test_step_is_shrunk_to_land_on_the_end():
    run = oscillate(t_end=1.0, h=0.3)
    assert run.h == 0.25
    assert run.t.tolist() == [0, 0.25, 0.5, 0.75, 1]


# Invariants -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("save_every", [1, 7, 100000, None])
def test_drift_is_that_of_every_step(save_every):
    run = oscillate(t_end=300, save_every=save_every, invariants={"energy": oscillator_energy, "position": position})
    every = oscillate(t_end=300)
    energy = every.v**2 / 2 + 4.5 * every.u**2
    assert run.drift["energy"] == pytest.approx(np.abs(energy - energy[0]).max(), rel=1e-12)
    assert run.drift["position"] == pytest.approx(np.abs(every.u - 1).max(), rel=1e-12)
    np.testing.assert_array_equal(run.u[-1], every.u[-1])


def test_drift_of_a_vector_run_over_many_chunks(monkeypatch):
    monkeypatch.setattr("eig3.run.chunks._CHUNK_SECONDS", 1e-5)
    options = {"h": 0.01, "params": (1, 2, 3), "invariants": {"first": first_position}}
    run = integrate(coupled, (0, 50), [1.0, 2.0, 3.0], [0.0] * 3, save_every=13, **options)
    every = integrate(coupled, (0, 50), [1.0, 2.0, 3.0], [0.0] * 3, **options)
    assert run.drift["first"] == every.drift["first"] == pytest.approx(np.abs(every.u[:, 0] - 1).max(), rel=1e-12)
    np.testing.assert_array_equal(run.u[:-1], every.u[::13][: len(run.u) - 1])


def test_kernel_seconds_hold_no_compiling(monkeypatch):
    """The clock of the slices is read just around its kernel: twice a call, and by nothing else."""
    readings = []
    tick = 2.0**-20
    clock = type(
        "clock", (), {"perf_counter": lambda: readings.append(0) or len(readings) * tick, "thread_time": lambda: 0.0}
    )
    monkeypatch.setattr(eig3.stepping.slices, "time", clock)
    monkeypatch.setattr("eig3.run.short.MOST_SECONDS", 0.0)
    run = oscillate(inline=True, invariants={"energy": oscillator_energy})
    assert len(readings) > 0
    assert run.kernel_seconds == tick * len(readings) / 2  # each call lasts one tick


# How it ends ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("save_every", [1, 7, None])
def test_divergence_keeps_the_finite_part(save_every):
    run = oscillate(t_end=7e3, h=0.7, save_every=save_every, invariants={"energy": oscillator_energy})
    assert run.status is eig3.Status.DIVERGED
    assert not run.success
    assert np.isfinite(run.u).all()
    assert np.isfinite(run.v).all()
    assert run.t[-1] == pytest.approx(run.n_steps * run.h)
    for word in ("non-finite at t =", "h = 0.7", "explain()"):
        assert word in run.message
    for word in ("non-finite at t =", "h = 0.7", "is 0.6667", "(omega = 3, xi = 0)", "h = 0.6 was tried and is stable"):
        assert word in run.explain()
    step = eig3.Stepper(oscillator, 1.0, 0.0, h=run.h, params=PARAMS)
    step.advance(run.n_steps)
    assert step.is_finite
    assert step.u == run.u[-1]
    step.advance(1)
    assert not step.is_finite


def test_pickling_and_printing_a_diverged_solution_run_nothing(monkeypatch):
    run = oscillate(t_end=7e3, h=0.7)
    monkeypatch.setattr(eig3.Stepper, "advance", None)
    copy = pickle.loads(pickle.dumps(run))
    assert copy.message == run.message
    assert run.message in repr(copy) == repr(run)
    assert copy.explain() == run.message
    np.testing.assert_array_equal(copy.u, run.u)


def test_a_pickled_solution_keeps_an_explanation_once_found():
    run = oscillate(t_end=7e3, h=0.7)
    assert "0.6667" in run.explain()
    assert pickle.loads(pickle.dumps(run)).explain() == run.explain()


@eig3.jit
def raises_between_seconds(t, u, v, p):
    if abs(t - round(t)) > 1e-9:
        raise ValueError("not a whole second")
    return -p[0] * u


@pytest.mark.parametrize(
    ("stiffness", "remedy"), [(9.0, "shorter steps"), (1e200, "was not tried, because that would take too long")]
)
def test_a_right_hand_side_that_raises_where_the_cause_is_sought_does_not_hide_it(stiffness, remedy):
    run = integrate(raises_between_seconds, (0, 2000), 1.0, 0.0, h=1.0, params=stiffness)
    assert run.status is eig3.Status.DIVERGED
    assert "became non-finite" in run.message
    assert remedy in run.explain()


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
@pytest.mark.parametrize("rhs_u0", [(oscillator, 1.0), (oscillator_vector, [1.0])], ids=["scalar", "vector"])
def test_divergence_inside_a_solve_is_divergence(solver, rhs_u0):
    rhs, u0 = rhs_u0
    method = eig3.CentralDifference(solver=solver)
    run = integrate(rhs, (0, 1e4), u0, np.zeros_like(u0), h=0.7, params=(3.0, 0.01), method=method)
    assert run.status is eig3.Status.DIVERGED
    assert np.isfinite(run.u).all()


def test_raise_on_failure_carries_the_solution():
    with pytest.raises(eig3.IntegrationError, match="non-finite") as caught:
        oscillate(t_end=1e4, h=0.7, raise_on_failure=True)
    assert caught.value.solution.status is eig3.Status.DIVERGED
    assert len(caught.value.solution.t) > 100
    copy = pickle.loads(pickle.dumps(caught.value))  # as from another process
    assert str(copy) == str(caught.value)
    np.testing.assert_array_equal(copy.solution.u, caught.value.solution.u)


@eig3.jit
def raises_later(t, u, v, p):
    if t > p[0]:
        raise ValueError("past the end of the record")
    return -u


@eig3.jit
def raises_later_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j]
    if t > p[0]:
        raise ValueError("past the end of the record")


@pytest.mark.parametrize("inline", [False, True])
@pytest.mark.parametrize(("rhs", "u0"), [(raises_later, 1.0), (raises_later_vector, [1.0, 2.0, 3.0])])
def test_stepper_stands_where_it_stood_after_an_exception(rhs, u0, inline):
    stepper = eig3.Stepper(rhs, u0, np.zeros_like(u0), h=0.01, params=0.5, inline=inline)
    stepper.advance(20)
    u, n_rhs = stepper.u, stepper.n_rhs
    references = sys.getrefcount(stepper.state), sys.getrefcount(stepper.params)
    for _ in range(3):
        with pytest.raises(ValueError, match="past the end"):
            stepper.advance(100)
    assert (stepper.index, stepper.n_rhs) == (20, n_rhs)
    np.testing.assert_array_equal(stepper.u, u)
    assert (sys.getrefcount(stepper.state), sys.getrefcount(stepper.params)) == references
    stepper.advance(20)
    assert stepper.index == 40


@pytest.mark.parametrize("method", ["eig3", "rk4", "ab3", "cd"])
def test_exceptions_leak_no_history(method):
    for rhs, u0 in ((raises_later, 1.0), (raises_later_vector, [1.0, 2.0, 3.0])):
        rows = np.empty((1000, *np.shape(u0))), np.empty((1000, *np.shape(u0)))
        stepper = eig3.Stepper(rhs, u0, np.zeros_like(u0), h=0.01, params=0.5, method=method)
        references = sys.getrefcount(rows[0])
        for _ in range(3):
            with contextlib.suppress(ValueError):  # pytest.raises would keep the traceback, and so the rows
                stepper.advance(1000, 1, *rows)
        after = sys.getrefcount(rows[0])  # not in an assertion, because pytest keeps references there
        assert after == references
        assert stepper.index == 0


def test_a_thread_can_integrate():
    runs = []
    thread = threading.Thread(target=lambda: runs.append(oscillate()))
    thread.start()
    thread.join()
    assert runs[0].success


def test_progress_bar_counts_the_steps(capsys):
    oscillate(progress=True)
    assert "1.00k/1.00k" in capsys.readouterr().err


def test_without_tqdm_progress_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match="pip install tqdm"):
        oscillate(progress=True)


# The solution --------------------------------------------------------------------------------------------------------


def test_interpolation_meets_the_saved_states_and_keeps_shapes():
    run = integrate(coupled, (0, 5), [1.0, 2.0, 3.0], [0.0] * 3, h=0.01, params=(1, 2, 3), save_every=7)
    u, v = run.at(run.t)
    np.testing.assert_allclose(u, run.u, rtol=0, atol=1e-14)
    np.testing.assert_allclose(v, run.v, rtol=0, atol=1e-12)  # a difference of positions over a step
    assert run.at(2.5)[0].shape == (3,)
    assert run.at([[1.0, 2.0]])[1].shape == (1, 2, 3)
    assert np.ndim(oscillate().at(0.123)[0]) == 0
    ends = integrate(coupled, (0, 1e-9), [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], h=1, params=(1, 2, 3))
    ends.t, ends.u, ends.v = ends.t[:1], ends.u[:1], ends.v[:1]  # as left by a run that fails at its first step
    assert ends.at([0.0, 0.0])[1].tolist() == [[4.0, 5.0, 6.0]] * 2
    for t in (-0.1, 5.1, np.nan):
        with pytest.raises(ValueError, match="within the span"):
            run.at(t)


def test_repr_is_a_summary():
    text = repr(oscillate(invariants={"energy": oscillator_energy}))
    words = ["EIG3(alpha=1.0, beta=0.5)", "completed", "1000 steps", "1001 evaluations", "drift of energy", "ns a step"]
    assert not [word for word in words if word not in text]
    assert "non-finite" in repr(oscillate(t_end=1e4, h=0.7))
    assert "iterations" in repr(oscillate(method=eig3.CentralDifference()))


# Errors ------------------------------------------------------------------------------------------------------------


def plain(t, u, v, p):
    return -u


three_arguments = numba.njit(lambda t, u, v: -u)


@numba.njit
def returns_nothing(t, u, v, p):
    pass


returns_an_integer = numba.njit(lambda t, u, v, p: 0)
returns_float32 = numba.njit(lambda t, u, v, p: np.float32(u))
many_arguments = numba.njit(lambda t, u, v, p, k, m: u)
returns_an_array = numba.njit(lambda t, u, v, p, a: u * 2.0)
does_not_type = numba.njit(lambda t, u, v, p: u + "a")


@numba.njit("float64(float64, float64, float64, float64[:])")
def explicit(t, u, v, p):
    return -u


@numba.njit
def half_written(t, u, v, p, a):
    a[0] = 0.0


@numba.njit
def asks_what_is_unknown(t, u, v, p, a):
    a[0] = u.missing


in_another_order = numba.njit(lambda u, v, t, p: -u)
not_finite = numba.njit(lambda t, u, v, p: 1.0 / u if u != 0 else np.nan)

GOOD = {"rhs": oscillator, "t_span": (0, 1), "u0": 1.0, "v0": 0.0, "h": 0.1, "params": PARAMS}


BAD_VALUES = [
    ({"rhs": half_written, "u0": [1.0, 1.0], "v0": [0.0, 0.0]}, "rhs gives nan for degree of freedom 1"),
    ({"rhs": not_finite, "u0": 0.0}, "rhs gives nan for degree of freedom 0 at the start"),
    ({"u0": [1.0, 2.0]}, "u0 and v0 must have the same shape, not (2,) and ()."),
    ({"u0": [[1.0]], "v0": [[0.0]]}, "u0 must be a number or a 1-D array, not an array of shape (1, 1)."),
    ({"u0": [], "v0": []}, "u0 must hold at least one degree of freedom, but it is empty."),
    ({"u0": np.nan}, "u0 must be finite, but it holds nan."),
    ({"v0": np.inf}, "v0 must be finite, but it holds inf."),
    ({"h": 0}, "h must be a positive, finite number of time units, not 0."),
    ({"h": -0.1}, "h must be a positive, finite number of time units, not -0.1."),
    ({"h": np.nan}, "h must be a positive, finite number of time units, not nan."),
    ({"h": np.inf}, "h must be a positive, finite number of time units, not inf."),
    ({"h": 1e-17}, "h must be at least 1.11e-16 for this t_span"),
    ({"h": np.ones((30, 30))}, "not array([[1., 1., 1.,"),
    ({"t_span": (0, 0)}, "t_span must end after it starts, but it is (0.0, 0.0)."),
    ({"t_span": (1, 0)}, "but it is (1.0, 0.0): to go back in time, integrate f(-t, u, -v) over (-1.0, 0.0) from"),
    ({"t_span": (1e10, 1e10 + 1e-5), "h": 1e-6}, "h must be at least 7.63e-06 for floating-point times"),
    ({"t_span": (-1.7e308, 1.7e308)}, "t_span must have a finite length"),
    ({"t_span": (0, np.inf)}, "t_span must be finite, not (0.0, inf)."),
    ({"t_span": 5.0}, "t_span must be the two times (t0, t1), not 5.0."),
    ({"params": [[1.0]]}, "params must be a number or a 1-D sequence, not an array of shape (1, 1)."),
    ({"method": "euler"}, "method must be one of 'eig3', 'cd', 'rk2', 'rk3', 'rk4', 'ab2', 'ab3'"),
    ({"save_every": 0}, "save_every must be a whole number of at least 1, not 0."),
    ({"save_every": 1.5}, "save_every must be a whole number of at least 1, not 1.5."),
    (
        {"method": eig3.CentralDifference(velocity="none"), "params": (3.0, 0.1)},
        "velocity='none' needs a rhs that ignores v",
    ),
]
BAD_TYPES = [
    ({"rhs": plain}, "rhs must be compiled: decorate it with @eig3.jit or @numba.njit."),
    ({"rhs": 3}, "rhs must be a function decorated with @eig3.jit or @numba.njit, not int."),
    ({"rhs": three_arguments}, "rhs takes 3 arguments, but must take 4: (t, u, v, p) -> a."),
    ({"rhs": oscillator_vector}, "rhs has the vector form (t, u, v, p, a), writing a, but u0 is a number"),
    ({"u0": [1.0], "v0": [0.0]}, "rhs has the scalar form (t, u, v, p) -> a, but u0 is an array"),
    ({"rhs": returns_nothing}, "but it returns nothing."),
    ({"rhs": returns_an_integer}, "return float(...) of it, or 0.0 for 0."),
    ({"rhs": returns_an_array, "u0": [1.0], "v0": [0.0]}, "(t, u, v, p, a), writing a, but it returns array"),
    ({"rhs": does_not_type}, "rhs does not compile for the arguments (t, u, v, p) -> a: "),
    (
        {"rhs": asks_what_is_unknown, "u0": [1.0], "v0": [0.0]},
        "(t, u, v, p, a), writing a: Unknown attribute 'missing' of type readonly array",
    ),
    ({"rhs": in_another_order}, "rhs takes u, v, t, p as its first arguments, but must have the form (t, u, v, p)"),
    ({"rhs": explicit}, "its decorator must not list signatures"),
    ({"u0": 1j}, "u0 must be made of real numbers, not 1j."),
    ({"u0": "a"}, "u0 must be made of real numbers, not 'a'."),
    ({"rhs": returns_float32}, "it returns float32; return float(...) of it"),
    ({"rhs": many_arguments}, "rhs takes 6 arguments, but must take 4"),
    ({"invariants": oscillator_energy}, "invariants must be a dictionary of names and jitted functions"),
    ({"h": "small"}, "h must be made of real numbers, not 'small'."),
    ({"params": "k"}, "params must be made of real numbers, not 'k'."),
    ({"invariants": {"energy": plain}}, "invariants['energy'] must be compiled"),
    ({"invariants": {"energy": three_arguments}}, "invariants['energy'] takes 3 arguments"),
    ({"method": eig3.CentralDifference(jacobian=plain)}, "jacobian must be compiled"),
]


@pytest.mark.parametrize(
    ("error", "change", "message"),
    [(ValueError, *row) for row in BAD_VALUES] + [(TypeError, *row) for row in BAD_TYPES],
)
def test_bad_input_gives_an_error_of_one_sentence(change, error, message):
    with pytest.raises(error) as caught:
        integrate(**{**GOOD, **change})
    text = str(caught.value)
    assert message in text
    assert "\n" not in text
    assert text.endswith(".")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: eig3.EIG3(alpha=np.nan), "alpha must be a finite number"),
        (lambda: eig3.EIG3(velocity="implicit"), "velocity must be 'auto', 'explicit' or 'none', not 'implicit'"),
        (lambda: eig3.EIG3(beta=np.inf), "beta must be a finite number"),
        (
            lambda: eig3.CentralDifference(velocity="explicit"),
            "velocity must be 'auto', 'implicit', 'none' or 'lagged'",
        ),
        (lambda: eig3.CentralDifference(solver="broyden"), "solver must be 'auto', 'newton' or 'fixed-point'"),
        (lambda: eig3.EIG3(alpha="1"), "alpha must be a finite number, not '1'"),
        (lambda: eig3.CentralDifference(tol=0), "tol must be a number between 0 and 1"),
        (lambda: eig3.CentralDifference(max_iterations=0), "max_iterations must be a whole number of at least 1"),
        (lambda: eig3.CentralDifference(max_iterations=2.5), "max_iterations must be a whole number of at least 1"),
        (lambda: eig3.CentralDifference(velocity="lagged", jacobian=plain), "jacobian is used by"),
    ],
)
def test_bad_records_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize("name", [1, ("a", "b"), None, b"a"], ids=repr)
@pytest.mark.parametrize("options", [{"h": 0.1}, {"rtol": 1e-6}], ids=["fixed", "tolerances"])
def test_names_must_be_strings(name, options, tmp_path):
    start = oscillator, (0, 1), 1.0, 0.0
    options = {**options, "params": PARAMS, "save_to": tmp_path / "run"}
    for argument, value in (("events", eig3.Event(position)), ("outputs", position), ("invariants", position)):
        message = rf"^the names in {argument} must be strings, not {re.escape(repr(name))}\.$"
        with pytest.raises(TypeError, match=message):
            integrate(*start, **options, **{argument: {name: value}})
        if argument != "events":
            with pytest.raises(TypeError, match=message):
                eig3.ensemble(oscillator, (0, 1), [1.0, 2.0], 0.0, h=0.1, params=[PARAMS], **{argument: {name: value}})
    with pytest.raises(TypeError, match="the names in z0 must be strings"):
        dataclasses.replace(eig3.problems.shear_building(work=True), z0={name: 0.0})
    assert not (tmp_path / "run").exists()


def test_history_that_does_not_fit_is_refused_with_the_save_every_that_would(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 24e6)
    with pytest.raises(
        MemoryError, match=r"needs 2\.4e\+08 bytes and 2\.4e\+07 are free; save_every=(\d+) would fit"
    ) as caught:
        oscillate(t_end=1e5)
    every = int(str(caught.value).partition("save_every=")[2].split()[0])
    assert every == 11
    run = oscillate(t_end=1e5, save_every=every)
    assert run.success
    assert 24 * len(run.t) <= 24e6


def test_memory_available_is_found():
    assert 1e6 < memory.available_memory() < 1e15


GIGABYTE = 2**30
IN_A_GROUP = {  # the paths of control groups and the files that a process sees, with 1 GiB free in one of the groups
    "version 2, in a container": (
        "0::/",
        {".": {"memory.max": 4 * GIGABYTE, "memory.current": 3 * GIGABYTE, "memory.stat": "anon 7\ninactive_file 0"}},
    ),
    "version 2, its own path and the limit of a group around it": (
        "0::/user/job",
        {
            "user": {
                "memory.max": 5 * GIGABYTE,
                "memory.current": 6 * GIGABYTE,
                "memory.stat": f"inactive_file {2 * GIGABYTE}",
            },
            "user/job": {"memory.max": "max", "memory.current": 7, "memory.stat": "inactive_file 0"},
        },
    ),
    "version 1, in a container that does not see its path": (
        "5:devices:/docker/7\n4:cpu,memory:/docker/7\n0::/",
        {
            "memory": {
                "memory.limit_in_bytes": 2 * GIGABYTE,
                "memory.usage_in_bytes": 2 * GIGABYTE,
                "memory.stat": f"inactive_file 7\ntotal_inactive_file {GIGABYTE}",
            }
        },
    ),
}


@pytest.mark.parametrize("case", IN_A_GROUP)
@pytest.mark.parametrize(("kilobytes", "free"), [(2**21, GIGABYTE), (2**10, 2**20)])
def test_memory_available_in_a_container_is_that_of_its_control_groups(case, kilobytes, free, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "_PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "_CGROUPS", tmp_path / "groups")
    (tmp_path / "proc" / "self").mkdir(parents=True)
    (tmp_path / "proc" / "meminfo").write_text(f"MemTotal: 7 kB\nMemAvailable:   {kilobytes} kB\n")
    paths, groups = IN_A_GROUP[case]
    assert memory.available_memory() == 1024 * kilobytes
    (tmp_path / "proc" / "self" / "cgroup").write_text(paths + "\n")
    assert memory.available_memory() == 1024 * kilobytes
    for group, files in groups.items():
        (tmp_path / "groups" / group).mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (tmp_path / "groups" / group / name).write_text(f"{content}\n")
    assert memory.available_memory() == free


def test_newton_matrix_that_does_not_fit_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 1e6)
    u0, newton = np.zeros(1000), eig3.CentralDifference(solver="newton")
    with pytest.raises(MemoryError, match="solver='fixed-point'"):
        integrate(oscillator_vector, (0, 1), u0, u0, h=0.1, params=PARAMS, method=newton, save_every=None)


def test_caller_keeps_its_arrays():
    u0, v0, p = np.ones(3), np.zeros(3), np.array([1.0, 2.0, 3.0])
    run = integrate(coupled, (0, 1), u0, v0, h=0.01, params=p)
    assert (u0 == 1).all()
    assert (v0 == 0).all()
    assert p.tolist() == [1, 2, 3]
    assert run.u[0].tolist() == [1, 1, 1]


def test_stepper_refuses_rows_that_do_not_fit():
    stepper = eig3.Stepper(oscillator, 1.0, 0.0, h=0.1, params=PARAMS)
    with pytest.raises(ValueError, match="shape"):
        stepper.advance(10, 1, np.empty(9), np.empty(10))
    with pytest.raises(ValueError, match="float64"):
        stepper.advance(10, 1, np.empty(10), np.empty(10, np.float32))
    with pytest.raises(ValueError, match="writeable"):
        stepper.advance(10, 1, [0.0] * 10, np.empty(10))
    with pytest.raises(ValueError, match="count must not be negative"):
        stepper.advance(-1)
    with pytest.raises(TypeError):
        stepper.advance(10, 1.5, np.empty(6), np.empty(6))
    assert stepper.advance(np.int32(0)) == 0
    assert stepper.index == 0
