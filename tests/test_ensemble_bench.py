"""`eig3 bench ensemble`: every contestant solves the same ensemble; the tables say who is ahead and who is absent."""

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eig3 import problems
from eig3.bench import ensemble, ensemble_million
from eig3.bench.ensemble import TARGET, Found, Reference
from eig3.bench.ensemble_cases import CASES, CASES_WITH_TOLERANCES
from eig3.bench.ensemble_rivals import ENSEMBLE_RIVALS, Contestant, jax_eig3
from eig3.bench.ensemble_tolerances import sets, tolerance_tables
from eig3.bench.rivals.general import first_order
from eig3.cli import main

pytestmark = pytest.mark.system

HEYOKA = [rival for rival in ENSEMBLE_RIVALS if rival.package == "heyoka"]
DIFFRAX = [rival for rival in ENSEMBLE_RIVALS if rival.package == "diffrax"]


@pytest.mark.parametrize("name", CASES)
def test_lanes_the_loop_by_hand_and_jax_take_the_same_steps(name):
    case, m, n_steps = CASES[name], 3, 200
    options = {"h": case.h, "t_end": n_steps * case.h, "save_every": None}
    expected = case.problem.ensemble(**case.members(m), **options).u[:, -1].reshape(m, -1)
    for run in (case.run_by_hand(m, n_steps), jax_eig3(case, m, n_steps)):
        # the same sums in another order: round-off of 200 steps
        np.testing.assert_allclose(run(), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", [*CASES, *CASES_WITH_TOLERANCES])
def test_the_reference_is_accurate(name):
    """Its error must be small beside the target. The jumps of the ground's velocity cost any method its order."""
    case, m = {**CASES, **CASES_WITH_TOLERANCES}[name], 2
    has_jumps = name == "shear_building"
    reference = Reference(case, m)
    for i, problem in enumerate(case.one_by_one(m)):
        if problem.events:
            (g, e), h0 = problem.params, float(problem.u0)
            exact, _ = problems.bouncing_ball(e, h0, g).exact(problem.t_span[1])
            np.testing.assert_allclose(reference.ends[i], exact, rtol=0, atol=1e-8 * h0)
            continue
        y0, params, slope = first_order(problem)

        def f(t, y, params=params, slope=slope):
            dy = np.empty_like(y)
            slope(t, y, params, dy)
            return dy

        y, t_end = y0, problem.t_span[1]
        times = problem.params[1:1002] if has_jumps else (0.0, t_end)
        for begin, end in pairwise(times):
            # up to the jump, but not beyond it
            y = solve_ivp(f, (begin, np.nextafter(end, 0)), y, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        n = np.size(problem.u0)
        error = np.abs(reference.ends[i] - y[:n]) / reference.sizes[i]
        assert error.max() < (0.1 * TARGET if has_jumps else 1e-8)


@pytest.mark.parametrize("name", [name for name in CASES if not HEYOKA[0].cannot(CASES[name])])
def test_heyoka_solves_the_same_ensembles(name):
    """The members do not fill two batches of the size that heyoka recommends, or not one."""
    heyoka = pytest.importorskip("heyoka")
    chosen = HEYOKA if name == "duffing" else HEYOKA[:1]
    for rival, m in product(chosen, (heyoka.recommended_simd_size() + 1, 1)):
        ends = rival.prepare(CASES[name], m)(1e-9)()
        assert ends.shape == (m, np.size(CASES[name].problem.u0))
        assert Reference(CASES[name], m).error(ends) < 1e-7  # some hundred steps with the tolerance


@pytest.mark.parametrize("rival", DIFFRAX, ids=lambda rival: rival.label)
def test_diffrax_solves_the_same_ensemble(rival, monkeypatch):
    monkeypatch.setattr("eig3.bench.ensemble_rivals._CHUNK", 2)
    case = CASES["duffing"]
    ends = rival.prepare(case, 4)(1e-9)()
    assert Reference(case, 4).error(ends) < 1e-6  # some thousand steps with the tolerance


def test_heyoka_has_no_tables():
    assert HEYOKA[0].cannot(CASES["shear_building"])
    assert not DIFFRAX[0].cannot(CASES["shear_building"])


def test_members_are_problems_with_other_constants():
    case = CASES["shear_building"]
    params = case.members(3)["params"]
    for row in params:
        built = problems.shear_building(stiffness=row[-2], damping=row[-1], t_end=10.0)
        np.testing.assert_array_equal(row, built.params)
    np.testing.assert_array_equal(case.members(2)["params"], params[:2])
    assert len(np.unique(params[:, -1])) == 3


def test_a_setting_must_be_enough_for_all_members(monkeypatch):
    """The pilots take the second setting; a member that is not among them needs the third."""
    monkeypatch.setattr(ensemble, "_PILOTS", 2)
    case = CASES["duffing"]
    reference = Reference(case, 4)

    def prepare(case, m):
        def at(setting):
            ends = reference.ends[:m].copy()
            ends[0] += (setting < 2) * 2 * TARGET * reference.sizes[0]
            if m == 4:
                ends[3] += (setting < 3) * 2 * TARGET * reference.sizes[3]
            return lambda: ends

        return at

    contestant = Contestant("made up", prepare, (1, 2, 3, 4), "a package")
    _, setting, ran = ensemble._search(contestant, case, 4, reference)
    assert (setting, ran) == (3, 4)
    assert ensemble._search(Contestant("made up", prepare, (1, 2), "a package"), case, 4, reference) is None


def test_a_member_that_diverged_has_no_accuracy():
    reference = Reference(CASES["duffing"], 2)
    ends = reference.ends.copy()
    assert reference.error(ends) == 0
    ends[1] = np.nan
    assert not reference.error(ends) <= TARGET


def test_verdict_names_the_rivals_that_are_ahead():
    found = {
        "one": {"EIG-3": Found(True, 2.0, "100"), "RK4": Found(True, 1.0, "10"), "diffrax": Found(False, 4.0, "1e-05")},
        "two": {"EIG-3": Found(True, 2.0, "100"), "RK4": Found(True, word="not reached"), "diffrax": Found(False, 0.5)},
        "three": {"EIG-3": Found(True, 2.0, "100"), "RK4": Found(True, 1.0), "diffrax": Found(False, word="absent")},
    }
    assert ensemble.verdict(found).splitlines() == [
        "one: RK4 takes 0.250 of the time of diffrax.",
        "two: A rival is ahead: EIG-3 takes 4.00 of the time of diffrax.",
        "three: RK4 takes 1.00 s, and no rival ran.",
    ]
    assert ensemble.accuracy_rows(found)[1] == ["RK4", "1.00 (10)", "not reached", "1.00 ()"]


def test_command_without_rivals(capsys, monkeypatch):
    monkeypatch.setattr(Contestant, "is_installed", False)
    monkeypatch.setattr(ensemble, "is_installed", lambda package: False)
    sizes = ["--members", "3", "--steps", "20", "--accurate", "3", "--repeats", "1"]
    main(["bench", "ensemble", "--problem", "duffing", *sizes])
    printed = capsys.readouterr().out
    assert "left out: heyoka, batches in threads" in printed
    assert "diffrax Dopri8, JAX." in printed
    for method in ("EIG-3", "EIG-9", "RK4"):
        assert f"| duffing, {method}" in printed
    assert printed.count("not installed |") == len(ENSEMBLE_RIVALS)
    assert "single_dof, EIG-3, 1000 members of 20 steps: " in printed
    assert "and no rival ran." in printed


def test_command_with_a_rival(capsys, monkeypatch):
    """The row of EIG-3 has a loop by hand and one in JAX; the second table has seconds and tolerance of the rival."""
    pytest.importorskip("heyoka")
    monkeypatch.setattr(ensemble, "ENSEMBLE_RIVALS", HEYOKA[:1])
    monkeypatch.setattr(ensemble, "SPEED_METHODS", ("eig3",))
    monkeypatch.setattr(ensemble, "ACCURACY_METHODS", ("rk8",))
    ensemble.benchmark(only=["duffing"], repeats=1, members=3, n_steps=20, accurate=40)
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("| heyoka, batches"))
    assert "(0.0" in row or "e-0" in row


def test_members_in_bounded_memory(capsys):
    ensemble_million.main(m=300, n_steps=20)
    assert "300 members of 20 steps in 3 parts" in capsys.readouterr().out


def test_the_tables_of_tolerances_have_a_row_for_each_set_and_method():
    tables = tolerance_tables(20, 1)
    rows = [line for line in tables.splitlines() if line.startswith("|")]
    assert len(rows) == 2 + 9 + 2 + 3
    for name in sets(20):
        assert sum(row.startswith(f"| {name}") for row in rows) == 3  # two methods, and an event or a fixed step
