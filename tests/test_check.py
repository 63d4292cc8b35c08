"""`check=True`: the estimated error of a run against the true error, its order, and the time from which it is wrong."""

import copy
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse

import eig3
from eig3 import problems
from eig3.ensembles.checked import errors_of_members
from eig3.result.error_estimate import _order

from .conftest import bounce, falling, position, spring


@eig3.jit
def swinging_atwood(t, u, v, p, a):
    a[0] = (u[0] * v[1] ** 2 - p[0] * 9.81 + 9.81 * np.cos(u[1])) / (1 + p[0])
    a[1] = -(2 * v[0] * v[1] + 9.81 * np.sin(u[1])) / u[0]


double_well = eig3.jit(lambda t, u, v, p: u - u**3 - 0.1 * v + 0.3 * np.cos(1.2 * t))
jump = eig3.jit(lambda t, u, v, p: (1.0 if t > 5 + 1 / 3 else 0.0) - u)

SYSTEMS = {
    "swinging atwood": (swinging_atwood, (0.0, 5.0), [1.0, 1.2], [0.0, 0.0], [3.0]),
    "double well": (double_well, (0.0, 20.0), 1.0, 0.5, ()),
}
_EXACT = {}


def run(system, **options):
    rhs, span, u0, v0, params = SYSTEMS[system]
    if "steps" in options:
        options["h"] = (span[1] - span[0]) / options.pop("steps")
    return eig3.integrate(rhs, span, u0, v0, params=params, **options)


def true_error(system, solution):
    """The errors of u and v at the saved times, by RK8 with the smallest tolerance; each exact run is made once."""
    if system not in _EXACT:
        _EXACT[system] = run(system, rtol=3e-14, method="rk8")
    u, v = _EXACT[system].at(solution.t)
    return solution.u - u, solution.v - v


# Estimated and true errors -------------------------------------------------------------------------------------------


# The kernels of two degrees of freedom of all methods would only take time to compile.
FIXED = [("eig3", 1000), ("eig3", 1001), ("eig3", 16000), ("rk4", 500), ("rk4", 4000), ("eig9", 4000), ("rk8", 250)]
TOLERANCES = [("rk8", 1e-5), ("rk8", 1e-9), ("eig3", 1e-5)]


@pytest.mark.parametrize(
    ("system", "method", "steps"), [("swinging atwood", "eig3", 1000), *(("double well", *run) for run in FIXED)]
)
def test_the_estimate_is_the_true_error(system, method, steps):
    """The next term of the series of the error is smaller by about the step: 30 % allow for the coarsest runs."""
    solution = run(system, method=method, steps=steps, check=True)
    error = solution.error
    for estimated, true in zip((error.u, error.v), true_error(system, solution), strict=True):
        largest = np.abs(true).max()
        assert np.abs(estimated - true).max() < 0.3 * largest + 1e-12
    assert error.largest["u"] == pytest.approx(np.abs(error.u).max())
    if error.largest["u"] > 1e-10:
        assert solution.order == pytest.approx(solution.method.order, abs=0.6)
        assert f"which show the order {solution.order:.1f})" in repr(solution)
        assert not error.notes


@pytest.mark.parametrize(
    ("system", "method", "rtol"), [("swinging atwood", "rk8", 1e-5), *(("double well", *run) for run in TOLERANCES)]
)
@pytest.mark.parametrize("options", [{}, {"t_eval": np.linspace(0.0, 5.0, 33)}], ids=["steps", "t_eval"])
def test_the_estimate_with_tolerances_is_within_a_factor_of_two(system, method, rtol, options):
    solution = run(system, method=method, rtol=rtol, check=True, **options)
    true = np.abs(true_error(system, solution)[0]).max()
    assert 0.5 < solution.error.largest["u"] / true < 2
    assert solution.order is None
    assert "a run with a tenth of the tolerance" in repr(solution)
    assert not solution.error.notes


