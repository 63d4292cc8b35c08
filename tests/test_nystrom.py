"""RKN12: the conditions of order of its tableau and of its continuous extension, and runs with a fixed step, with
tolerances and with events."""

import itertools

import numpy as np
import pytest

import eig3
from eig3.kernels.methods import rkn12

from .conftest import assert_same, position, velocity

ORBIT = eig3.problems.kepler(e=0.3)
PERIOD = 2 * np.pi

forced = eig3.jit(lambda t, u, v, p: np.sin(t) - u - u * u * u)
pulled = eig3.jit(lambda t, u, v, p: -u if t < 5 else -u - 0.1 * v)
damped = eig3.jit(lambda t, u, v, p: -u - 0.1 * v)


def trees(A, c, order):
    """The conditions of order of u'' = f(t, u), up to an order: triples of a vector w, a number q, and the order q + 2.

    Weights of the stages give u after the fraction s of a step to this order if their product with w is
    s^(q + 2) / ((q + 1) (q + 2)) for all w, and v if it is s^(q + 1) / (q + 1). Each w belongs to a tree, whose root is
    a derivative of f: in t, with the factor c, and in u, in the directions of smaller trees. The factors are so scaled
    that they are c^q for stages without errors.
    """
    branches = {1: [c]}
    found = []
    for rho in range(2, order + 1):
        made = []
        for sizes in sums(rho - 2, rho - 2):
            sets = [
                itertools.combinations_with_replacement(branches[size], len([*group]))
                for size, group in itertools.groupby(sizes)
            ]
            made += [
                np.prod([np.ones(len(c)), *itertools.chain(*chosen)], axis=0) for chosen in itertools.product(*sets)
            ]
        branches[rho] = [rho * (rho - 1) * (A @ w) for w in made]
        found += [(w, rho - 2, rho) for w in made]
    return found


def sums(total, largest):
    """The ways to write a number as a sum of numbers that do not increase."""
    if total == 0:
        yield []
    for first in range(min(total, largest), 0, -1):
        for rest in sums(total - first, first):
            yield [first, *rest]


def square(rows, width):
    return np.array([[*row, *[0.0] * (width - len(row))] for row in rows])


def test_the_tableau_has_order_12_and_the_estimate_order_10():
    C, B, ERROR = np.array(rkn12.C), np.array(rkn12.B), np.array(rkn12.ERROR)
    found = trees(square([(), *rkn12.A], len(C)), C, 12)
    # The numbers of trees: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, II.14.
    assert [sum(rho == order for *_, rho in found) for order in range(2, 9)] == [1, 1, 2, 3, 6, 10, 20]
    tolerance = 1e-12  # coefficients of up to 30 have round-off, and there are 17 stages
    for w, q, rho in found:
        assert (B * (1 - C)) @ w == pytest.approx(1 / ((q + 1) * (q + 2)), rel=tolerance)
        assert B @ w == pytest.approx(1 / (q + 1), rel=tolerance)
        if rho <= 10:
            assert abs((ERROR * (1 - C)) @ w) < tolerance
        if rho <= 11:
            assert abs(ERROR @ w) < tolerance
    assert max(abs((ERROR * (1 - C)) @ w) for w, _, rho in found if rho == 11) > 1e-6
    assert max(abs(ERROR @ w) for w, _, rho in found if rho == 12) > 1e-6


def test_the_continuous_extension_has_order_10():
    C, B, stages = np.array(rkn12.C), np.array(rkn12.B), len(rkn12.C)
    c = np.array([*C, 1.0, *rkn12.EXTRA_C])
    A = square([(), *rkn12.A, B * (1 - C), *rkn12.EXTRA_A], len(c))
    found, extension = trees(A, c, 10), square(rkn12.EXTENSION, len(c))
    of_u, of_v = square([B * (1 - C), B], len(c))
    first, last = np.eye(len(c))[[0, stages]]
    # The terms of a polynomial through u, v and a at both ends, as weights: those of h v cancel.
    terms = [of_u, -of_u, 2 * of_u - of_v]
    terms.append(first / 2 + terms[1] - terms[2])
    terms.append(last / 2 + terms[1] + 2 * terms[2] - terms[3])
    factor = [np.polynomial.Polynomial([0, 1]), np.polynomial.Polynomial([1, -1])]  # s and 1 - s
    products = [np.prod([factor[k % 2] for k in range(i + 1)]) for i in range(10)]
    for s in (0.1, 0.37, 0.5, 0.83):
        weights = sum(term * product(s) for term, product in zip([*terms, *extension], products, strict=True))
        slopes = sum(term * product.deriv()(s) for term, product in zip([*terms, *extension], products, strict=True))
        for w, q, _ in found:
            assert weights @ w == pytest.approx(s ** (q + 2) / ((q + 1) * (q + 2)), abs=1e-13)
            assert slopes @ w == pytest.approx(s ** (q + 1) / (q + 1), abs=1e-12)


def follow(t_end, **options):
    return eig3.integrate(forced, (0, t_end), 1.0, 0.5, **options)


