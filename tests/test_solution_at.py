"""The accelerations of a solution, and the interpolation between its saved states."""

import copy
import math
import pickle

import numpy as np
import pytest

import eig3
from eig3.result.occurrences import Occurrences

from .conftest import coupled, damped, hardening

#: With u(0) = 1 and v(0) = 0, the exact motion is cos t.
forced = eig3.jit(lambda t, u, v, p: -2 * u + np.cos(t))


@eig3.jit
def fragile(t, u, v, p):
    """It fails at t = 1 if its parameter is positive."""
    if t > 0.9999999 and p[0] > 0:
        raise ValueError("too late")
    return -u


def hand_made(t, u, v, method="rk4", accelerations=None, events=None):
    """A solution with these states; `accelerations` is a function of t, u and v."""
    return eig3.Solution(
        t=t, u=u, v=v, h=float(t[1] - t[0]), n_steps=len(t) - 1, n_rhs=0, n_iterations=0,
        status=eig3.Status.COMPLETED, message="", kernel_seconds=0.0, method=eig3.METHODS[method](),
        events=events or {}, _accelerations=accelerations
    )  # fmt: skip


def midpoint_errors(rhs, h, method):
    run = eig3.integrate(rhs, (0, 8), 1.0, 0.0, h=h, method=method)
    t = (run.t[1:] + run.t[:-1]) / 2
    u, v = run.at(t)
    return np.array([np.abs(u - np.cos(t)).max(), np.abs(v + np.sin(t)).max()])


@pytest.mark.parametrize(
    ("method", "h", "rhs"),
    [(*row, damped) for row in (("eig3", 0.1), ("rk4", 0.1), ("rk5", 0.1), ("rk8", 0.4), ("eig9", 0.1))]
    + [("eig3", 0.1, forced), ("bm6", 0.2, forced)],
)
def test_between_saved_states_the_order_is_that_of_the_method(method, h, rhs):
    order = np.log2(midpoint_errors(rhs, h, method) / midpoint_errors(rhs, h / 2, method))
    # the next term of the error changes the ratio by O(h): by up to 0.4 in the order at these steps
    assert (np.abs(order - eig3.METHODS[method]().order) < (0.1 if method == "bm6" else 0.4)).all()


@pytest.mark.parametrize(("method", "knots"), [("rk4", 2), ("rk8", 3), ("eig10", 4), ("eig13", 5)])
@pytest.mark.parametrize("n", [1, 3])
def test_polynomials_are_met_from_unequal_steps(method, knots, n):
    """A polynomial of degree 3 k - 1 is its own Hermite polynomial, wherever the k knots are: v has this order too."""
    assert 3 * knots - 1 >= eig3.METHODS[method]().order
    rng = np.random.default_rng(knots)
    t = 2 + np.cumsum(rng.uniform(0.02, 0.2, 30))
    t = (t - t[0]) / (t[-1] - t[0])
    parts = [np.polynomial.Chebyshev(rng.normal(size=3 * knots), domain=[0, 1]) for _ in range(n)]

    def values(t, order=0):
        return np.stack([(part.deriv(order) if order else part)(t) for part in parts], axis=-1)

    solution = hand_made(t, values(t), values(t, 1), method, lambda t, u, v: values(t, 2))
    fine = rng.uniform(0, 1, 500)
    u, v = solution.at(fine)
    # Round-off grows by the fifth power of the ratio of the steps, at most 10. v divides it by the step, about 1/30.
    np.testing.assert_allclose(u, values(fine), rtol=0, atol=1e-16 * 1e5 * 10)
    np.testing.assert_allclose(v, values(fine, 1), rtol=0, atol=1e-16 * 1e5 * 3000)


def test_knots_that_are_nearly_at_one_time_do_no_harm():
    t = np.sort(np.concatenate([np.linspace(0, 6, 25), np.linspace(0.01, 5.5, 7), 1e-9 + np.linspace(0.25, 5.25, 21)]))
    solution = hand_made(t, np.sin(t), np.cos(t), "rk8", lambda t, u, v: -np.sin(t))
    fine = np.linspace(0, 6, 1237)
    u, v = solution.at(fine)
    # interval 1/4 between knots that are at most 1/2 apart: the term of degree 9 is below (1/2)^9 / 9! = 5e-9
    np.testing.assert_allclose(u, np.sin(fine), rtol=0, atol=5e-9)
    np.testing.assert_allclose(v, np.cos(fine), rtol=0, atol=9 / 0.25 * 5e-9)


