"""What eig3.plan predicts, against exact solutions; never a wall-clock time."""

import dataclasses
import math
import re
import time
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import eig3
from eig3 import problems
from eig3.cli import main
from eig3.effects import BreakingString, LinearDamper, LinearSpring
from eig3.functions.checks import check_method
from eig3.methods import LIBRARY
from eig3.planning import kinds, pilots, planner, step_search
from eig3.scene import Scene

from .test_check import swinging_atwood

OTHER_GRADES = [f"eig{grade}" for grade in (4, 6, 7, 8, 10, 11, 12)]  # their kernels have the text of other grades
#: Methods for a force that depends on the velocity.
ANY_FORCE = [name for name in LIBRARY if not (eig3.METHODS[name]().ignores_velocity or name in OTHER_GRADES)]
OF_EACH_KIND = ["eig3", "cd", "rk4", "ab3", "eig9"]  # all others would only compile more kernels


def achieved(prediction, problem):
    solution = problem.integrate(**prediction.options)
    exact = problem.exact(solution.t)[0]
    return np.abs(solution.u - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4])
def test_every_method_reaches_the_accuracy_at_the_step_predicted(accuracy):
    problem = problems.single_dof(xi=0.02, force=1.0, force_omega=3.0, t_end=50.0)
    plan = eig3.plan(problem, accuracy, methods=ANY_FORCE)
    fixed = [p.method.name for p in plan.predictions if p.rtol is None]
    assert sorted(fixed) == sorted(ANY_FORCE)
    assert {p.method.name for p in plan.predictions if p.rtol is not None} == {"rk5", "rk8"}
    for prediction in plan.predictions:
        assert prediction.reaches, prediction
        if not prediction.note:
            assert 0.1 <= achieved(prediction, problem) / accuracy <= 1.5, prediction


def test_the_plan_runs():
    problem = problems.single_dof(t_end=100.0)
    plan = eig3.plan(problem, 1e-3, methods=["eig3", eig3.RK4()])
    solution = plan.run()
    assert solution.method == plan.best.method
    assert solution.n_steps == plan.best.n_steps
    assert solution.n_rhs == pytest.approx(plan.best.evaluations, rel=0.01)
    assert solution.drift == {}
    assert len(solution.t) < 5000
    text = repr(plan)
    assert "Plan for single_dof: trajectory error 0.001 up to t = 100" in text
    assert "EIG-3" in text
    assert "RK4" in text


def test_an_orbit_with_close_passages_is_run_with_tolerances():
    """With a fixed step RK8 needs the step of the passages everywhere: some ten times as many steps."""
    problem = problems.kepler(e=0.9, t_end=12 * np.pi)
    plan = eig3.plan(problem, 1e-5, methods=["rk8"])
    adaptive, fixed = plan.predictions
    assert (adaptive.rtol is None, fixed.rtol is None) == (False, True)
    assert 5 * adaptive.evaluations < fixed.evaluations
    assert f"RK8, rtol {adaptive.rtol:.1e}" in repr(plan)
    solution = plan.run()
    assert solution.steps is not None
    assert solution.n_steps == adaptive.n_steps
    assert 0.3 <= np.abs(solution.u - problem.exact(solution.t)[0]).max() / 1.9 / 1e-5 <= 1.2  # the search aims at 0.4
    evenly = plan.run(t_eval=np.linspace(0, 12 * np.pi, 5))
    assert len(evenly.t) == 5


def test_impacts_are_followed():
    """Between impacts every method is exact, so that any step is short enough; falling freely, u would be -80 m."""
    problem = problems.bouncing_ball()
    plan = eig3.plan(problem, 1e-6, methods=["rk8"])
    assert len(plan.predictions) == 2
    for prediction in plan.predictions:
        assert prediction.error < 1e-10
        assert achieved(prediction, problem) < 1e-10


def test_a_terminal_event_is_refused():
    problem = problems.single_dof()
    stopped = problem.with_(events={"rest": eig3.Event(problem.energy, terminal=True)})
    with pytest.raises(ValueError, match=r"problem must have no terminal event, such as 'rest' of single_dof: "):
        eig3.plan(stopped, 1e-3)


def test_a_tolerance_that_is_not_found_has_a_reason():
    """The smallest rtol is 2e-14. The error of the phase grows with each of the 4000 radians."""
    plan = eig3.plan(problems.single_dof(t_end=1000.0), 1e-12, methods=["rk8"])
    (missed,) = (p for p in plan.predictions if p.rtol is not None)
    assert not missed.reaches
    assert re.search("  RK8, rtol +not reached: its error is .* with rtol = 2.2", repr(plan))


