"""`accuracy=`: the error that a run is asked for, against the true error, and what is said when it is not reached."""

import time
from itertools import count
from threading import Event

import numpy as np
import pytest

import eig3
from eig3 import Status, problems
from eig3.cli import main
from eig3.ensembles.checked import errors_of_members
from eig3.ensembles.in_process import EnsembleRun
from eig3.functions.companions import remembered
from eig3.run import accuracy as module
from eig3.run import chunks, short

from .conftest import position, spring
from .test_check import energy

#: Duffing's oscillator, or a motion that is singular at a finite time if both forces push it away.
cubic = eig3.jit(lambda t, u, v, p: p[0] * u + p[1] * u * u * u + p[2] * np.cos(t))


HARDENING, FALLING_AWAY = (-1.0, -1.0, 0.0), (0.0, 1.0, 0.0)


STARTS = np.linspace(1.0, 3.0, 20)
FAST = 1e4  # the stiffness of motions that would take minutes


def run(**options):
    return eig3.integrate(spring, (0, 20), 3.0, 0.0, params=1.0, **options)


def runs_of(monkeypatch):
    """Return a list that gets the h or the rtol of each run that is compared with an accuracy."""
    seen, after = [], module._Search.after
    monkeypatch.setattr(
        module._Search, "after", lambda self, solution, value: seen.append(value) or after(self, solution, value)
    )
    remembered(spring, "accuracies").clear()
    return seen


@pytest.mark.parametrize(
    ("method", "accuracy"),
    [*((method, x) for method in (None, "rk4", "rk8") for x in (1e-2, 1e-5, 1e-9)), ("eig3", 1e-2), ("eig3", 1e-5)],
)
def test_the_error_is_at_most_the_accuracy(method, accuracy):
    """The estimate is right to about 10 % where the runs follow their order."""
    solution = run(accuracy=accuracy, method=method)
    assert solution.success
    error = np.abs(solution.u - 3 * np.cos(solution.t)).max() / 3
    assert error < 1.2 * accuracy
    assert solution.error.largest["u"] <= 3 * accuracy
    assert (solution.steps is None) == (method in ("eig3", "rk4"))


def test_several_errors_can_be_bounded():
    events = {"down": eig3.Event(position, direction=-1)}
    options = {"invariants": {"energy": energy}, "outputs": {"height": position}, "events": events}
    wanted = {"u": 1e-2, "v": 1e-3, "drift": 1e-6, "height": 1e-4}
    solution = run(accuracy=wanted, method="rk4", **options)
    assert solution.drift["energy"] / 4.5 <= 1e-6
    assert np.abs(solution.outputs["height"] - 3 * np.cos(solution.t)).max() / 3 < 1.1e-4
    solution = run(accuracy={"height": 1e-7}, method="rk8", **options)
    assert np.abs(solution.outputs["height"] - 3 * np.cos(solution.t)).max() / 3 < 1.2e-7
    solution = run(accuracy={"down": 1e-7}, method="rk4", **options)
    times = np.pi / 2 + 2 * np.pi * np.arange(3)
    assert np.abs(solution.events["down"].t - times).max() / 20 < 1.2e-7


def test_what_was_learned_is_kept(monkeypatch):
    """The second call begins with the step that reached the accuracy, and compares it with one coarser run."""
    seen = runs_of(monkeypatch)
    first = run(accuracy=1e-6, method="eig3")
    searched = len(seen)
    again = run(accuracy=1e-6, method="eig3")
    assert searched > 1
    assert len(seen) == searched + 1
    assert (first.error.by, again.error.by) == (
        "a run with twice the step and a run with four times the step",
        "a run with twice the step",
    )
    np.testing.assert_array_equal(again.u, first.u)
    np.testing.assert_allclose(again.error.u, first.error.u, rtol=0.01, atol=1e-3 * first.error.largest["u"])


