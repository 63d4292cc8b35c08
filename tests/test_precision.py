"""The work-precision sets: errors against the truth, times to reach an accuracy, and that no run is dropped."""

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import eig3
from eig3 import problems
from eig3.bench import plan, precision, rivals, sweep
from eig3.bench.modes import MODES
from eig3.bench.precision import reach
from eig3.bench.problem_set import PROBLEM_SET, VARIABLE_SPEED, BenchmarkProblem, about, describe
from eig3.bench.reference import Judge, reference
from eig3.bench.rivals import general
from eig3.bench.sweep import Point, WorkPrecisionSet
from eig3.bench.tolerances import TOLERANCES
from eig3.cli import main
from eig3.stability import limit

pytestmark = pytest.mark.system


def points(*pairs, metric="trajectory"):
    return [
        Point("eig3", "EIG-3", "pointer", 1 / 2**k, 2**k, 2**k, True, {metric: error}, [seconds])
        for k, (error, seconds) in enumerate(pairs)
    ]


def result_of(swept, **fields):
    plain = {"name": "x", "title": "x", "description": "", "metric": "trajectory", "source": "", "uncertainty": 0.0}
    plain |= {"targets": (1e-2, 1e-3, 1e-4, 1e-6, 1e-8), "tolerances": False, "points": swept, "skipped": []}
    return WorkPrecisionSet(**plain | fields)


def test_reach_interpolates_in_logarithms():
    found = reach(result_of(points((1e-1, 1.0), (1e-3, 4.0))), "eig3", "trajectory", 1e-2)
    assert found.seconds == pytest.approx(2.0)
    assert found.setting == pytest.approx(2**-0.5)
    assert not found.at_most


def test_reach_says_at_most_where_the_first_step_is_accurate_and_nothing_where_none_is():
    swept = points((1e-3, 1.0), (1e-5, 2.0))
    result = result_of(swept)
    assert reach(result, "eig3", "trajectory", 1e-2).at_most
    assert reach(result, "eig3", "trajectory", 1e-8) is None
    swept[0].stable = False
    assert reach(result, "eig3", "trajectory", 1e-2).seconds == 2.0


def test_an_error_that_is_small_by_chance_does_not_count():
    result = result_of(points((1e-1, 1.0), (1e-5, 2.0), (1e-2, 4.0), (1e-6, 16.0), (1e-7, 32.0)))
    found = reach(result, "eig3", "trajectory", 1e-4)
    assert 4.0 < found.seconds < 16.0
    result = result_of(points((1e-1, 1.0), (1e-5, 2.0), (1e-6, 4.0)))
    assert 1.0 < reach(result, "eig3", "trajectory", 1e-4).seconds < 2.0


def test_nothing_is_claimed_below_three_times_the_uncertainty_of_the_truth():
    swept = [replace(point, errors={"trajectory": 1e-9, "energy": 1e-9}) for point in points((1e-9, 1.0))]
    result = result_of(swept, uncertainty=1e-5)
    assert reach(result, "eig3", "trajectory", 3.1e-5)
    assert reach(result, "eig3", "trajectory", 2.9e-5) is None
    assert [bool(contest.ours) for contest in precision.contests(result, "trajectory")] == [True] * 3 + [False] * 2
    assert all(contest.ours for contest in precision.contests(result, "energy"))  # needs no true motion


def test_the_modes_of_a_set_are_apart_and_the_rivals_in_each():
    swept = points((1e-3, 1.0))
    swept += [replace(point, mode="inline", seconds=[0.5]) for point in swept]
    swept.append(Point("heyoka", "heyoka", "", 1e-3, None, None, True, {"trajectory": 1e-3}, [2.0]))
    result = result_of(list(reversed(swept)), command="eig3 bench precision --problem x")
    assert result.modes == ["pointer", "inline"]
    assert result.in_mode("pointer").command == f"{result.command} --mode pointer"
    assert result.in_mode("inline").in_mode("inline").command == f"{result.command} --mode inline"
    for mode, ratio in (("pointer", 1 / 2), ("inline", 1 / 4)):
        (contest, *_) = precision.contests(result.in_mode(mode), "trajectory")
        assert contest.ratio == ratio
        assert result.in_mode(mode).modes == [mode]


def test_a_mode_changes_what_is_timed_and_not_the_motion():
    problem = problems.single_dof(t_end=20.0)
    options = {"h": 0.01, "method": "eig3"}
    runs = {name: mode.timed(problem, options)()[1] for name, mode in MODES.items()}
    for run in runs.values():
        np.testing.assert_allclose(run.u, runs["pointer"].u, rtol=0, atol=1e-12)  # rounded in another way when inlined
    assert MODES["prepared"].timed(problem, options)()[0] > 0


