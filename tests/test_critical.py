"""eig3.critical_step: against closed forms, and against runs on both sides of the limit that it finds."""

import math
import re
from functools import partial
from itertools import product

import numpy as np
import pytest
import threadpoolctl
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3 import NoCriticalStepError, critical_step, problems
from eig3.diagnosis.blas_threads import one_blas_thread
from eig3.diagnosis.critical import _sees_rates, longest_stable_step, of_linear
from eig3.diagnosis.linearisation import Linearised, linearise, linearise_at
from eig3.effects import (
    BoucWen,
    Coulomb,
    Gap,
    GiuffreMenegottoPinto,
    Gravity,
    HertzContact,
    LennardJones,
    LinearSpring,
    Maxwell,
    PlaneContact,
    SupportMotion,
)
from eig3.functions.guard import guarded
from eig3.kernels.methods import eig
from eig3.planning.pilots import PilotRun, Pilots
from eig3.planning.step_search import Search
from eig3.scene import Scene
from eig3.stability import alternating_limit, limit, practical_limit
from eig3.structures import Frame, Section

from .conftest import hardening, oscillator, oscillator_vector, structure

LAGGED = eig3.CentralDifference(velocity="lagged")
EVERY = ["eig3", "cd", LAGGED, "rk3", "rk4", "ab3"]
STEADY = {"eig3": 2.0, "cd": 2.0, "rk3": 3**0.5, "rk4": 8**0.5, "ab3": 12 / (5 * 11**0.5)}


@eig3.jit
def structure_jacobian(t, u, v, p, J):
    n = u.size
    for i in range(n):
        for j in range(n):
            J[i, j] = -p[n * n + i * n + j]


def name_of(method):
    return method if isinstance(method, str) else repr(method)