@pytest.mark.parametrize(
    "options",
    [
        {"save_every": None},
        {"save_every": 7},
        {"save_every": 8},
        {"save_every": 3, "steps": 1001},
        {"t_eval": np.linspace(0.0, 20.0, 33)},
        {"t_eval": np.linspace(0.0, 20.0, 33), "steps": 1001},
    ],
)
def test_the_saved_states_have_errors(options):
    solution = run("double well", method="rk4", check=True, **{"steps": 1000, **options})
    true = true_error("double well", solution)[0]
    assert solution.error.u.shape == solution.u.shape
    assert np.abs(solution.error.u - true).max() < 0.02 * np.abs(true).max()
    has_order = options.get("save_every", 0) is not None or solution.n_steps % 2 == 0
    assert (solution.order is not None) == has_order


@pytest.mark.parametrize(("steps", "method"), [({"h": 0.05}, "eig3"), ({"rtol": 1e-4}, "rk5")])
def test_outputs_invariants_extremes_and_events_have_errors(steps, method):
    """u = cos(t): the height is u, the energy 1/2, and u falls through 0.3 at arccos(0.3) and 2 pi later.

    The extremes of a run with a fixed step are missed by up to a half of h^2 / 4, which is not a smooth function of h.
    """
    event = eig3.Event(crossing, direction=-1)
    options = {"invariants": {"energy": energy}, "outputs": {"height": position}, "events": {"down": event}}
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, method=method, check=True, **steps, **options)
    error = solution.error
    missed = solution.events["down"].t - np.arccos(0.3) - 2 * np.pi * np.arange(2)
    np.testing.assert_allclose(error.events["down"], missed, rtol=0.3, atol=0.05 * np.abs(missed).max())
    assert 0.25 < error.drift["energy"] / solution.drift["energy"] < 4  # a maximum over steps is not smooth either
    assert abs(error.extremes["height"].low) < 3 * abs(solution.extremes["height"].low + 1)
    assert error.largest.keys() >= {"u", "v", "energy", "down"}
    np.testing.assert_array_equal(error.outputs["height"], error.u)


crossing = eig3.jit(lambda t, u, v, p: u - 0.3)
energy = eig3.jit(lambda t, u, v, p: 0.5 * (u * u + v * v))


def test_the_work_has_an_error():
    """With tolerances, the error of the compared run and the change of its steps leave a larger difference."""
    damped = eig3.linear([1.0], [[0.1]], [[1.0]], t_span=(0, 20), u0=1.0, work=True)
    for options, rest in (({"h": 0.02}, 0.1), ({"rtol": 1e-6, "method": "rk8"}, 0.5)):
        solution = damped.integrate(check=True, **options)
        exact = damped.integrate(rtol=1e-12, t_eval=solution.t).z["work"]
        error = solution.z["work"] - exact
        assert np.abs(solution.error.z["work"] - error).max() < rest * np.abs(error).max()


@pytest.mark.parametrize("method", ["rk5", "rk8"])
def test_the_jump_of_a_reset_is_no_error(method):
    """The compared runs bounce some round-off earlier or later; the velocity then differs by 20 m/s for a moment."""
    solution = problems.bouncing_ball().integrate(rtol=1e-6, method=method, check=True)
    assert (np.diff(solution.t) == 0).sum() > 5
    assert np.abs(solution.error.v).max() < 1e-10


def test_the_order_is_the_root_of_the_ratio_of_the_differences():
    for order in (0.7, 2.0, 8.0):
        assert _order((2**order - 1) / (1 - (2 / 3) ** order), 2.0, 2 / 3) == pytest.approx(order, abs=1e-9)


# What lowers the order, and what ends it -----------------------------------------------------------------------------


def test_a_jump_of_the_force_lowers_the_order_from_there_on():
    solution = eig3.integrate(jump, (0, 20), 1.0, 0.0, h=0.01, method="rk4", check=True)
    assert solution.order < 3
    (note,) = solution.error.notes
    assert note.startswith("The run shows the order")
    since = float(note.partition("from t = ")[2].partition(" ")[0])
    assert 4.9 < since < 7  # the run is looked at in 16 parts
    assert note in repr(solution)


@eig3.jit
def ramp(t, u, v, p):
    return max(0.0, t - p[0]) - u


def test_coarser_runs_that_show_the_order_by_chance_are_not_believed():
    """From the corner of the force on, u is t - t1 - sin(t - t1). It was 13 % of the error."""
    corner = 2 + 117 / 401
    solution = eig3.integrate(ramp, (0, 10), 0.0, 0.0, h=0.05, method="rk4", params=[corner], check=True)
    after = np.maximum(0.0, solution.t - corner)
    assert solution.error.largest["u"] > 0.5 * np.abs(solution.u - after + np.sin(after)).max()


