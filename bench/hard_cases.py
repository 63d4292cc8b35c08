"""The hard cases: difficult runs, each with the result that theory or an independent solution predicts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import eig3
from eig3 import problems
from eig3.kernels.methods import bm6, rk8
from eig3.methods import EIG, METHODS, Method
from eig3.problem import Problem
from eig3.problems.bouncing_ball import impact_times
from eig3.problems.hertz_impact import contact_time
from eig3.problems.single_dof import particular
from eig3.stability import limit, spectral_radius

from .article import TABLES
from .characteristic import gyroscope_growth
from .choices import ARTICLE_METHODS
from .hardening_orbit import AMPLITUDE, S1, S2, eig_power, energy_after, harmonics, one_step_power

_ROWS = 2**18  # states in a chunk
_FORCED = 96.0  # duration of a run with a force of frequency 1: a multiple of its steps
_DECAYED = 1e-100  # size below which no round-off is left that could grow; subnormal numbers take 100 times longer


@dataclass(frozen=True)
class Finding:
    """One number from one run, and its expected value or bound."""

    what: str
    expected: str
    measured: str
    passed: bool


@dataclass(frozen=True)
class HardCase:
    """A hard case: ``check(method)`` yields the findings of one of its methods."""

    title: str
    methods: tuple[str, ...]
    check: Callable[[Method], Iterator[Finding]]

    def findings(self, method: str) -> list[Finding]:
        lagged = eig3.CentralDifference(velocity="lagged")
        return list(self.check(lagged if method == "cd lagged" else METHODS[method]()))


#: The cases by number.
HARD_CASES: dict[int, HardCase] = {}


def case(number: int, title: str, *methods: str) -> Callable:
    """Register a check under a number, for these methods or for the methods of the article."""

    def register(check: Callable) -> Callable:
        HARD_CASES[number] = HardCase(title, methods or ARTICLE_METHODS, check)
        return check

    return register


# Expected values ------------------------------------------------------------------------------------------------------


def near(what: str, expected: float, measured: float, *, rel: float = 0.0, tolerance: float = 0.0) -> Finding:
    tolerance = max(tolerance, rel * abs(expected))
    passed = abs(measured - expected) <= tolerance
    return Finding(what, f"{expected:.8g} +- {tolerance:.1g}", f"{measured:.8g}", passed)


def within(what: str, expected: float, measured: float, factor: float) -> Finding:
    passed = expected / factor <= measured <= expected * factor
    return Finding(what, f"{expected:.3g}, to a factor {factor:g}", f"{measured:.3g}", passed)


def at_most(what: str, bound: float, measured: float) -> Finding:
    return Finding(what, f"<= {bound:.4g}", f"{measured:.4g}", measured <= bound)


def ended(expected: eig3.Status, solution: eig3.Solution) -> Finding:
    return Finding("how the run ends", expected.value, solution.status.value, solution.status is expected)


# Runs -----------------------------------------------------------------------------------------------------------------


def _of(problem: Problem, method: Method) -> Method:
    """The form of the method for this problem: without velocity if f does not depend on it."""
    return method if problem.uses_velocity else method.without_velocity()


def march(problem: Problem, h: float, n_steps: int, method: Method) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """u and v after every step, in chunks, up to the last step or a state that is not finite."""
    stepper = problem.stepper(h=h, method=_of(problem, method))
    rows = max(1, _ROWS // np.size(problem.u0))
    u, v = (np.empty((rows, *np.shape(problem.u0))) for _ in range(2))
    while stepper.index < n_steps and stepper.is_finite:
        taken = stepper.advance(min(rows, n_steps - stepper.index), 1, u, v)
        yield u[:taken], v[:taken]
        if taken < len(u) and stepper.index < n_steps:
            return  # a solve failed


def largest(problem: Problem, h: float, n_steps: int, method: Method) -> float:
    """max abs u over every step, up to the last or to one where a stable motion has decayed to `_DECAYED`."""
    found = 0.0
    for u, v in march(problem, h, n_steps, method):
        found = float(np.maximum(found, np.abs(u).max()))  # keeps a NaN
        if np.abs(u[-1]).max() < _DECAYED and np.abs(v[-1]).max() < _DECAYED:
            break
    return found


def steps_until(problem: Problem, h: float, bound: float, most: int, method: Method) -> float:
    """The number of steps until |u| exceeds a bound; infinity if it does not within `most` steps."""
    before = 0
    for u, _ in march(problem, h, most, method):
        with np.errstate(invalid="ignore"):
            beyond = np.flatnonzero(~(np.abs(u) <= bound).reshape(len(u), -1).all(axis=1))
        if beyond.size:
            return before + int(beyond[0]) + 1
        before += len(u)
    return math.inf


# The cases ------------------------------------------------------------------------------------------------------------


@case(1, "just below the limit", "eig3", "cd", "rk3", "rk4")
def below_the_limit(method: Method) -> Iterator[Finding]:
    """Ten million steps: EIG-3 and CD have |z| = 1; Runge-Kutta methods reduce the norm of (omega u, v) each step."""
    Omega = 1.999 / 2 * limit(method)
    displaced = problems.single_dof(omega=Omega)
    struck = problems.single_dof(omega=Omega, u0=0.0, v0=1.0)
    found = largest(displaced, 1.0, 10**7, method), largest(struck, 1.0, 10**7, method)
    if method.name in ("eig3", "cd"):
        yield near("max abs u from u0 = 1", 1.0, found[0], rel=1e-9)
        yield near("max abs u from h v0 = 1", 1 / (Omega * math.sqrt(1 - Omega**2 / 4)), found[1], rel=1e-9)
    else:
        yield at_most("max abs u from u0 = 1", 1 + 1e-9, found[0])
        yield at_most("max abs u from h v0 = 1", (1 + 1e-9) / Omega, found[1])


@case(2, "just above the limit", "eig3", "cd", "rk3", "rk4", "ab3")
def above_the_limit(method: Method) -> Iterator[Finding]:
    if method.name in ("eig3", "cd"):
        for Omega, expected in ((2.001, 7293), (2.0001, 23061)):
            steps = steps_until(problems.single_dof(omega=Omega), 1.0, 1e200, 10**5, method)
            yield near(f"steps to 1e200, Omega = {Omega}", expected, steps, tolerance=2)
        struck = problems.single_dof(omega=2.0, u0=0.0, v0=1.0)
        ratio = largest(struck, 1.0, 20_000, method) / largest(struck, 1.0, 10_000, method)
        yield near("max abs u in 20 000 steps / in 10 000, Omega = 2", 2.0, ratio, rel=1e-9)
    else:
        Omega = 1.001 * limit(method)
        steps = steps_until(problems.single_dof(omega=Omega), 1.0, 1e200, 10**6, method)
        # the growing root holds 0.1 to 10 times the start: this changes ln 1e200 by less than 1 %
        expected = round(math.log(1e200) / math.log(spectral_radius(method, Omega)))
        yield near("steps to 1e200, Omega = 1.001 of the limit", expected, steps, rel=0.02)


@case(3, "two frequencies", "eig3", "cd", "rk4")
def two_frequencies(method: Method) -> Iterator[Finding]:
    problem, h = problems.two_frequency_oscillator(), 0.0019
    solution = problem.integrate(h=h, method=method.name, invariants={})
    error = float(np.abs(solution.u[:, 0] - np.cos(solution.t)).max())
    fast = float(np.abs(solution.u[:, 1]).max())
    if method.name == "rk4":
        yield within("error of the slow mode: h^4 T/120", h**4 * 1000 / 120, error, 1.1)
        yield at_most("max abs u of the fast mode", 1.0, fast)
    else:
        yield near("error of the slow mode: h^2 T/24", 1.5e-4, error, rel=0.02)
        yield at_most("max abs u of the fast mode: 1/sqrt(1 - s/4)", 1 / math.sqrt(1 - (1000 * h) ** 2 / 4), fast)


@case(4, "damped, either side", "eig3", "cd", "cd lagged", "rk2", "rk3", "rk4", "ab2", "ab3")
def damped_limit(method: Method) -> Iterator[Finding]:
    """At xi = 1 Runge-Kutta and Adams methods have a double root z: n z^n then rises to 1/(e (1 - |z|))."""
    ours = method.name == "eig3"
    highest, excess, most = (5.3, 1.001, 200_000) if ours else (400.0, 1.02, 10**6)
    for xi in (0.01, 0.1, 0.5, 1.0, 5.0):
        bound = limit(method, xi)
        starts = [{"u0": 1.0, "v0": 0.0}, {"u0": 0.0, "v0": 1.0}]
        below = [problems.single_dof(omega=0.999 * bound, xi=xi, **start) for start in starts]
        found = max(largest(problem, 1.0, 10**6, method) for problem in below)
        yield at_most(f"max abs u at 0.999 of the limit, xi = {xi}", highest, found)
        above = problems.single_dof(omega=excess * bound, xi=xi)
        steps = steps_until(above, 1.0, 1e90, most, method)
        yield at_most(f"steps to 1e90 at {excess} of the limit, xi = {xi}", most, steps)


@case(5, "resonance", "eig3", "cd", "rk2", "rk4")
def resonance(method: Method) -> Iterator[Finding]:
    """A relative period error e shifts the phase by e t/2 at an amplitude of t/2: the error at the end is e T^2/4."""
    T, h = 200.0, 0.01
    problem = problems.single_dof(omega=1.0, force=1.0, force_omega=1.0, u0=0.0, t_end=T)
    solution = problem.integrate(h=h, method=method.name)
    error = float(np.abs(solution.u - solution.t * np.sin(solution.t) / 2).max())
    period_error = {"eig3": h**2 / 24, "cd": h**2 / 24, "rk2": h**2 / 6, "rk4": h**4 / 120}[method.name]
    yield near("max error", 4.09e-2 if method.name == "eig3" else period_error * T**2 / 4, error, rel=0.05)


@case(6, "chaos")
def chaos(method: Method) -> Iterator[Finding]:
    """No trajectory stays accurate for long, but its means do: 2e5 units of time are about 3e4 periods of the force.

    The means for omega = 1.2 agree between DOP853, RK4 and EIG-3.
    """
    h, T = 0.01, 2e5
    for omega, expected in ((1.0, (0.7565, 0.374)), (1.2, (0.784, 0.266))):
        squares, n_steps = np.zeros(2), 0
        for u, v in march(problems.duffing(omega=omega, t_end=T), h, round(T / h), method):
            squares += u @ u, v @ v
            n_steps += len(u)
        mean = squares / n_steps
        yield near(f"mean u^2, omega = {omega}", expected[0], float(mean[0]), tolerance=0.005)
        yield near(f"mean v^2, omega = {omega}", expected[1], float(mean[1]), tolerance=0.006)


@case(7, "relaxation")
def relaxation(method: Method) -> Iterator[Finding]:
    """Van der Pol's oscillator: the period from its zero crossings on the limit cycle."""
    for mu, period in ((10.0, 19.07837), (100.0, 162.83707)):
        problem = problems.van_der_pol(mu=mu, t_end=4.3 * period)
        solution = problem.integrate(h=0.02 / mu, method=method)
        rising = np.flatnonzero((solution.u[:-1] < 0) & (solution.u[1:] >= 0))
        crossings = [_zero(solution, i) for i in rising.tolist()]
        error = abs((crossings[-1] - crossings[1]) / (len(crossings) - 2) / period - 1)
        what = f"relative error of the period, mu = {mu:g}, h mu = 0.02"
        if method.name == "eig3":
            yield within(what, 1.9e-4, error, 2)
        else:
            yield at_most(what, 5e-4 if method.order == 2 else 2e-5, error)