def test_single_times_and_arrays_of_times_agree_to_the_last_bit():
    run = eig3.integrate(coupled, (0, 5), [1.0, 2.0, 3.0], [0.0] * 3, h=0.1, params=(1, 2, 3), method="rk8")
    times = np.random.default_rng(0).uniform(0, 5, 50)
    u, v = run.at(times)
    assert np.array_equal(u, [run.at(t)[0] for t in times])
    assert np.array_equal(v, [run.at(t)[1] for t in times])
    many = np.tile(times, 1000)  # more than are computed at once
    assert np.array_equal(run.at(many)[0], np.tile(u, (1000, 1)))


# Jumps ---------------------------------------------------------------------------------------------------------------


class Ball:
    """A ball that falls from the height 1 with u'' = -1, and bounces with the coefficient of restitution 0.8."""

    def __init__(self, count):
        first = math.sqrt(2)
        speeds = first * 0.8 ** np.arange(count)
        self.t = first + np.concatenate([[0], np.cumsum(2 * speeds[1:])])
        zero = np.zeros(count)
        self.impacts = Occurrences(self.t, zero, -speeds, zero, 0.8 * speeds)

    def __call__(self, t):
        """The motion, at the time of an impact that after it."""
        k = np.searchsorted(self.t, t, side="right") - 1
        since = t - np.where(k < 0, 0.0, self.t[k])
        v0 = np.where(k < 0, 0.0, self.impacts.v_after[k])
        return np.where(k < 0, 1.0, 0.0) + v0 * since - since**2 / 2, v0 - since


def gravity(t, u, v):
    return np.full(np.shape(u), -1.0)