# One degree of freedom -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", EVERY, ids=name_of)
@pytest.mark.parametrize(("xi", "omega"), [(0.0, 1e-3), (0.02, 3e5), (0.3, 7.0), (1.0, 3e5), (4.0, 1e-3)])
def test_oscillator(method, xi, omega):
    """Differences over 1.5e-8 of u and omega u leave 1.5e-8 of round-off in k and in c / omega, and a limit goes with
    either times eight at most, as the two rates do at xi = 4. Where xi = 1 its square root parts the double rate."""
    expected = limit(method, xi)
    for v0 in (0.0, 0.5 * omega):
        found = critical_step(oscillator, 1.0, v0, (omega, xi), method=method)
        assert found.limit == pytest.approx(expected / omega, rel=3e-4 if xi == 1 else 1e-6)
    assert found.h == 0.9 * found.limit
    assert found.omega_max == pytest.approx(omega, rel=1e-6)
    assert found.xi == pytest.approx(xi, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(("method", "xi"), [("rk2", 0.1), ("ab2", 0.1), ("rk2", 1e-5), ("ab2", 1e-5), ("rk2", 3.0)])
def test_oscillator_that_only_damping_makes_stable(method, xi):
    """A growth of 1e-8 a step is round-off of differences, and hides some per cent of xi Omega = 4e-7 at xi = 1e-5."""
    found = critical_step(oscillator, 1.0, 0.5, (2.0, xi), method=method)
    assert found.limit == pytest.approx(limit(method, xi) / 2, rel=0.02 if xi < 1e-3 else 1e-6)


def test_a_slowly_unstable_set_of_eig3_has_a_step_with_damping():
    method = eig3.EIG3(0.9)
    assert critical_step(oscillator, 1.0, 0.0, (1.0, 3e-5), method=method).limit == pytest.approx(
        limit(method, 3e-5), rel=0.01
    )
    with pytest.raises(NoCriticalStepError, match="unstable at every step"):
        critical_step(oscillator, 1.0, 0.0, (1.0, 0.0), method=method)


@settings(deadline=None, max_examples=60)
@given(
    omega=st.floats(1e-12, 1e12),
    xi=st.sampled_from([0.0, 1e-3, 0.05, 0.7, 3.0, 10.0]),
    u0=st.sampled_from([0.0, 1.0, -1e-9, 1e9]),
    vector=st.booleans(),
    method=st.sampled_from(EVERY),
)
def test_limit_is_positive_and_scales_with_time(omega, xi, u0, vector, method):
    expected = limit(method, xi)
    state = ([u0, u0], [0.0, 1.0]) if vector else (u0, 0.0)
    arguments = (oscillator_vector if vector else oscillator, *state, (omega, xi))
    found = critical_step(*arguments, method=method)
    assert 0 < found.h < found.limit < math.inf
    # v = 1 in the vector form can be more than omega u, and c v then hides omega^2 u in round-off
    if not vector:
        assert found.limit == pytest.approx(expected / omega, rel=1e-5)
    assert all(math.isfinite(x) for x in (found.h, found.limit, found.omega_max))


def test_hardening_stiffens_with_the_state():
    """omega^2 = p (1 + 3 u^2) of the tangent."""
    for u0 in (0.0, 0.5, 2.0):
        found = critical_step(hardening, u0, 0.0, 9.0)
        assert found.omega_max == pytest.approx(3 * math.sqrt(1 + 3 * u0 * u0), rel=1e-6)
        assert found.limit == pytest.approx(2 / found.omega_max, rel=1e-6)


def test_rhs_gets_the_time_of_the_state():
    aging = eig3.jit(lambda t, u, v, p: -(1 + t) * u)
    assert critical_step(aging, 1.0, 0.0, t=3.0).omega_max == pytest.approx(2, rel=1e-6)
    with pytest.raises(ValueError, match="t must be a finite number"):
        critical_step(aging, 1.0, 0.0, t=math.nan)


# Bars and chains -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 64, 65, 100, 20_000])
def test_elastic_bar(n):
    """From 65 masses on, a Krylov space of 60 directions finds the highest frequency, in a long bar to 1e-3."""
    bar = problems.elastic_bar(n)
    highest = 2 * math.sqrt(bar.params[0]) * math.cos(math.pi / (2 * (n + 1)))
    for method in ("eig3", "cd", "rk4")[: 1 if n > 1000 else 3]:
        found = bar.critical_step(method=method)
        assert found.omega_max == pytest.approx(highest, rel=1e-3)
        assert found.limit == pytest.approx(STEADY[method] / highest, rel=1e-3)
        assert found.xi == 0
        if n > 64:  # two for each of 60 directions, and a few to find increments
            assert found.evaluations < 150


@pytest.mark.parametrize(("n", "xi"), [(100, 0.1), (1000, 1.0)])
def test_damped_bar(n, xi):
    """Its modes are the modes of the elastic bar, damped by xi omega / (2 sqrt(k))."""
    bar = problems.damped_bar(n, xi=xi)
    ratio = math.cos(math.pi / (2 * (n + 1)))
    highest = 2 * math.sqrt(bar.params[0]) * ratio
    for method in ("eig3", "cd", LAGGED):
        found = bar.critical_step(method=method)
        assert found.limit == pytest.approx(limit(method, xi * ratio) / highest, rel=2e-3)
        assert found.omega_max == pytest.approx(highest, rel=2e-3)
        assert found.xi == pytest.approx(xi * ratio, rel=2e-3)


# Systems with modes in common, and without ---------------------------------------------------------------------------


def system(kind, n):
    """K and C of a random system: frequencies from 1 to 10."""
    random = np.random.default_rng(n)
    Q = np.linalg.qr(random.normal(size=(n, n)))[0]
    K = Q @ np.diag(np.concatenate([[100.0], random.uniform(1, 90, n - 1)])) @ Q.T
    if kind == "undamped":
        return K, np.zeros((n, n))
    if kind == "modal":
        return K, 0.05 * np.eye(n) + 0.01 * K
    if kind == "local":
        C = np.zeros((n, n))
        C[0, 0] = 4.0
        return K, C
    B = random.normal(size=(n, n))
    return K, B @ B.T / n  # has no modes in common with K


def largest(method, K, C, h, n_steps):
    """The largest sqrt(v^2 + u K u) of a run from a random start, relative to its value at the start."""
    n = len(K)
    root = np.linalg.cholesky(K)
    random = np.random.default_rng(99)
    u0 = np.linalg.solve(root.T, random.normal(size=n))
    v0 = random.normal(size=n)
    params = np.concatenate([K.ravel(), C.ravel()])
    if method == "cd" and n > 3:  # without it Newton's method evaluates n times for each iteration
        method = eig3.CentralDifference(jacobian=structure_jacobian) if C.any() else "cd"
    record = method if isinstance(method, eig3.Method) else eig3.METHODS[method]()
    record = record if C.any() else record.without_velocity()
    stepper = eig3.Stepper(structure, u0, v0, h=h, params=params, method=record)
    u_rows, v_rows = np.empty((n_steps, n)), np.empty((n_steps, n))
    taken = stepper.advance(n_steps, 1, u_rows, v_rows)
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sqrt((v_rows[:taken] ** 2).sum(axis=1) + ((u_rows[:taken] @ root) ** 2).sum(axis=1))
    highest = np.nan_to_num(sizes, nan=np.inf).max(initial=0.0)
    return highest / math.sqrt(v0 @ v0 + u0 @ K @ u0) if taken == n_steps else math.inf


@pytest.mark.parametrize(
    ("method", "kind", "n"),
    [(method, "full", 20) for method in EVERY]
    + [("eig3", kind, 20) for kind in ("undamped", "modal", "local")]
    + [("cd", "undamped", 20), ("cd", "local", 20), ("rk4", "undamped", 20)]
    # projected: these have more than 64 degrees of freedom, or for an implicit method more than 36
    + [("eig3", "full", 80), ("eig3", "local", 80), ("rk4", "full", 80), ("cd", "full", 40), ("cd", "local", 80)],
    ids=str,
)
def test_runs_on_both_sides_of_the_limit(method, kind, n):
    """0.99 of the limit stays bounded, 1.01 grows without bound.

    In one undamped mode at 0.99 of the limit, central difference's positions grow to at most 1/sqrt(1 - 0.99^2) = 7.1
    times the start, and EIG-3's reported velocities to at most (1 + 2 * 0.99) times that. Runge-Kutta steps never grow,
    and the parasites of AB3 grow little. Damped systems without common modes can grow for a while, because their modes
    are not orthogonal. The factor 30 allows for twice this growth, and for an error of the limit of 0.2 per cent. Above
    the limit RK3 grows most slowly, by 1 - Omega^4/24 + Omega^6/72, which is 0.75 per cent per step and e^18 in 2500
    steps. Newton's method at 80 degrees of freedom takes 200 steps, in which an alternating mode grows by 20 per cent
    each.
    """
    K, C = system(kind, n)
    found = critical_step(structure, np.zeros(n), np.zeros(n), np.concatenate([K.ravel(), C.ravel()]), method=method)
    n_steps = 200 if method == "cd" and n == 80 and C.any() else 5000 if n < 80 else 2500
    assert largest(method, K, C, 0.99 * found.limit, n_steps) < 30
    assert not largest(method, K, C, 1.01 * found.limit, n_steps) < 1e6
    if kind == "undamped":
        expected = STEADY.get(name_of(method), 2.0) / 10
        assert found.limit == pytest.approx(expected, rel=1e-5)
        assert found.omega_max == pytest.approx(10, rel=1e-5)


@pytest.mark.parametrize("method", ["rk2", "ab2"])
def test_slowly_unstable_methods_on_both_sides(method):
    """Every mode has a damping ratio of 0.1 in a system damped in proportion to sqrt(K), so that the fastest limits."""
    n, random = 20, np.random.default_rng(20)
    Q = np.linalg.qr(random.normal(size=(n, n)))[0]
    omega = np.concatenate([[10.0], random.uniform(1, 9, n - 1)])
    K, C = Q @ np.diag(omega**2) @ Q.T, Q @ np.diag(0.2 * omega) @ Q.T
    found = critical_step(structure, np.zeros(n), np.zeros(n), np.concatenate([K.ravel(), C.ravel()]), method=method)
    assert found.limit == pytest.approx(limit(method, 0.1) / 10, rel=1e-5)
    # at 1.01 the growth is 0.01 Omega (Omega^3/2 - xi) > 0.0003 a step: e^15 = 3e6 in 50 000
    assert largest(method, K, C, 0.99 * found.limit, 50_000) < 30
    assert not largest(method, K, C, 1.01 * found.limit, 50_000) < 1e6


# Gyroscopic systems --------------------------------------------------------------------------------------------------


@eig3.jit
def spinning(t, u, v, p, a):
    """Springs p[0] and p[1] in a plane that turns at the rate p[2] / 2, without the centrifugal force.

    Nothing moves across the plane: two degrees of freedom have kernels of their own, which only take time to compile.
    """
    a[0] = -p[0] * u[0] - p[2] * v[1]
    a[1] = -p[1] * u[1] + p[2] * v[0]
    a[2] = 0.0


#: A plane that turns, without springs.
TURNING = (0.0, 0.0, 3.0)
START = [1.0, 0.3, 0.0], [0.2, 0.5, 0.0]


def farthest(params, method, h, n_steps):
    run = eig3.integrate(spinning, (0, n_steps * h), *START, h=h, params=params, method=method)
    return max(np.abs(run.u).max(), np.abs(run.v).max()) if run.success else math.inf


@pytest.mark.parametrize("method", ["rk3", "rk4", "ab3"])
@pytest.mark.parametrize(("params", "rate"), [(TURNING, 3.0), ((4.0, 4.0, 3.0), 4.0)])
def test_gyroscopic_systems_limit_methods_by_their_rates(method, params, rate):
    """s^2 -+ 3 i s + 4 = 0: rates of 4 and -1; and 3 without springs."""
    found = critical_step(spinning, *START, params, method=method)
    assert found.limit == pytest.approx(STEADY[method] / rate, rel=1e-5)
    assert found.omega_max == pytest.approx(rate, rel=1e-6)
    assert str(found.xi) == "0.0"
    # at 0.99 nothing grows; u may drift by v / rate, and the start of AB3 has an error
    assert farthest(params, method, 0.99 * found.limit, 20_000) < 10
    assert farthest(params, method, 1.01 * found.limit, 20_000) > 1e6


@pytest.mark.parametrize(("n", "seed"), [(4, 9), (8, 1), (10, 0)])
def test_round_off_of_differences_is_no_growth_of_gyroscopic_structures(n, seed):
    """All rates are imaginary, and RK4 is stable up to sqrt(8). Errors of 1e-5 in K and C had given them real parts."""
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(2, n, n))
    K, C = A @ A.T + np.eye(n), 3 * (B - B.T)
    u, v = random.normal(size=(2, n))
    found = critical_step(structure, u, v, np.concatenate([K.ravel(), C.ravel()]), method="rk4")
    rates = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]]))
    assert found.limit == pytest.approx(math.sqrt(8) / np.abs(rates).max(), rel=1e-6)