def test_a_set_comes_back_from_json():
    ended = Point("cd", "CD", "pointer", 1.0, 0, 51, False, {})  # in its first step
    swept = [*points((1e-3, 1.0)), Point("rk4", "RK4", "inline", 1.0, 3, 12, False, {"trajectory": math.inf}), ended]
    result = result_of(swept, description="A mass.", skipped=["heyoka (not installed)"], command="eig3 bench")
    text = json.dumps(result.as_json(), allow_nan=False)
    assert WorkPrecisionSet.from_json(json.loads(text)) == result


def test_a_problem_is_described_without_its_parameters():
    chosen = PROBLEM_SET["kepler_03"]
    assert describe(chosen.build(), about(chosen.build)) == (
        "Kepler's problem in the plane, from the perihelion; u is (x, y) in m, and the sun is at the origin. "
        "It has 2 degrees of freedom and lasts 125.7 s; its forces do not read the velocity."
    )
    chosen = VARIABLE_SPEED["bouncing_ball"]
    assert describe(chosen.build(), about(chosen.build)).endswith("do not read the velocity; it has the event impact.")


def test_front_names_the_methods_in_order():
    swept = points((1e-1, 1.0), (1e-3, 4.0))
    swept.append(Point("rk4", "RK4", "pointer", 0.1, 10, 40, True, {"trajectory": 1e-9}, [3.0]))
    result = result_of(swept)
    assert precision.render_front(result, "trajectory").endswith("EIG-3 (1.0e-01), RK4 (1.0e-09).")


def test_a_rival_that_is_ahead_is_named_for_each_accuracy():
    swept = points((1e-2, 1.0), (1e-6, 4.0))
    swept += [Point("heyoka", "heyoka", "", tol, None, None, True, {"trajectory": tol}, [2.0]) for tol in (1e-2, 1e-8)]
    result = result_of(swept)
    found = [(contest.target, contest.ratio, contest.is_lost) for contest in precision.contests(result, "trajectory")]
    # between two points, log t is linear in log error: at 1e-3 and 1e-4 ours takes 4^(1/4) and 4^(2/4) s
    expected = [(1e-2, 0.5, False), (1e-3, 4**0.25 / 2, False), (1e-4, 1.0, False), (1e-6, 2.0, True)]
    assert [pytest.approx(cell) for cell in found[:4]] == expected
    assert found[4] == (1e-8, math.inf, True)
    printed = precision.render_contests(result, "trajectory")
    assert "At 1e-06, a rival is ahead: heyoka 2.00e+03 ms, against EIG-3 4.00e+03 ms." in printed
    assert "At 1e-08, a rival is ahead: heyoka 2.00e+03 ms, against none." in printed
    assert "fastest in 3 of 5 cells" in precision.render_summary([result])


def test_without_rivals_nothing_is_called_ahead():
    result = result_of(points((1e-3, 1.0)))
    assert all(contest.ratio is None and not contest.is_lost for contest in precision.contests(result, "trajectory"))
    assert "No rival was measured" in precision.render_contests(result, "trajectory")
    assert precision.render_summary([result]) == "No rival was measured."


@pytest.mark.parametrize("name", ["hardening_spring", "hardening_chain"])
def test_reference_agrees_with_a_second_solver(name):
    problem = getattr(problems, name)(t_end=0.5)
    truth = reference(problem, PROBLEM_SET[name].omega)
    assert truth.uncertainty < 1e-10  # of the dense output of DOP853, and of RK4 with 1000 steps per radian
    assert reference(problem, PROBLEM_SET[name].omega) is truth
    solution = problem.integrate(h=1e-5, method="rk4", save_every=100)
    assert Judge(problem, truth).of_run(solution)["trajectory"] < 1e-8


def test_the_exact_contact_agrees_with_rk4():
    """At 8000 steps a contact: RK4 errs by h^(5/2), 1e-10 of it, at each end of the contact."""
    problem = problems.hertz_impact()
    truth = reference(problem, VARIABLE_SPEED["hertz_impact"].omega)
    assert truth.source == "exact solution"
    solution = problem.integrate(h=problem.t_span[1] / 16_000, method="rk4", save_every=16)
    assert Judge(problem, truth).of_run(solution)["trajectory"] < 1e-8


