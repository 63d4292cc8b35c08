"""The explanation of a run that diverges, and the note of a finite run whose invariant grows steadily."""

import math
import re
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import eig3
from eig3 import integrate, problems
from eig3.effects import HarmonicForce, HertzContact, LinearDamper, LinearSpring
from eig3.scene import Scene
from eig3.stability import limit, practical_limit, spectral_radius

from .conftest import gyroscope, hardening, harmonic_vector, oscillator, oscillator_vector

CD = eig3.CentralDifference(velocity="none")
OMEGA = 3.0
THREE = [1.0, 2.0, 0.5]  # two degrees of freedom have kernels of their own, which only take time to compile


def said(pattern, text):
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


def tried_step_holds(run, rhs, u0, v0, params):
    """Run with the step that the message names to where the run failed, and return that step and the largest |u|."""
    h = said(r"; h = ([\d.e+-]+) was tried and is stable up to then\.$", run.explain())
    n_steps = math.ceil((run.t[-1] + run.h) / h)
    again = integrate(rhs, (0, n_steps * h), u0, v0, h=h * (1 + 1e-9), params=params, method=run.method)
    assert again.success
    assert again.h == pytest.approx(h, rel=1e-8)
    return h, np.abs(again.u).max()


# Linear systems ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("u0", "method", "xi", "h"),
    [
        (1.0, eig3.CentralDifference(), 0.1, 0.7),
        (1.0, eig3.RK4(), 0.0, 1.0),
        (THREE, eig3.EIG3(), 0.1, 0.6),
        (THREE, CD, 0.0, 0.7),
        (THREE, eig3.CentralDifference(velocity="lagged"), 0.1, 0.7),
        (THREE, eig3.AB3(), 0.0, 0.3),
        (THREE, eig3.EIG(9), 0.0, 0.2),
        (THREE, eig3.RK8(), 0.0, 2.2),
        (THREE, eig3.BM6(), 0.0, 4.0),
    ],
    ids=lambda value: repr(value).partition(", jacobian")[0],
)
def test_a_linear_run_names_its_limit_and_a_stable_step(u0, method, xi, h):
    rhs, v0 = oscillator_vector if np.ndim(u0) else oscillator, np.zeros_like(u0)
    run = integrate(rhs, (0, 1e5 * h), u0, v0, h=h, params=(OMEGA, xi), method=method)
    assert run.status is eig3.Status.DIVERGED
    assert np.isfinite(run.u).all()
    assert run.explain().startswith(f"The run became non-finite at t = {run.t[-1] + run.h:g}")
    assert ("in degree of freedom" in run.explain()) == (np.ndim(u0) == 1)
    assert f", with h = {run.h:g}: the critical step of {method!r} is " in run.explain()
    named = said(r" is ([\d.]+) from t = 0 to ", run.explain())
    assert named == pytest.approx(limit(method, xi) / OMEGA, rel=1e-3)  # four digits are printed
    assert said(r"\(omega = ([\d.]+), xi", run.explain()) == pytest.approx(OMEGA, rel=1e-3)
    assert said(r", xi = ([\d.e+-]+)\)", run.explain()) == pytest.approx(xi, abs=1e-6)
    step, largest = tried_step_holds(run, rhs, u0, v0, (OMEGA, xi))
    # the step is rounded to three digits, and the limit to four
    assert step == pytest.approx(0.9 * min(named, run.h), rel=5.5e-3)
    # at 0.9 of the limit, an undamped motion grows at most to 1/sqrt(1 - 0.81) = 2.3, the size of CD's principal pair
    assert largest < 3 * np.max(u0)


def test_the_degree_of_freedom_that_fails_is_named():
    @eig3.jit
    def three(t, u, v, p, a):
        a[0] = a[2] = -u[0]
        a[1] = -p[0] * u[1]

    run = integrate(three, (0, 1e4), [1.0] * 3, [0.0] * 3, h=0.5, params=25.0)
    assert "in degree of freedom 1" in run.message
    assert "in degree of freedom 1, with h = 0.5" in run.explain()
    named = eig3.Problem("three", three, [1.0] * 3, [0.0] * 3, 25.0, (0, 1e4), names=("left", "middle", "right"))
    for solution in (named.integrate(h=0.5), named.ensemble(u0=np.ones((2, 3)), h=0.5)[1]):
        assert "in degree of freedom 1 (middle), with h = 0.5" in solution.message
    assert re.search(r"is 0\.4 from t = 0 to [\d.]+ \(omega = 5, xi = 0\)", run.explain())