def test_later_calls_with_a_fixed_step_estimate_their_own_error():
    """The corner of the force is elsewhere in each call. With the order of an earlier call, a quarter of the
    estimates were below a third of the error. By chance, about 1 of 100 is.
    """
    ratios = []
    for corner in 2 + 3 * np.arange(1, 41) / 401:
        run = eig3.integrate(ramp, (0, 10), 0.0, 0.0, accuracy=1e-4, method="rk4", params=[corner])
        after = np.maximum(0.0, run.t - corner)
        ratios.append(run.error.largest["u"] / np.abs(run.u - after + np.sin(after)).max())
    assert np.mean(np.array(ratios) > 1 / 3) > 0.95


def test_round_off_is_named():
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, h=1e-3, method="rk8", check=True)
    assert any("round-off" in note for note in solution.error.notes)
    assert solution.error.largest["u"] < 1e-12


def test_tolerances_that_hardly_reduce_the_error_have_a_note():
    """With long steps, the errors of RK8 are as large at a tenth of this tolerance."""
    rhs, _, u0, v0, params = SYSTEMS["swinging atwood"]
    solution = eig3.integrate(rhs, (0, 10), u0, v0, params=params, rtol=1e-3, method="rk8", check=True)
    assert "the estimate is rough" in " ".join(solution.error.notes)


stiff = eig3.jit(lambda t, u, v, p: 1e4 * (np.cos(t) - u) - 1e3 * v)


def test_tolerances_that_do_not_control_the_steps_have_a_note():
    """A decay with exp(-990 t) limits the steps of RK5 by stability; nothing limits the steps of the oscillation."""
    given = {"rtol": 1e-3, "method": "rk5", "params": 1.0, "check": True}
    found = [eig3.integrate(rhs, (0, end), 1.0, 0.0, **given).error.notes for rhs, end in ((stiff, 5), (spring, 300))]
    assert ["hardly more steps" in " ".join(notes) for notes in found] == [True, False]


def test_an_exact_run_has_no_order():
    """Free fall is exact but for round-off: the runs differ in the last digits, or not at all."""
    solution = eig3.integrate(falling, (0, 1), 0.1, 0.3, params=8.0, h=0.03, method="rk4", check=True)
    assert solution.error.largest["u"] < 1e-14
    (note,) = solution.error.notes
    assert "near round-off" in note


def test_a_run_at_rest_does_not_tell_of_round_off():
    """Shorter steps do not help against round-off, but they can see a load that is shorter than a step."""
    for step in ({"h": 0.1}, {"h": 0.1, "method": "rk4", "save_every": None}, {"rtol": 1e-3, "h_max": 0.1}):
        run = eig3.integrate(late_duffing, (0, 10.0), 0.0, 0.0, **step, check=True)
        assert run.error.largest["u"] == 0
        assert run.error.notes[-1].startswith("Nothing moves in the compared runs either")
        assert "round-off" not in " ".join(run.error.notes)


def test_round_off_that_all_runs_have_is_noted():
    """The coefficients of RK8 are rounded, which changes the period by about eps: over 20,000 s, the true error was 140
    times the estimate, which coarser runs alone had given."""
    given = {"params": 1.0, "method": "rk8", "check": True}
    coarse, fine = (eig3.integrate(spring, (0, 20000), 1.0, 0.0, h=h, save_every=50, **given) for h in (0.2, 0.05))
    true = np.abs(coarse.u - np.cos(coarse.t)).max()
    assert coarse.error.largest["u"] == pytest.approx(true, rel=0.05)  # the next term is smaller by about h^2
    assert coarse.error.notes == ()
    assert any("round-off" in note for note in fine.error.notes)
    members = eig3.ensemble(spring, (0, 20000), [1.0, 1.0], 0.0, h=0.05, **given)
    assert any("round-off" in note for note in members.error[0].notes)


def test_near_the_limit_of_stability_the_order_is_not_known():
    """The limit of EIG-3 is h = 2: with twice the step the coarser run is unstable."""
    solution = eig3.integrate(spring, (0, 1000), 1.0, 0.0, params=1.0, h=1.2, check=True, save_every=None)
    assert solution.order is None
    assert "near the limit of stability" in " ".join(solution.error.notes)


