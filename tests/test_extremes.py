"""Extremes of outputs and invariants with tolerances: they are those of the motion, also between the ends of steps."""

import functools

import numpy as np
import pytest

import eig3
from eig3 import Event, Status, integrate

from .conftest import above_level, assert_same, falling, position, rebound, velocity

XI = 0.05
END = 20.0
DAMPED = np.sqrt(1 - XI**2)  # the circular frequency of the damped vibration; the undamped one is 1

oscillator = eig3.jit(lambda t, u, v, p: -u - 2 * p[0] * v)


@eig3.jit
def oscillators(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j] - 2 * p[0] * v[j]


@eig3.jit
def quadratic(t, u, v, p, out):
    out[0] = u
    out[1] = u * u
    out[2] = u * v
    out[3] = t * u


@eig3.jit
def quadratic_of_two(t, u, v, p, out):
    out[0] = u[0]
    out[1] = u[0] * u[0]
    out[2] = u[0] * v[0]
    out[3] = t * u[0]
    out[4] = u[1]


def u_of(t):
    return np.exp(-XI * t) * np.sin(DAMPED * t) / DAMPED


def v_of(t):
    return np.exp(-XI * t) * (np.cos(DAMPED * t) - XI / DAMPED * np.sin(DAMPED * t))


T = np.linspace(0, END, 400_001)  # its spacing changes an extreme by 1e-9 at most: 6 (5e-5 / 2)^2 / 2
VALUES = np.stack([u_of(T), u_of(T) ** 2, u_of(T) * v_of(T), T * u_of(T)])
# The first peak, where v = 0, in closed form.
PEAK_TIME = np.arctan2(DAMPED, XI) / DAMPED
PEAK = u_of(PEAK_TIME)

RUNS = [(method, rtol) for method in ("rk5", "rk8") for rtol in (1e-3, 1e-5, 1e-8, 1e-10)]
RUNS += [("eig3", rtol) for rtol in (1e-3, 1e-5, 1e-7)]


def vibration(**options):
    return integrate(oscillator, (0.0, END), 0.0, 1.0, params=XI, **options)


def run_error(run):
    u, v = (run.u, run.v) if run.u.ndim == 1 else (run.u[:, 0], run.v[:, 0])
    return max(np.abs(u - u_of(run.t)).max(), np.abs(v - v_of(run.t)).max())


@pytest.mark.parametrize(("method", "rtol"), RUNS)
def test_extremes_are_those_of_the_motion(method, rtol):
    """The factors are the derivatives of the values by u and v: 2 |u|, |u| + |v| and t. The dense output between the
    ends of steps has twice their error, or less."""
    run = vibration(rtol=rtol, method=method, outputs={"u": position, "more": (quadratic, 4)})
    within = 2 * run_error(run) * np.array([1, 2, 2, END]) + 1e-9
    assert run.extremes["u"].high == pytest.approx(PEAK, abs=2 * run_error(run))
    # near the peak v = -(t - t_peak) PEAK: the error of v moves it
    assert run.extremes["u"].t_high == pytest.approx(PEAK_TIME, abs=4 * run_error(run))
    low, high, t_low, t_high = run.extremes["more"]
    assert (np.abs(low - VALUES.min(axis=1)) < within).all()
    assert (np.abs(high - VALUES.max(axis=1)) < within).all()
    for times, places in ((t_low, VALUES.argmin(axis=1)), (t_high, VALUES.argmax(axis=1))):
        # the values have their extremes at these times: they are smooth, with second derivatives of 0.3 to 20
        assert (np.abs(times - T[places])[1:] < np.sqrt(8 * within[1:]) + 1e-4).all()
        assert times[0] == pytest.approx(T[places[0]], abs=8 * run_error(run) + 1e-4)