def test_a_bar_beyond_its_limit():
    bar = problems.elastic_bar(100)
    exact = 2 / (2 * math.sqrt(bar.params[0]) * math.cos(math.pi / 202))
    for method in ("eig3", "cd"):
        run = bar.integrate(h=1.01 * exact, method=method, t_end=5000 * exact)
        assert run.status is eig3.Status.DIVERGED
        assert said(r" is ([\d.e-]+) from t = 0 to ", run.explain()) == pytest.approx(exact, rel=2e-3)
        tried_step_holds(run, bar.rhs, bar.u0, bar.v0, bar.params)


@pytest.mark.parametrize("method", ["rk2", "ab2"])
def test_a_method_without_a_stable_step_says_so(method):
    run = integrate(oscillator, (0, 1e4), 1.0, 0.0, h=0.5, params=(OMEGA, 0.0), method=method)
    assert run.status is eig3.Status.DIVERGED
    assert f"{run.method!r} is unstable at every step for this system, with a mode of omega = 3 and xi" in run.explain()
    assert run.explain().endswith("such as 'eig3', 'cd', 'rk4'.")  # and no step is called stable
    # the roots grow from one to the largest floating-point number
    radius = spectral_radius(method, OMEGA * run.h)
    assert run.n_steps == pytest.approx(math.log(sys.float_info.max) / math.log(radius), rel=0.01)


def test_eig3_on_a_gyroscope_is_sent_to_others():
    run = integrate(gyroscope, (0, 1e5), [0.0, 0.0], [1.0, 0.0], h=0.3, params=3.0)
    assert run.status is eig3.Status.DIVERGED
    assert "EIG3(alpha=1.0, beta=0.5) is unstable at every step" in run.explain()
    assert run.explain().endswith("such as 'eig5', 'cd', 'rk4'.")


def test_a_blow_up_by_weak_growth_is_named():
    """The step is below the one at which a root is -1, so that only the weak growth is left."""
    method, h = eig3.EIG(6), 0.9 / OMEGA
    span, given = (0, 30_000 * h), {"params": (OMEGA, 0.0), "method": method}
    run = integrate(oscillator_vector, span, [1.0], [0.0], h=h, **given)
    assert run.status is eig3.Status.DIVERGED
    text = run.explain()
    assert (
        f"{method!r} is unstable at every step for this system, with a mode of omega = 3 and xi = 0; it grows " in text
    )
    practical = practical_limit(method) / OMEGA
    assert said(r"weakly, by less than 1e-5 a step up to h = ([\d.]+) \(by ", text) == pytest.approx(
        practical, rel=1e-3
    )
    again = integrate(oscillator_vector, span, [1.0], [0.0], h=practical, **given)
    assert again.success
    # it grows by 1e-5 a step
    assert np.abs(again.u).max() == pytest.approx(math.exp(1e-5 * again.n_steps), rel=0.02)


def test_a_growth_that_is_negligible_ends_no_run():
    """The energy grows by twice the growth of the motion. The note has two digits."""
    Omega, method = 0.066, eig3.RK2()
    run = problems.single_dof().integrate(h=Omega / 4, method=method, save_every=None)
    expected = 2 * (spectral_radius(method, Omega) - 1) * run.n_steps
    assert math.log1p(noted_growth(run)) == pytest.approx(expected, rel=0.06)
    assert problems.single_dof().integrate(h=Omega / 400, method=method, save_every=None).notes == ()