def test_growth_of_a_coarser_run_is_not_explained(monkeypatch):
    """The search for its reason took a hundred times as long as the runs of a scene with many grains."""
    monkeypatch.setattr("eig3.run.fixed_run.find_blow_up", pytest.fail)
    run = eig3.integrate(spring, (0, 121.2), 1.0, 0.0, params=1.0, h=1.01, method="cd", check=True)
    assert "does not follow the motion: the step is near the limit of stability" in str(run)


def test_memory_for_the_error_is_looked_for_before_the_compared_runs(monkeypatch):
    """Linux killed the process."""
    monkeypatch.setattr("eig3.result.memory.available_memory", lambda: 4e6)
    with pytest.raises(MemoryError, match=r"the estimated error needs 9.6e.06 bytes and 4e.06 are free") as caught:
        eig3.integrate(spring, (0, 100), 1.0, 0.0, params=1.0, h=0.001, check=True)
    assert caught.value.solution.success
    with pytest.raises(MemoryError, match=r"the estimated error needs 6.41e.06 bytes and 4e.06 are free") as caught:
        eig3.ensemble(spring, (0, 100), np.ones(100), 0.0, params=1.0, h=0.1, save_every=1, check=True)
    assert caught.value.solution.success.all()


@eig3.jit
def late_duffing(t, u, v, p):
    return -0.3 * v + u - u**3 + (0.5 * np.cos(1.2 * t) if t > 10.03 else 0.0)


def test_chaos_is_right_up_to_a_time():
    """The same motion by RK8 with a small tolerance leaves the run by half of its size near the reported time."""
    problem = problems.double_pendulum(theta1=2.0, theta2=2.5, t_end=40.0)
    solution = problem.integrate(h=0.002, method="rk4", save_every=10, check=True)
    exact = problem.integrate(rtol=1e-13, method="rk8", t_eval=solution.t)
    apart = np.abs((solution.u - exact.u) / np.abs(solution.u).max(axis=0)).max(axis=1)
    first = solution.t[np.argmax(apart > 0.5)]
    assert solution.reliable_until == pytest.approx(first, rel=0.1)
    text = repr(solution)
    assert f"No digit of u is right after t = {solution.reliable_until:.4g}. The error grows like exp(" in text
    assert f"up to t = {solution.reliable_until:.4g}" in text
    for few in ({"save_every": None}, {"t_eval": [20.0, 40.0]}):  # other states are compared
        run = problem.integrate(h=0.002, method="rk4", **few, check=True)
        assert run.reliable_until == pytest.approx(first, rel=0.1)
        assert str(run.error).startswith("no digit of u is right (estimated from ")
    members = problem.ensemble(h=0.002, method="rk4", u0=[problem.u0, problem.u0], check=True)
    assert (members.error.reliable_until == 0).all()
    assert "No digit of u is right at t = 40, and no state is saved that shows since when." in members.error[1].notes


@eig3.jit
def not_finite_for_a_moment(t, u, v, p):
    return np.nan if 1.02 < t < 1.03 else -u - 5 * abs(u)


def test_an_error_is_infinite_after_a_compared_run_has_failed():
    """The kink makes a finer run necessary, which evaluates f at t = 1.025. An error of 0.0025 was reported."""
    solution = eig3.integrate(not_finite_for_a_moment, (0, 3), 1.0, 0.0, h=0.1, method="rk4", check=True)
    assert solution.success
    np.testing.assert_array_equal(np.isfinite(solution.error.u), solution.t <= 1.0)
    assert solution.error.largest["u"] == np.inf
    assert solution.reliable_until is None
    assert "The compared run, a run with half the step, ended early" in solution.error.notes[-1]


def test_an_odd_number_of_steps_is_compared_at_its_end_too():
    """Twice the step cannot end there, but a step that is a little longer can. The exact error is of fourth order."""
    exact = 3 * np.cos(20.0)
    runs = [
        eig3.integrate(spring, (0, 20), 3.0, 0.0, params=1.0, h=20 / n, method="rk4", save_every=None, check=True)
        for n in (201, 401)
    ]
    for run in runs:
        assert run.n_steps % 2 == 1
        assert run.order == pytest.approx(4, abs=0.1)  # the next term of the error is smaller by h
        assert run.error.u[-1] == pytest.approx(run.u[-1] - exact, rel=0.1)