def _zero(solution: eig3.Solution, i: int) -> float:
    """The time between states i and i + 1 at which u is zero, by the cubic between them."""
    low, high = solution.t[i], solution.t[i + 1]
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if solution.at(middle)[0] < 0 else (low, middle)
    return low


@case(8, "impact", "eig3", "cd", "rk4")
def impact(method: Method) -> Iterator[Finding]:
    """The speed after the impact: the largest error over 20 places of the start of contact within a step."""
    problem = problems.hertz_impact()
    duration = contact_time(1e6, 1.0)
    for per_contact, expected in ((100, 7.2e-6), (1000, 2.2e-8)):
        h = duration / per_contact
        gaps = (3 + np.arange(20) / 20) * h
        runs = [replace(problem, u0=gap).integrate(h=h, method=method.name) for gap in gaps.tolist()]
        error = max(abs(float(run.v[-1]) - 1) for run in runs)
        what = f"error of restitution, t_c / h = {per_contact}"
        yield at_most(what, expected, error) if method.name == "rk4" else within(what, expected, error, 2)
        touching = (runs[0].u < 0).sum() * runs[0].h
        yield near(f"contact time, t_c / h = {per_contact}", duration, float(touching), tolerance=2 * h)


@case(9, "a pulse at CFL = 1", "eig3", "cd")
def pulse(method: Method) -> Iterator[Finding]:
    """At CFL = 1.001 the pulse has almost nothing at the highest frequency, so its growth starts from round-off."""
    problem = problems.elastic_bar(n=99)
    h = 1 / 100 / 5000.0  # an element's length over the wave speed
    assert problem.continuum is not None
    exact = problem.continuum(h * np.arange(200))[0]  # 200 steps take the pulse to the far end and back
    worst, index = 0.0, 1
    for u, _ in march(problem, h, 40_000, method):
        worst = max(worst, float(np.abs(u - exact[np.arange(index, index + len(u)) % 200]).max()))
        index += len(u)
    yield at_most("error from d'Alembert's solution, 40 000 steps", 1e-12, worst)
    steps = steps_until(problem, 1.001 * h, 1e50, 40_000, method)
    yield near("steps to 1e50 at CFL = 1.001", 1832, steps, rel=0.02)