def test_energy_is_a_metric():
    problem = problems.spring_pendulum(t_end=10.0)
    plan = eig3.plan(problem, 1e-4, metric="energy", methods=["eig3", "rk8"])
    scale = abs(problem.energy(0.0, np.array(problem.u0), np.array(problem.v0), np.array(problem.params)))
    for prediction in plan.predictions:
        drift = problem.integrate(**prediction.options).drift["energy"]
        assert 0.05 <= drift / scale / 1e-4 <= 1.5
    assert "energy" in plan.run().drift


def test_a_step_limited_by_stability_has_a_note_and_is_stable():
    problem = problems.elastic_bar(n=100, width=0.2, t_end=1e-3)
    (prediction,) = eig3.plan(problem, 0.1, methods=["rk4"]).predictions
    assert prediction.note == "the step is limited by stability"
    assert 0.8 < prediction.h / (8**0.5 / (2 * 5000 * 101)) < 1.0
    assert achieved(prediction, problem) < 0.1


def test_a_part_of_the_span_is_enough(monkeypatch):
    """The error of the phase grows with time: 16 times as far over the whole span."""
    monkeypatch.setattr(step_search, "_TRIALS", ((1 / 16, step_search.GUIDE, 0.3),))
    problem = problems.single_dof(t_end=200.0)
    (prediction,) = eig3.plan(problem, 1e-4, methods=["rk4"]).predictions
    assert 0.3 <= achieved(prediction, problem) / 1e-4 <= 1.2


def test_work_counts_in_the_error_of_the_energy():
    """The damper takes most of the energy away; the energy minus the work is constant."""
    scene = Scene(dimension=1)
    mass = scene.mass(1.0, (1.0,))
    wall = scene.fixed((0.0,))
    scene.add(LinearSpring(stiffness=1.0, rest_length=0.5), wall, mass)
    scene.add(LinearDamper(damping=0.2), wall, mass)
    problem = scene.problem((0, 100), work=True)
    (prediction,) = eig3.plan(problem, 1e-4, metric="energy", methods=["rk4"]).predictions
    drift = problem.integrate(h=prediction.h, method=prediction.method).drift["energy"]
    assert 0.3 <= drift / problem.energy_of(problem.u0, problem.v0) / 1e-4 <= 1.0


def test_a_run_ends_when_its_motion_has_decayed():
    """After that, all numbers are subnormal, and a step takes a hundred times as long."""
    problem = problems.single_dof(xi=0.2, t_end=2000.0)
    runs = pilots.Pilots(problem, "trajectory", 1e-3)
    n_steps = 61 * 512
    history = runs.history(check_method("rk8"), n_steps)
    times = np.linspace(0.0, 2000.0, len(history.u) + 1)[1:]
    np.testing.assert_allclose(history.u, problem.exact(times)[0], rtol=0, atol=1e-5)
    assert history.u[-1] == 0
    assert history.n_rhs == pytest.approx(12 * n_steps, rel=1e-3)  # as if it had taken all its steps


def test_a_run_with_more_impacts_than_steps_counts_as_unstable():
    problem = problems.bouncing_ball(restitution=1.0, t_end=180.0)  # 200 impacts
    runs = pilots.Pilots(problem, "trajectory", 1e-3)
    assert runs.history(check_method("eig3"), 122) is None
    assert runs.history(check_method("eig3"), 244).is_whole