def test_gyroscopic_limit_of_central_difference():
    """2 cos phi - g sin phi = 2 - s has four real solutions while s < 2 + sqrt(4 + g^2), s = k h^2 and g = kappa h,
    that is h < sqrt(4 k + kappa^2) / k. K and C by differences and the search add up to far less than 1e-6."""
    random = np.random.default_rng(4)
    for k, kappa in ((4.0, 3.0), *zip(random.uniform(0.5, 20, 6), random.uniform(0.2, 10, 6), strict=True)):
        found = critical_step(spinning, *START, (k, k, kappa), method="cd")
        assert found.limit == pytest.approx(math.sqrt(4 * k + kappa * kappa) / k, rel=1e-6)
    found = critical_step(spinning, *START, (4.0, 4.0, 3.0), method="cd")
    assert farthest((4.0, 4.0, 3.0), "cd", 0.99 * found.limit, 5000) < 30
    assert farthest((4.0, 4.0, 3.0), "cd", 1.01 * found.limit, 5000) > 1e6
    with pytest.raises(NoCriticalStepError, match="nothing that oscillates or decays limits the step"):
        critical_step(spinning, *START, TURNING, method="cd")


@pytest.mark.parametrize(
    ("k1", "k2", "kappa"), [(1.8, 1.3, 0.8), (1.39, 1.49, -5.84), (12.77, 13.06, -4.65), (2.6, 3.0, 14.8)]
)
def test_gyroscopic_forces_do_not_hide_a_window_of_instability(k1, k2, kappa):
    """In what alternates from step to step v is zero: one mode is lost at h = 2 / sqrt(k) of the stiffer spring, and
    the two are stable together again once the other one is lost as well."""
    found = critical_step(spinning, *START, (k1, k2, kappa), method="cd")
    expected = 2 / math.sqrt(max(k1, k2))
    assert found.limit == pytest.approx(expected, rel=1e-6)
    assert farthest((k1, k2, kappa), "cd", 0.99 * found.limit, 5000) < 1000  # springs that all but cancel
    window = (expected + 2 / math.sqrt(min(k1, k2))) / 2
    assert farthest((k1, k2, kappa), "cd", window, 5000) > 1e6


def test_a_narrow_window_of_instability_is_seen():
    """Two stiffnesses that differ by 1e-4 leave a window of 5e-5 of the step, far below the ratio of the search."""
    k1, k2, kappa = 2.0, 2.0 * (1 + 1e-4), 1.0
    found = critical_step(spinning, *START, (k1, k2, kappa), method="cd")
    assert found.limit == pytest.approx(2 / math.sqrt(k2), rel=1e-6)


def test_fixed_point_iteration_limits_the_step_of_a_gyroscopic_pair():
    """An iteration leaves q = kappa h / 2 of the error, and 50 of them have to leave 1e-12: q = 1e-12^(1/50) = 0.575.

    From where the iteration starts makes a difference of some iterations, as q^2 to q^-2 does in 1e-12: 5 per cent.
    """
    method = eig3.CentralDifference(solver="fixed-point")
    found = critical_step(spinning, *START, (4.0, 4.0, 3.0), method=method)
    assert found.limit == pytest.approx(2 / 3 * 1e-12 ** (1 / 50), rel=0.05)
    assert found.omega_max == pytest.approx(4, rel=1e-6)  # of the mode in which the iteration is slowest
    for factor, status in ((0.95, eig3.Status.COMPLETED), (1.1, eig3.Status.NOT_CONVERGED)):
        h = factor * found.limit
        run = eig3.integrate(spinning, (0, 500 * h), *START, h=h, params=(4.0, 4.0, 3.0), method=method)
        assert run.status is status


@pytest.mark.parametrize("method", ["eig3", "rk2", "ab2", LAGGED], ids=name_of)
@pytest.mark.parametrize("params", [TURNING, (4.0, 4.0, 3.0)])
def test_gyroscopic_systems_have_no_step_with_methods_that_excite_them(method, params):
    with pytest.raises(NoCriticalStepError) as caught:
        critical_step(spinning, *START, params, method=method)
    message = str(caught.value)
    assert "is unstable at every step for this system" in message
    names = "'eig5', 'cd', 'rk4'" if params is TURNING else "'cd', 'rk4'"  # not 'eig3'; with springs EIG-5 grows too
    assert message.endswith(f"a method that has a stable step for it, such as {names}.")
    assert " and xi = 0;" in message
    # the growth is kappa^4 h^4 / 8 a step for RK2 and twice that for the others, at kappa h = 0.3 0.1 per cent
    assert farthest(params, method, 0.1, 40_000) > 1e6


@pytest.mark.parametrize(("n", "size"), [(2, 0.01), (5, 3.0), (20, 0.01)])
def test_weak_gyroscopic_forces_excite_lagged_central_difference(n, size):
    """It grows by half of kappa h per step, also where kappa is only a hundredth of the frequencies."""
    random = np.random.default_rng(n)
    Q = np.linalg.qr(random.normal(size=(n, n)))[0]
    B = random.normal(size=(n, n))
    params = np.concatenate([(Q @ np.diag(random.uniform(1, 10, n)) @ Q.T).ravel(), (size * (B - B.T)).ravel()])
    with pytest.raises(NoCriticalStepError, match="unstable at every step"):
        critical_step(structure, np.zeros(n), np.zeros(n), params, method=LAGGED)


# The EIG family, RK5, RK8 and BM6 -------------------------------------------------------------------------------------

FAMILY = [eig3.EIG(5), eig3.EIG(13), eig3.RK8()]


@pytest.mark.parametrize("method", FAMILY, ids=name_of)
def test_limits_of_the_family(method):
    """The damping ratio is found to 1e-8, and the limit of grade 13 goes as 1 / xi."""
    for xi in (0.0, 0.02, 0.3, 2.0):
        found = critical_step(oscillator, 1.0, 0.0, (7.0, xi), method=method)
        assert found.limit == pytest.approx(limit(method, xi) / 7, rel=1e-5 if xi else 1e-6)
        assert xi or found.omega_max == pytest.approx(7, rel=1e-6)


def test_the_undamped_limit_of_bm6():
    """Beyond it, BM6 is unstable only in a short interval."""
    found = critical_step(oscillator, 1.0, 0.0, (7.0, 0.0), method=eig3.BM6())
    assert found.limit == pytest.approx(limit(eig3.BM6().without_velocity()) / 7, rel=1e-6)


def test_a_weakly_growing_grade_names_its_rate_and_a_practical_step():
    method = eig3.EIG(6)
    with pytest.raises(NoCriticalStepError) as caught:
        critical_step(oscillator, 1.0, 0.0, (4.0, 0.0), method=method)
    found = re.search(
        r"by less than 1e-5 a step up to h = ([\d.]+) \(by (.*), where Omega = omega h\);", str(caught.value)
    )
    assert found[2] == "3 Omega^6/80"
    assert float(found[1]) == pytest.approx(practical_limit(method) / 4, rel=1e-3)  # four digits
    assert "EIG(grade=" in str(caught.value)
    assert str(caught.value).endswith(
        "take such a step for a short run, and for a long run a method that has a stable step for it, such as "
        "'eig3', 'cd', 'rk4'."
    )
    with pytest.raises(NoCriticalStepError, match=r"up to h = 0\.02364 \(by Omega\^4/8, where"):
        critical_step(oscillator, 1.0, 0.0, (4.0, 0.0), method="rk2")


