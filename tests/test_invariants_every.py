"""Invariants that are evaluated after some steps only, as a problem follows its energy."""

import re

import numpy as np
import pytest

import eig3
from eig3.kernels.loops.follow import next_due

H, N = 1e-3, 3000
EVERY = 100 + (np.sqrt(5) - 1) / 2  # the least favourable irrational number for a period to be near to


def due_steps(n_steps, spacing=EVERY):
    steps, due = [], 1.0
    while due <= n_steps:
        steps.append(int(np.ceil(due)))
        due = next_due.py_func(due, spacing)
    return np.array(steps)


@pytest.fixture(scope="module")
def problem():
    return eig3.problems.spring_pendulum()


def drift_at(problem, run, steps):
    e = problem.energy_of(run.u, run.v)
    return np.abs(e[steps] - e[0]).max()


@pytest.mark.parametrize(
    ("name", "options"),
    [("spring_pendulum", {}), ("softening_spring", {"inline": True}), ("softening_spring", {"method": "ab3"})],
)
def test_the_drift_is_found_at_the_steps_that_are_due(name, options):
    problem = getattr(eig3.problems, name)()
    run = problem.integrate(h=H, t_end=N * H, **options)
    steps = due_steps(run.n_steps)
    assert run.n_invariants == len(steps)
    assert run.drift["energy"] == pytest.approx(drift_at(problem, run, steps), rel=1e-9)  # compiled in another order
    assert re.search(rf"drift of energy: \S+ \(at {run.n_invariants} of 3,000 steps\)", str(run))


def test_with_tolerances_the_drift_is_found_at_the_ends_of_steps_that_are_due(problem):
    run = problem.integrate(rtol=1e-7, t_end=40.0)
    steps = due_steps(run.n_steps)
    assert run.n_invariants == len(steps) < run.n_steps / 8
    assert run.drift["energy"] == pytest.approx(drift_at(problem, run, steps), rel=1e-6)


def test_members_in_lanes_have_the_drift_of_single_runs(problem):
    v0 = np.array(problem.v0) + np.array([[0.0, 0.0], [0.0, 0.1]] * 10)
    runs = problem.ensemble(h=H, t_end=N * H, v0=v0)
    for i in range(2):
        single = problem.with_(v0=v0[i]).integrate(h=H, t_end=N * H)
        assert runs.n_invariants[i] == single.n_invariants
        assert runs.drift["energy"][i] == pytest.approx(single.drift["energy"], rel=1e-9)  # other vectors, other bits
    assert f"(at {20 * len(due_steps(N)):,} of {20 * N:,} steps)" in str(runs)


def test_a_run_that_goes_on_has_the_drift_of_one_run(problem, tmp_path):
    whole = problem.integrate(h=H, t_end=N * H)
    part = problem.integrate(h=H, t_end=N / 2 * H)
    part.save(tmp_path / "run.npz")
    for begun in (part, problem.load(tmp_path / "run.npz")):
        run = begun.extend(N * H)
        assert (run.drift, run.n_invariants) == (whole.drift, whole.n_invariants)


def test_a_loaded_run_that_begins_anew_evaluates_as_seldom(tmp_path):
    """The steps of this short run follow from its span, so that `extend` repeats them."""
    problem = eig3.problems.hertz_impact()
    problem.integrate(rtol=1e-6, t_end=0.0111).save(tmp_path / "run.npz")
    whole, run = problem.integrate(rtol=1e-6, t_end=0.03), problem.load(tmp_path / "run.npz").extend(0.03)
    assert (run.drift, run.extremes, run.n_invariants) == (whole.drift, whole.extremes, whole.n_invariants)


def test_outputs_are_evaluated_at_every_step_beside(problem):
    speed = eig3.jit(lambda t, u, v, p: np.sqrt(v[0] ** 2 + v[1] ** 2))
    run = problem.integrate(h=H, t_end=N * H, outputs={"speed": speed})
    assert run.n_invariants == len(due_steps(N))
    assert run.extremes["speed"].high == run.outputs["speed"].max()
    assert run.drift == problem.integrate(h=H, t_end=N * H).drift


def test_a_user_asks_for_every_step_or_for_none(problem):
    run = problem.integrate(h=H, t_end=N * H, invariants_every=1)
    assert run.n_invariants == run.n_steps
    assert run.drift["energy"] == pytest.approx(drift_at(problem, run, slice(None)), rel=1e-9)
    assert problem.integrate(h=H, t_end=N * H, invariants={"energy": problem.energy}).drift == run.drift
    assert problem.integrate(h=H, t_end=N * H, invariants={}).n_invariants == 0
    assert "steps)" not in str(run).partition("drift")[2]


def test_few_steps_are_due_and_the_drift_is_near_to_that_of_all(problem):
    """At most 3 % of 3,000 steps and 1.1 % of 100,000: an energy that costs two steps then costs 5 %."""
    assert len(due_steps(N)) < 0.03 * N
    long = problem.integrate(h=H, save_every=None)
    assert long.n_invariants == len(due_steps(long.n_steps)) < 0.011 * long.n_steps
    every = problem.integrate(h=H, save_every=None, invariants_every=1)
    # The steps that are due meet an oscillating error in a thousand phases.
    assert 0.95 < long.drift["energy"] / every.drift["energy"] <= 1


@pytest.mark.parametrize("period", [2, 5, 20, 50, 64, 100, 200, 202])
def test_no_period_of_the_motion_is_met_in_few_phases(period):
    phases = np.unique(due_steps(10**5)[-500:] % period)
    assert len(phases) > min(period, 150) * 0.9


@pytest.mark.parametrize("every", [0, -1, 1.5, "2"])
def test_other_than_counts_are_refused(problem, every):
    with pytest.raises((TypeError, ValueError), match="invariants_every"):
        problem.integrate(h=H, invariants_every=every)