@case(10, "close passages")
def close_passages(method: Method) -> Iterator[Finding]:
    """Kepler's orbits: EIG-3's energy error is largest during a close passage, where it extrapolates v from two forces.

    For the other methods at e = 0.99 only the order of magnitude is known in advance.
    """
    problem = problems.kepler(e=0.9)
    options: dict[str, Any] = {"method": method.name, "save_every": None, "invariants_every": 1}
    drifts = [problem.integrate(h=h, **options).drift["energy"] for h in (2e-4, 1e-4)]
    order = math.log2(drifts[0] / drifts[1])
    yield Finding(
        "order of the energy error, e = 0.9", f">= {method.order - 0.1}", f"{order:.3f}", order >= method.order - 0.1
    )
    problem, expected = problems.kepler(e=0.99, t_end=20 * math.pi), 2.7e-3
    solution = problem.integrate(h=1e-5, method=method.name, save_every=None)
    error = abs(problem.energy_of(solution.u[-1], solution.v[-1]) / problem.energy_of(problem.u0, problem.v0) - 1)
    what = "energy error after 10 orbits, e = 0.99"
    yield within(what, expected, error, 1.5) if method.name == "eig3" else at_most(what, 10 * expected, error)


@case(11, "double pendulum")
def double_pendulum(method: Method) -> Iterator[Finding]:
    problem = problems.double_pendulum()
    solution = problem.integrate(h=1e-3, method=method, save_every=None, invariants_every=1)
    error = solution.drift["energy"] / abs(problem.energy_of(problem.u0, problem.v0))
    what = "energy error, h = 1e-3, T = 100"
    yield within(what, 8.2e-5, error, 2) if method.name == "eig3" else at_most(what, 2 * 8.2e-5, error)