def test_growth_within_round_off_does_not_count():
    """Grade 11 grows by less than 1e-8 a step up to where a root is -1, which grows fast."""
    found = critical_step(oscillator, 1.0, 0.0, (4.0, 0.0), method="eig11")
    assert found.limit == pytest.approx(alternating_limit(11, 0.0) / 4, rel=1e-6)


def test_a_run_of_the_family_on_both_sides_of_the_limit_of_coupled_modes():
    """1 % above the limit, a root passes -1 by 0.1 to 1 %: round-off, which is 1e-16 h^2 of the motion, grows by more
    than e^60 in 60 000 steps."""
    (K, C), method = system("full", 20), eig3.EIG(5)
    found = critical_step(structure, *np.zeros((2, 20)), np.concatenate([K.ravel(), C.ravel()]), method=method)
    assert largest(method, K, C, 0.99 * found.limit, 5000) < 30
    assert not largest(method, K, C, 1.01 * found.limit, 60_000) < 1e6


@pytest.mark.parametrize("method", ["eig3", "cd"])
def test_the_mode_that_limits_the_step_is_a_mode_of_the_system(method):
    """With damping and gyroscopic forces that couple the modes, omega and xi are of a rate of the system."""
    K = np.array([[3.0, 1.0, 0.0], [1.0, 9.0, -2.0], [0.0, -2.0, 20.0]])
    C = np.array([[0.2, 0.9, 0.1], [-0.7, 0.3, 1.1], [0.1, -0.9, 0.4]])
    found = critical_step(structure, *np.zeros((2, 3)), np.concatenate([K.ravel(), C.ravel()]), method=method)
    rates = np.linalg.eigvals(np.block([[np.zeros((3, 3)), np.eye(3)], [-K, -C]]))
    nearest = rates[np.argmin(np.abs(np.abs(rates) - found.omega_max))]
    assert found.omega_max == pytest.approx(abs(nearest), rel=1e-6)
    assert found.xi == pytest.approx(-nearest.real / abs(nearest), rel=1e-5)


def gyroscopic_radius(grade, k):
    """The largest root z of (1 - x)(1 - i k x K(1 - x)) = i k x S(1 - x), x = 1/z: EIG of v' = i k v with h = 1."""
    x = np.polynomial.Polynomial([0, 1])
    K, S = (
        sum(float(c) * (1 - x) ** j for j, c in enumerate(coefficients))
        for coefficients in (eig.kappa(grade - 2), eig.sigma(grade - 1))
    )
    return 1 / np.abs(((1 - x) * (1 - 1j * k * x * K) - 1j * k * x * S).roots()).min()


@pytest.mark.parametrize("grade", [5, 13])
def test_eig_of_a_gyroscope(grade):
    """Its growth in grade 7 is 2e-8 a step at the limit, which is within the round-off of coupled modes."""
    method = eig3.EIG(grade)
    found = critical_step(spinning, *START, TURNING, method=method)
    for part in (0.01, 0.3, 0.9, 0.9999):
        assert gyroscopic_radius(grade, 3 * found.limit * part) < 1 + 1e-7
    assert gyroscopic_radius(grade, 3 * found.limit * 1.0001) > 1 + 1e-6
    assert found.omega_max == pytest.approx(3, rel=1e-6)
    assert farthest(TURNING, method, 0.99 * found.limit, 5000) < 10
    assert farthest(TURNING, method, 1.01 * found.limit, 60_000) > 1e6


def test_only_runge_kutta_sees_rates():
    assert [method for method in FAMILY if _sees_rates(method)] == [eig3.RK8()]


def test_a_projected_step_has_the_limit_of_all_directions(monkeypatch):
    """EIG-9 carries 11 values for each degree of freedom: with room for 100, the step of 10 is projected on 9."""
    method, coupled = eig3.EIG(9), Linearised(*system("full", 10), 0)
    monkeypatch.setattr("eig3.diagnosis.critical._VALUES", 100)
    projected, _, _ = longest_stable_step(method, coupled)
    assert projected > 0
    monkeypatch.setattr("eig3.diagnosis.critical._VALUES", 10**4)
    assert projected == pytest.approx(longest_stable_step(method, coupled)[0], rel=2e-3)


def test_bm6_in_a_bar():
    """The stiffest mode of all is the first to reach the short interval of unstable steps at pi."""
    bar = problems.elastic_bar(30)
    highest = 2 * math.sqrt(bar.params[0]) * math.cos(math.pi / 62)
    found = bar.critical_step(method="bm6")
    assert found.limit == pytest.approx(limit("bm6") / highest, rel=1e-6)
    assert found.omega_max == pytest.approx(highest, rel=1e-6)
    with pytest.raises(ValueError, match=r"^BM6\(\) needs a rhs that ignores v and has no z0"):
        critical_step(spinning, *START, TURNING, method="bm6")


# Bodies --------------------------------------------------------------------------------------------------------------


def held_body(size=1.0, spin=0.0):
    """A body with the moments 0.3, 0.3 and 0.5, whose axis is held by springs at its ends, 0.5 from the centre."""
    scene = Scene(dimension=3)
    moments = size * size * np.array([0.3, 0.3, 0.5])
    body = scene.body(20.0, moments, (0, 0, 0), angular_velocity=(1e-3, 0, spin))
    for end, x, y in product((0.5, -0.5), (1, -1), (1, -1)):
        foot = scene.fixed((size * x, size * y, size * end))
        scene.add(LinearSpring(4.0, size * 2**0.5), body.point((0, 0, size * end)), foot)
    return scene.problem((0, 60))


def test_a_body_that_turns_between_springs():
    """A tilt by x moves both ends by x / 2 against a stiffness of 8, and turns a unit vector against a reaction of 0.25
    spin^2. Gyroscopic forces do not act on a motion that alternates from step to step.

    The limit is accurate to 1e-6, and at 1.02 of it a tilt grows by the factor exp(acosh(2 1.02^2 - 1)) = 1.5 a step.
    """
    for spin in (0.0, 0.1, 0.5):
        problem = held_body(spin=spin)
        found = problem.critical_step()
        assert found.limit == pytest.approx(2 / math.sqrt((4 + 0.25 * spin**2) / 0.3), rel=1e-5)
    with pytest.raises(NoCriticalStepError, match="such as 'rk4'"):  # 'cd' takes no constraints
        problem.critical_step(method="rk2")
    for part, is_stable in ((0.98, True), (1.02, False)):
        run = problem.integrate(h=part * found.limit, save_every=None)
        assert (run.success and run.drift["energy"] < 0.1) == is_stable


