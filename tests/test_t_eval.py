"""States at the times of t_eval: the dense output within the steps, at their ends, and next to impacts."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3 import Event, Status
from eig3.problems.bouncing_ball import bouncing_ball

from .conftest import damped, first_position, hardening_chain, position, spring

squares = eig3.jit(lambda t, u, v, p: u * u)

RUNS = [{"h": 0.1, "method": "eig3"}, {"rtol": 1e-6, "method": "rk5"}]
BOTH = pytest.mark.parametrize("options", RUNS, ids=["fixed", "adaptive"])


def run(t_eval, rhs=damped, span=(0, 8), u0=1.0, v0=0.0, **options):
    return eig3.integrate(rhs, span, u0, v0, t_eval=t_eval, **options)


def errors(solution):
    return np.array([np.abs(solution.u - np.cos(solution.t)).max(), np.abs(solution.v + np.sin(solution.t)).max()])


@pytest.mark.parametrize(
    ("method", "h", "order"),
    [("eig3", 0.1, 2), ("cd", 0.05, 2), ("ab3", 0.05, 3), ("rk4", 0.1, 4), ("rk8", 0.4, 8), ("eig9", 0.2, 9)],
)
def test_between_fixed_steps_the_order_is_that_of_the_method(method, h, order):
    """The times are in all parts of a step."""
    times = np.linspace(0, 8, 1001)
    found = np.log2(errors(run(times, h=h, method=method)) / errors(run(times, h=h / 2, method=method)))
    # the next term of the error changes the ratio by O(h)
    assert (found > order - 0.6).all()


@pytest.mark.parametrize(
    ("method", "tolerances"), [("rk5", (1e-7, 1e-11)), ("rk8", (1e-7, 1e-11)), ("eig3", (1e-5, 1e-8))]
)
def test_between_steps_of_variable_length_the_error_is_that_at_their_ends(method, tolerances):
    times = np.linspace(0, 8, 1001)
    for rtol in tolerances:
        between = errors(run(times, rtol=rtol, method=method))
        at_steps = errors(run(None, rtol=rtol, method=method))
        # The quintic polynomial and RK8's extension are of the order of the estimate at least. Within a step, their
        # error adds some tolerances.
        assert (between < 3 * at_steps + 30 * rtol).all()


@pytest.mark.parametrize("method", ["rk5", "rk8", "eig3"])
def test_order_of_the_dense_output_of_single_steps(method):
    """Within the first step, whose start is exact: RK8's extension has the error h^8, and the quintic h^6 in u."""

    def error(h):
        times = np.linspace(0.1, 0.9, 9) * h
        solution = run(times, rtol=0.9, atol=1e9, first_step=h, h_max=h, method=method, span=(0, h))
        assert solution.n_steps == 1
        return errors(solution)

    found = np.log2(error(0.8) / error(0.4))
    # the errors of u and v at the end of the step count too: EIG-3's h^3 and h^2 of a start without past
    least = {"rk5": (6, 5), "rk8": (8, 8), "eig3": (3, 2)}[method]
    assert (found > np.array(least) - 0.5).all()


@pytest.mark.parametrize(
    "options",
    [{"h": 0.1, "method": name} for name in ("eig3", "rk4", "eig9", "ab3")]
    + [{"rtol": 1e-5, "method": name} for name in ("rk5", "rk8", "eig3")],
)
def test_the_states_at_the_ends_of_steps_are_those_of_the_run(options):
    whole = run(None, **options)
    some = run(whole.t[1::2], **options)
    for name in ("t", "u", "v") + ("steps",) * ("rtol" in options):
        assert np.array_equal(getattr(some, name), getattr(whole, name)[1::2])


@BOTH
def test_first_and_last_time(options):
    whole = run(None, **options)
    for span, times in (((0, 8), [0.0, 8.0]), ((0, 8), [8.0]), ((0, 8), [0.0])):
        solution = run(times, span=span, **options)
        assert solution.t.tolist() == times
        rows = [0 if t == 0 else -1 for t in times]
        assert np.array_equal(solution.u, whole.u[rows])
        assert np.array_equal(solution.v, whole.v[rows])


@BOTH
def test_the_end_is_reached_in_spite_of_round_off(options):
    """Neither 0.1 + 77 h nor 1/3 has an exact end."""
    for span in ((0.1, 7.8), (1 / 3, 7.1), (1e6 + 0.1, 1e6 + 3.3)):
        solution = run([span[1]], span=span, **options)
        assert solution.t.tolist() == [span[1]]
        assert solution.u[0] == run(None, span=span, **options).u[-1]


@BOTH
def test_times_do_not_change_the_steps(options):
    whole, dense = run(None, **options), run(np.linspace(0, 8, 5001), **options)
    assert dense.u.shape == (5001,)  # far denser than the steps
    assert dense.n_steps == whole.n_steps
    assert dense.n_rejected == whole.n_rejected
    limit = 20 * options.get("rtol", 5e-4)
    assert (errors(dense) < limit).all()