@pytest.mark.parametrize("method", ["rk4", "rk8", "eig13"])
@pytest.mark.parametrize("accelerations", [gravity, None], ids=["quintic", "cubic"])
def test_no_polynomial_reaches_across_an_impact(method, accelerations):
    """Between impacts the motion is quadratic, so that the polynomials are exact."""
    ball = Ball(6)
    t = np.linspace(0, ball.t[-1] + 0.5, 40)
    solution = hand_made(t, *ball(t), method, accelerations, {"impact": ball.impacts})
    fine = np.linspace(0, t[-1], 5000)
    # round-off of values of size 1, divided by intervals down to 0.002
    for value, exact in zip(solution.at(fine), ball(fine), strict=True):
        np.testing.assert_allclose(value, exact, rtol=0, atol=1e-12)
    assert np.array_equal(solution.at(ball.t), [ball.impacts.u_after, ball.impacts.v_after])
    before = solution.at(np.nextafter(ball.t, 0))[1]
    np.testing.assert_allclose(before, ball.impacts.v, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ending", [0.5, 0.0], ids=["goes on", "ends at an impact"])
@pytest.mark.parametrize("kept", ["both", "before", "after"])
def test_rows_at_the_time_of_an_impact(kept, ending):
    """A history may contain both states of a jump, or one of them."""
    ball = Ball(3)
    others = np.setdiff1d(np.linspace(0, ball.t[-1] + ending, 30), ball.t)
    t = np.concatenate([others, ball.t, ball.t])
    jumps = ball.impacts
    u = np.concatenate([ball(others)[0], jumps.u, jumps.u_after])
    v = np.concatenate([ball(others)[1], jumps.v, jumps.v_after])
    keep = np.ones(len(t), dtype=bool)
    if kept != "both":
        keep[len(others) + 3 * (kept == "before") :][:3] = False
    order = np.argsort(t[keep], kind="stable")
    t, u, v = (x[keep][order] for x in (t, u, v))
    with_events = hand_made(t, u, v, "rk8", gravity, {"impact": jumps})
    solutions = [with_events]
    if kept == "both":
        solutions.append(hand_made(t, u, v, "rk8", gravity))  # the equal times alone tell
    fine = np.linspace(0, t[-1], 3001)
    for solution in solutions:
        for value, exact in zip(solution.at(fine), ball(fine), strict=True):
            np.testing.assert_allclose(value, exact, rtol=0, atol=1e-12)
        assert np.array_equal(solution.at(ball.t), [jumps.u_after, jumps.v_after])
        assert len(solution.a) == len(t)
    copied = pickle.loads(pickle.dumps(with_events))
    assert np.array_equal(copied.at(fine), with_events.at(fine))


def test_impacts_outside_the_saved_times_are_no_knots():
    ball = Ball(6)
    t = np.linspace(ball.t[1] + 0.1, ball.t[3] - 0.1, 20)
    solution = hand_made(t, *ball(t), "rk8", gravity, {"impact": ball.impacts})
    np.testing.assert_allclose(solution.at(t), ball(t), rtol=0, atol=0)
    fine = np.linspace(t[0], t[-1], 777)
    np.testing.assert_allclose(solution.at(fine), ball(fine), rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="within the span"):
        solution.at(ball.t[0])


def test_an_event_without_a_jump_changes_nothing():
    ball = Ball(1)
    crossing = np.array([0.55])
    states = [*ball(crossing)] * 2
    t = np.linspace(0, 1, 7)
    solution = hand_made(t, *ball(t), "rk8", gravity)
    marked = hand_made(t, *ball(t), "rk8", gravity, {"crossing": Occurrences(crossing, *states)})
    fine = np.linspace(0, 1, 101)
    assert np.array_equal(solution.at(fine), marked.at(fine))


# The accelerations ---------------------------------------------------------------------------------------------------


def test_accelerations_are_those_of_the_right_hand_side():
    run = eig3.integrate(hardening, (0, 5), 1.0, 0.0, h=0.1, params=2.0, method="rk4")
    expected = [hardening(t, u, v, np.array([2.0])) for t, u, v in zip(run.t, run.u, run.v, strict=True)]
    np.testing.assert_allclose(run.a, expected, rtol=1e-14)
    assert run.a is not None
    assert run.n_rhs == 1 + 4 * run.n_steps

    run = eig3.integrate(coupled, (0, 5), [1.0, 2.0, 3.0], [0.0] * 3, h=0.1, params=(1, 2, 3), save_every=7)
    expected = np.full(run.u.shape, np.nan)
    for row in zip(run.t, run.u, run.v, expected, strict=True):
        coupled(*row[:3], np.array([1.0, 2.0, 3.0]), row[3])
    np.testing.assert_allclose(run.a, expected, rtol=0, atol=1e-14)


def test_a_problem_that_follows_work_has_the_accelerations_of_its_masses():
    problem = eig3.problems.shear_building(work=True)
    run = problem.integrate(h=1e-3, t_end=0.5, save_every=10)
    without = eig3.problems.shear_building().integrate(h=1e-3, t_end=0.5, save_every=10)
    assert run.a.shape == run.u.shape
    np.testing.assert_allclose(run.a, without.a, rtol=0, atol=1e-12 * np.abs(run.a).max())
    np.testing.assert_allclose(run.at(0.123), without.at(0.123), rtol=0, atol=1e-12 * np.abs(run.v).max())


def test_members_of_an_ensemble_have_accelerations():
    params = np.array([[1.0], [2.0], [3.0]])
    together = eig3.ensemble(hardening, (0, 2), 1.0, 0.0, h=0.1, params=params, save_every=2)
    for i, p in enumerate(params):
        alone = eig3.integrate(hardening, (0, 2), 1.0, 0.0, h=0.1, params=p, save_every=2)
        # the states agree except for round-off
        np.testing.assert_allclose(together[i].a, alone.a, rtol=0, atol=1e-13)
        np.testing.assert_allclose(together[i].at(1.23), alone.at(1.23), rtol=0, atol=1e-13)
    copied = pickle.loads(pickle.dumps(together))[1]
    assert copied.a is None
    assert np.isfinite(copied.at(1.23)).all()


def test_copies_keep_the_accelerations():
    run = eig3.integrate(coupled, (0, 5), [1.0, 2.0, 3.0], [0.0] * 3, h=0.1, params=(1, 2, 3), method="rk8")
    for other in (pickle.loads(pickle.dumps(run)), copy.copy(run), copy.deepcopy(run)):
        assert np.array_equal(other.a, run.a)
        assert np.array_equal(other.at(1.23), run.at(1.23))


def test_without_accelerations_the_polynomials_are_cubic():
    def errors(h):
        t = np.linspace(0, 10, round(10 / h) + 1)
        solution = hand_made(t, np.sin(t), np.cos(t), "rk8")
        assert solution.a is None
        fine = np.linspace(0, 10, 1237)
        u, v = solution.at(fine)
        return np.array([np.abs(u - np.sin(fine)).max(), np.abs(v - np.cos(fine)).max()])

    np.testing.assert_allclose(np.log2(errors(0.1) / errors(0.05)), [4, 3], atol=0.1)


def test_a_right_hand_side_that_fails_leaves_cubic_polynomials():
    run = eig3.integrate(fragile, (0, 1), 1.0, 0.0, h=0.1, params=0.0, method="rk4")
    run._accelerations.args[1][0] = 1.0  # from now on it fails at t = 1
    with pytest.raises(ValueError, match="too late"):
        run.a  # noqa: B018
    cubic = hand_made(run.t, run.u, run.v)
    assert np.array_equal(run.at(0.97), cubic.at(0.97))
    assert not np.array_equal(run.at(0.55), cubic.at(0.55))  # where rhs can be evaluated
    copied = pickle.loads(pickle.dumps(run))
    assert copied.a is None
    assert np.array_equal(copied.at(0.55), cubic.at(0.55))


def test_accelerations_that_are_not_finite_are_not_used():
    t = np.linspace(0, 1, 11)

    def accelerations(t, u, v):
        return np.where(t > 0.99, np.inf, -np.sin(t))

    solution = hand_made(t, np.sin(t), np.cos(t), "rk4", accelerations)
    cubic = hand_made(t, np.sin(t), np.cos(t))
    fine = np.linspace(0, 1, 101)
    last = fine > 0.9
    assert np.array_equal(solution.at(fine[last]), cubic.at(fine[last]))
    # (h/2)^6 / 6! is the term of degree 6
    np.testing.assert_allclose(solution.at(fine[~last])[0], np.sin(fine[~last]), rtol=0, atol=0.05**6 / 720)


# States that are too far apart ---------------------------------------------------------------------------------------

TOO_FAR = r"^the saved states around t = .* are too far apart to interpolate between them, .* save_every=1 .* t_eval\.$"


#: A ball on a floor with Hertz's contact.
bouncing = eig3.jit(lambda t, u, v, p: -9.81 + p[0] * max(-u, 0.0) ** 1.5)


def test_a_run_with_two_states_says_that_nothing_is_known_between_them():
    options = {"h": 1e-4, "params": 1e6, "method": "rk4"}
    run = eig3.integrate(bouncing, (0, 1.5), 1.0, 0.0, save_every=None, **options)
    with pytest.warns(UserWarning, match=TOO_FAR):
        u, _ = run.at(0.7)
    full = eig3.integrate(bouncing, (0, 1.5), 1.0, 0.0, **options)
    assert abs(u - full.at(0.7)[0]) > 0.5  # of a motion of 1 m


def test_a_contact_between_two_states_is_noticed_around_it_only():
    options = {"h": 1e-4, "params": 1e6, "method": "rk4", "save_every": 1000}
    run = eig3.integrate(bouncing, (0, 0.8), 1.0, 0.0, **options)
    contact = np.searchsorted(run.t, math.sqrt(2 / 9.81))  # 0.45 s
    away = np.delete((run.t[1:] + run.t[:-1]) / 2, contact - 1)
    run.at(away)  # without a warning
    with pytest.warns(UserWarning, match=TOO_FAR):
        run.at(run.t[contact - 1] + 0.05)


def sampled(per_period, method, periods=12):
    """States of cos t, which the method could have reached in steps a hundredth as long."""
    t = 2 * np.pi / per_period * np.arange(round(periods * per_period) + 1) + 0.3
    solution = hand_made(t, np.cos(t), -np.sin(t), method, lambda t, u, v: -u)
    solution.h /= 100
    return solution


@pytest.mark.parametrize("method", ["rk4", "rk8", "eig10"])
@pytest.mark.parametrize("per_period", [1.2, 1.7, 2.6, 3.1, 4.1, 7.1])
def test_the_estimated_error_is_that_of_the_interpolation(method, per_period):
    """It is meant to be right within a factor of four; the motion has the size 2, and the largest error is asked."""
    solution = sampled(per_period, method)
    fine = np.linspace(solution.t[0], solution.t[-1], 4001)
    estimate = solution._errors(fine)
    true = np.abs(solution._interpolated(fine)[0] - np.cos(fine)).max() / 2
    assert np.array_equal(*estimate)  # one degree of freedom
    assert 0.25 < estimate[0].max() / true < 4


@pytest.mark.parametrize("keeps_rhs", [True, False])
@pytest.mark.parametrize(("per_period", "is_enough"), [(1.5, False), (4, True)])
def test_less_than_two_states_a_period_are_too_few(per_period, is_enough, keeps_rhs):
    solution = sampled(per_period, "rk4")
    if not keeps_rhs:
        solution = pickle.loads(pickle.dumps(solution))
    times = (solution.t[1:] + solution.t[:-1]) / 2
    if is_enough:
        solution.at(times)
    else:
        with pytest.warns(UserWarning, match=TOO_FAR):
            solution.at(times)


def test_the_saved_states_themselves_can_always_be_asked_for():
    solution = sampled(1.5, "rk4")
    assert np.array_equal(solution.at(solution.t), [solution.u, solution.v])
    assert np.array_equal(solution.at(solution.t[-1]), [solution.u[-1], solution.v[-1]])


def test_every_step_is_enough_however_long_it_is():
    solution = sampled(1.5, "rk4")
    solution.h *= 100
    solution.at(solution.t[:-1] + 1.0)


def test_a_stiff_direction_magnifies_no_error():
    """The second degree follows the square of the first, held by a stiffness of 1e9 / s^2.

    In intervals of 0.4 s the quintic for cos^2 t has an error of about (2 * 0.4)^6 / 46080 / 2 = 3e-6, and f there
    differs by 3e3 m / s^2. Without the stiffness, this would stand for an error of 0.4^2 / 12 * 3e3 = 40 m.
    """

    def accelerations(t, u, v):
        return np.stack([-np.cos(t), -2 * np.cos(2 * t) - 1e9 * (u[:, 1] - np.cos(t) ** 2)], axis=1)

    t = np.arange(0, 8, 0.4)
    u, v = np.stack([np.cos(t), np.cos(t) ** 2], axis=1), np.stack([-np.sin(t), -np.sin(2 * t)], axis=1)
    solution = hand_made(t, u, v, "rk4", accelerations)
    solution.h = 1e-5
    fine = np.linspace(0, t[-1], 500)
    found = solution.at(fine)[0]  # without a warning
    error = np.abs(found[:, 1] - np.cos(fine) ** 2).max()
    assert 0.1 * error < solution._errors(fine)[0].max() < 4 * error


def test_a_load_between_two_states_of_rest_is_noticed():
    def pulse(t, u, v):
        return np.where((t > 40) & (t < 60), 1.0, 0.0) - u - v

    t = np.array([0.0, 100.0])
    solution = hand_made(t, 0 * t, 0 * t, "rk4", pulse)
    solution.h = 0.01
    with pytest.warns(UserWarning, match=TOO_FAR):
        solution.at(10.0)


def test_round_off_at_rest_is_no_motion():
    """A mass in equilibrium, with the round-off of u = 1 and a stiffness of 1e6 / s^2."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, 10, 30)
    noise = rng.normal(scale=1e-16, size=30)
    solution = hand_made(t, 1 + noise, 1e3 * noise, "rk4", lambda t, u, v: -1e6 * (u - 1))
    solution.h = 1e-4
    solution.at(np.linspace(0, 10, 100))


def test_only_the_intervals_of_the_wanted_times_are_looked_at_once():
    rows = []

    def accelerations(t, u, v):
        rows.append(len(t))
        return -u

    solution = sampled(8, "rk4")
    solution._accelerations = accelerations
    solution.at(solution.t[[3, 3, 7]] + 0.01)
    assert sum(rows) == 2 * 2 * 3 + 2 * 4  # two at each of three points, and the ends, for the estimate and for u and v
    rows.clear()
    solution.at(solution.t[[3, 7]] + 0.02)
    assert sum(rows) == 4


@pytest.mark.parametrize("method", ["rk5", "rk8"])
def test_runs_with_loose_tolerances_are_fine_enough(method):
    run = eig3.integrate(hardening, (0, 30), 1.0, 0.0, params=2.0, rtol=1e-2, method=method)
    fine = np.linspace(0, 30, 1000)
    run.at(fine)
    pickle.loads(pickle.dumps(run)).at(fine)
    wanted = eig3.integrate(hardening, (0, 30), 1.0, 0.0, params=2.0, rtol=1e-2, method=method, t_eval=[0, 9, 30])
    with pytest.warns(UserWarning, match=TOO_FAR):
        wanted.at(fine)


def test_impacts_that_a_run_found_need_no_further_states():
    run = eig3.problems.bouncing_ball().integrate(h=1e-3, save_every=None)
    assert len(run.t) == 2
    full = eig3.problems.bouncing_ball().integrate(h=1e-3)
    np.testing.assert_allclose(run.at(full.t), full.at(full.t), rtol=0, atol=1e-9)