@pytest.mark.parametrize("name", ["van_der_pol", "arenstorf"])
def test_taylor_series_agree_with_a_second_solver(name):
    """With DOP853 at 3e-14; Arenstorf's orbit multiplies its errors by up to 1e5."""
    pytest.importorskip("heyoka")
    problem = VARIABLE_SPEED[name].build()
    truth = reference(problem, VARIABLE_SPEED[name].omega)
    assert truth.source.startswith("Taylor series")
    assert truth.uncertainty < 1e-14
    times = np.linspace(*problem.t_span, 11)
    answer = rivals.RIVALS["scipy dop853"].prepare(problem, times)(3e-14)()
    assert Judge(problem, truth).of_answer(times, answer)["trajectory"] < 1e-8


def test_errors_of_a_run_are_those_of_the_exact_solution():
    problem = problems.single_dof(t_end=10.0)
    solution = problem.integrate(h=0.01, invariants_every=1)
    errors = Judge(problem, reference(problem, 4.0)).of_run(solution)
    exact = np.cos(4 * solution.t)
    assert errors["trajectory"] == pytest.approx(np.abs(solution.u - exact).max(), rel=1e-6)
    assert errors["energy"] == pytest.approx(solution.drift["energy"] / 8)


@pytest.mark.parametrize("key", [key for key, rival in rivals.RIVALS.items() if rival.package == "scipy"])
@pytest.mark.parametrize("name", ["spring_pendulum", "hardening_chain"])
def test_rivals_solve_the_same_problem(name, key):
    problem = getattr(problems, name)(t_end=0.5)
    times = np.linspace(0, 0.5, 11)
    answer = rivals.RIVALS[key].prepare(problem, times)(1e-9)()
    ours = problem.integrate(h=1e-5, method="rk4", save_every=5000)
    scale = np.abs(ours.u).max()
    np.testing.assert_allclose(answer.u, ours.u, atol=1e-5 * scale)  # global errors reach 1000 times the tolerance
    assert answer.success
    assert answer.evaluations > 0


@pytest.mark.parametrize(
    ("key", "name"),
    [
        # heyoka gets each problem as an expression of its own
        *(("heyoka", name) for name in PROBLEM_SET | VARIABLE_SPEED if name != "bouncing_ball"),
        *((key, name) for key in ("cyrk dop853", "cyrk vern8") for name in ("hardening_spring", "spring_pendulum")),
        *((key, name) for key in ("diffrax tsit5", "diffrax dopri8") for name in ("softening_spring", "rotor")),
        ("diffrax dopri8", "figure_eight"),
        ("rebound ias15", "figure_eight"),
    ],
)
def test_rivals_of_other_packages_solve_the_same_problems(key, name):
    rival = rivals.RIVALS[key]
    pytest.importorskip(rival.package)
    sizes = {"elastic_bar": {"n": 20}, "damped_bar": {"n": 20}, "hardening_chain": {"n": 20}}.get(name, {})
    t_end = 1e-4 if "bar" in name else 0.5
    problem = (PROBLEM_SET | VARIABLE_SPEED)[name].build() if not sizes else getattr(problems, name)(**sizes)
    problem = problem.with_(t_span=(0.0, t_end))
    answer = rival.prepare(problem, np.linspace(0, t_end, 11))(1e-9)()
    ours = problem.integrate(h=t_end / 1e5, method="rk4", save_every=10_000)
    np.testing.assert_allclose(answer.u, ours.u, atol=1e-5 * np.abs(ours.u).max())


@pytest.mark.parametrize(
    ("key", "name", "tolerance"),
    [
        ("rebound ias15", "outer_solar_system", 1e-11),
        ("rebound whfast", "outer_solar_system", 1e-6),  # of second order in the masses of the planets
        ("verlet", "outer_solar_system", 1e-4),
        ("verlet", "henon_heiles", 1e-4),
        ("verlet", "softening_spring", 1e-4),
    ],
)
def test_rivals_with_steps_between_the_times_solve_the_same_problems(key, name, tolerance):
    """Over omega t = 20 in 4096 steps: the phase of Verlet's method errs by (omega h)^2 omega t / 24 = 2e-5."""
    rival = rivals.RIVALS[key]
    pytest.importorskip(rival.package)
    chosen = (PROBLEM_SET | VARIABLE_SPEED)[name]
    problem = chosen.build().with_(t_span=(0.0, 20 / chosen.omega))
    times = np.linspace(*problem.t_span, 9)
    assert rival.refusal(problem) == ""
    answer = rival.prepare(problem, times)(times[1] / 512 if rival.substeps else 1e-9)()
    ours = problem.integrate(rtol=1e-12, t_eval=times)
    np.testing.assert_allclose(answer.u, ours.u, rtol=0, atol=tolerance * np.abs(ours.u).max())
    np.testing.assert_allclose(answer.v, ours.v, rtol=0, atol=10 * tolerance * np.abs(ours.v).max())