def test_order_12_on_an_orbit():
    def error(n_steps):
        orbit = ORBIT.with_(t_span=(0, PERIOD))
        run = orbit.integrate(h=PERIOD / n_steps, method="rkn12", save_every=None, invariants={})
        return np.abs(run.u[-1] - ORBIT.u0).max()

    # The next terms change the error by (omega h)^2, a sixth at the perihelion; with more steps there is round-off.
    assert np.log(error(16) / error(24)) / np.log(1.5) == pytest.approx(12, abs=0.5)


def test_order_12_with_a_force_that_depends_on_time():
    exact = follow(12, h=1 / 8, method="rkn12").u[-1]
    errors = [abs(follow(12, h=h, method="rkn12").u[-1] - exact) for h in (12 / 14, 12 / 28)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(12, abs=1.5)  # the next term is large at so long a step


def test_the_error_between_the_ends_of_a_step_is_that_of_order_10():
    """One step of the length h: the error of u falls as h^11, and that of v as h^10."""

    def errors(h):
        times = h * np.array([0.2, 0.45, 0.7, 0.9])
        step = follow(h, rtol=0.1, first_step=h, h_max=h, t_eval=times, method="rkn12")
        assert step.n_steps == 1
        exact = follow(h, rtol=1e-13, t_eval=times)
        return np.array([np.abs(step.u - exact.u).max(), np.abs(step.v - exact.v).max()])

    np.testing.assert_allclose(np.log(errors(0.8) / errors(0.5)) / np.log(1.6), [11, 10], atol=0.8)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_errors_at_and_between_the_steps_are_within_the_tolerance(rtol):
    t = np.linspace(0, 20, 301)
    run, exact = follow(20, rtol=rtol), follow(20, rtol=3e-14, t_eval=t)
    assert run.method == eig3.RKN12()
    wanted = follow(20, rtol=rtol, t_eval=t)
    for value, also, truth in zip(run.at(t), (wanted.u, wanted.v), (exact.u, exact.v), strict=True):
        assert np.abs(value - truth).max() < 10 * rtol  # the errors of some ten steps
        np.testing.assert_allclose(also, value, rtol=0, atol=1e-13)


def test_errors_on_an_orbit():
    run = ORBIT.with_(t_span=(0, 3 * PERIOD)).integrate(rtol=1e-9, save_every=None, invariants={})
    assert run.method == eig3.RKN12()
    assert np.abs(run.u[-1] - ORBIT.u0).max() < 1e-7  # the error of the phase grows as the square of the time


@pytest.mark.parametrize("options", [{"rtol": 1e-11}, {"h": 0.25, "method": "rkn12"}])
def test_events_and_extremes_are_found_on_the_continuous_extension(options):
    events = {"rest": eig3.Event(velocity)}
    run = follow(20, events=events, outputs={"u": position}, save_every=None, **options)
    fine = follow(20, rtol=3e-14, events=events)
    # A step of 0.25 has an error of 1e-11 or less, and the slope of v at a zero is about 1.
    np.testing.assert_allclose(run.events["rest"].t, fine.events["rest"].t, rtol=0, atol=1e-9)
    found = fine.events["rest"].u
    if "rtol" in options:
        assert run.extremes["u"][:2] == pytest.approx((found.min(), found.max()), abs=1e-9)


def test_an_extended_run_is_one_run():
    assert_same(follow(10, rtol=1e-9).extend(25), follow(25, rtol=1e-9))


def test_more_events_than_degrees_of_freedom():
    events = {f"crossing {k}": eig3.Event(position) for k in range(4)}
    run = follow(20, rtol=1e-9, events=events)
    times = [run.events[name].t for name in events]
    assert len(times[0]) > 2
    assert all(np.array_equal(times[0], others) for others in times)


def test_a_run_from_rest_finds_its_first_step():
    """u = t - sin t, which is t^3 / 6 at first."""
    from_rest = eig3.jit(lambda t, u, v, p: np.sin(t))
    run = eig3.integrate(from_rest, (0, 10), 0.0, 0.0, rtol=1e-9)
    assert run.method == eig3.RKN12()
    np.testing.assert_allclose(run.u, run.t - np.sin(run.t), rtol=0, atol=1e-8)
    assert run.n_steps < 100


@pytest.mark.parametrize("steps", [{"h": 0.1}, {"rtol": 1e-8}])
def test_a_force_that_reads_the_velocity_is_refused(steps):
    with pytest.raises(ValueError, match=r"^RKN12\(\) needs a rhs that ignores v and has no z0"):
        eig3.integrate(damped, (0, 1), 1.0, 0.0, method="rkn12", **steps)


def test_the_default_follows_the_tolerance_and_the_velocity():
    def chosen(rhs, rtol):
        return eig3.prepare(rhs, rtol=rtol).method.name

    assert [chosen(forced, rtol) for rtol in (1e-3, 1e-5, 1e-6, 1e-9)] == ["rk5", "rk8", "rkn12", "rkn12"]
    assert [chosen(rhs, 1e-9) for rhs in (damped, pulled)] == ["rk8", "rk8"]