@pytest.mark.parametrize("build", [problems.spinning_top, problems.tumbling_box, problems.four_bar])
def test_a_step_that_loses_the_constraints_is_longer_than_the_critical_step(build):
    """Ten steps keep the constraints with the step to take and with the limit, and not with a step of 1.05 limits: the
    search is accurate to 2 %."""
    problem = build()
    for method in ("eig3", "rk4"):
        found = problem.critical_step(method=method)
        assert "no state was found that keeps the constraints" in found.holds
        for h, is_kept in ((found.h, True), (found.limit, True), (1.05 * found.limit, False)):
            run = problem.stepper(h=h, method=method)
            run.advance(10)
            assert run.is_finite == is_kept


# Where nothing oscillates --------------------------------------------------------------------------------------------

spring_and_drag = eig3.jit(lambda t, u, v, p: -p[0] * u - p[1] * v)


@pytest.mark.parametrize(
    ("method", "drag"), [*((method, 0.0) for method in (*EVERY, "rk2", "ab2")), ("cd", 5.0)], ids=str
)
def test_a_free_particle_has_every_step(method, drag):
    """Drag does not limit an implicit method."""
    with pytest.raises(NoCriticalStepError, match="limits the step"):
        critical_step(spring_and_drag, 1.0, 2.0, (0.0, drag), method=method)


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_a_force_without_a_linear_part_limits_no_step(method):
    """Derivatives of |v| v, u^3 and u^1.5 are 0 at this state, and a body at rest has reactions with squares of v."""
    body = Scene(dimension=2)
    body.body(1.0, 0.5, (0, 0))
    for limited in (
        partial(critical_step, eig3.jit(lambda t, u, v, p: -3.0 * abs(v) * v), 1.0, 0.0),
        partial(critical_step, eig3.jit(lambda t, u, v, p: -3.0 * u**3), 0.0, 0.0),
        partial(critical_step, eig3.jit(lambda t, u, v, p: -3.0 * max(u, 0.0) ** 1.5), 0.0, 0.0),
        body.problem((0, 1)).critical_step,
    ):
        with pytest.raises(NoCriticalStepError, match="limits the step"):
            limited(method=method)


@pytest.mark.parametrize(
    ("method", "interval"),
    [("eig3", 1), (LAGGED, 2), ("rk2", 2), ("rk3", 2.5127453266), ("rk4", 2.7852935634), ("ab2", 1), ("ab3", 6 / 11)],
)
def test_pure_drag(method, interval):
    """v' = -c v: the real interval of each method. EIG-3's velocity has AB2's interval, a lagged one has Euler's."""
    found = critical_step(spring_and_drag, 1.0, 2.0, (0.0, 5.0), method=method)
    assert found.limit == pytest.approx(interval / 5, rel=1e-6)
    assert (found.omega_max, found.xi) == (0.0, math.inf)
    runs = [
        eig3.Stepper(spring_and_drag, 1.0, 2.0, h=factor * found.limit, params=(0.0, 5.0), method=method)
        for factor in (0.99, 1.01)
    ]
    for run in runs:
        run.advance(5000)
    assert abs(runs[0].v) < 1e-6
    assert not abs(runs[1].v) < 1e6  # 1.01 of an interval grows by 0.3 per cent a step at least


def test_a_saddle_may_grow_by_itself():
    """u'' = 4 u: the growth exp(2 t) is physical; the decay exp(-2 t) limits the methods of first-order systems."""
    for method, interval in (("rk2", 2), ("rk4", 2.7852935634), ("ab2", 1)):
        assert critical_step(spring_and_drag, 1.0, 0.0, (-4.0, 0.0), method=method).limit == pytest.approx(
            interval / 2, rel=1e-6
        )
    for method in ("eig3", "cd", LAGGED):
        with pytest.raises(NoCriticalStepError, match="limits the step"):
            critical_step(spring_and_drag, 1.0, 0.0, (-4.0, 0.0), method=method)


@pytest.mark.parametrize("c", [1e-7, 1e-6, 7.2e-6, 1.2e-5, 1.4e-5, 1e-4])
def test_a_slow_growth_beside_a_spring_is_physical(c):
    """The spring limits the step; the other mode grows by itself, by c / 2 per unit of time."""
    system = Linearised(np.diag([5000.0, 1.0]), np.diag([0.0, -c]), 0)
    assert longest_stable_step(eig3.RK4(), system)[0] == pytest.approx(math.sqrt(8 / 5000), rel=1e-5)


def test_a_saddle_beside_a_spring():
    for method, expected in STEADY.items():
        found = critical_step(spinning, [1.0, 0.0, 0.0], [0.0] * 3, (-4.0, 9.0, 0.0), method=method)
        assert found.limit == pytest.approx(expected / 3, rel=1e-6)
        assert found.omega_max == pytest.approx(3, rel=1e-6)


# Hard to difference, or to span --------------------------------------------------------------------------------------


@pytest.mark.parametrize("c", [10.0, 51.0, 60.0, 1e3])
def test_a_strong_damper_does_not_hide_the_limit_of_central_difference(c):
    found = critical_step(spring_and_drag, 1.0, 0.0, (1.0, c), method="cd")
    assert found.limit == pytest.approx(2, rel=1e-5)
    assert found.xi == pytest.approx(c / 2, rel=1e-5)


@pytest.mark.parametrize("n", [20, 100])
def test_a_strong_damper_at_the_end_of_a_chain(n):
    """Central difference does not see it, and EIG-3's limit is 1/c."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    C = np.zeros((n, n))
    C[-1, -1] = 100.0
    params = np.concatenate([K.ravel(), C.ravel()])
    stiffest = 2 * math.cos(math.pi / (2 * (n + 1)))
    for method, expected in (("cd", 2 / stiffest), ("eig3", 0.01)):
        found = critical_step(structure, np.zeros(n), np.zeros(n), params, method=method)
        assert found.limit == pytest.approx(expected, rel=5e-3)  # 0.2 % from the search, and the effect of the spring


contact = eig3.jit(lambda t, u, v, p: p[0] * max(0.0, -u) - 9.81)


@eig3.jit
def contacts(t, u, v, p, a):
    for j in range(u.size):
        a[j] = p[0] * max(0.0, -u[j]) - u[j]


def test_the_stiffer_side_of_a_kink_counts():
    assert critical_step(contact, 0.0, 0.0, 1e6).limit == pytest.approx(2e-3, rel=1e-5)
    for n in (3, 64, 65, 200):
        assert critical_step(contacts, np.zeros(n), np.zeros(n), 1e6).limit == pytest.approx(2e-3, rel=1e-5)


@eig3.jit
def metres_and_radians(t, u, v, p, a):
    a[0] = -1e-6 * u[0]
    a[1] = -100 * np.sin(u[1])


small_wave = eig3.jit(lambda t, u, v, p: -p[0] * np.sin(u / p[0]))
heavy = eig3.jit(lambda t, u, v, p: p[0] - p[1] * u)


def test_increments_fit_the_system():
    """The error is 1 % of the sine's curvature, the difference that is allowed between two increments."""
    for far in (1.0, 1e4, 1e8, 1e10):
        found = critical_step(metres_and_radians, [far, 0.0], [0.0, 0.0])
        assert found.limit == pytest.approx(0.2, rel=5e-3)
    for length in (1e3, 1.0, 1e-6, 1e-9, 1e-12):
        assert critical_step(small_wave, 0.0, 0.0, length).limit == pytest.approx(2, rel=5e-3)
    for stiffness in (1.0, 30.0, 100.0, 1e6):
        assert critical_step(heavy, 0.0, 0.0, (9.81e9, stiffness)).limit == pytest.approx(2 / stiffness**0.5, rel=1e-3)