@case(12, "dry friction", "eig3", "cd", "cd lagged", "rk2", "rk3", "rk4", "ab2", "ab3")
def friction(method: Method) -> Iterator[Finding]:
    solution = problems.friction_oscillator().integrate(h=0.0005, method=method)
    turns = np.flatnonzero(np.diff(np.sign(solution.v[1:])) != 0)[:4] + 1
    for expected, turn in zip((-0.85, 0.65, -0.45, 0.25), turns, strict=True):
        yield near("peak", expected, float(solution.u[turn]), tolerance=1e-4)


@eig3.jit
def leapfrog_energy(t: float, u: float, v: float, p: np.ndarray) -> float:
    """w^2 + omega^2 u_n u_{n-1}, which the positions conserve exactly, from EIG-3's v_n = w_n + h/2 a_{n-1}."""
    square, h = p[0] * p[0], p[1]
    w = (v + h * square * u / 2) / (1 + h * h * square / 2)
    return w * w + square * u * (u - h * w)


@eig3.jit
def verlet_energy(t: float, u: float, v: float, p: np.ndarray) -> float:
    """The same from central difference's v_n = w_n + h/2 a_n."""
    square, h = p[0] * p[0], p[1]
    w = v + h * square * u / 2
    return w * w + square * u * (u - h * w)


@eig3.jit
def undamped(t: float, u: float, v: float, p: np.ndarray) -> float:
    return -p[0] * p[0] * u


@case(13, "round-off", "eig3", "cd", "rk4")
def round_off(method: Method) -> Iterator[Finding]:
    """Round-off alone changes what the discrete motion conserves exactly; with the form 2 u - u_prev by 2.8e-9."""
    n_steps, h = 10**8, 2.0**-12
    kept = {"eig3": leapfrog_energy, "cd": verlet_energy}.get(method.name, problems.single_dof().energy)
    solution = eig3.integrate(
        undamped,
        (0, n_steps * h),
        1.0,
        0.0,
        h=h,
        params=(1.0, h),
        method=method.without_velocity(),
        save_every=None,
        invariants={"energy": kept},
    )
    start = kept(0.0, 1.0, 0.0, np.array([1.0, h]))
    # RK4's dissipation of Omega^6/72 per step adds up to 3e-16 only
    yield at_most("relative drift, 1e8 steps", 7e-12, solution.drift["energy"] / start)