# Systems that are not linear -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_hardening_names_the_critical_step_at_both_ends(method):
    """At the start omega^2 = 9 (1 + 3 u^2). It is larger after the motion has grown."""
    run = integrate(hardening, (0, 1e3), 3.0, 0.0, h=0.4, params=9.0, method=method)
    assert run.status is eig3.Status.DIVERGED
    record = run.method.without_velocity()
    omega = 3 * math.sqrt(1 + 3 * 9)
    assert said(r" is ([\d.e-]+) at t = 0", run.explain()) == pytest.approx(limit(record) / omega, rel=1e-3)
    assert said(r"at t = 0 \(omega = ([\d.]+), xi = 0\)", run.explain()) == pytest.approx(omega, rel=1e-3)
    end = re.search(r"and ([\d.e-]+) at t = [\d.]+ \(omega = ([\d.e+]+), xi = 0\)", run.explain())
    assert float(end[1]) * float(end[2]) == pytest.approx(limit(record), rel=2e-3)
    assert float(end[1]) < limit(record) / omega
    tried_step_holds(run, hardening, 3.0, 0.0, 9.0)


def test_a_run_that_grows_into_instability_holds_with_the_step_named():
    """The chain becomes stiffer when it is struck: a step that is stable at rest is too long for compressed springs."""
    chain = problems.hardening_chain(20, hardening=1e8)
    h = 0.95 * chain.critical_step().limit
    run = chain.integrate(h=h)
    assert run.status is eig3.Status.DIVERGED
    assert said(r" is ([\d.e-]+) at t = 0", run.explain()) > h
    step, _ = tried_step_holds(run, chain.rhs, chain.u0, chain.v0, chain.params)
    assert step < h


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_a_solution_that_is_unbounded_itself_is_reported_as_unbounded(method):
    """u'' = 6 u^2 from 1 and 2: u = 1 / (1 - t)^2 is infinite at t = 1."""
    exploding = eig3.jit(lambda t, u, v, p: 6 * u * u)
    run = integrate(exploding, (0, 10), 1.0, 2.0, h=1e-3, method=method)
    assert run.status is eig3.Status.DIVERGED
    assert run.t[-1] == pytest.approx(1, abs=0.05)
    assert "were tried and fail too: the solution itself may be unbounded." in run.explain()
    assert said(r"shorter steps down to h = ([\d.e-]+) were tried", run.explain()) < 1e-3 / 50
    assert "is stable up to then" not in run.explain()


@pytest.mark.parametrize("limited", [True, False])
def test_a_force_that_leaves_its_domain_does_not_hide_a_step_that_is_too_long(limited):
    hardening_to_infinity = eig3.jit(lambda t, u, v, p: -np.sinh(u))
    with_a_domain = eig3.jit(lambda t, u, v, p: -u - 0 * np.sqrt(1 - u * u))
    rhs = hardening_to_infinity if limited else with_a_domain
    run = integrate(rhs, (0, 1000), 1e-3, 0.0, h=2.04)
    assert re.search(r"rhs gives (-?inf|nan) at t = ", run.explain())
    assert said(r"is ([\d.]+) (?:at|from) t = 0", run.explain()) == pytest.approx(2, rel=1e-3)
    tried_step_holds(run, rhs, 1e-3, 0.0, ())


def test_a_system_that_becomes_stiffer_gets_the_step_for_its_end():
    stiffens = eig3.jit(lambda t, u, v, p: -u * (1 + 1e6 * (t > 50)))
    run = integrate(stiffens, (0, 1e4), 1.0, 0.0, h=1.0, save_every=None)
    assert said(r"is ([\d.]+) at t = 0 ", run.explain()) == pytest.approx(2, rel=1e-3)
    assert said(r"and ([\d.e-]+) at t = 5", run.explain()) == pytest.approx(0.002, rel=1e-2)
    assert said(r"h = ([\d.e-]+) was tried and is stable", run.explain()) <= 0.0018


def test_a_long_run_is_given_the_time_to_try():
    chain = problems.hardening_chain(2000, hardening=0.0, t_end=200.0)
    run = chain.integrate(h=0.0102, save_every=None, invariants={})
    assert run.status is eig3.Status.DIVERGED
    assert "was tried and is stable" in run.explain()


# Growth that is noted ------------------------------------------------------------------------------------------------


def noted_growth(run, name="energy"):
    """The growth in the note: the factor minus one."""
    assert run.success
    (note,) = run.notes
    assert note.startswith(f"{name} grows steadily, ")
    how = "slowly unstable" if "%" in note else "(slowly )?unstable"
    assert re.search(f"if the motion should keep it, {re.escape(repr(run.method))} is {how} here", note)
    percent = re.search(r"by ([\d.e+-]+) % over the run", note)
    return float(percent[1]) / 100 if percent else said(r"to ([\d.e+]+) times its size", note) - 1