@pytest.mark.parametrize("accuracy", [1e-4, 1e-7])
def test_later_calls_from_other_starts_estimate_their_own_error(accuracy):
    """The ratio of the errors of two tolerances differs up to tenfold from one start to the next.

    With a finer run it hardly matters, unless that happens to be as wrong. An estimate by ten times the tolerance was
    down to 0.004 of the true error.
    """
    ratios = []
    for speed in np.linspace(0.9, 1.1, 12):  # relative to the speed at the perihelion for e = 0.6
        e = 1.6 * speed**2 - 1
        orbit = problems.kepler(a=0.4 / (1 - e), e=e)
        solution = eig3.integrate(orbit.rhs, (0, 30), orbit.u0, orbit.v0, params=orbit.params, accuracy=accuracy)
        error, size = np.abs(solution.u - orbit.exact(solution.t)[0]).max(), np.abs(solution.u).max()
        ratios.append(solution.error.largest["u"] / error)
        assert error < 1.3 * accuracy * size
    assert 0.2 < min(ratios) < max(ratios) < 2.5
    assert np.mean(np.abs(np.log2(ratios)) < 1) > 0.7


def test_a_call_evaluates_rhs_at_most_three_times_as_often_as_its_run(monkeypatch):
    """So does the first call, if its first run reaches the accuracy.

    RK8 takes a tenth of the tolerance with 10^(1/8) = 1.33 times the steps, and evaluates more for saved times.
    """
    counts, made = [], chunks.solution_of

    def counted(*given):
        solution = made(*given)
        counts.append(solution.n_rhs)
        return solution

    monkeypatch.setattr(chunks, "solution_of", counted)
    monkeypatch.setattr(short, "solution_of", counted)
    remembered(cubic, "accuracies").clear()
    for _ in range(3):  # the second call may begin with a larger tolerance
        counts.clear()
        solution = eig3.integrate(cubic, (0, 100), 1.0, 0.5, params=HARDENING, accuracy=1e-6, method="rk8")
        assert len(counts) == 2
        assert sum(counts) <= 3 * solution.n_rhs
        assert solution.error.by == "a run with a tenth of the tolerance"


def test_the_result_is_that_of_the_step_that_was_found(monkeypatch):
    """A scale makes the accuracy absolute."""
    seen = runs_of(monkeypatch)
    solution = run(accuracy=1e-3, scale=0.1, method="eig3")
    assert np.abs(solution.u - 3 * np.cos(solution.t)).max() < 1.1e-4
    np.testing.assert_array_equal(solution.u, run(h=seen[-1], method="eig3").u)


def test_an_unstable_first_step_is_shortened():
    """The limit of EIG-3 is h = 2 / 300, and the first step 0.02."""
    solution = eig3.integrate(spring, (0, 20), 1.0, 0.0, params=300.0, accuracy=1e-2, method="eig3")
    assert solution.success
    assert np.abs(solution.u - np.cos(300 * solution.t)).max() < 1.2e-2


def test_a_problem_takes_an_accuracy():
    problem = problems.spring_pendulum(t_end=10.0)
    solution = problem.integrate(accuracy={"u": 1e-6, "drift": 1e-7})
    exact = problem.integrate(rtol=1e-13, method="rk8", t_eval=solution.t)
    assert np.abs(solution.u - exact.u).max() / np.abs(exact.u).max() < 1e-6
    assert problem.integrate(accuracy=1e-4, t_end=5.0).t[-1] == 5.0


# When it is not reached ----------------------------------------------------------------------------------------------


def test_round_off_is_the_reason():
    solution = run(accuracy=1e-15)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert not solution.success
    assert "The accuracy 1e-15 of u is not reached, because round-off" in solution.message
    assert np.abs(solution.u - 3 * np.cos(solution.t)).max() < 1e-11  # this is the best run
    with pytest.raises(eig3.IntegrationError, match="is not reached, because round-off"):
        run(accuracy=1e-15, raise_on_failure=True)