@case(14, "unstable rest", "eig3", "cd", "ab2", "rk2")
def unstable_rest(method: Method) -> Iterator[Finding]:
    """The inverted spring pendulum falls, since sin pi is not exactly zero, with more energy than in Table 4."""
    problem = problems.spring_pendulum(theta0=math.pi)
    solutions = [problem.integrate(h=h, method=method.name, invariants_every=1) for h in (1e-3, 1e-4)]
    early = np.abs(solutions[0].u[solutions[0].t <= 3, 1] - math.pi).max()
    yield at_most("abs (theta - pi) up to t = 3", 1e-8, float(early))
    table = next(table for table in TABLES if table.number == 4)
    coarse, fine = (table.entries[method.name][table.steps.index(h)].recomputed for h in (1e-3, 1e-4))
    drifts = [solution.drift["energy"] for solution in solutions]
    yield within("energy drift at h = 1e-3 / at 1e-4: as in Table 4", coarse / fine, drifts[0] / drifts[1], 2)


@eig3.jit
def gyroscope(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    a[0] = -p[0] * v[1]
    a[1] = p[0] * v[0]


@case(15, "gyroscope")
def gyroscopic_growth(method: Method) -> Iterator[Finding]:
    """u'' = kappa J u', kappa h = 0.1: a method for first-order systems changes |v| as it changes an oscillator.

    The first step of a multistep method is made by another method, which lengthens v by about (kappa h)^2 / 2.
    """
    n_steps = 10_000
    run = eig3.integrate(gyroscope, (0, n_steps * 0.1), [0.0, 0.0], [1.0, 0.0], h=0.1, params=1.0, method=method)
    expected = {"eig3": 1.2922, "cd": 1.0}.get(method.name) or spectral_radius(method, 0.1) ** n_steps
    rel = 6e-3 if method.name in ("eig3", "ab2", "ab3") else 1e-9
    yield near("abs v after 10 000 steps", expected, float(np.hypot(*run.v[-1])), rel=rel)


@case(16, "order with velocity", "eig3", "cd", "cd lagged", "rk2", "rk3", "rk4", "ab2", "ab3")
def order_with_velocity(method: Method) -> Iterator[Finding]:
    """The damped, forced oscillator and the spring pendulum: Richardson's ratio of three runs."""
    forced = problems.single_dof(omega=2.0, xi=0.1, force=1.0, force_omega=3.0, t_end=10.0)
    for problem, h in ((forced, 0.01), (problems.spring_pendulum(t_end=2.0), 0.002)):
        ends = [problem.integrate(h=h / 2**i, method=method, save_every=None).u[-1] for i in range(3)]
        coarse, fine = (float(np.abs(ends[i] - ends[i + 1]).max()) for i in range(2))
        yield near(f"order on {problem.name}", method.order, math.log2(coarse / fine), tolerance=0.15)


@case(17, "a million periods", "eig5", "eig9", "bm6", "rk8")
def million_periods(method: Method) -> Iterator[Finding]:
    """Energy of the hardening spring, from its mean over the first and over the last 100 periods.

    A symplectic method conserves an energy close to the exact one. The others lose energy at a rate that depends on the
    amplitude. Their next order in h changes this rate by less than 1 %.
    """
    per_period = {"eig5": 150, "eig9": 80, "bm6": 12, "rk8": 16}[method.name]
    omega, _ = harmonics(AMPLITUDE)
    h = 2 * math.pi / omega / per_period
    n_steps, window = 10**6 * per_period, 100 * per_period
    problem = problems.hardening_spring(S1, S2, AMPLITUDE)
    stepper = problem.stepper(h=h, method=_of(problem, method))
    u, v = np.empty((2, window)), np.empty((2, window))
    stepper.advance(window, 1, u[0], v[0])
    stepper.advance(n_steps - 2 * window)
    stepper.advance(window, 1, u[1], v[1])
    first, last = (problem.energy_of(u[i], v[i]) for i in range(2))
    start = problem.energy_of(AMPLITUDE, 0.0)
    if method.name == "bm6":
        ratio = np.abs(last - start).max() / np.abs(first - start).max()
        yield at_most("largest energy error, last 100 periods / first 100", 1.1, float(ratio))
    else:
        grade = method.grade if isinstance(method, EIG) else 0
        power = eig_power(grade, h) if grade else one_step_power(method, h)
        expected = energy_after(power, n_steps * h) / start
        yield near("ln (energy at the end / at the start)", math.log(expected), math.log(last.mean() / start), rel=0.01)


@case(18, "gyroscope, grades 5 to 7", "eig5", "eig6", "eig7")
def gyroscopic_growth_of_grades(method: EIG) -> Iterator[Finding]:
    """EIG-5 loses speed, and so does not grow. The first steps are left out: parasitic roots decay there."""
    for k in (0.05, 0.1):
        stepper = eig3.Stepper(gyroscope, [0.0, 0.0], [1.0, 0.0], h=k, params=1.0, method=method)
        stepper.advance(1000)
        start = np.hypot(*stepper.v)
        stepper.advance(10**6)
        growth = math.log(np.hypot(*stepper.v) / start) / 10**6
        yield near(f"growth of abs v a step, kappa h = {k}", gyroscope_growth(method.grade, k), growth, rel=1e-3)


@case(19, "round-off, high grades", "eig9", "eig11", "eig13")
def round_off_of_grades(method: Method) -> Iterator[Finding]:
    """A random walk of the energy (1/2): in each step u and V, between 1/2 and 1, are rounded to a multiple of 2^-53.

    One rounding has the variance 2^-106/12, and the energy changes by u or V times the two, on average by half of their
    sum. The maximum of a walk is sqrt(pi/2) times its standard deviation in the mean, and hardly ever 4 times more or
    less. The large coefficients of high grades do not matter, because h^2 multiplies them.
    """
    n_steps, h = 10**7, 2.0**-10
    problem = problems.single_dof(omega=1.0, t_end=n_steps * h)
    options: dict[str, Any] = {"method": _of(problem, method), "save_every": None, "invariants_every": 1}
    drift = problem.integrate(h=h, **options).drift["energy"]
    expected = math.sqrt(math.pi / 2) * 2.0**-53 * math.sqrt(n_steps / 12)
    yield within("energy drift, 1e7 steps", expected, drift, 4)


@eig3.jit
def one_sided(t: float, u: float, v: float, p: np.ndarray) -> float:
    return -u - p[0] * max(u, 0.0)


@case(20, "a kink", "eig5", "eig9", "eig13", "rk4", "rk8", "bm6")
def kink(method: Method) -> Iterator[Finding]:
    """A spring that is stiffer by c on one side of u = 0, which the mass passes at the speed 1 and the energy 1/2.

    The acceleration gets a kink -c (t - t0)+ there. Where t0 is at the fraction theta of a step, a Runge-Kutta method
    has the velocity error -c h^2 (sum b_i (c_i - theta)+ - (1 - theta)^2/2). In EIG the weights of past accelerations
    sum up to the weights of the trapezoidal rule, so that at every grade the error is -c h^2 B_2(theta)/2 with
    Bernoulli's polynomial B_2, whose mean square is 1/180. So every order falls to 2. Without the kink the order is
    kept.
    """
    theta = (np.arange(1000) + 0.5) / 1000
    if isinstance(method, EIG):
        kernel = (theta**2 - theta + 1 / 6) / 2
    else:
        b, c = {
            "rk4": ((1 / 6, 1 / 3, 1 / 3, 1 / 6), (0, 1 / 2, 1 / 2, 1)),
            "rk8": (rk8.B, rk8.C),
            "bm6": (bm6.KICKS, (0, *bm6.TIMES)),
        }[method.name]
        kernel = sum(w * np.maximum(x - theta, 0) for w, x in zip(b, c, strict=True)) - (1 - theta) ** 2 / 2
    expected = 2 * math.sqrt(np.mean(kernel**2))
    coarse, fine = (_energy_errors_of_a_passage(method, 1.0, h) for h in (0.02, 0.01))
    smooth = _energy_errors_of_a_passage(method, 0.0, 0.01)
    # the next terms in h are a few h relative
    yield near("relative energy error / (c h^2), rms over places in a step", expected, fine / 0.01**2, rel=0.03)
    yield near("order", 2.0, math.log2(coarse / fine), tolerance=0.1)
    yield at_most("energy error without the kink / with it", 1e-3, smooth / fine)


def _energy_errors_of_a_passage(method: Method, c: float, h: float) -> float:
    """The rms of 2 E - 1 after u = 0 was passed at 100 places within a step."""
    errors = []
    for begin in (0.3 + (np.arange(100) + 0.5) / 100 * h).tolist():
        u, v = -math.cos(begin), math.sin(begin)
        stepper = eig3.Stepper(one_sided, u, v, h=h, params=c, method=method.without_velocity())
        stepper.advance(round(2.2 / h))
        errors.append(stepper.v**2 + stepper.u**2 + c * max(stepper.u, 0.0) ** 2 - 1)
    return float(np.sqrt(np.mean(np.square(errors))))


@eig3.jit
def whirled(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    """A gyroscope with a force that turns once in 2 pi."""
    a[0] = np.cos(t) - p[0] * v[1]
    a[1] = np.sin(t) + p[0] * v[0]


@case(21, "order with velocity, higher orders", *(f"eig{grade}" for grade in range(4, 14)), "rk5", "rk8")
def higher_order_with_velocity(method: Method) -> Iterator[Finding]:
    """From the rms error of v over a run with h and over one with h/2.

    With strong damping or gyroscopic forces the stable steps of high grades are so short that only round-off is left.
    Their order shows where a force is much faster than the system: it needs short steps, which are stable.
    """
    Omega = {"eig11": 0.3, "eig12": 0.4, "eig13": 0.3, "rk5": 0.4, "rk8": 1.6}.get(method.name, 0.2)
    yield _order("single_dof", method, [_error_of_damped(method, h) for h in (Omega, Omega / 2)])
    yield _order("a gyroscope", method, [_error_of_whirled(method, h) for h in (Omega, Omega / 2)])
    pendulum = problems.spring_pendulum(t_end=2.0)
    exact = pendulum.integrate(h=1e-4, method="rk8")
    if method.order < 9:
        h = {"rk5": 0.004, "rk8": 0.02}.get(method.name, 0.004)
        runs = [pendulum.integrate(h=step, method=method) for step in (h, h / 2)]
        yield _order("spring_pendulum", method, [_rms(run.v - exact.v[:: round(run.h / exact.h)]) for run in runs])
    else:
        run = pendulum.integrate(h=1e-4, method=method)
        yield at_most("error on spring_pendulum, h = 1e-4", 1e-12, _rms(run.v - exact.v))


def _order(where: str, method: Method, errors: list[float]) -> Finding:
    return near(f"order on {where}", method.order, math.log2(errors[0] / errors[1]), tolerance=0.3)


def _error_of_damped(method: Method, h: float) -> float:
    """On the steady motion of a damped oscillator, with a force that is ten times as fast as its own motion."""
    constants = {"omega": 0.1, "xi": 0.01, "force": 1.0, "force_omega": 1.0}
    u0, v0 = particular(0.0, **constants)
    run = problems.single_dof(**constants, u0=u0, v0=v0, t_end=_FORCED).integrate(h=h, method=method)
    return _rms(run.v - particular(run.t, **constants)[1])


def _error_of_whirled(method: Method, h: float) -> float:
    """On the steady motion v = i w exp(i t) with w = -1 / (1 - kappa)."""
    kappa = 0.005 if method.order > 7 and method.name != "rk8" else 0.2
    w = -1 / (1 - kappa)
    run = eig3.integrate(whirled, (0, _FORCED), [w, 0.0], [0.0, w], h=h, params=kappa, method=method)
    return _rms(run.v[:, 0] + 1j * run.v[:, 1] - 1j * w * np.exp(1j * run.t))


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.abs(errors) ** 2)))