@pytest.mark.parametrize(("h", "save_every"), [(0.004, None), (0.01, 1), (0.03, 50), (0.05, None)])
@pytest.mark.parametrize(("method", "rate"), [("rk2", 1 / 4), ("ab2", 1 / 2)])
def test_slow_growth_is_noted_with_its_size(method, rate, h, save_every):
    """Energy grows by (1 + Omega^4 / 4)^N with RK2 and, up to terms of order Omega^6, by its square with AB2.

    The note has two digits, and takes the growth between the middles of two parts of the run for a straight line, which
    an exponential leaves by up to 0.06 of its growth. If the energy more than doubles, the note compares the two ends.
    The next term of AB2's rate is 4.2 Omega^2 times the rate.
    """
    run = problems.single_dof().integrate(h=h, method=method, save_every=save_every)
    exponent = rate * (4 * h) ** 4 * run.n_steps
    if method == "rk2":
        assert abs(math.log1p((4 * h) ** 4 / 4) - 2 * math.log(spectral_radius("rk2", 4 * h))) < 1e-12
    growth = noted_growth(run)
    grown = math.log1p(growth)
    within = 0.03 + 5 * (4 * h) ** 2 * (method == "ab2") + math.tanh(exponent) * 0.06
    assert (1 - within) * exponent < grown < (1 + within) * exponent
    assert f"  Note: {run.notes[0]}" in repr(run)


def test_small_growth_is_noted_down_to_its_threshold():
    """RK2 adds N Omega^4/4 to the energy. A growth of 1e-6 or more gives a note."""
    for h, noted in ((0.0003, True), (0.0002, False)):
        growth = (4 * h) ** 4 / 4 * 1000 / h
        assert (growth > 1e-6) is noted
        assert bool(problems.single_dof().integrate(h=h, method="rk2", save_every=None).notes) is noted


speed_squared = eig3.jit(lambda t, u, v, p: v[0] * v[0] + v[1] * v[1])


def test_eig3_on_a_gyroscope_is_noted():
    """Its velocity is AB2's: |v| grows by kappa^4/4 a step."""
    run = integrate(gyroscope, (0, 1000), [0.0, 0.0], [1.0, 0.0], h=0.1, params=1.0, invariants={"v^2": speed_squared})
    expected = 2 * 0.1**4 / 4 * run.n_steps
    assert math.log1p(noted_growth(run, "v^2")) == pytest.approx(expected, rel=0.06)
    # the second-order start, and the next term
    assert np.hypot(*run.v[-1]) == pytest.approx(math.exp(expected / 2), rel=0.02)


def test_a_driven_gyroscope_that_grows_is_noted():
    """A rotor turns with its unbalance at the rate 2, and starts on this motion: with z = u_0 + i u_1, the force
    exp(2 i t) and the gyroscopic force -0.5 i z', |z| = 1 / |1 + 1 - 4|. No invariant shows that it must not grow."""
    damping = np.array([[1e-3, 0.5], [-0.5, 1e-3]])
    rotor = eig3.linear(
        [1.0, 1.0], damping, np.eye(2), force=unbalance, t_span=(0, 6000), u0=[-0.5, 0.0], v0=[0.0, -1.0]
    )
    fine, coarse = (rotor.integrate(h=h, save_every=None) for h in (0.04, 0.25))
    assert (fine.success, fine.notes) == (True, ())
    assert np.hypot(*fine.u[-1]) == pytest.approx(0.5, rel=0.08**2)  # of second order: (2 h)^2
    assert (coarse.success, np.hypot(*coarse.u[-1]) > 5) == (True, True)
    limit = rotor.critical_step().limit
    assert coarse.notes[0].startswith(f"h = 0.25 is longer than the critical step {limit:.4g} of EIG3")
    *_, note = rotor.ensemble(h=[0.04, 0.25, 0.25], save_every=None, executor=ThreadPoolExecutor(1)).notes
    assert note == f"{coarse.notes[0]} This is member 1 of the 2 members that have grown."