def test_a_run_of_diffrax_that_falls_into_the_sun_ends():
    """With such a tolerance, Tsit5 leaves the orbit and takes ever smaller steps."""
    pytest.importorskip("diffrax")
    problem = problems.kepler(e=0.9)
    assert not rivals.RIVALS["diffrax tsit5"].prepare(problem, np.linspace(*problem.t_span, 401))(1e-3)().success


def test_rivals_that_do_not_suit_a_problem_say_why():
    not_expressed = ("needs the equations in its own symbols", "not installed")
    assert rivals.RIVALS["verlet"].refusal(problems.spring_pendulum()) == "the forces read the velocity"
    assert rivals.RIVALS["rebound ias15"].refusal(problems.spring_pendulum()) in not_expressed
    assert rivals.RIVALS["verlet"].refusal(problems.bouncing_ball()) == "has no events"
    own = eig3.Problem("kepler", eig3.problems.kepler().rhs, [1.0, 0.0], [0.0, 1.0], 1.0, (0.0, 1.0))
    assert rivals.RIVALS["heyoka"].refusal(own, is_of_the_library=False) in not_expressed
    assert rivals.RIVALS["scipy lsoda"].refusal(problems.elastic_bar()) == "more than 300 degrees of freedom"


@pytest.mark.parametrize(
    "key",
    [key for key, rival in rivals.RIVALS.items() if rival.refusal(problems.bouncing_ball()) in ("", "not installed")],
)
def test_rivals_follow_the_impacts_of_the_ball(key):
    """Through 30 impacts; LSODA, whose steps are the least accurate, is late by 4e-7 s in the end."""
    rival = rivals.RIVALS[key]
    pytest.importorskip(rival.package)
    problem = problems.bouncing_ball()
    times = np.linspace(*problem.t_span, 101)
    answer = rival.prepare(problem, times)(1e-9)()
    assert answer.success
    u, v = problem.exact(times)
    np.testing.assert_allclose(answer.u, u, rtol=0, atol=1e-7)
    np.testing.assert_allclose(answer.v, v, rtol=0, atol=1e-5)  # g times as much as the time


def test_a_rival_without_impacts_leaves_the_motion():
    """The restart is what makes the ball bounce: without the event, SciPy's ball falls through the floor."""
    problem = problems.bouncing_ball(t_end=1.0).with_(events={})
    times = np.linspace(0, 1, 11)
    answer = rivals.RIVALS["scipy dop853"].prepare(problem, times)(1e-9)()
    np.testing.assert_allclose(answer.u, 1 - 9.81 * times**2 / 2, rtol=0, atol=1e-8)


def test_where_the_search_of_scipy_fails_the_run_failed(monkeypatch):
    def fails(*arguments):
        raise ValueError("f(a) and f(b) must have different signs")

    monkeypatch.setattr(general, "restarted", fails)
    answer = rivals.RIVALS["scipy rk45"].prepare(problems.bouncing_ball(), np.linspace(0, 1, 3))(1e-3)()
    assert not answer.success


def test_fixed_steps_are_left_out_where_there_are_events():
    chosen = VARIABLE_SPEED["bouncing_ball"]
    assert list(sweep.records(chosen.build(), chosen, ["eig3", "rk4"])) == []


def test_tolerances_are_compared_with_each_package_and_with_fixed_steps():
    seconds = {"rk8": 6.0, "rk5 tolerances": 3.0, "rk8 tolerances": 2.0}
    seconds |= {"scipy rk45": 40.0, "heyoka": 4.0, "scipy dop853": 20.0}
    mode = {key: "" if key in rivals.RIVALS else "pointer" for key in seconds}
    swept = [Point(x, x, mode[x], 1e-5, None, None, True, {"trajectory": 1e-10}, [seconds[x]]) for x in seconds]
    result = result_of(swept, targets=(1e-3, 1e-6, 1e-9), tolerances=True)
    rows = [line.split("|")[1:-1] for line in precision.render_tolerances(result, "trajectory").splitlines()]
    cells = {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows}
    assert cells["SciPy"] == ["0.10"] * 3  # 2 s, of RK8, against 20 s, of DOP853
    assert cells["heyoka"] == ["0.50"] * 3
    assert cells["CyRK"] == ["-"] * 3
    assert cells["fixed steps"] == ["0.33"] * 3
    summary = precision.render_summary([result, result_of(swept, name="y")])
    assert summary.count("fastest of eig3 / fastest rival") == 2  # a table for each set of targets
    assert "fastest in 8 of 8 cells" in summary