def test_the_end_of_the_digits_does_not_depend_on_the_later_motion():
    """The pendulum turns over many times: 16.6 s were named for 300 s, and 11 s for 20 s."""
    problem = problems.double_pendulum(theta1=3.0, theta2=2.8)
    short, long = (problem.integrate(h=0.002, t_end=t, save_every=10, check=True) for t in (20.0, 300.0))
    assert np.abs(long.u).max() > 2 * np.abs(short.u).max()
    assert long.reliable_until == pytest.approx(short.reliable_until, rel=0.05)  # a sixth of 1 / rate


def test_the_first_error_of_a_motion_that_begins_late_is_not_the_end_of_its_digits():
    """The load acts from t = 10.03 on: before the next state, the motion is less than its error."""
    run = eig3.integrate(late_duffing, (0, 400), 0.0, 0.0, h=0.1, check=True)
    fine = eig3.integrate(late_duffing, (0, 400), 0.0, 0.0, h=0.005, method="eig9", save_every=20)
    apart = np.abs(run.u - fine.u) / np.abs(run.u).max()
    assert run.reliable_until == pytest.approx(run.t[np.argmax(apart > 0.5)], rel=0.2)  # the largest so far is less


def test_the_front_of_a_wave_is_not_chaos():
    """The masses that the wave has just reached move by less than a hundredth of the others."""
    K = scipy.sparse.diags_array([2 * np.ones(200), -np.ones(199), -np.ones(199)], offsets=[0, 1, -1])
    times = np.linspace(0.0, 50.0, 501)
    bar = eig3.linear(np.ones(200), None, K, t_span=(0, 50), force=(times, np.sin(0.3 * times), [0]))
    solution = bar.integrate(h=0.5, check=True, save_every=10)
    sizes, errors = (np.abs(x).max(axis=0) for x in (solution.u, solution.error.u))
    assert (errors > 0.5 * sizes)[sizes > 0].any()
    assert errors.max() < 0.05 * sizes.max()
    assert solution.reliable_until is None


def test_impacts():
    """Between impacts EIG-3 is exact: only round-off is left."""
    solution = problems.bouncing_ball().integrate(h=1e-3, check=True)
    assert solution.error.largest["u"] < 1e-11
    assert solution.reliable_until is None


def test_a_terminal_event_may_come_earlier():
    ends = {"params": 1.0, "events": {"end": eig3.Event(crossing, terminal=True)}, "check": True}
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, h=0.05, **ends)
    true = np.cos(solution.t)
    assert solution.error.events["end"][0] == pytest.approx(solution.t[-1] - np.arccos(0.3), rel=0.2)
    assert np.abs(solution.u - true - solution.error.u).max() < 0.2 * np.abs(solution.u - true).max()
    for step in ({"h": 0.05, "method": "rk4"}, {"rtol": 1e-6, "method": "rk8"}):  # with the two ends only
        solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, **step, **ends, save_every=None)
        assert solution.error.u[-1] == pytest.approx(solution.u[-1] - np.cos(solution.t[-1]), rel=0.3)
        true = solution.v[-1] + np.sin(solution.t[-1])
        assert 0.5 < solution.error.v[-1] / true < 2  # the dense output of v within a step has other errors


def test_a_fast_motion_that_a_method_damps_away_has_a_note():
    """RK4 with omega h = 1 damps the fast oscillation in all compared runs, which agree: the energy tells."""
    fast = problems.two_frequency_oscillator(t_end=100.0)
    solution = fast.integrate(h=1e-3, method="rk4", save_every=50_000, check=True)
    true = np.abs(solution.u - fast.exact(solution.t)[0]).max()
    assert solution.error.largest["u"] < 1e-6 < 0.5 < true
    assert "energy changes by 1e+02 %, which the estimated error of u does not show" in solution.error.notes[-1]
    fine = fast.integrate(h=1e-4, method="rk8", save_every=10_000, t_end=10.0, check=True)
    assert not any("changes by" in note for note in fine.error.notes)