def test_a_linear_structure_that_grows_a_little_is_noted(tmp_path):
    """As above with the force in a table: at h = 0.25, the motion grows five times in 8000 steps."""
    t = np.linspace(0, 2000, 40001)
    damping, force = np.array([[1e-3, 0.5], [-0.5, 1e-3]]), (t, np.stack([np.cos(2 * t), np.sin(2 * t)], axis=1))
    start = {"t_span": (0, 2000), "u0": [-0.5, 0.0], "v0": [0.0, -1.0]}
    rotor = eig3.linear([1.0, 1.0], damping, np.eye(2), force=force, **start)
    fine, coarse = (rotor.integrate(h=h, save_every=None) for h in (0.15, 0.25))
    assert fine.notes == ()
    assert 1 < np.hypot(*coarse.u[-1]) < 5
    (note,) = coarse.notes
    assert note.startswith(f"h = 0.25 is longer than the critical step {rotor.critical_step().limit:.4g} of EIG3")
    from_rest = rotor.with_(u0=[0.0, 0.0], v0=[0.0, 0.0])
    assert [x.notes[:1] for x in (from_rest.integrate(h=0.15), from_rest.integrate(h=0.25))] == [(), (note,)]
    longer, steps = rotor.with_(t_span=(0, 5000)), {"h": [0.15, 0.25], "save_every": None}
    (of_members,) = longer.ensemble(**steps).notes
    assert of_members == f"{note} This is member 1 of the 1 members that have grown."
    assert longer.ensemble(**steps, save_to=tmp_path).notes == eig3.load(tmp_path).notes == (of_members,)
    assert longer.ensemble(**steps, reduce=lambda part: part.notes) == [(of_members,)]


def test_members_of_a_linear_structure_share_the_critical_step(monkeypatch):
    """All members grow from u = 0.1 or less to 1. To find the limit takes far longer than short runs, as in a fit."""
    seen = []
    monkeypatch.setattr("eig3.ensembles.step_notes.instability", lambda *given: seen.append(given) or "")
    free = eig3.linear([1.0, 1.0], None, np.eye(2), t_span=(0, 1.5), v0=1.0)
    for h, count in ((0.1, 0), (1.5 / 20_000, 1)):
        free.ensemble(u0=np.outer(np.linspace(0.01, 0.1, 8), np.ones(2)), h=h, save_every=None)
        assert len(seen) == count


@eig3.jit
def forwards(t, u, v, p):
    if v < 0:
        raise RuntimeError("v is negative")
    return 1.0 - 0.1 * v


def test_a_function_that_fails_beside_the_start_has_no_note():
    """The mass begins at rest. The error had ended a run, and an ensemble, that had completed."""
    assert integrate(forwards, (0, 300), 1.0, 0.0, h=0.01, save_every=None).notes == ()


@eig3.jit
def unbalance(t, u, v, p, out):
    out[0] += np.cos(2 * t)
    out[1] += np.sin(2 * t)


@pytest.mark.parametrize("method", ["rk2", "ab2"])
def test_growth_on_the_softening_spring_is_noted(method):
    run = problems.softening_spring().integrate(h=1e-3, method=method, save_every=None)
    finer = problems.softening_spring().integrate(h=5e-4, method=method, save_every=None)
    # of third order in h, as a rate of h^4 a step; the energy is 331, the growth is 1e-4 of it, printed with two digits
    assert noted_growth(run) / noted_growth(finer) == pytest.approx(8, rel=0.1)


# A force that reads the velocity, and high grades ---------------------------------------------------------------------


@pytest.mark.parametrize("grade", [5, 9])
def test_a_high_grade_with_a_force_that_reads_the_velocity_is_noted(grade):
    """With the limit of the closed form, 0.114 for grade 9; not with a force that ignores the velocity."""
    method = eig3.EIG(grade)
    run = integrate(oscillator_vector, (0, 1), THREE, [0.0] * 3, h=1e-3, params=(1.0, 0.1), method=method)
    assert run.success
    if grade > 7:
        (note,) = run.notes
        assert note.startswith(f"EIG-{grade} predicts the velocity from {grade - 2} accelerations: with damping")
        assert said(r"\(omega h = ([\d.]+) at xi = 0.1\)", note) == pytest.approx(limit(method, 0.1), rel=5e-3)
        assert note.endswith("; take RK8 or a grade of 5 to 7.")
    else:
        assert run.notes == ()
    assert integrate(harmonic_vector, (0, 1), [1.0], [0.0], h=1e-3, method=method).notes == ()