def test_round_off_of_a_large_system_is_no_growth():
    """Differences and the projection leave an error of 2e-7 of C in a mode without forces. The limit comes from the
    other mode, and a growth of 1e-8 counts as round-off."""
    system = Linearised(np.diag([1.0, 0.0]), np.diag([0.6, -2e-7]), 0, is_complete=False)
    for method in (eig3.EIG3(), LAGGED):
        assert longest_stable_step(method, system) == pytest.approx((limit(method, 0.3), 1.0, 0.3), rel=1e-7)


def beam(elements, inertia):
    """M^-1 K of Hermite elements in metres and radians, pinned: not symmetric, and its units differ."""
    L, EI, n = 0.1, 1e3, 2 * (elements + 1)
    element = np.array([[12, 6 * L, -12, 6 * L], [6 * L, 4 * L * L, -6 * L, 2 * L * L]])
    element = EI / L**3 * np.concatenate([element, [[-12, -6 * L, 12, -6 * L], [6 * L, 2 * L * L, -6 * L, 4 * L * L]]])
    K = np.zeros((n, n))
    for e in range(elements):
        K[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += element
    K /= np.tile([1.0, inertia], elements + 1)[:, None]
    free = np.delete(np.arange(n), [0, n - 2])
    return K[np.ix_(free, free)]


@pytest.mark.parametrize(("mass", "stiffness"), [(0.0, 0.0), (1e-4, 0.1)])
def test_a_beam_in_metres_and_radians(mass, stiffness):
    """Damping proportional to mass and to stiffness, by its ratios at the highest frequency."""
    K = beam(100, inertia=1e-3)
    highest = math.sqrt(np.linalg.eigvals(K).real.max())
    C = 2 * mass * highest * np.eye(len(K)) + 2 * stiffness / highest * K
    for method in (eig3.EIG3(), eig3.RK4(), LAGGED):
        found = of_linear(linearise(lambda t, u, v: -K @ u - C @ v, 0.0, np.zeros(len(K)), np.zeros(len(K))), method)
        assert found.limit == pytest.approx(limit(method, mass + stiffness) / highest, rel=5e-3)


def test_the_reported_mode_is_the_one_that_limits():
    """Central difference is limited by the stiff mode, not by the fast decay of the other."""
    K, C = np.diag([1.0, 100.0]), np.array([[30.0, 0.1], [0.1, 0.0]])
    found = of_linear(Linearised(K, C, 0), eig3.CentralDifference())
    assert found.limit == pytest.approx(0.2, rel=5e-3)
    assert found.omega_max == pytest.approx(10, rel=1e-3)
    assert found.xi < 1e-3


# What it costs -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["undamped", "modal", "full"])
@pytest.mark.parametrize("n", [1, 64, 65, 150])
def test_evaluations_are_those_made(kind, n):
    K, C = system(kind, n)
    calls = []

    def acceleration(t, u, v):
        calls.append(1)
        return -K @ u - C @ v

    # the search for the limit makes no further evaluations; large systems leave out the first two, which take long
    for method in (eig3.EIG3(), eig3.CentralDifference(), eig3.RK4())[0 if n <= 3 else 2 :]:
        calls.clear()
        found = of_linear(linearise(acceleration, 0.0, np.ones(n), np.zeros(n)), method)
        assert found.evaluations == len(calls)
        # A difference takes two. A small system needs a few to find an increment, one at that increment and one over a
        # longer one, in each direction of u and of v. A large one needs 60 for each of three Krylov spaces, twice for
        # the space of the combination, 60 to see whether C stays in the first space, and two for each of 90 directions.
        assert found.evaluations <= (1 + 40 * n if n <= 64 else 1 + 2 * (5 * 60 + 2 * 90) + 80)


def test_state_is_not_changed():
    u0, v0, params = np.ones(3), np.zeros(3), np.array([4.0, 5.0, 0.1])
    critical_step(spinning, u0, v0, params, method="rk4")
    assert (u0.tolist(), v0.tolist(), params.tolist()) == ([1, 1, 1], [0, 0, 0], [4, 5, 0.1])


def test_all_evaluations_share_a_copy_of_the_parameters(monkeypatch):
    """Copies took two thirds of the search in a scene of 5000 grains, whose parameters have the neighbour lists."""
    copies = []
    monkeypatch.setattr("eig3.stepping.march.guarded", lambda values: copies.append(1) or guarded(values))
    assert critical_step(spinning, np.ones(3), np.zeros(3), [4.0, 5.0, 0.1], method="rk4").evaluations > 10
    assert len(copies) == 1


# Problems, records and users' methods --------------------------------------------------------------------------------


def test_a_problem_has_the_critical_step_of_its_force():
    bar = problems.elastic_bar(10)
    found = bar.critical_step(method="cd", safety=0.8)
    assert found == bar.critical_step(method=eig3.CentralDifference(velocity="none"), safety=0.8)
    assert found.h == 0.8 * found.limit
    assert problems.damped_bar(10).critical_step(method="cd").limit > 0


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_record_with_a_jacobian_has_the_limit_of_central_difference(damping):
    K = np.array([[3.0, -1.0], [-1.0, 2.0]])
    params = np.concatenate([K.ravel(), damping * K.ravel()])
    with_jacobian = eig3.CentralDifference(jacobian=structure_jacobian)
    one, other = (
        critical_step(structure, [1.0, 0.5], [0.0, 0.3], params, method=method) for method in (with_jacobian, "cd")
    )
    assert one == other
    assert one.limit == pytest.approx(2 / math.sqrt(np.linalg.eigvalsh(K)[-1]), rel=1e-6)


@pytest.mark.parametrize("record", [eig3.EIG3(velocity="none"), eig3.CentralDifference(velocity="none")])
def test_a_record_without_velocity_refuses_a_force_that_reads_it(record):
    with pytest.raises(ValueError, match="velocity='none' needs a rhs that ignores v"):
        critical_step(oscillator, 1.0, 0.0, (2.0, 0.1), method=record)
    assert critical_step(oscillator, 1.0, 0.0, (2.0, 0.0), method=record).limit == pytest.approx(1, rel=1e-6)


def test_a_users_method(symplectic_euler):
    for xi in (0.0, 0.2, 1.0):
        found = critical_step(oscillator, 1.0, 0.0, (3.0, xi), method="symplectic-euler")
        assert found.limit == pytest.approx(2 * (math.sqrt(1 + xi * xi) - xi) / 3, rel=1e-6)
    K, C = system("full", 20)
    params = np.concatenate([K.ravel(), C.ravel()])
    found = critical_step(structure, np.zeros(20), np.zeros(20), params, method=symplectic_euler())
    assert largest(symplectic_euler(), K, C, 0.99 * found.limit, 5000) < 30
    assert not largest(symplectic_euler(), K, C, 1.01 * found.limit, 5000) < 1e6


# What is refused -----------------------------------------------------------------------------------------------------


def plain(t, u, v, p):
    return -u


lonely = eig3.jit(lambda t, u, v, p: 0.0 if u == 0 else np.nan)
undefined = eig3.jit(lambda t, u, v, p: np.nan)

GOOD = {"rhs": oscillator, "u0": 1.0, "v0": 0.0, "params": (2.0, 0.0)}


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        *(
            ({"safety": x}, ValueError, f"safety must be a number above 0 and up to 1, not {x!r}.")
            for x in (0, -0.5, 1.1, math.nan, True, "0.9")
        ),
        ({"u0": [1.0, 2.0]}, ValueError, "u0 and v0 must have the same shape, not (2,) and ()."),
        ({"u0": [1.0], "v0": [0.0]}, TypeError, "rhs has the scalar form"),
        ({"u0": np.nan}, ValueError, "u0 must be finite, but it holds nan."),
        ({"rhs": plain}, TypeError, "rhs must be compiled: decorate it with @eig3.jit or @numba.njit."),
        ({"rhs": oscillator_vector}, TypeError, "rhs has the vector form"),
        ({"method": "euler"}, ValueError, "method must be one of 'eig3', 'cd'"),
        ({"params": "k"}, TypeError, "params must be made of real numbers, not 'k'."),
        ({"rhs": undefined}, ValueError, "rhs gives nan for degree of freedom 0 at the start"),
        ({"rhs": lonely, "u0": 0.0}, ValueError, "rhs is not finite close to this state; give another state."),
    ],
)
def test_bad_input_gives_an_error_of_one_sentence(change, error, message):
    with pytest.raises(error) as caught:
        critical_step(**{**GOOD, **change})
    text = str(caught.value)
    assert message in text
    assert "\n" not in text
    assert text.endswith(".")