@case(22, "order and drift with tolerances", "rk5", "rk8", "eig3")
def order_with_tolerances(method: Method) -> Iterator[Finding]:
    """The order: errors against the mean step, for two tolerances. The drift: in the energy of the hardening spring.

    Each step changes the energy a little, by its place in the period. Over each period this has a mean, so that twice
    the time has twice the drift; also with EIG-3, which keeps the energy with a fixed step.
    """
    problem = problems.single_dof(xi=0.02, force=1.0, force_omega=3.0, t_end=50.0)
    times = np.linspace(0, 50, 201)
    assert problem.exact is not None
    exact = problem.exact(times)[0]
    runs = [problem.integrate(rtol=rtol, method=method, t_eval=times, invariants={}) for rtol in (1e-8, 1e-10)]
    errors = [_rms(run.u - exact) for run in runs]
    order = math.log(errors[0] / errors[1]) / math.log(runs[0].h / runs[1].h)
    yield near("order on single_dof", method.order, order, tolerance=0.3)
    spring = problems.hardening_spring()
    drifts = [
        spring.integrate(rtol=1e-7, method=method, t_end=t_end, save_every=None, invariants_every=1).drift["energy"]
        for t_end in (5.0, 10.0)
    ]
    yield near("energy drift over 10 s / over 5 s, rtol = 1e-7", 2.0, drifts[1] / drifts[0], rel=0.05)