# Ensembles -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"h": 0.01},
        {"h": 0.01, "save_every": 10},
        {"h": 0.01, "save_every": 7},
        {"h": 10 / 1001},
        {"h": np.array([0.01, 0.005, 10 / 1001]), "t_eval": np.linspace(0, 10, 5)},
        {"rtol": 1e-5, "method": "rk5"},
    ],
)
def test_members_have_the_errors_of_single_runs(options):
    starts, every = np.array([1.0, 2.0, 0.5]), {"save_every": None} if "t_eval" not in options else {}
    runs = eig3.ensemble(spring, (0, 10), starts, 0.0, params=1.0, check=True, **options)
    plain = eig3.ensemble(spring, (0, 10), starts, 0.0, params=1.0, **options)
    np.testing.assert_array_equal(runs.u, plain.u)
    for i, start in enumerate(starts):
        own = {name: x[i] if name == "h" and np.ndim(x) else x for name, x in options.items()}
        single = eig3.integrate(spring, (0, 10), start, 0.0, params=1.0, check=True, **{**every, **own})
        # A single run is compared with coarser runs, and the errors between common states are interpolated.
        near = 0.05 * single.error.largest["u"] + 1e-12
        np.testing.assert_allclose(runs.error[i].u, single.error.u, rtol=0.05, atol=near)
    true = np.abs(runs.u - starts[:, None] * np.cos(runs.t)).max(axis=1)
    np.testing.assert_allclose(runs.error.largest["u"], true, rtol=0.2)
    if "h" in options:
        np.testing.assert_allclose(runs.error.order, 2, atol=0.1)
    assert np.isnan(runs.error.reliable_until).all()
    assert f"error of u at most {runs.error.largest['u'].max():.2g} in 3 members" in repr(runs)


def test_members_with_resets_have_errors_without_the_jumps():
    """A state before a reset is not compared with one after it. The errors are some 20 rtol; a jump of v is 2."""
    wall = eig3.Event(eig3.jit(lambda t, u, v, p: u + 0.5), direction=-1, apply=bounce)
    options = {
        "rtol": 1e-6,
        "method": "rk5",
        "save_every": 1,
        "events": {"wall": wall},
        "params": np.linspace(1, 4, 5)[:, None],
    }
    runs = eig3.ensemble(spring, (0, 10), 1.0, 0.0, check=True, **options)
    assert runs.success.all()
    assert np.isfinite(runs.events["wall"].first).all()
    assert runs.error.largest["v"].max() < 1e-4


def test_members_that_fail_have_no_error():
    runs = eig3.ensemble(spring, (0, 1000), 1.0, 0.0, params=1.0, h=np.array([0.1, 2.5]), check=True)
    assert runs.error[1] is None
    assert np.isnan(runs.error.largest["u"]).tolist() == [False, True]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"reduce": len}, "check and reduce exclude each other"),
        ({"method": eig3.Langevin(1.0, 1.0)}, "adds random numbers"),
    ],
)
def test_ensembles_that_cannot_be_checked_say_why(given, words):
    with pytest.raises(ValueError, match=words):
        eig3.ensemble(spring, (0, 1), np.ones(2), 0.0, params=1.0, h=0.1, check=True, **given)


@pytest.mark.parametrize("options", [{"h": 0.01, "save_every": 10}, {"rtol": 1e-6}, {"rtol": 0.1, "method": "rk8"}])
def test_the_errors_of_all_members_are_those_of_each(options):
    """Members without a note are compared together; some of these are chaotic, or miss the order, and have a note."""
    starts = np.linspace(0.1, 0.5, 20)[:, None] * np.ones(2)
    runs = problems.spring_pendulum(t_end=10.0).ensemble(u0=starts, check=True, **options)
    assert runs.error._plain.chosen.any()
    each = list(runs.error)
    for name, values in runs.error.largest.items():
        np.testing.assert_allclose(values, [np.nan if x is None else x.largest[name] for x in each], rtol=1e-9)
    orders = [np.nan if x is None or x.order is None else x.order for x in each]
    np.testing.assert_allclose(runs.error.order, orders, rtol=1e-9)


def test_a_member_whose_fast_motion_is_damped_away_has_a_note():
    fast = problems.two_frequency_oscillator()
    runs = fast.ensemble(u0=[fast.u0] * 2, h=1e-3, method="rk4", t_end=10.0, check=True)
    assert "energy changes by 1e+02 %, which the estimated error of u does not show" in runs.error[0].notes[-1]