def test_chaos_is_the_reason():
    """An error of round-off grows to the size of the motion within 40 s or so."""
    problem = problems.double_pendulum(theta1=2.0, theta2=2.5, t_end=80.0)
    solution = problem.integrate(accuracy=1e-3)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert "as in a chaotic motion" in solution.message
    assert 20 < solution.reliable_until < 70


def test_the_best_run_of_a_chaotic_motion_is_right_for_the_longest_time():
    """The smallest error is a matter of chance; the message gave the time of another run."""
    problem = problems.double_pendulum(t_end=1000.0)
    solution = problem.integrate(accuracy=1e-6, save_every=10)
    assert f"no digit of u is right after t = {solution.reliable_until:.4g}, as in a chaot" in solution.message
    assert solution.reliable_until > problem.integrate(rtol=1e-8, check=True, save_every=10).reliable_until


def test_a_chaotic_motion_is_known_by_short_runs(monkeypatch):
    """All errors are as large as the motion: a step that is shorter by their ratio to the accuracy leads nowhere."""
    seen = runs_of(monkeypatch)
    problem = problems.double_pendulum(theta1=2.0, theta2=2.5, t_end=150.0)
    solution = problem.integrate(accuracy=1e-9, method="rk4")
    assert "as in a chaotic motion" in solution.message
    assert 150 / min(seen) < 1e6
    seen.clear()
    ends = problem.integrate(accuracy=1e-9, method="rk4", save_every=None)  # the end alone does not show this
    assert f"no digit of u is right after t = {ends.reliable_until:.4g}, as in a chaotic motion" in ends.message
    assert 150 / min(seen) < 1e6


def test_round_off_in_chaos_is_seen():
    """EIG of grade 13 reaches round-off with 100 steps in a unit of time: then no digit is right for longer."""
    problem = problems.henon_heiles(0.1666, -0.15)
    solution = problem.integrate(accuracy=1e-9, method="eig13", t_end=5000.0, save_every=50)
    assert "as in a chaotic motion" in solution.message
    assert solution.h > 1e-3


def test_the_drift_converges_in_chaos_too():
    """No digit of u is right at the end, but RK4 decreases the drift with h^4 or more."""
    problem = problems.double_pendulum(theta1=2.0, theta2=2.5, t_end=60.0)
    solution = problem.integrate(accuracy={"drift": 1e-9}, method="rk4", save_every=100)
    assert solution.success
    assert solution.reliable_until < 60


def test_a_motion_at_rest_has_an_error_and_an_accuracy_of_its_drift():
    """Its energy is 0, and so is the change of it."""
    options = {"params": 1.0, "invariants": {"energy": energy}}
    at_rest = eig3.integrate(spring, (0, 3), 0.0, 0.0, rtol=1e-3, check=True, **options)
    assert at_rest.error.largest["energy"] == 0
    starts = [1.0, 0.0, 2.0], [0.0, 0.0, 1.0]
    members = eig3.ensemble(spring, (0, 3), *starts, accuracy={"drift": 1e-5}, method="rk8", **options)
    assert members.success.all()
    assert members.drift["energy"].max() < 1e-5 * 5


def test_the_best_run_for_a_drift_has_the_least_drift(monkeypatch):
    """The drift of BM6 reaches round-off while no digit of u is right at the end."""
    seen, after = [], module._Search.after

    def watched(search, solution, value):
        seen.append(solution.drift["energy"])
        return after(search, solution, value)

    monkeypatch.setattr(module._Search, "after", watched)
    problem = problems.henon_heiles(0.1666, -0.15)
    solution = problem.integrate(accuracy={"drift": 1e-17}, method="bm6", t_end=2000.0, save_every=50)
    assert solution.drift["energy"] == min(seen)
    assert "because round-off" in solution.message


def test_steps_that_are_too_long_are_no_chaos():
    """Kepler's ellipse is regular. With EIG3, a fourth of the first step leaves fewer digits right than this step."""
    assert problems.kepler().integrate(accuracy=1e-2, method="eig3", save_every=1000).success