def test_no_critical_step_is_a_value_error():
    assert issubclass(NoCriticalStepError, ValueError)


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_an_equilibrium_of_large_forces_has_the_step_of_the_states_beside_it(method):
    """The sum of forces that cancel is round-off, which says nothing about the size of the forces."""
    car = problems.quarter_car()
    at_rest = car.critical_step(method=method).limit
    nearby = critical_step(car.rhs, car.u0 + 1e-3, car.v0, car.params, method=method).limit
    assert at_rest == pytest.approx(nearby, rel=1e-6)
    K = np.array([[198e3, -18e3], [-18e3, 18e3]]) / [[40.0], [300.0]]
    C = np.array([[1200.0, -1200.0], [-1200.0, 1200.0]]) / [[40.0], [300.0]]
    matrices = critical_step(structure, np.ones(2), np.ones(2), np.concatenate([K.ravel(), C.ravel()]), method=method)
    assert at_rest == pytest.approx(matrices.limit, rel=1e-6)


# The motion that follows ---------------------------------------------------------------------------------------------


def atoms(distance, speed=0.0):
    """Two atoms of 1 kg with the units of the force between them, which approach each other at twice the speed."""
    scene = Scene(dimension=3)
    pair = scene.mass(1.0, [[0.0, 0.0, 0.0], [distance, 0.0, 0.0]], [[speed, 0.0, 0.0], [-speed, 0.0, 0.0]])
    scene.add(LennardJones(1.0, 1.0, cutoff=2.5), pair)
    return scene.problem((0.0, 10.0))


def of_atoms(r):
    """The critical step of EIG-3 and central difference at a distance, at which the shifted force matters little."""
    return 2 / math.sqrt(2 * 24 * (26 / r**14 - 7 / r**8))


@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_two_atoms_have_the_step_of_their_closest_approach(speed):
    """Its energy is that of the two at the start, with that of the fall from the reach: 4 (s^12 - s^6) = speed^2."""
    problem = atoms(1.5, speed)
    s6 = (1 + math.sqrt(1 + speed**2)) / 2
    for method in ("eig3", "cd"):
        found = problem.critical_step(method=method)
        assert found.limit == pytest.approx(of_atoms(s6 ** (-1 / 6)), rel=0.05)
        assert found.h == 0.9 * found.limit
        assert found.holds.startswith("in the motion, by an estimate")
        run = problem.integrate(h=found.h, method=method)
        assert np.abs(run.v[-1]).max() < 2 + speed
    alone = critical_step(problem.rhs, problem.u0, problem.v0, problem.params, method="rk4", t=0.0)
    assert alone.holds.startswith("at this state")
    assert problem.integrate(h=2.2 * found.limit).drift["energy"] > 10


def test_what_is_pressed_at_the_start_counts():
    found = atoms(0.3).critical_step()
    assert found.limit == pytest.approx(of_atoms(0.3), rel=0.05)


def test_argon_has_the_step_of_its_collisions():
    """At the lattice the limit is 5e-13 s, a quarter of which diverges."""
    argon = problems.argon(4)
    found = argon.critical_step()
    at_start = critical_step(argon.rhs, argon.u0, argon.v0, argon.params)
    assert argon.h < found.h < 0.1 * at_start.h
    assert argon.integrate(h=found.h, t_end=1e-12, save_every=None).drift["energy"] < 0.01 * abs(
        argon.energy_of(argon.u0, argon.v0)
    )
    assert not argon.integrate(h=at_start.h / 4, t_end=4e-12, save_every=None).success


def test_grains_have_the_step_of_their_hardest_contact():
    """Two spheres of 1 kg with Hertz's contact: m v^2 = 2/5 k d^(5/2), and a stiffness of 3/2 k sqrt(d)."""
    scene = Scene(dimension=2)
    scene.add(
        HertzContact(stiffness=1e6, contact_distance=0.1),
        scene.mass(1.0, [[0.0, 0.0], [1.0, 0.0]], [[1.0, 0], [-1.0, 0]]),
    )
    depth = (2.5 / 1e6) ** 0.4
    found = scene.problem((0.0, 2.0)).critical_step(method="cd")
    assert found.limit == pytest.approx(2 / math.sqrt(2 * 1.5e6 * math.sqrt(depth)), rel=0.02)


def test_a_plane_counts_with_the_speed_of_a_fall():
    """Over the span of 1 s, gravity can give a mass of 2 kg 9.81 m/s: 2/5 k d^(5/2) = 9.81^2."""
    scene = Scene(dimension=2)
    ball = scene.mass(2.0, (0.0, 1.0))
    scene.add(PlaneContact(1e6, (0, 1)), ball)
    scene.add(Gravity((0, -9.81)))
    depth = (2.5 * 9.81**2 / 1e6) ** 0.4
    found = scene.problem((0.0, 1.0)).critical_step()
    assert found.limit == pytest.approx(2 / math.sqrt(1.5e6 * math.sqrt(depth) / 2), rel=0.02)


def test_a_wall_that_moves_counts_with_the_speed_of_a_bounce():
    """A ball that the wall strikes at 3 m/s flies away at 6 m/s, and may strike another one."""

    def struck(wall, speed):
        scene = Scene(dimension=1)
        floor, ball = scene.fixed(0.0), scene.mass(2.0, [1.0], speed)
        scene.add(HertzContact(1e6, 0.1), ball, others=floor)
        scene.add(SupportMotion(eig3.jit(lambda t: (t, 1.0)), (wall,)), floor)
        return scene.problem((0.0, 1.0)).critical_step().limit

    assert struck(3.0, -1.0) < struck(3.0, 0.0) == struck(0.0, -6.0)


def test_grains_have_springs_along_their_surfaces():
    hopper = problems.hopper(800)  # of which `test_grains` compiles the code
    assert 2e-5 < hopper.critical_step().h < 1e-4
    k, c = hopper.ahead(0.0)
    assert math.sqrt(max(k) / k[0]) == pytest.approx(1.57, rel=0.1)  # 0.82 times the stiffness, and 3 times 1 / mass
    assert (c > 0).all()