leaving = eig3.jit(lambda t, u, v, p: 1 + (0.8 if v < 0 else 0.5) * v)


def test_the_start_of_an_invariant_is_known(tmp_path):
    """For u = cos(t) it falls from 1 to 0.2, and then rises beyond its start to 1.5."""
    options = {"params": 1.0, "h": 0.01, "method": "rk4", "invariants": {"e": leaving}, "check": True}
    single = eig3.integrate(spring, (0, 10), 1.0, 0.0, **options)
    runs = eig3.ensemble(spring, (0, 10), np.ones(20), 0.0, **options)
    assert single.error.notes[-1].startswith("e changes by 80 %")
    for found in (runs, eig3.load(runs.save(tmp_path / "file"))):
        assert found.error[3].notes[-1] == single.error.notes[-1]


# In files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{"h": 0.01, "save_every": 10}, {"rtol": 1e-6, "outputs": {"height": position}}])
def test_a_run_in_files_keeps_its_errors(tmp_path, options):
    whole = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, check=True, save_to=tmp_path / "run", **options)
    loaded = eig3.load(tmp_path / "run", rhs=spring, outputs=options.get("outputs"))
    assert repr(loaded.error) == repr(whole.error)
    assert loaded.error.largest == whole.error.largest
    np.testing.assert_array_equal(loaded.u, whole.u)
    later = loaded.extend(12.0)
    assert later.error is None


@pytest.mark.parametrize("options", [{"h": 0.01, "save_every": 100}, {"rtol": 1e-6}])
def test_an_ensemble_in_files_keeps_its_errors(tmp_path, options):
    given = spring, (0, 10), np.linspace(1, 2, 20), 0.0
    runs = eig3.ensemble(*given, params=1.0, check=True, save_to=tmp_path / "runs", **options)
    plain = eig3.ensemble(*given, params=1.0, **options)
    np.testing.assert_array_equal(runs.u, plain.u)
    resumed = eig3.load(tmp_path / "runs", rhs=spring).resume()
    for loaded in (eig3.load(tmp_path / "runs"), eig3.load(runs.save(tmp_path / "file")), resumed):
        np.testing.assert_array_equal(loaded.error.largest["u"], runs.error.largest["u"])
        np.testing.assert_array_equal(loaded.error[3].u, runs.error[3].u)
        assert loaded.error[3].notes == runs.error[3].notes
    assert eig3.load(plain.save(tmp_path / "plain")).error is None


@pytest.mark.parametrize(
    "options",
    [
        {"h": 0.01},
        {"h": 0.01, "t_eval": [5.0, 10.0]},
        {"rtol": 1e-6, "method": "rk8"},
        {"rtol": 1e-6, "method": "rk8", "outputs": {"height": position}},
    ],
)
def test_compared_runs_that_are_interrupted_show_no_error(options, tmp_path, monkeypatch):
    cancel = threading.Event()
    check = eig3.Solution.check
    monkeypatch.setattr(eig3.Solution, "check", lambda run, cancel: cancel.set() or check(run, cancel=cancel))
    given = {"params": 1.0, "check": True, "cancel": cancel, **options}
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, save_to=tmp_path / "run", **given)
    assert solution.success
    assert solution.error is eig3.load(tmp_path / "run").error is None


def test_compared_ensembles_that_are_interrupted_show_no_errors(tmp_path, monkeypatch):
    cancel = threading.Event()
    monkeypatch.setattr(
        "eig3.ensembles.ensemble.errors_of_members", lambda *given: cancel.set() or errors_of_members(*given)
    )
    given = spring, (0, 10), np.linspace(1, 2, 20), 0.0
    runs = eig3.ensemble(*given, params=1.0, h=0.01, check=True, save_to=tmp_path / "runs", cancel=cancel)
    assert runs.success.all()
    assert list(runs.error) == [None] * 20
    assert np.isnan(runs.error.largest.get("u", np.nan)).all()
    assert eig3.load(tmp_path / "runs").error is None