@pytest.mark.parametrize("method", ["rk5", "rk8", "eig3"])
def test_vector_form(method):
    options = {"rtol": 1e-6, "method": method, "params": XI}
    run = integrate(
        oscillators, (0.0, END), [0.0, 0.5], [1.0, 0.0], outputs={"all": (quadratic_of_two, 5)}, **options
    )  # fmt: skip
    low, high, _, t_high = run.extremes["all"]
    within = 2 * run_error(run) * np.array([1, 2, 2, END]) + 1e-9
    assert (np.abs(high[:4] - VALUES.max(axis=1)) < within).all()
    assert (np.abs(low[:4] - VALUES.min(axis=1)) < within).all()
    assert t_high[0] == pytest.approx(PEAK_TIME, abs=4 * run_error(run))
    assert (high[4], t_high[4]) == (0.5, 0.0)


same_extremes = functools.partial(assert_same, names=("extremes", "drift"))


@pytest.mark.parametrize("method", ["rk5", "rk8", "eig3"])
def test_they_do_not_depend_on_what_is_saved_nor_on_the_calls(method, monkeypatch):
    options = {"rtol": 1e-5, "method": method, "outputs": {"more": (quadratic, 4)}, "invariants": {"v": velocity}}
    run = vibration(**options)
    same_extremes(run, vibration(save_every=7, **options))
    same_extremes(run, vibration(save_every=None, **options))
    same_extremes(run, vibration(t_eval=[1.0, END], **options))
    first = integrate(oscillator, (0.0, 7.0), 0.0, 1.0, params=XI, **options)
    same_extremes(run, first.extend(END))
    monkeypatch.setattr("eig3.run.short.MOST_SECONDS", 0.0)
    monkeypatch.setattr("eig3.stepping.slices._SECONDS", 1e-12)  # a step in each call
    monkeypatch.setattr("eig3.stepping.slices._FIRST_SECONDS", 1e-12)
    same_extremes(run, vibration(**options))


def test_what_is_followed_leaves_the_motion_alone():
    """It only adds the evaluations of the dense output to the count: three in each step of RK8."""
    options = {"rtol": 1e-6, "method": "rk8"}
    run, alone = vibration(outputs={"u": position}, **options), vibration(**options)
    np.testing.assert_array_equal(run.u, alone.u)
    np.testing.assert_array_equal(run.steps, alone.steps)
    assert run.n_rhs == alone.n_rhs + 3 * run.n_steps


undefined_later = eig3.jit(lambda t, u, v, p: np.nan if t > 3.0 else u)


@eig3.jit
def first_undefined_later(t, u, v, p, out):
    out[0] = np.nan if t > 3.0 else u
    out[1] = u


def test_the_first_nan_stays_with_its_time():
    run = vibration(rtol=1e-8, outputs={"one": undefined_later, "two": (first_undefined_later, 2)})
    alone = vibration(rtol=1e-8, outputs={"u": position})
    step = run.steps[np.searchsorted(run.t, 3.0)]
    low, high, t_low, t_high = run.extremes["one"]
    assert np.isnan([low, high]).all()
    assert 3.0 < t_low == t_high < 3.0 + step / 2
    both = run.extremes["two"]
    assert (both.t_low[0], both.t_high[0]) == (t_low, t_high)
    assert np.isnan([both.low[0], both.high[0]]).all()
    for x, y in zip(both, alone.extremes["u"], strict=True):
        assert x[1] == y


saw = eig3.jit(lambda t, u, v, p: abs(u))


def test_an_output_with_a_kink_has_values_that_it_takes():
    """The polynomial through the values of |u| falls below zero."""
    for rtol in (1e-3, 1e-5, 1e-8):
        extremes = vibration(rtol=rtol, outputs={"size": saw, "u": position}).extremes
        assert extremes["size"].low == 0.0  # at the start
        assert extremes["size"].high == extremes["u"].high
        start = integrate(oscillator, (0.0, END), 0.5, 1.0, params=XI, rtol=rtol, outputs={"size": saw})
        assert 0 <= start.extremes["size"].low < 0.01