QUIET = {
    "single_dof": (problems.single_dof, [0.01, 0.1, 0.25], None),
    "hardening_spring": (problems.hardening_spring, [1e-4, 1e-3], None),
    "two_frequency_oscillator": (problems.two_frequency_oscillator, [2e-4, 1.7e-3], 50.0),
    "elastic_bar": (lambda: problems.elastic_bar(50), [2e-7, 1.6e-6, 3.3e-6], None),
}


@pytest.mark.parametrize("problem", QUIET)
@pytest.mark.parametrize("method", ["eig3", "cd", "rk4"])
def test_what_does_not_grow_is_not_noted(problem, method):
    build, steps, t_end = QUIET[problem]
    for h in steps:
        run = build().integrate(h=h, method=method, t_end=t_end, save_every=None)
        assert run.success
        assert run.notes == ()
        assert "Note" not in repr(run)


@pytest.mark.parametrize("method", ["eig3", "cd", "rk2", "ab2"])
def test_a_run_shorter_than_the_period_is_not_noted(method):
    """In a part of a period, the energy error rises with the motion."""
    period = 2 * math.pi / 4
    for part in (0.1, 0.24, 0.5, 0.74, 0.99):
        for v0 in (0.0, 3.0):
            run = problems.single_dof(v0=v0).integrate(h=1e-3, method=method, t_end=part * period)
            assert run.success
            assert run.notes == ()


def test_what_grows_by_itself_without_turning_back_is_not_noted():
    falling = eig3.jit(lambda t, u, v, p: -9.81)
    run = integrate(falling, (0, 10), 0.0, 0.0, h=0.01, invariants={"e": speed_squared_scalar})
    assert run.success
    assert run.notes == ()


speed_squared_scalar = eig3.jit(lambda t, u, v, p: v * v)


def test_only_the_invariant_that_grows_is_noted():
    one = eig3.jit(lambda t, u, v, p: 1.0)
    falls = eig3.jit(lambda t, u, v, p: -v * v - p[0] * p[0] * u * u)
    invariants = {"energy": problems.single_dof().energy, "one": one, "falls": falls}
    run = problems.single_dof().integrate(h=0.01, method="rk2", invariants=invariants)
    assert len(run.notes) == 1
    noted_growth(run)
    assert integrate(oscillator, (0, 1000), 1.0, 0.0, h=0.01, params=(4.0, 0.0), method="rk2").notes == ()


@pytest.mark.parametrize("options", [{"h": 0.01}, {"rtol": 1e-4}])
def test_an_invariant_that_starts_from_nothing_can_grow(options):
    """The invariant is zero in the first part of the run, so that its growth can only be compared with itself."""
    late = eig3.jit(lambda t, u, v, p: max(0.0, t - 48.0))
    run = problems.single_dof().integrate(invariants={"late": late}, **options)
    assert run.drift["late"] == pytest.approx(952)
    (note,) = run.notes
    assert note.startswith("late grows steadily, to 2 times its size over the run")


def forced_from_rest(damping):
    """A mass of 1 kg on a spring of 100 N/m, whose energy is zero at the start, with a force at resonance."""
    scene = Scene(dimension=1)
    wall, mass = scene.fixed((0.0,)), scene.mass(1.0, (1.0,))
    scene.add(LinearSpring(stiffness=100.0, rest_length=1.0), wall, mass)
    scene.add(HarmonicForce((10.0,), 10.0, -np.pi / 2), mass)
    if damping:
        scene.add(LinearDamper(damping=damping), wall, mass)
    return scene.problem((0.0, 60.0), work=True)


@pytest.mark.parametrize(
    ("damping", "method", "relative"), [(0.5, "rk4", 1e-5), (0.5, "rk2", 0.03), (0.0, "eig3", 0.01)]
)
@pytest.mark.parametrize("save_every", [1, None])
def test_a_small_part_of_the_work_is_no_growth(damping, method, relative, save_every):
    """The energy less the work is zero at the start, and the errors of the work add up: they are small beside it."""
    run = forced_from_rest(damping).integrate(h=0.005, method=method, save_every=save_every)
    assert 0 < run.drift["energy"] < relative * np.abs(run.z["work"]).max()
    assert run.notes == ()