def test_memory_is_the_reason(monkeypatch):
    """The runs so far were lost, or the process was killed."""
    monkeypatch.setattr("eig3.result.memory.available_memory", lambda: 1e8)
    solution = problems.kepler().integrate(accuracy=1e-6, method="eig3")
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert "with h = 0.000123 the estimated error needs 1.64e+08 bytes and 1e+08 are free" in solution.message


def test_the_words_of_numpy_about_memory_are_whole(monkeypatch):
    """They have no full stop, which is left out of the reason."""
    error, seen = module._error, []

    def second_fails(*given):
        seen.append(given)
        return error(*given) if len(seen) == 1 else np.empty(10**16)

    monkeypatch.setattr(module, "_error", second_fails)
    solution = problems.kepler().integrate(accuracy=1e-6, method="eig3", save_every=100)
    assert "data type float64: the estimated error is" in solution.message


def ticking(monkeypatch, *owners):
    """Let each look at the clock take a second."""
    clock = count()
    for owner in owners or (module, time):  # the search, and the kernels
        monkeypatch.setattr(owner, "perf_counter", lambda: float(next(clock)))


def test_time_is_the_reason(monkeypatch):
    """The step for the accuracy is about 2e-5, and takes too long; there is time for a fourth of the first step."""
    seen = runs_of(monkeypatch)
    ticking(monkeypatch)
    solution = run(accuracy=1e-9, method="eig3", max_seconds=300)
    assert len(seen) > 1
    assert solution.h < seen[0] / 2
    assert "because the next run would exceed max_seconds = 300" in solution.message


def test_an_unstable_run_says_why_no_shorter_step_is_tried(monkeypatch):
    ticking(monkeypatch, module)
    solution = eig3.integrate(spring, (0, 1e5), 3.0, 0.0, params=FAST, accuracy=1e-3, method="eig3", max_seconds=5)
    assert solution.status is Status.DIVERGED
    assert solution.message.endswith(
        " A shorter step was not tried, because the next run would exceed max_seconds = 5."
    )


def test_a_short_run_does_not_tell_the_time_of_a_long_one(monkeypatch):
    """Only the time of the kernel, here 30 us, grows with the number of steps."""
    ticking(monkeypatch, module)
    assert run(accuracy=1e-7, method="eig3", max_seconds=100, save_every=100).success


def test_the_first_run_ends_in_time(monkeypatch):
    """The whole run would take minutes. Its part can go on."""
    ticking(monkeypatch)
    options = {"accuracy": 1e-9, "max_seconds": 5, "save_every": None}
    solution = eig3.integrate(spring, (0, 1e9), 3.0, 0.0, params=FAST, **options)
    assert solution.status is Status.INTERRUPTED
    assert 0 < solution.t[-1] < 1e9
    assert solution.message == f"The run was interrupted after t = {solution.t[-1]:g}: max_seconds = 5 had passed."
    assert solution.can_go_on


def test_a_later_run_that_takes_too_long_leaves_the_best_run(monkeypatch):
    seen = runs_of(monkeypatch)
    monkeypatch.setattr(module, "perf_counter", lambda: 10.0 * len(seen))
    monkeypatch.setattr(module._Search, "_may_run", lambda search, seconds: True)
    solution = run(accuracy=1e-9, method="eig3", max_seconds=5)
    assert len(seen) == 2
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert solution.h == seen[0]
    assert "because the next run would exceed max_seconds = 5" in solution.message