def test_a_file_with_errors_of_another_ensemble_is_refused(tmp_path):
    given = spring, (0, 10), np.linspace(1, 2, 20), 0.0
    runs = eig3.ensemble(*given, params=1.0, h=0.1, check=True)
    runs.error._others[0] = eig3.ensemble(spring, (0, 10), np.ones(3), 0.0, params=1.0, h=0.1), 0.5
    with pytest.raises(ValueError, match="damaged"):
        eig3.load(runs.save(tmp_path / "file"))


# How it is asked for -------------------------------------------------------------------------------------------------


def test_every_single_run_can_be_checked():
    options = {"h": 0.01, "method": "rk4"}
    given = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, check=True, **options)
    plain = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, **options)
    assert plain.error is plain.order is plain.reliable_until is None
    np.testing.assert_array_equal(given.u, plain.u)
    runs = [
        eig3.prepare(spring, **options)((0, 10), 1.0, 0.0, 1.0, check=True),
        eig3.Problem("spring", spring, 1.0, 0.0, 1.0, (0, 10)).integrate(check=True, **options),
        eig3.Problem("spring", spring, 1.0, 0.0, 1.0, (0, 10)).prepare(**options)(check=True),
        eig3.Problem("spring", spring, 1.0, 0.0, [1.0], (0, 10)).ensemble(
            u0=[1.0, 2.0], save_every=1, check=True, **options
        ),
        plain.extend(12.0),
    ]
    runs[-1].check()
    runs[3] = SimpleNamespace(error=runs[3].error[0])
    for each in runs:
        # The ensemble is compared with other steps, and the next term of the series is smaller by about the step.
        near = {"rtol": 1e-3, "atol": 1e-15} if each is not runs[3] else {"rtol": 0.05, "atol": 1e-11}
        np.testing.assert_allclose(each.error.u[: len(given.t) - 1], given.error.u[:-1], **near)


def test_a_run_that_fails_has_no_error():
    unstable = eig3.integrate(spring, (0, 1000), 1.0, 0.0, params=1.0, h=2.5, check=True)
    assert not unstable.success
    assert unstable.error is None
    with pytest.raises(ValueError, match="check needs a successful run, and this one has the status diverged"):
        unstable.check()


def test_what_cannot_be_checked_says_why():
    solution = copy.copy(eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, h=0.01))
    with pytest.raises(ValueError, match="check needs the run"):
        solution.check()
    with pytest.raises(ValueError, match="adds random numbers"):
        eig3.integrate(spring, (0, 1), 1.0, 0.0, params=1.0, h=0.01, method=eig3.Langevin(1.0, 1.0), check=True)
    with pytest.raises(TypeError, match="check must be True or False"):
        eig3.integrate(spring, (0, 1), 1.0, 0.0, params=1.0, h=0.01, check="yes")


def test_ctrl_c_returns_the_run(monkeypatch):
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, h=0.01)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("eig3.run.fixed_run.FixedRun.error_of", interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        solution.check()
    assert caught.value.solution is solution


@eig3.jit
def narrow(t, u, v, p):
    if abs(u) > 1.0 + 5e-4:
        raise ValueError("too far")
    return -u


def test_an_exception_in_a_compared_run_keeps_the_run():
    """A stage of RK2 exceeds the amplitude by h^2 / 2: 2e-4 with this step, and 8e-4 with twice the step."""
    for run_of in (
        lambda: eig3.integrate(narrow, (0, 50), 1.0, 0.0, h=0.02, method="rk2", check=True),
        lambda: eig3.ensemble(narrow, (0, 50), np.ones(2), 0.0, h=0.02, method="rk2", check=True),
    ):
        with pytest.raises(ValueError, match="too far") as caught:
            run_of()
        assert np.all(caught.value.solution.success)


def test_runs_and_ensembles_name_what_they_were_compared_with():
    single = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, h=0.01, save_every=None, check=True)
    runs = eig3.ensemble(spring, (0, 10), np.ones(2), 0.0, params=1.0, h=0.01, check=True)
    assert runs.error[0].by == "a run with two thirds of the step and a run with twice the step"
    assert single.error.by == "a run with twice the step and a run with four times the step"
    loose = eig3.ensemble(spring, (0, 10), np.ones(2), 0.0, params=1.0, rtol=0.1, check=True)
    assert loose.error[0].by == "a run with a tenth of the tolerance"