def test_energy_that_a_method_adds_to_a_forced_motion_is_noted():
    """RK2 with omega h = 0.2 grows by Omega^4/8 in each step: its energy doubles in 1700 of the 3000 steps."""
    run = forced_from_rest(0.5).integrate(h=0.02, method="rk2")
    assert run.success
    (note,) = run.notes
    grown = said(
        r"energy minus the work grows steadily, by ([\d.e+]+) % of the larger of the two over the run: RK2\(\) ", note
    )
    assert grown == pytest.approx(100 * run.drift["energy"] / np.abs(run.z["work"]).max(), rel=0.1)
    first = forced_from_rest(0.5).integrate(h=0.02, method="rk2", t_end=30.0)
    assert first.extend(60.0).notes == run.notes


speed_and_position = eig3.jit(lambda t, u, v, p: v * v + 16 * u * u)


def test_an_invariant_that_overflows_is_noted_and_its_drift_infinite():
    """Negative damping makes u grow as exp(0.1 t) to some 1e191, whose square is not finite."""
    options = {"h": 0.1, "params": (4.0, -0.025), "method": "rk4", "invariants": {"energy": speed_and_position}}
    run = integrate(oscillator, (0, 4400), 1.0, 0.0, **options)
    assert run.success
    assert run.drift["energy"] == math.inf
    (note,) = run.notes
    assert note.startswith("energy grows steadily, beyond the largest floating-point number, over the run")


def test_an_invariant_that_is_not_a_number_is_not_noted():
    undefined = eig3.jit(lambda t, u, v, p: np.nan if t > 500 else v * v + 16 * u * u)
    run = problems.single_dof().integrate(h=0.01, method="rk2", invariants={"e": undefined})
    assert math.isnan(run.drift["e"])
    assert run.notes == ()


def test_a_run_that_fails_has_a_message_and_no_note():
    run = problems.single_dof().integrate(h=0.5, method="rk2")
    assert run.status is eig3.Status.DIVERGED
    assert run.notes == ()


def test_the_step_that_is_named_is_shorter_than_the_one_that_failed():
    """If a contact closes during the run, the critical step at the start is longer than the step that fails."""
    scene = Scene(1)
    balls = scene.mass(0.1, [-0.11, 0.0, 0.1, 0.2, 0.3], [1.0, 0.0, 0.0, 0.0, 0.0])
    scene.add(HertzContact(1e9, 0.1), balls[:-1], balls[1:])
    problem = scene.problem((0.0, 0.05))
    run = problem.integrate(h=1e-3)
    assert run.status is eig3.Status.DIVERGED
    assert eig3.critical_step(problem.rhs, problem.u0, problem.v0, params=problem.params).limit > 1e-2
    assert problem.critical_step().limit < 1e-3  # by the energy of the first ball
    assert said(r"; h = ([\d.e-]+) was tried and is stable", run.explain()) < 1e-3


pushed_from_rest = eig3.jit(lambda t, u, v, p: 1e-20 * math.exp(30 * t) - 1e4 * ((u + 10) - 10))


def test_a_small_motion_from_rest_that_a_force_makes_grow_is_stable():
    """The sum u + 10 rounds off the differences for the critical step, which are of 1e-19 at the end: the step of 0.01
    is half of the true critical step 2 / omega = 0.02."""
    run = eig3.integrate(pushed_from_rest, (0, 1), 0.0, 0.0, h=0.01)
    assert run.success
    particular = 1e-20 * math.exp(30) / (30**2 + 1e4)
    assert run.u[-1] == pytest.approx(particular, rel=0.02)  # of order (omega h)^2 / 24 = 4 %, in its response


def test_the_reason_does_not_depend_on_the_chunks_of_the_run():
    """The length of chunks depends on the speed of the machine, and on whether the time per step is known."""
    problem = problems.double_pendulum()
    runs = [problem.integrate(h=0.2, t_end=2000, method="eig3") for _ in range(3)]
    assert runs[0].status is eig3.Status.DIVERGED
    assert len({run.explain() for run in runs}) == 1