@pytest.mark.parametrize("key", TOLERANCES)
def test_methods_with_tolerances_are_measured_at_the_times_of_the_rivals(key):
    problem = problems.kepler(e=0.5, t_end=6.0)
    times = np.linspace(0, 6, 13)
    prepare = TOLERANCES[key].prepare(problem, times, mode=MODES["pointer"])
    loose, tight = (prepare(tolerance)() for tolerance in (1e-4, 1e-6))
    errors = [np.abs(answer.u - problem.exact(times)[0]).max() for answer in (loose, tight)]
    assert loose.success
    assert tight.success
    assert errors[1] < errors[0] / 10 < 1e-2  # at best in proportion to the tolerance, which falls by 100
    assert tight.evaluations > loose.evaluations > 0
    assert tight.seconds > 0


@pytest.mark.parametrize("key", TOLERANCES)
def test_methods_with_tolerances_follow_the_impacts_of_the_ball(key):
    problem = problems.bouncing_ball()
    times = np.linspace(*problem.t_span, 101)
    answer = TOLERANCES[key].prepare(problem, times, mode=MODES["integrate"])(1e-6)()
    assert answer.success
    np.testing.assert_allclose(answer.u, problem.exact(times)[0], rtol=0, atol=1e-9)  # each is exact for parabolas


def test_command_measures_tolerances_on_problems_whose_speed_varies(monkeypatch, capsys):
    short = BenchmarkProblem(
        lambda: problems.kepler(e=0.5, t_end=7.0), 3.0, "orbit", targets=(1e-3, 1e-6), tolerances=True
    )
    monkeypatch.setattr(precision, "VARIABLE_SPEED", {"orbit": short})
    options = ["--problem", "orbit", "--methods", "rk4", "rk8", "--no-rivals", "--repeats", "1", "--longest", "0.001"]
    options += ["--mode", "integrate"]
    assert main(["bench", "precision", *options]) == 0
    printed = capsys.readouterr().out
    assert "| RK8, tolerances " in printed
    assert "RK5, tolerances" not in printed
    assert re.search(r"\| fixed steps +\| +[\d.]+ \|", printed)


@pytest.fixture
def small(monkeypatch):
    """Two short problems in place of the set."""
    monkeypatch.setattr(precision, "VARIABLE_SPEED", {})
    short = {
        "single_dof": BenchmarkProblem(lambda: problems.single_dof(t_end=20.0), 4.0, "oscillator"),
        "elastic_bar": BenchmarkProblem(
            lambda: problems.elastic_bar(n=20, width=0.2, t_end=4e-4), 2 * 5000 * 21.0, "bar", "continuum"
        ),
    }
    for module in (precision, plan):
        monkeypatch.setattr(module, "PROBLEM_SET", short)