def test_what_nothing_keeps_apart_has_the_step_of_the_start():
    scene = Scene(dimension=1)
    scene.add(Coulomb(-1.0, cutoff=10.0), scene.mass(1.0, [0.0]), scene.mass(1.0, [1.0]))
    problem = scene.problem((0.0, 1.0))
    assert problem.ahead(0.0) is None
    with pytest.raises(NoCriticalStepError, match="limits the step"):
        problem.critical_step()


def test_a_plan_from_a_part_of_the_span_keeps_the_step_of_the_encounters():
    problem = atoms(1.5, 3.0)
    pilots = Pilots(problem, "energy", 1e-2)
    pilots.look_at(0.25)
    search = Search(pilots, eig3.EIG3())
    search.add(PilotRun(20, 1e-4))
    assert search.steps == math.ceil(10 / problem.critical_step().h)


def test_states_of_links_do_not_matter():
    """The states change at events only, and a link that has not yielded is a spring; the rest is round-off."""

    def chain(law, n, stretched=1.0):
        scene = Scene(1)
        masses = scene.mass(1.0, stretched * np.arange(1.0, n + 1))
        scene.add(law, scene.fixed(0.0), masses[0])
        scene.add(law, masses[:-1], masses[1:])
        return scene.problem((0, 1))

    steel = GiuffreMenegottoPinto(50.0, 3.0, 0.1, rest_length=1.0)
    in_krylov_spaces = chain(steel, 20).critical_step().h
    assert in_krylov_spaces == pytest.approx(chain(LinearSpring(50.0, 1.0), 20).critical_step().h, rel=1e-8)
    yielding = chain(steel, 1, stretched=1.1).with_(events={})
    stepper = yielding.stepper(h=1.0)
    ends = [stepper.acceleration(0.0, np.eye(7)[0] * x, np.zeros(7))[0] for x in (1.1 - 1e-6, 1.1 + 1e-6)]
    omega = math.sqrt((ends[0] - ends[1]) / 2e-6)
    assert yielding.critical_step().limit == pytest.approx(2 / omega, rel=1e-6)


@pytest.mark.parametrize(("length", "time"), [(1e-9, 1e-12), (1e9, 1e5)])
def test_the_units_do_not_matter(length, time):
    """A link with a state that is a length, in units of atoms and of planets. Differences have a round-off of 1e-6."""

    def step(length, time):
        scene = Scene(1)
        stiffness = 50.0 / time**2
        link = Maxwell(stiffness, 2.0 * stiffness * time)
        scene.add(link, scene.fixed(0.0), scene.mass(1.0, 1.1 * length, velocity=1.5 * length / time))
        return scene.problem((0, time)).critical_step().h / time

    assert step(length, time) == pytest.approx(step(1.0, 1.0), rel=1e-6)


@pytest.mark.parametrize("storeys", [1, 12])
@pytest.mark.parametrize(("length", "part"), [(1e-9, 1e-10), (1.0, 1e-10), (1e9, 0.0), (1e9, 1e-10)])
def test_a_frame_has_its_step_in_all_units_and_at_small_displacements(storeys, length, part):
    """Displacements of a small part of the lengths hardly stiffen a frame. Differences have a round-off of 1e-6. Large
    frames have angles and lengths in one projection."""

    def columns(length, corotational):
        frame = Frame()
        section = Section(E=2e11 / length, A=1e-2 * length**2, I=1e-4 * length**4, density=8e3 / length**3)
        for level, line in product(range(storeys + 1), range(2)):
            frame.node(f"{level} {line}", 3 * line * length, 3 * level * length)
            if level:
                frame.mass(f"{level} {line}", 1e4)
                frame.member(f"{level - 1} {line}", f"{level} {line}", section)
            else:
                frame.support(f"{level} {line}", "ux uy rz")
            if level and line:
                frame.member(f"{level} 0", f"{level} 1", section)
        return frame.problem((0, 1), corotational=corotational)

    expected = columns(1.0, False).critical_step(method="cd").limit
    moved = columns(length, True)
    units = np.where([".r" in name for name in moved.labels.names], 1.0, length)
    shape = np.random.default_rng(0).standard_normal(len(units))
    found = moved.with_(u0=part * units * shape).critical_step(method="cd")
    assert found.limit == pytest.approx(expected, rel=1e-6)
    assert columns(length, False).critical_step(method="cd").limit == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_the_work_does_not_matter_in_units_of_planets(method):
    """Nothing depends on the work, whose rate in J/s is far above the other rates."""
    found = []
    for length, time, mass in ((1.0, 1.0, 1.0), (1e9, 1e5, 1e21)):
        links = [(Gap(500.0 * mass / time**2, 0.1 * length), None, 0)]
        given = {"t_span": (0, time), "u0": [0.2 * length], "v0": [0.5 * length / time], "work": True}
        problem = eig3.linear([mass], [[0.3 * mass / time]], None, links=links, **given)
        found.append(critical_step(problem.rhs, *problem.start, problem.params, method=method).limit / time)
    assert found[1] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.parametrize(("length", "time"), [(1e-6, 1e-6), (1e-9, 1e-12), (1e9, 1e5)])
def test_a_state_at_zero_has_another_unit_than_velocities(length, time):
    """A hysteretic stretch, whose yield is far below any velocity. Its differences see some of the yield: to 1e-4."""

    def step(length, time):
        law = BoucWen(40.0 / time**2, 0.05 * length, 0.1, 2.0)
        given = {"t_span": (0, time), "u0": [0.02 * length], "v0": [0.5 * length / time]}
        problem = eig3.linear([1.0], [[0.3 / time]], None, links=[(law, None, 0)], **given)
        return problem.critical_step(method="rk4").h / time

    assert step(length, time) == pytest.approx(step(1.0, 1.0), rel=1e-3)


@pytest.mark.parametrize("build", [problems.four_bar, problems.double_wishbone, partial(problems.hopper, 800)])
def test_what_grows_by_errors_of_differences_limits_no_step(build):
    """A mechanism and free grains have motions without stiffness, whose rates are 1e-6 or less in place of 0."""
    start = build().stepper(h=1.0, method="rk4")
    step = of_linear(linearise_at(start, eig3.RK4()), eig3.RK4())
    assert step.limit == pytest.approx(limit(eig3.RK4(), step.xi) / step.omega_max, rel=1e-3)


def test_matrices_are_computed_in_one_thread():
    """Beside a busy process, two threads of BLAS took 20 to 80 s in place of 6 s for 15,000 degrees of freedom."""

    def threads(*_):
        of_blas = (library for library in threadpoolctl.threadpool_info() if library["user_api"] == "blas")
        return min((library["num_threads"] for library in of_blas), default=1)

    seen = []
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        before = threads()
        of_linear(linearise(lambda t, u, v: seen.append(threads()) or -u, 0.0, np.ones(2), np.zeros(2)), eig3.EIG3())
        one_blas_thread.__enter__()
        one_blas_thread.__enter__()  # in another thread
        one_blas_thread.__exit__()
        assert threads() == 1
        one_blas_thread.__exit__()
        assert threads() == before
    assert set(seen) == {1}