def test_an_invariant_drifts_at_the_ends_of_steps():
    run = vibration(rtol=1e-6, invariants={"v": velocity})
    assert run.drift["v"] == np.abs(run.v - 1).max()
    assert run.extremes["v"].low < run.v.min()


# Events --------------------------------------------------------------------------------------------------------------

speed = eig3.jit(lambda t, u, v, p: abs(v))


@pytest.mark.parametrize("method", ["rk5", "rk8", "eig3"])
@pytest.mark.parametrize("terminal", [False, True])
def test_the_states_before_and_after_an_impact_count(method, terminal):
    """A fall from 5 m with 10 m/s^2 ends after 1 s with -10 m/s, from where the ball rises with 5 m/s to 1.25 m."""
    run = integrate(
        falling, (0.0, 1.8), 5.0, 0.0, params=10.0, rtol=1e-6, method=method,
        events={"impact": Event(position, -1, apply=rebound, terminal=terminal)},
        outputs={"v": velocity, "speed": speed, "u": position},
    )  # fmt: skip
    assert run.status is (Status.TERMINATED if terminal else Status.COMPLETED)
    low, high, t_low, t_high = run.extremes["v"]
    assert (low, high) == pytest.approx((-10, 5), rel=1e-13)  # a polynomial of degree 2 has round-off only
    assert t_low == t_high == run.events["impact"].t[0]
    assert run.extremes["speed"].high == pytest.approx(10, rel=1e-13)
    assert run.extremes["u"].low == pytest.approx(0, abs=1e-13)


shifted = eig3.jit(lambda t, u, v, p: v + u / 10)


def test_a_peak_right_after_an_impact():
    """u = sin(t) / 2 after an impact, and v + u / 10 has its peak within the first step: atan(0.1) after the impact."""
    events, outputs = {"impact": Event(position, -1, apply=rebound)}, {"shifted": shifted}
    options = {"params": 0.0, "rtol": 1e-6, "save_every": 1000, "events": events, "outputs": outputs}
    run = integrate(oscillator, (0.0, np.pi / 2 + 1), 1.0, 0.0, method="rk8", **options)
    assert run.extremes["shifted"].high == pytest.approx(np.sqrt(1.01) / 2, abs=1e-6)  # a tolerance
    assert len(run.t) == 2  # only with save_every=1 is the state before an impact saved


stops = eig3.jit(lambda t, u, v, p: (p[1], 0.0))


@pytest.mark.parametrize("method", ["rk5", "rk8"])
@pytest.mark.parametrize("level", [0.99, 0.5])
@pytest.mark.parametrize("apply", [None, stops])
def test_a_part_of_a_step_up_to_an_event(method, level, apply):
    """The vibration passes the level on its way back, in the step that has the peak, or in another."""
    events = {"back": Event(above_level, -1, apply=apply, terminal=True)}
    options = {"rtol": 1e-6, "method": method, "params": (XI, level * PEAK)}
    run = integrate(oscillator, (0.0, END), 0.0, 1.0, events=events, outputs={"u": position}, **options)
    assert run.extremes["u"].high == pytest.approx(PEAK, abs=1e-5)  # some tolerances
    assert run.extremes["u"].t_high == pytest.approx(PEAK_TIME, abs=1e-5)


def test_a_peak_that_is_not_reached():
    """The step that would pass the peak ends at the event before it."""
    run = integrate(
        oscillator, (0.0, END), 0.0, 1.0, params=(XI, 0.8 * PEAK), rtol=1e-3, method="rk8",
        events={"up": Event(above_level, 1, terminal=True)}, outputs={"u": position},
    )  # fmt: skip
    assert run.extremes["u"].high == run.u[-1] == pytest.approx(0.8 * PEAK, rel=1e-12)
    assert run.extremes["u"].t_high == run.t[-1]