@pytest.mark.usefixtures("small")
def test_command_writes_tables_json_and_pictures(tmp_path, capsys):
    options = ["--repeats", "1", "--longest", "0.001", "--no-rivals", "--mode", "pointer", "--out", str(tmp_path)]
    assert main(["bench", "precision", "--methods", "eig3", "rk2", *options]) == 0
    printed = capsys.readouterr().out
    assert "## oscillator (single_dof)" in printed
    assert "time to reach (continuum)" in printed
    assert "Pareto front, from fast to accurate: " in printed
    assert "Unstable or too inaccurate" in printed
    data = json.loads((tmp_path / "precision.json").read_text())
    kept = [point for problem in data["problems"] for point in problem["points"]]
    assert {point["method"] for point in kept} == {"eig3", "rk2"}
    unstable = [point for point in kept if not point["stable"]]
    assert unstable
    assert all(point["seconds"] for point in kept if point["stable"])
    timed = [point for point in kept if point["seconds"]]
    assert all(point["minimum"] <= point["median"] for point in timed)
    products = ((point["ns_per_step"] * point["n_steps"], 1e9 * point["median"]) for point in timed)
    assert all(one == pytest.approx(other, rel=1e-4) for one, other in products)  # five digits each
    for name in ("single_dof", "elastic_bar"):
        assert (tmp_path / f"precision_{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("small")
def test_rivals_that_are_not_installed_are_listed_as_left_out(capsys, monkeypatch):
    monkeypatch.setattr(rivals.Rival, "is_installed", False)
    main(["bench", "precision", "--problem", "single_dof", "--method", "rk4", "--repeats", "1", "--longest", "0.001"])
    assert "heyoka (not installed)" in capsys.readouterr().out


@pytest.mark.parametrize("option", [["--problem", "none"], ["--method", "euler"]])
def test_unknown_names_are_refused(option, tmp_path):
    for command in (["precision"], ["report", "--out", str(tmp_path)]):
        with pytest.raises(SystemExit, match=r"eig3 bench: --(problem|method) must be one of"):
            main(["bench", *command, *option])
    assert not list(tmp_path.iterdir())


def test_a_long_run_that_is_unstable_does_not_end_the_sweep(monkeypatch):
    """The first run of a method is beyond its limit, and may take long."""

    def timed(problem, options):
        success, n_steps = options["h"] * 4.0 < limit("rk4"), round(problem.t_span[1] / options["h"])
        return lambda: (0.03, SimpleNamespace(success=success, kernel_seconds=0.03, n_steps=n_steps, n_rhs=4 * n_steps))

    monkeypatch.setitem(sweep.MODES, "slow", SimpleNamespace(timed=timed, is_whole=True, is_inline=True))
    judge = SimpleNamespace(of_run=lambda solution: {"trajectory": 0.5})
    problem, chosen = problems.single_dof(), BenchmarkProblem(problems.single_dof, 4.0, "oscillator")
    found = sweep.sweep(problem, chosen, judge, "rk4", eig3.RK4(), 0.02, None, "slow")
    assert [point.stable for point, _ in found] == [False, True]


@pytest.mark.usefixtures("small")
def test_plan_is_measured_against_the_sweep(capsys, monkeypatch):
    monkeypatch.setattr(plan, "ACCURACIES", (1e-2, 1e-4))
    monkeypatch.setattr(plan, "LIBRARY", ["eig3", "cd", "rk4", "eig9"])  # each further method compiles up to four loops
    assert main(["bench", "plan", "--problem", "single_dof", "--repeats", "1", "--longest", "0.001"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("| single_dof | trajectory |") == printed.count("| single_dof |     energy |") == 2
    assert re.search(r"at most 1.3 times as long as the best in \d of 4 cases. It reaches the accuracy in \d.", printed)
    with pytest.raises(SystemExit, match="--problem must be one of"):
        main(["bench", "plan", "--problem", "none"])


def test_a_miss_says_what_is_wrong_with_the_first_choice():
    chosen = eig3.plan(problems.single_dof(t_end=10.0), 1e-2, methods=["rk4"])
    (prediction,) = chosen.predictions

    def case(error, seconds):
        return plan.Outcome.of(chosen, [plan.Checked(prediction, error, 1.0)], seconds, "EIG-9", 1.0)

    cases = [case(0.7, 1.2), case(1.4, 1.2), case(0.7, 2.0), plan.Outcome.of(chosen, [], float("inf"), "EIG-9", 1.0)]
    assert [c.miss for c in cases] == [
        "",
        "RK4 has 1.40 of the requested error",
        "RK4 takes 2.00 times as long as EIG-9",
        "no method is predicted to reach the accuracy, but EIG-9 does",
    ]
    text = plan.render(cases)
    assert "in 2 of 4 cases. It reaches the accuracy in 2." in text
    assert text.count("- single_dof, trajectory 0.01: ") == 3
    assert plan.Checked(prediction, 0.7, 1.1).is_hit
    assert not plan.Checked(prediction, 0.7, 2.0).is_hit
    assert not plan.Checked(prediction, 1.1, 1.0).is_hit


def test_a_rival_without_end_is_given_up_but_timed_runs_are_not_limited(monkeypatch):
    problem = problems.duffing(t_end=5.0)
    run = rivals.RIVALS["scipy rk45"].prepare(problem, np.linspace(0.0, 5.0, 11))(1e-9)
    needed = run().evaluations
    monkeypatch.setattr(general, "_ENDLESS", needed // 2)
    assert run().evaluations == needed  # it has ended once
    first = rivals.RIVALS["scipy rk45"].prepare(problem, np.linspace(0.0, 5.0, 11))(1e-9)()
    assert not first.success