@BOTH
@settings(max_examples=20, deadline=None)
@given(chosen=st.lists(st.integers(0, 400), min_size=1, unique=True).map(sorted))
def test_a_part_of_the_times_has_a_part_of_the_states(options, chosen):
    times = np.linspace(0, 8, 401)
    whole, part = run(times, **options), run(times[chosen], **options)
    for name in ("t", "u", "v"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[chosen])


@BOTH
def test_vector_form(options):
    times = np.linspace(0.05, 4, 80)
    start = {"span": (0, 4), "u0": [0.1, 0.2, 0.3], "v0": [0.0] * 3, "params": (1.0, 2.0, 3.0)}
    solution = run(times, hardening_chain, **start, **options)
    assert solution.u.shape == solution.v.shape == (80, 3)
    reference = run(times, hardening_chain, **start, rtol=1e-11, method="rk8")
    # EIG-3 with h = 0.1 has errors of 1e-2; those of RK5 are some tolerances
    assert np.abs(solution.u - reference.u).max() < (0.03 if "h" in options else 1e-4)
    assert np.array_equal(solution.a.shape, solution.u.shape)


@BOTH
def test_outputs_and_extremes(options):
    times = np.linspace(0, 8, 17)
    solution = run(times, outputs={"square": squares}, invariants={"u": position}, **options)
    np.testing.assert_allclose(solution.outputs["square"], solution.u**2, rtol=1e-15)
    whole = run(None, outputs={"square": squares}, invariants={"u": position}, **options)
    assert solution.extremes["square"].high == whole.extremes["square"].high  # over every step, as without times
    assert solution.drift == whole.drift


@pytest.mark.parametrize(
    "options",
    [{"h": 0.07, "method": "eig3"}, {"h": 0.3, "method": "ab3"}, {"h": 0.3, "method": "eig9"}, {"rtol": 1e-5}],
)
def test_between_impacts(options):
    """No polynomial goes through an impact: every state is exact for a constant acceleration, with any steps."""
    times = np.linspace(0, 3.2, 2001)
    problem = bouncing_ball(t_end=3.2)
    solution = problem.integrate(t_eval=times, **options)
    u, v = problem.exact(times)
    np.testing.assert_allclose(solution.u, u, rtol=0, atol=1e-11)
    np.testing.assert_allclose(solution.v, v, rtol=0, atol=1e-10)
    assert (solution.u > -1e-12).all()


@BOTH
def test_times_after_the_end_of_a_run_are_left_out(options):
    times = np.linspace(0, 8, 33)
    solution = run(times, events={"zero": Event(position, 1, terminal=True)}, **options)
    assert solution.status is Status.TERMINATED
    end = solution.events["zero"].t[0]
    assert np.array_equal(solution.t, times[times <= end])
    stopped = bouncing_ball(0.5, t_end=8.0).integrate(t_eval=times, **options)
    assert stopped.status is Status.ZENO
    assert np.array_equal(stopped.t, times[times <= stopped.events["impact"].t[-1]])


def test_after_max_steps_the_times_reached_are_there():
    times = np.linspace(0, 8, 801)
    whole, part = run(times, rtol=1e-6, method="rk5"), run(times, rtol=1e-6, method="rk5", max_steps=9)
    assert part.status is Status.TOO_MANY_STEPS
    count = len(part.t)
    assert 0 < count < 801
    assert np.array_equal(part.u, whole.u[:count])


@BOTH
def test_steps_contain_their_times(options):
    solution = run(np.linspace(0, 8, 301), **options)
    if "h" in options:
        assert solution.steps is None
    else:
        steps = run(None, **options)
        k = np.searchsorted(steps.t, solution.t)
        assert np.array_equal(solution.steps, steps.steps[k])


@BOTH
@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([], "^t_eval must be a 1-D array of at least one time"),
        ([[1.0]], "^t_eval must be a 1-D array"),
        (3.0, "^t_eval must be a 1-D array"),
        ([1.0, 1.0], "^t_eval must increase"),
        ([2.0, 1.0], "^t_eval must increase"),
        ([-1.0, 1.0], r"^t_eval must lie within t_span, from 0\.0 to 8\.0, not at -1\.0: leave"),
        ([1.0, 9.0], "lie within t_span"),
        (np.float32([8.000001]), r"not at 8\.00000095\d*: .* clip it if it is round-off\.$"),
        ([math.nan], "^t_eval must"),
        ([1.0, math.inf], "^t_eval must"),
    ],
)
def test_bad_times_are_refused(times, message, options):
    with pytest.raises(ValueError, match=message):
        run(times, **options)


def test_words_are_no_times_and_save_every_and_times_exclude_each_other():
    with pytest.raises(TypeError, match=r"^t_eval must be made of real numbers"):
        run("x", h=0.1)
    with pytest.raises(ValueError, match=r"^save_every and t_eval exclude each other"):
        run([1.0], h=0.1, save_every=2)