@eig3.jit
def oscillation(t: float, u: float, v: float, p: np.ndarray) -> float:
    return -u


@eig3.jit
def above(t: float, u: float, v: float, p: np.ndarray) -> float:
    """It touches zero at u = -1, or passes it a little earlier and later: the lowest value of u is -1."""
    return u + 1 - p[0]


@case(23, "a grazing event", "rk5", "rk8")
def grazing(method: Method) -> Iterator[Finding]:
    """A dip of depth d below zero has its two zeros at arccos(1 - d) from its middle, in u = cos t.

    There the velocity is sqrt(2 d). An error of u, below 1e-9 here, is divided by it. The two zeros are far enough
    apart for steps of 0.02. The zero of a dip of depth 0 is double: g does not change its sign, but with round-off it
    may change twice.
    """

    def times(depth: float) -> np.ndarray:
        options: dict[str, Any] = {"rtol": 1e-10, "h_max": 0.02, "method": method, "params": depth, "save_every": None}
        run = eig3.integrate(oscillation, (0, 20 * math.pi), 1.0, 0.0, events={"low": eig3.Event(above)}, **options)
        return run.events["low"].t

    def from_middle(t: np.ndarray) -> np.ndarray:
        return np.abs((t % (2 * math.pi)) - math.pi)

    found = times(1e-3)
    yield near("zeros of ten dips, depth 1e-3", 20, len(found))
    error = np.abs(from_middle(found) - math.acos(1 - 1e-3)).max()
    yield at_most("largest error of their times", 1e-9 / math.sqrt(2e-3), float(error))
    found = times(0.0)
    yield near("zeros of ten dips, depth 0, modulo 2", 0, len(found) % 2)
    yield at_most("their largest distance from the middle", math.sqrt(2e-9), float(from_middle(found).max(initial=0)))
    yield near("zeros of ten dips that end 1e-6 above zero", 0, len(times(-1e-6)))