def test_a_run_that_fails_is_returned():
    solution = eig3.integrate(cubic, (0, 1000), 1.0, 1.0, params=FALLING_AWAY, accuracy=1e-3)
    assert solution.status not in (Status.COMPLETED, Status.ACCURACY_NOT_REACHED)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"accuracy": 0.0}, "accuracy must be a relative error between 0 and 1"),
        ({"accuracy": {"u": 2.0}}, "accuracy must be a relative error between 0 and 1"),
        ({"accuracy": {}}, "accuracy must name at least one error"),
        ({"accuracy": "high"}, "accuracy must be"),
        ({"accuracy": {"w": 1e-3}}, "accuracy has no w"),
        ({"h": 0.1}, "accuracy and h exclude each other"),
        ({"rtol": 0.1}, "accuracy and rtol exclude each other"),
        ({"save_to": "run"}, "accuracy and save_to exclude each other"),
        ({"scale": -1.0}, "scale must be a positive number"),
        ({"max_seconds": 0}, "max_seconds must be a positive number"),
        ({"accuracy": None, "h": 0.1, "scale": 1.0}, "scale belongs to accuracy"),
        ({"method": eig3.Langevin(1.0, 1.0)}, "adds random numbers"),
    ],
)
def test_bad_arguments(given, words):
    with pytest.raises((TypeError, ValueError), match=words):
        run(**{"accuracy": 1e-3, **given})


def test_command(capsys):
    assert main(["run", "spring_pendulum", "--accuracy", "1e-5", "--t-end", "5"]) == 0
    assert "error of u at most" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["run", "spring_pendulum", "--accuracy", "1e-5", "--h", "0.1"])


# Ensembles -----------------------------------------------------------------------------------------------------------


def ensemble(rhs=spring, u0=STARTS, t_end=20, params=1.0, **options):
    return eig3.ensemble(rhs, (0, t_end), u0, 0.0, params=params, **options)


@pytest.mark.parametrize(
    ("accuracy", "options"), [(1e-3, {"t_eval": np.linspace(0, 20, 9), "method": "rkn12"}), (1e-8, {})]
)
def test_every_member_has_the_accuracy(accuracy, options):
    solution = ensemble(accuracy=accuracy, **options)
    assert solution.success.all()
    error = np.abs(solution.u - STARTS[:, None] * np.cos(solution.t)).max(axis=1)
    assert (error < 1.2 * accuracy * np.abs(solution.u).max(axis=1)).all()
    assert (solution.error.largest["u"] <= accuracy * np.abs(solution.u).max(axis=1)).all()


def test_a_later_ensemble_begins_with_what_was_learned(monkeypatch):
    runs = []
    march = EnsembleRun.march
    monkeypatch.setattr(EnsembleRun, "march", lambda self, *_, **__: runs.append(1) or march(self))
    first = ensemble(cubic, params=HARDENING, t_end=2000, accuracy=1e-6)
    count = len(runs)
    later = ensemble(cubic, params=HARDENING, t_end=2000, accuracy=1e-6)
    assert (count > 2, len(runs) - count) == (True, 2)  # the run, and the finer run
    np.testing.assert_array_equal(later.u, first.u)


not_at_the_start = eig3.jit(lambda t, u, v, p: 10 * u if t > 0 else np.nan)


def test_an_output_that_is_nan_at_the_start_is_compared_elsewhere():
    """The values after the start have the error of 10 u = 10 cos(t), in single runs and in ensembles."""
    options = {"outputs": {"k": not_at_the_start}, "t_eval": np.linspace(0, 500, 11)}
    options |= {"accuracy": {"k": 1e-3}, "scale": 1e-4, "method": "rkn12"}
    one = eig3.integrate(spring, (0, 500), 1.0, 0.0, params=1.0, **options)
    many = ensemble(u0=np.full(8, 1.0), t_end=500, **options)
    for outputs in (one.outputs["k"], *many.outputs["k"]):
        assert np.abs(outputs - 10 * np.cos(one.t))[1:].max() < 1.2e-7
    assert one.success
    assert many.success.all()


@pytest.mark.parametrize("options", [{"method": "rk4"}, {"method": "rk8"}])
def test_a_cancelled_search_is_interrupted_and_learns_nothing(options, monkeypatch):
    cancel, error = Event(), chunks.Run.error
    monkeypatch.setattr(chunks.Run, "error", lambda *given: cancel.set() or error(*given))
    remembered(spring, "accuracies").clear()
    solution = run(accuracy=1e-6, cancel=cancel, **options)
    assert (solution.status, solution.error) == (Status.INTERRUPTED, None)
    assert "interrupted before its error was known" in solution.message
    assert not remembered(spring, "accuracies")