def test_impacts_are_where_they_are_without_times():
    alone, watched = (bouncing_ball(t_end=2.0).integrate(h=0.01, **x) for x in ({}, {"t_eval": np.linspace(0, 2, 501)}))
    assert np.array_equal(alone.events["impact"].t, watched.events["impact"].t)


def test_a_run_that_diverges_keeps_its_finite_times():
    solution = run(np.linspace(0, 1000, 2001), spring, (0, 1000), params=10.0, h=1.0, method="eig3")
    assert solution.status is Status.DIVERGED
    assert len(solution.t) < 2001
    assert np.isfinite(solution.u).all()


falling = eig3.jit(lambda t, u, v, p: -1.0)


@eig3.jit
def falling_bodies(t, u, v, p, a):
    a[0] = a[1] = -1.0


rises = eig3.jit(lambda t, u, v, p: (0.0, 1.0))


@BOTH
def test_no_time_is_lost_to_round_off_at_the_end(options):
    """t0 + n h is below the end of some of these spans by a few spacings."""
    rng = np.random.default_rng(4)
    for _ in range(60):
        t0 = rng.uniform(-5, 5)
        t1 = t0 + rng.uniform(0.5, 3)
        times = [t0 + (t1 - t0) / 3]
        for count in (1, 3):
            near = t1
            for _ in range(count):
                near = np.nextafter(near, -np.inf)
            times.append(near)
        times = sorted({*times, t1})
        for wanted in (times, times[:-1]):
            solution = run(wanted, span=(t0, t1), **options)
            assert solution.status is Status.COMPLETED
            assert solution.t.tolist() == wanted
            # the state changes by some 1e-15 in some spacings of t
            np.testing.assert_allclose(solution.u[1:], solution.u[-1], rtol=0, atol=1e-14)


@BOTH
def test_the_time_of_a_terminal_event_is_there(options):
    """u = 1/2 - t^2 / 2 is zero at t = 1; the computed time may be wrong by some spacings."""
    after = [1.0]
    while len(after) < 4:
        after.append(np.nextafter(after[-1], np.inf))
    events = {"floor": Event(position, -1, terminal=True), "rise": Event(position, -1, apply=rises)}
    for names in (["floor"], ["rise", "floor"]):
        chosen = {name: events[name] for name in names}
        for h in (0.0625, 0.1, 0.3):
            steps = {"h": h, "method": "eig3"} if "h" in options else {**options, "h_max": h}
            solution = run([0.25, *after, 1.5], falling, (0, 2), 0.5, events=chosen, **steps)
            assert solution.status is Status.TERMINATED
            assert solution.t.tolist() == [0.25, *after]
            np.testing.assert_allclose(solution.v[1:], -1, rtol=0, atol=1e-12)  # before the reset
            np.testing.assert_allclose(solution.u[1:], 0, rtol=0, atol=1e-12)


@BOTH
@pytest.mark.parametrize("is_vector", [False, True], ids=["scalar", "vector"])
def test_a_solution_without_states(options, is_vector, tmp_path):
    """The run ends before the first of the wanted times."""
    event = {"floor": Event(first_position if is_vector else position, -1, terminal=True)}
    start = {"u0": [0.5, 1.0], "v0": [0.0, 0.0]} if is_vector else {"u0": 0.5}
    rhs = falling_bodies if is_vector else falling
    name = first_position if is_vector else position
    solution = run([1.5], rhs, (0, 2), **start, events=event, outputs={"height": name}, **options)
    assert solution.status is Status.TERMINATED
    assert len(solution.t) == 0
    loaded = eig3.load(solution.save(tmp_path / "run"))
    for each in (solution, loaded):
        assert "the run ended before the first time of t_eval" in repr(each)
        assert each.u.shape == each.v.shape == each.a.shape == ((0, 2) if is_vector else (0,))
        with pytest.raises(ValueError, match=r"^the solution has no states: the run ended before the first time") as e:
            each.at(0.5)
        assert len(str(e.value).splitlines()) == 1
        frame = each.to_pandas()
        assert list(frame.columns) == (["u0", "u1", "v0", "v1"] if is_vector else ["u0", "v0"]) + ["height"]
        assert len(frame) == 0
        assert dict(each.to_xarray().sizes) == ({"t": 0, "dof": 2} if is_vector else {"t": 0})
    assert loaded.events["floor"].t.tolist() == solution.events["floor"].t.tolist()


def test_a_solution_without_states_of_a_problem(tmp_path):
    problem = bouncing_ball(t_end=3.0)
    problem = problem.with_(events={"floor": Event(position, -1, terminal=True)})
    solution = problem.integrate(h=0.01, t_eval=[2.5])
    assert len(solution.to_pandas()) == 0
    assert len(solution.to_xarray().t) == 0
    for shown in (lambda: problem.animate(solution, tmp_path / "x.html"), lambda: problem.export(solution, "x.pvd")):
        with pytest.raises(ValueError, match=r"^the solution has no states: the run ended before the first time"):
            shown()