@pytest.mark.parametrize("method", [step_search.GUIDE, step_search.SCOUT])
def test_the_fewest_stable_steps(method):
    runs = pilots.Pilots(problems.single_dof(t_end=1000.0), "trajectory", 1e-3)
    fewest = runs.stable_steps(method, step_search._STABLE[method])
    assert runs.history(method, fewest).is_whole
    assert runs.history(method, fewest // 2) is None


@pytest.mark.parametrize(("error", "is_known"), [(0.1, False), (0.005, True)])
def test_a_run_close_to_unstable_does_not_show_how_errors_grow(error, is_known):
    """On a busy machine, such a run of a chaotic motion let a plan promise an accuracy over a time 16 times as long."""
    runs = pilots.Pilots(problems.spring_pendulum(t_end=100.0), "trajectory", 1e-6)
    runs.look_at(1 / 16)
    runs.note_growth([pilots.PilotRun(61, 1.0, seen_error=1e-4)], 1.0, pilots.PilotRun(976, error, seen_error=error))
    assert runs.knows_growth == is_known


@pytest.mark.parametrize("slow_processor", [1, 10])
def test_chaos_is_reported(slow_processor, monkeypatch):
    """Also on a busy machine: when the wall clock limited the runs, they covered too short a part of the motion.

    A slow processor leaves time for no stable run over more than 12 time units, in which the errors are small.
    """
    slow_clock(monkeypatch, 10, slow_processor)
    plan = eig3.plan(problems.spring_pendulum(r0=1.5, theta0=2.5, t_end=3e3), 1e-6, methods=["eig3"])
    assert not plan.predictions[0].reaches
    with pytest.raises(ValueError, match=r"accuracy 1e-06 is not reached by any method of this plan \(EIG-3: "):
        plan.run()
    assert "not reached: " in repr(plan)


@pytest.mark.parametrize("is_known", [True, False])
def test_what_a_short_part_does_not_show_is_taken_from_a_longer_one(is_known, monkeypatch):
    """Within 39 s, the errors of a chaotic motion are small; a regular motion over as many periods has its plan."""
    if not is_known:
        monkeypatch.setattr(step_search.Search, "is_chaotic", False)
    plan = eig3.plan(problems.double_pendulum(t_end=1e4), 1e-6, methods=["rk8"])
    assert (
        plan.window[1] - plan.window[0] < 100
    ) != is_known  # if runs over a longer part show chaos, they are the last
    reason = r"error grows too fast with time, as in chaos or after kinks of the force: over (625|1e\+04) time units"
    assert all(re.search(reason, p.note) for p in plan.predictions)
    regular = eig3.plan(problems.henon_heiles().with_(t_span=(0, 1e5)), 1e-6, methods=["rk8"])
    assert regular.window[1] - regular.window[0] < 1e4
    assert regular.predictions[0].reaches


def test_kinks_outside_a_short_part_deny_its_promise():
    """At 1e-7, the part of 3 ms has no contact, and RK8 promised 5e-15 for all 800 ms, with the error 9e-7."""
    search = runs_of(pilots.Pilots(problems.single_dof(), "trajectory", 1e-7), step_search.GUIDE, (61, 1e-15, math.inf))
    search.pilots.look_at(1 / 256)
    promised = step_search._beside([(1 / 16, step_search.PilotRun(976, 7e-7, seen_error=3e-8))], search, 1.0)
    assert "error grows too fast with time, as in chaos or after kinks of the force" in promised


def test_all_errors_grow_with_time_as_fast_as_one_of_them():
    """In a part of a spring pendulum's 3,000 s, an error near the limit of stability grew like t: 1/22 was promised."""
    system = pilots.Pilots(problems.single_dof(), "trajectory", 1e-4)
    system.look_at(1 / 16)
    search = step_search.Search(system, step_search.GUIDE)
    for n_steps, seen, power in ((122, 2.5e-6, 1.0), (244, 3e-8, 1.5), (488, 1e-14, 2.0)):  # the last one is round-off
        search.add(step_search.PilotRun(n_steps, 16**power * seen, seen_error=seen))
    assert [run.error for run in search.runs] == pytest.approx([64 * 2.5e-6, 64 * 3e-8, 256 * 1e-14])


def runs_of(system, method, *runs):
    """A search with runs, each with its steps, its error, and the fraction of the span up to which it is right."""
    search = step_search.Search(system, method)
    for n_steps, error, right in runs:
        search.add(step_search.PilotRun(n_steps, error, seen_error=error, right=right))
    return search


@pytest.mark.parametrize(
    ("runs", "expected"),
    [
        ([(1000, 1.8, 0.25), (2000, 1.7, 0.28)], True),
        ([(1000, 1.8, 0.25), (2000, 1.7, 0.36)], False),  # the time grows like h^(-1/2): kinks in a regular motion
        ([(1000, 1.8, 0.25), (2000, 0.1, math.inf)], False),
        ([(100, 1.8, 0.25), (200, 1.7, 0.28)], False),  # 25 steps may be too few for the motion
        ([(1000, 2.1, 0.25), (2000, 1.7, 0.28)], False),  # the first one is unstable
        ([(2000, 1.7, 0.28)], False),
    ],
)
def test_in_chaos_a_shorter_step_hardly_extends_the_time_of_right_digits(runs, expected):
    search = runs_of(pilots.Pilots(problems.single_dof(), "trajectory", 1e-4), step_search.GUIDE, *runs)
    assert search.is_chaotic == expected


def test_a_short_part_promises_nothing_for_a_large_chaotic_system():
    """The flag loses its last digit at 0.4 s of 4 s; a plan from 0.016 s promised 1e-5 for all of them."""
    plan = eig3.plan(problems.flag(), 1e-4, methods=["eig3"])
    (prediction,) = plan.predictions
    assert not prediction.reaches
    assert (
        "error grows too fast with time, as in chaos or after kinks of the force: over 4 time units" in prediction.note
    )


def test_a_run_whose_steps_become_slow_is_stopped(monkeypatch):
    """Where grains penetrate each other, a step takes up to a hundred times as long.

    The first piece of such a run is one step, so that the time is looked at early.
    """
    monkeypatch.setattr(pilots, "_SLOW_STEP", 0.0)
    runs = pilots.Pilots(problems.single_dof(), "trajectory", 1e-4)
    runs.predicted(step_search.GUIDE, 1)
    history = runs.history(step_search.GUIDE, 61 * 512, longest=1e-4)
    assert not history.is_whole
    assert step_search.GUIDE not in runs._paces  # they tell nothing about the steps of other runs


def test_the_time_of_a_cheap_step_is_not_that_of_a_call():
    """A call of one step takes some 50 us, and RK8 was refused after 14,000 of its steps of 0.2 us."""
    runs = pilots.Pilots(problems.single_dof(), "trajectory", 1e-4)
    counts = []
    advance = runs._advance
    runs._advance = lambda method, h, n_steps, *rest: counts.append(n_steps) or advance(method, h, n_steps, *rest)
    runs.predicted(step_search.GUIDE, 1)
    assert counts[0] == 1
    assert counts[-1] > 50


def test_the_error_of_16_000_orbits_is_that_of_the_plan():
    """Runs over all orbits are too long: with few steps, the planet leaves, to where all errors look small.

    From four orbits, errors are extrapolated with t^2, as 60 orbits show: here to a factor of about 2.
    """
    problem = problems.kepler().with_(t_span=(0.0, 1e5))
    best = eig3.plan(problem, 1e-3, methods=["rkn12"]).best
    run = problem.integrate(**best.options, invariants={}, save_every=10)
    exact, _ = problem.exact(run.t)
    assert 1e-5 < np.abs(run.u - exact).max() / np.abs(exact).max() < 5e-3
    with pytest.raises(ValueError, match=r"EIG-3: the error grows like t\^2, and cannot be known from runs "):
        eig3.plan(problem, 1e-6, methods=["eig3"]).run()


def test_round_off_is_reported():
    plan = eig3.plan(problems.single_dof(t_end=100.0), 1e-14, methods=["rk4"])
    assert not plan.predictions[0].reaches


def test_whether_a_string_is_broken_is_no_length():
    """The state of the string, 0 or 1, is as large as the motion in metres, and a million times larger in the other."""
    steps = []
    for metre in (2.0**-20, 1.0):
        scene = Scene(dimension=2)
        ends = scene.fixed((0, 0)), scene.mass(1.0, (metre, 0), velocity=(2 * metre, 0.3 * metre))
        scene.add(LinearSpring(20.0, rest_length=metre), *ends)
        scene.add(BreakingString(30.0, rest_length=metre, strength=6 * metre), *ends)
        problem = scene.problem((0, 6))
        (prediction,) = eig3.plan(problem, 1e-4, methods=["eig3"]).predictions
        steps.append((prediction.n_steps, problem.integrate(accuracy=1e-4, method="eig3").n_steps))
    assert steps[0] == steps[1]


def test_a_large_system_is_not_given_newtons_differences():
    """Differences for each of the 60 degrees of freedom would take at least 60 evaluations per step."""
    (prediction,) = eig3.plan(problems.damped_bar(n=60, t_end=1e-4), 1e-2, methods=["cd"]).predictions
    assert prediction.evaluations < 20 * prediction.n_steps


# Structures at rest, whose load comes later ------------------------------------------------------------------------


@eig3.jit
def storeys(t, u, v, p, a):
    """A shear building whose ground shakes; p has its spacing of the record, damping, and K in compressed rows."""
    n, spacing, xi = u.size, p[0], p[1]
    starts, columns = 2, 3 + n
    values = columns + int(p[2 + n])
    record = values + int(p[2 + n])
    x = t / spacing
    i = min(int(x), p.size - record - 2)
    ground = p[record + i] + (x - i) * (p[record + i + 1] - p[record + i])
    for j in range(n):
        a[j] = -ground - xi * v[j]
        for k in range(int(p[starts + j]), int(p[starts + j + 1])):
            a[j] -= p[values + k] * u[int(p[columns + k])]


def building(n, omega, t_end, silent, xi=0.5, omega_ground=10.0):
    """A building of n storeys at rest on ground that hardly moves at first; `omega` is about its largest frequency.

    The ground then shakes with a growing and falling amplitude, near the lowest frequency of the building.
    """
    stiffness = np.diag(np.full(n, 2.0)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)
    stiffness[-1, -1] = 1.0
    stiffness *= (omega / 2) ** 2
    rows, columns = np.nonzero(stiffness)
    starts = np.searchsorted(rows, np.arange(n + 1))
    spacing = 0.01
    t = np.arange(0.0, t_end + 2 * spacing, spacing)
    later = np.maximum(0.0, t - silent) / (t_end - silent)
    record = (1e-5 + 3.0 * np.sin(np.pi * np.minimum(1.0, later)) ** 2) * np.sin(omega_ground * t)
    parameters = np.concatenate([[spacing, xi], starts, columns, stiffness[rows, columns], record])
    return eig3.Problem("building", storeys, np.zeros(n), np.zeros(n), parameters, (0.0, t_end))


def check_cost(plan, fewest):
    """EIG-3 takes few more evaluations than at its critical step; which method is faster depends on the machine."""
    (prediction,) = (p for p in plan.predictions if p.method.name == "eig3")
    assert prediction.evaluations < 1.2 * fewest
    assert plan.best.evaluations < 4 * fewest


def check_runs(plan, *, h, times_the_best=4):
    """Run every prediction that is not much slower than the best: error and evaluations are those predicted.

    The error is that at some 100 times, relative to the whole motion. RK4 with the step h gives the exact motion.
    """
    runs = []
    for prediction in plan.predictions:
        assert prediction.reaches or prediction.note
        assert prediction.reaches == math.isfinite(prediction.seconds)
        if prediction.reaches and prediction.evaluations < times_the_best * plan.best.evaluations:
            solution = plan.problem.integrate(**prediction.options, save_every=max(1, prediction.n_steps // 100))
            if prediction.rtol is None:  # with tolerances, steps are longer where nothing moves
                assert solution.n_rhs == pytest.approx(prediction.evaluations, rel=0.05), prediction
            runs.append((prediction, solution))
    assert runs
    times = np.unique(np.concatenate([solution.t for _, solution in runs]))
    exact = plan.problem.integrate(h=h, method="rk4", t_eval=times).u
    for prediction, solution in runs:
        error = np.abs(solution.u - exact[np.searchsorted(times, solution.t)]).max() / np.abs(exact).max()
        assert error < 1.2 * plan.accuracy, prediction


def test_a_load_that_begins_later_is_seen():
    """Almost nothing moves for 6 s, and the runs of RK8 over the whole span take too long: EIG-3 gives the reference.

    At its critical step its error is far below 1e-3, and no method takes fewer evaluations there.
    """
    problem = building(n=200, omega=3000.0, t_end=20.0, silent=6.0)
    plan = eig3.plan(problem, 1e-3, methods=ANY_FORCE)
    assert plan.window == (0.0, 20.0)
    check_cost(plan, 20.0 / problem.critical_step(method="eig3").limit)
    check_runs(plan, h=5e-4)


def test_a_part_of_the_span_is_that_of_the_large_motion(monkeypatch):
    """Two runs of EIG-3 over the whole span are allowed, which do not agree enough: they calibrate those of a part."""
    trials = ((1.0, step_search.GUIDE, 0.0), (1.0, step_search.SCOUT, 0.0), (1 / 16, step_search.GUIDE, 1.0))
    monkeypatch.setattr(step_search, "_TRIALS", trials)
    monkeypatch.setattr(step_search, "_GUIDE_WORK", 2**25)
    problem = building(n=200, omega=3000.0, t_end=20.0, silent=6.0)
    plan = eig3.plan(problem, 1e-5, methods=["eig3", "eig5", "rk8"])
    begin, end = plan.window
    assert end - begin == pytest.approx(20 / 16)
    assert begin > 10  # where the ground shakes more than half as much as at most
    assert end < 18
    assert "The pilot runs are from t = 1" in repr(plan)
    check_runs(plan, h=5e-4, times_the_best=8)


@eig3.jit
def loaded_chain(t, u, v, p, a):
    n = u.size
    for j in range(n):
        left = u[j - 1] if j > 0 else 0.0
        right = u[j + 1] if j < n - 1 else 0.0
        a[j] = left - 2 * u[j] + right
    a[n // 2] += p[0] * t * t


def test_a_growing_load_does_not_shorten_the_step():
    """The error of EIG-3 near its critical step, 1 here, is 3e-7 of the motion at the end, but more of that before."""
    n = 2000
    problem = eig3.Problem("chain", loaded_chain, np.zeros(n), np.zeros(n), [1e-3], (0.0, 1200.0))
    plan = eig3.plan(problem, 1e-3, methods=["eig3", "rk4", "rk8"])
    check_cost(plan, 1200)
    check_runs(plan, h=0.25)


@eig3.jit
def pushed_later(t, u, v, p):
    return -u - 0.1 * v + (np.sin(np.pi * (t - 100) / 20) if 100 < t < 120 else 0.0)


def test_tolerances_from_rest_do_not_step_over_the_load():
    """With rtol alone the steps grow without limit while nothing moves."""
    problem = eig3.Problem("pushed", pushed_later, 0.0, 0.0, (), (0.0, 200.0))
    plan = eig3.plan(problem, 1e-4, methods=["rk8"])
    (prediction,) = (p for p in plan.predictions if p.rtol is not None)
    assert prediction.reaches, prediction
    assert set(prediction.options) == {"method", "rtol", "atol", "h_max"}
    check_runs(plan, h=0.01, times_the_best=10)
    solution = problem.integrate(**prediction.options)
    assert np.abs(solution.u).max() > 0.5
    assert solution.n_rhs == pytest.approx(prediction.evaluations, rel=1e-3)


def test_what_never_moves_has_no_plan():
    problem = eig3.Problem("still", pushed_later, 0.0, 0.0, (), (0.0, 50.0))
    plan = eig3.plan(problem, 1e-2, methods=["eig3"])
    assert [p.note for p in plan.predictions] == ["nothing moves in any run"]


def test_no_pilot_run_begins_when_its_time_is_over(monkeypatch):
    monkeypatch.setattr(pilots, "_LATEST", 0.0)
    for methods in (None, ["eig3", "rk8"]):
        plan = eig3.plan(problems.single_dof(), 1e-3, methods=methods)
        assert {p.note for p in plan.predictions} == {step_search.NO_TIME}
        assert "no time was left to try it" in repr(plan)


# What the load of a machine may change -------------------------------------------------------------------------------


def slow_clock(monkeypatch, factor, processor=1):
    """Let every run seem to take `factor` times as long, and the processor `processor` times."""
    clock = SimpleNamespace(
        perf_counter=lambda: factor * time.perf_counter(), thread_time=lambda: processor * time.thread_time()
    )
    monkeypatch.setattr(pilots, "time", clock)


def verdicts(plan):
    """The notes of the plan on the stability of each method."""
    stable = {p.method for p in plan.predictions if p.reaches or p.note.startswith("the error does not converge")}
    return {p.method: "has a stable step" if p.method in stable else p.note for p in plan.predictions}


def falling_cloth():
    """Its threads become stiffer as they stretch: later, the critical step at the start is several times too long."""
    return problems.curtain(n=6, t_end=1.0)


running_away = eig3.jit(lambda t, u, v, p: u * u)


@pytest.mark.parametrize(
    ("build", "methods", "expected"),
    [
        (falling_cloth, ["eig3", "cd", "rk4"], "has a stable step"),
        (lambda: problems.double_pendulum(t_end=20.0), OF_EACH_KIND[:-1], "has a stable step"),
        (lambda: problems.damped_bar(n=80, t_end=2e-4), OF_EACH_KIND, "has a stable step"),
        (
            lambda: eig3.Problem("infinite", running_away, 1.0, 1.0, (), (0.0, 10.0)),
            ["rk4"],
            "unstable at every step tried",
        ),
    ],
    ids=["cloth", "chaos", "bar", "infinite"],
)
def test_the_load_of_a_machine_does_not_change_what_is_stable(build, methods, expected, monkeypatch):
    problem = build()
    found = []
    for factor in (1, 50):
        slow_clock(monkeypatch, factor)
        found.append(verdicts(eig3.plan(problem, 1e-2, methods=methods)))
    assert found[0] == found[1]
    assert set(found[0].values()) == {expected}


def test_a_loaded_machine_finds_the_same_step_limited_by_stability(monkeypatch):
    steps = []
    for factor in (1, 50):
        slow_clock(monkeypatch, factor)
        (prediction,) = eig3.plan(falling_cloth(), 1e-2, methods=["rk4"]).predictions
        assert prediction.note == "the step is limited by stability"
        steps.append(prediction.h)
    assert steps[0] == steps[1]


def test_a_fast_decay_is_resolved_also_by_a_method_that_it_does_not_limit():
    """Central difference is stable at steps far above the time of the decay. Two such runs agree on a wrong motion."""
    problem = problems.van_der_pol(t_end=20.0)
    (prediction,) = eig3.plan(problem, 1e-2, methods=["cd"]).predictions
    exact = problem.integrate(h=prediction.h / 8, method="rk4", save_every=8)
    solution = problem.integrate(h=prediction.h, method=prediction.method)
    assert np.abs(solution.u - exact.u).max() / np.abs(exact.u).max() < 1.5e-2


# What is ruled out ---------------------------------------------------------------------------------------------------


def test_methods_that_are_ruled_out_by_order_or_limit_are_not_compiled(monkeypatch):
    """At 1e-8, methods of low order need ten times the evaluations of those of high order."""
    ran = set()
    advance = pilots.Pilots._advance
    monkeypatch.setattr(
        pilots.Pilots, "_advance", lambda self, method, *rest: ran.add(method.name) or advance(self, method, *rest)
    )
    monkeypatch.setattr(planner, "LIBRARY", ("eig5", "eig3", "cd", "rk2", "ab2", "rk4", "rk8", "bm6"))
    plan = eig3.plan(problems.single_dof(t_end=200.0), 1e-8)
    assert {p.method.name for p in plan.predictions} >= set(planner.LIBRARY)
    assert plan.best.method.order >= 6
    assert {"eig3", "cd", "rk2", "ab2"}.isdisjoint(ran)
    for prediction in plan.predictions:
        if prediction.rtol is None and prediction.method.name not in ran:
            assert not prediction.reaches
            assert prediction.note.startswith("ruled out: ")
    assert re.search("  CD +ruled out: ", repr(plan))


def searched(method, *, seconds, is_limited=False, follows_order=True, is_far_off=False):
    return SimpleNamespace(
        method=check_method(method),
        label=check_method(method).label,
        seconds=seconds,
        is_limited=is_limited,
        follows_order=follows_order,
        is_far_off=is_far_off,
        evaluations=check_method(method).evaluations,
        pilots=SimpleNamespace(evaluations=lambda method: method.evaluations),
    )


@pytest.mark.parametrize(
    ("method", "other", "expected"),
    [
        (
            "eig9",
            searched("eig5", seconds=1.0, is_limited=True),
            "stability limits its step more than the step of EIG-5",
        ),
        ("eig4", searched("eig5", seconds=1.0, is_limited=True), ""),
        ("eig9", searched("eig7", seconds=1.0, is_limited=True), ""),  # it has no limit without damping, but EIG-9 has
        ("rk4", searched("eig5", seconds=5.0), "EIG-5, of order 4, takes 5 times as long as RK8"),
        ("rk4", searched("eig5", seconds=3.0), ""),  # a method may have a smaller error than another of its order
        ("rk5", searched("eig5", seconds=5.0), ""),
        ("eig4", searched("rk5", seconds=5.0), ""),  # it has fewer evaluations
        ("rk4", searched("eig5", seconds=5.0, follows_order=False), ""),
        (
            "rk4",
            searched("eig5", seconds=math.inf, follows_order=False, is_far_off=True),
            "EIG-5, of order 4, is far from the accuracy in 2 times the best time",
        ),
        ("rk5", searched("eig5", seconds=math.inf, follows_order=False, is_far_off=True), ""),
    ],
)
def test_what_rules_a_method_out(method, other, expected):
    best = searched("rk8", seconds=1.0)
    assert planner._ruled_out(check_method(method), [other], best) == expected


# Kinds of motions ----------------------------------------------------------------------------------------------------

stiffer_one_way = eig3.jit(lambda t, u, v, p: -u if u < 0 else -2.0 * u)


@pytest.mark.parametrize(
    ("problem", "kind"),
    [
        (problems.single_dof(t_end=10.0), "the motion takes few steps"),
        (problems.elastic_bar(n=100, width=0.2, t_end=1e-3), "stability limits the step"),
        (problems.kepler(e=0.9), "the speed varies much"),
        (eig3.Problem("kinks", stiffer_one_way, 1.0, 0.0, (), (0.0, 300.0)), "the force has kinks"),
        (problems.single_dof(), "the motion is smooth and even"),
    ],
)
def test_a_plan_knows_the_kind_of_the_motion(problem, kind):
    first = step_search.guide(pilots.Pilots(problem, "trajectory", 1e-4))
    assert kinds.kind_of(first).name == kind


def test_few_methods_are_compiled():
    """A method takes about a second to compile; the reference method is one of the four."""
    plan = eig3.plan(problems.single_dof(), 1e-6)
    usual = {p.method.name for p in plan.predictions if "usually slower" not in p.note}
    assert usual == {"rk8", "rkn12", "bm6", "eig12"}


@pytest.mark.parametrize("e", [0.0, 0.3, 0.6])
def test_unevenness_of_an_orbit(e):
    """The scale of time at the radius r is r^1.5: local errors are (h / r^1.5)^9, up to a factor of the state."""
    anomaly = np.linspace(0, 2 * np.pi, 100_000)
    r = 1 - e * np.cos(anomaly)  # dt = r d(anomaly)
    longest = np.mean(r * r ** (-1.5 * 9)) ** (1 / 8) / np.mean(r * r**-1.5) ** (9 / 8)
    problem = problems.kepler(e=e)
    runs = pilots.Pilots(problem, "trajectory", 1e-6)
    first = step_search.guide(runs)
    assert runs.unevenness(runs.span / first.steps) == pytest.approx(longest, rel=0.35)


# Other packages ------------------------------------------------------------------------------------------------------


def swinging_atwood_formulas(u, v, p):
    heyoka = pytest.importorskip("heyoka")
    first = (u[0] * v[1] ** 2 - p[0] * 9.81 + 9.81 * heyoka.cos(u[1])) / (1 + p[0])
    return [first, -(2 * v[0] * v[1] + 9.81 * heyoka.sin(u[1])) / u[0]]


@pytest.mark.parametrize(
    ("build", "formulas"),
    [
        (lambda: problems.van_der_pol(mu=10.0, t_end=20.0), lambda u, v, p: p[0] * (1 - u**2) * v - u),
        (
            lambda: eig3.Problem("atwood", swinging_atwood, [1.0, 1.0], [0.0, 0.0], [3.0], (0.0, 1.0)),
            swinging_atwood_formulas,
        ),
    ],
    ids=["scalar", "vector"],
)
def test_the_plan_says_how_to_use_taylor_series_for_a_high_accuracy(build, formulas):
    heyoka = pytest.importorskip("heyoka")
    problem = build()
    plan = eig3.plan(problem, 1e-10, methods=["rk8"])
    assert "Taylor series" in repr(plan)
    variables, solver = re.search(r": (u, v = .*); (heyoka.*\))\.propagate_until\(t_end\)", plan.elsewhere).groups()
    names = {"heyoka": heyoka, "u0": problem.u0, "v0": problem.v0}
    exec(variables, names)
    names["f"] = formulas(names["u"], names["v"], problem.params)
    exact = eval(solver, names)
    exact.propagate_until(problem.t_span[1])
    solution = plan.run()
    np.testing.assert_allclose(exact.state, [*np.ravel(solution.u[-1]), *np.ravel(solution.v[-1])], rtol=1e-8)


def test_a_low_accuracy_needs_no_other_package():
    assert not eig3.plan(problems.van_der_pol(mu=1.0, t_end=5.0), 1e-4, methods=["rk8"]).elsewhere


# Which methods -------------------------------------------------------------------------------------------------------


def test_a_users_method_breaks_no_plan():
    try:

        class Broken(eig3.Method):
            name: ClassVar[str] = "broken"
            label: ClassVar[str] = "broken"
            kernel: ClassVar[str] = "no.such.kernel"
            order: ClassVar[int] = 2

        assert "broken" in eig3.METHODS
        plan = eig3.plan(problems.single_dof(), 1e-6)  # as in another test, which compiles few methods
    finally:
        del eig3.METHODS["broken"]
    assert {p.method.name for p in plan.predictions} == set(LIBRARY)


def test_a_record_is_shown_where_its_name_stands_for_another():
    records = [eig3.EIG3(alpha=1.2), "eig3", eig3.CentralDifference(velocity="lagged"), "cd"]
    plan = eig3.plan(problems.single_dof(t_end=10.0), 1e-1, methods=records)
    names = [line.split("  ")[1] for line in repr(plan).splitlines()[2:]]
    assert sorted(names) == ["CD", "CentralDifference(velocity='lagged')", "EIG-3", "EIG3(alpha=1.2, beta=0.5)"]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"problem": 3}, TypeError, "problem must be an eig3.Problem, not int."),
        ({"accuracy": 0.0}, ValueError, "accuracy must be a number between 0 and 1, not 0.0."),
        ({"accuracy": "low"}, ValueError, "accuracy must be a number between 0 and 1, not 'low'."),
        ({"metric": "phase"}, ValueError, "metric must be 'trajectory' or 'energy', not 'phase'."),
        ({"methods": ["euler"]}, ValueError, "method must be one of 'eig3'"),
        ({"methods": []}, ValueError, "methods must name at least one method."),
    ],
)
def test_bad_input_gives_an_error_of_one_sentence(change, error, message):
    arguments = {"problem": problems.single_dof(), "accuracy": 1e-3, **change}
    with pytest.raises(error) as caught:
        eig3.plan(arguments.pop("problem"), arguments.pop("accuracy"), **arguments)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("name", "method", "message"),
    [("duffing", "rkn12", "needs a rhs that ignores v"), ("four_bar", "cd", "does not support constraints")],
)
def test_a_method_that_does_not_fit_is_refused_before_the_pilot_runs(name, method, message, monkeypatch):
    monkeypatch.setattr(eig3.planning.planner, "Pilots", None)
    with pytest.raises(ValueError, match=message):
        eig3.plan(getattr(problems, name)(), 1e-3, methods=["rk4", method])


def test_energy_must_not_be_zero_at_the_start():
    with pytest.raises(ValueError, match="relative to the energy at the start, which is 0 in hardening_spring"):
        eig3.plan(problems.hardening_spring().with_(u0=0.0, v0=0.0), 1e-3, metric="energy")


def test_energy_needs_an_energy():
    with pytest.raises(ValueError, match="needs a problem with an energy"):
        eig3.plan(dataclasses.replace(problems.single_dof(), energy=None), 1e-3, metric="energy")


def test_command(capsys):
    assert main(["plan", "hardening_spring", "--accuracy", "1e-2", "--method", "rk4"]) == 0
    assert "Plan for hardening_spring" in capsys.readouterr().out
    for arguments in (["plan", "no_problem", "--accuracy", "1e-2"], ["plan", "single_dof", "--accuracy", "2"]):
        with pytest.raises(SystemExit, match="eig3 plan: "):
            main(arguments)