def test_a_cancelled_ensemble_is_interrupted_and_learns_nothing(monkeypatch):
    cancel = Event()
    monkeypatch.setattr(
        "eig3.ensembles.ensemble.errors_of_members", lambda *given: cancel.set() or errors_of_members(*given)
    )
    remembered(spring, "accuracies").clear()
    solution = ensemble(accuracy=1e-6, cancel=cancel)
    assert (solution.status == Status.INTERRUPTED).all()
    assert "interrupted before this member had reached the accuracy" in solution.message[0]
    assert not remembered(spring, "accuracies")


def test_members_that_miss_the_accuracy_say_why():
    """The members with a large load are chaotic: no digit of them is right at the end."""
    params = [(1.0, -1.0, load) for load in np.linspace(0.0, 0.5, 16)]
    solution = ensemble(cubic, 1.2, 300, params, accuracy=1e-9)
    missed = solution.status == Status.ACCURACY_NOT_REACHED
    assert 0 < missed.sum() < 16
    assert (solution.success == ~missed).all()
    assert "The accuracy is not reached" in solution.message[np.argmax(missed)]


@pytest.mark.parametrize(("least", "statuses"), [(0.0, {"COMPLETED", "STEP_TOO_SMALL"}), (1.0, {"STEP_TOO_SMALL"})])
def test_a_member_that_fails_does_not_stop_the_others(least, statuses):
    """Nor is anything raised if all fail."""
    solution = ensemble(cubic, np.linspace(least, 2.0, 20), params=FALLING_AWAY, accuracy=1e-6)
    assert {status.name for status in solution.status} == statuses


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"h": 0.1}, "accuracy and h exclude each other"),
        ({"rtol": 1e-3}, "accuracy and rtol exclude each other"),
        ({"method": "eig3"}, "needs a method with tolerances"),
        ({"save_to": "x"}, "accuracy and save_to exclude each other"),
        ({"reduce": len}, "accuracy and reduce exclude each other"),
        ({"accuracy": {"w": 1e-3}}, "accuracy has no w: did you mean"),
        (
            {"accuracy": {"y": 1e-3}, "outputs": {"y": position}, "save_every": 1},
            "accuracy of 'y' in an ensemble needs",
        ),
        ({"accuracy": 2.0}, "between 0 and 1"),
        ({"accuracy": None, "scale": 2.0}, "scale belongs to accuracy"),
    ],
)
def test_bad_arguments_of_an_ensemble(given, words):
    with pytest.raises(ValueError, match=words):
        ensemble(**{"accuracy": 1e-3, **given})


@pytest.mark.parametrize(("most", "runs"), [(15, 1), (25, 2)])
def test_time_is_the_reason_in_an_ensemble(monkeypatch, most, runs):
    """The second run would end too late, or takes longer than the first."""
    clock = [0.0, 10.0, 1000.0]

    def errors(*given):
        clock.pop(0)
        return errors_of_members(*given)

    monkeypatch.setattr(module, "perf_counter", lambda: clock[0])
    monkeypatch.setattr("eig3.ensembles.ensemble.errors_of_members", errors)
    remembered(cubic, "accuracies").clear()
    solution = ensemble(cubic, params=HARDENING, t_end=2000, accuracy=1e-7, max_seconds=most)
    assert len(clock) == 3 - runs
    assert (solution.status == Status.ACCURACY_NOT_REACHED).any()
    missed = np.argmax(solution.status == Status.ACCURACY_NOT_REACHED)
    assert "the next run would exceed max_seconds" in solution.message[missed]


def test_the_first_run_of_an_ensemble_ends_in_time(monkeypatch):
    ticking(monkeypatch)
    solution = ensemble(t_end=1e9, params=FAST, accuracy=1e-9, max_seconds=5, save_every=None)
    assert (solution.status == Status.INTERRUPTED).all()
    assert all("max_seconds = 5 had passed" in message for message in solution.message)