@case(24, "a hundred thousand events", "rk5", "rk8", "eig3")
def many_events(method: Method) -> Iterator[Finding]:
    """Zeros of cos t, and the impacts of a ball that keeps its speed.

    A relative tolerance of 1e-10 on each of some ten steps in half a period shifts the zeros by at most 1e-9 of the
    time. Each method is exact in free flight. An impact is found at most 1e-12 of the span too late. The ball is then
    below the floor and returns as much later; its energy is not changed.
    """
    count, height = 10**5, 1.0
    if method.name != "eig3":  # which needs 1e5 steps a period for so small an error
        event = {"zero": eig3.Event(oscillation)}
        options: dict[str, Any] = {"rtol": 1e-10, "method": method, "save_every": None}
        found = eig3.integrate(oscillation, (0, count * math.pi), 1.0, 0.0, events=event, **options).events["zero"].t
        yield near("zeros of cos t", count, len(found))
        error = np.abs(found / math.pi - np.arange(len(found)) - 0.5).max() / count
        yield at_most("largest error of their times / span", 1e-9, float(error))
    exact = impact_times(count, 1.0, height, 9.81)
    ball = problems.bouncing_ball(restitution=1.0, h0=height, t_end=exact[-1] + (exact[1] - exact[0]) / 2)
    found = ball.integrate(rtol=1e-6, method=method, save_every=None).events["impact"].t
    yield near("impacts", count, len(found))
    yield at_most("largest error of their times / span", 2e-12 * count, float(np.abs(found - exact).max() / exact[-1]))


@case(25, "a ball that comes to rest", "eig3", "eig9", "rk4", "rk8")
def coming_to_rest(method: Method) -> Iterator[Finding]:
    """Its impacts follow each other without end before a known time. With a fixed step, and with tolerances.

    The run ends at a flight shorter than 1e-12 of the span of 10 s. The flights after it take 0.8 / (1 - 0.8) times as
    long, 4e-11 s.
    """
    ball = problems.bouncing_ball(t_end=10.0)
    rest = math.sqrt(2 / 9.81) * (1 + 0.8) / (1 - 0.8)
    kinds = [{"h": 0.01}] + [{"rtol": 1e-9}] * bool(getattr(method, "variable", ""))
    for options in kinds:
        run = ball.integrate(method=method, save_every=None, **options)
        yield ended(eig3.Status.ZENO, run)
        yield at_most(f"time from its end to rest, {', '.join(options)}", 1e-10, abs(float(run.t[-1]) - rest))


@eig3.jit
def attraction(t: float, u: float, v: float, p: np.ndarray) -> float:
    return 2 * u * u * u


@case(26, "a singularity", "rk5", "rk8", "eig3")
def singularity(method: Method) -> Iterator[Finding]:
    """u = 1 / (1 - t) has a pole at t = 1. An error of u early in the run shifts the pole by as much."""
    rtol = 1e-8
    run = eig3.integrate(attraction, (0, 2), 1.0, 1.0, rtol=rtol, method=method, save_every=None)
    yield ended(eig3.Status.STEP_TOO_SMALL, run)
    yield at_most("time from its end to the pole", 100 * rtol, abs(float(run.t[-1]) - 1))
