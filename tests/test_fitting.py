"""Derivatives of runs against closed forms and against the derivatives of the steps themselves, and fits to data."""

import re
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.stats import chi2

import eig3
from eig3 import problems
from eig3.effects import GiuffreMenegottoPinto, Gravity, Rod
from eig3.fitting.estimates import _DEPENDENT, early_note, loose_note
from eig3.fitting.series import History
from eig3.fitting.stencils import differences
from eig3.result.resampling import resampled
from eig3.scene import Scene

from .conftest import refusals

damped = eig3.jit(lambda t, u, v, p: -p.k * u - p.c * v)
damped_of_array = eig3.jit(lambda t, u, v, p: -p[0] * u - p[1] * v)
duffing = eig3.jit(lambda t, u, v, p: p.a * t - p.c * v - p.k * u - u * u * u)


@eig3.jit
def chain(t, u, v, p, a):
    stretch = u[1] - u[0]
    a[0] = (-p.k[0] * u[0] + p.k[1] * stretch - p.c * v[0]) / p.m[0]
    a[1] = (-p.k[1] * stretch - p.c * v[1]) / p.m[1]
    if u.size > 2:
        a[2] = v[0] * v[0] + v[1] * v[1]


@eig3.jit
def forces(t, u, v, p, out):
    out[0] = p.k[0] * u[0]
    out[1] = p.k[1] * (u[1] - u[0])


restoring = eig3.jit(lambda t, u, v, p: p.k * u)
undefined = eig3.jit(lambda t, u, v, p: np.nan)

TRUE = {"k": 4.0, "c": 0.2, "u0": 1.0, "v0": 0.5}
TIMES = np.linspace(0, 10, 41)
OSCILLATOR = eig3.Problem("oscillator", damped, 1.0, 0.5, {"k": 4.0, "c": 0.2}, (0, 10), units="m")
CHAIN = eig3.Problem(
    "chain", chain, [0.1, 0.0], [0.0, 0.2], {"k": np.array([30.0, 20.0]), "c": 0.3, "m": np.array([1.0, 2.0])},
    (0, 5), names=("low", "high"), z0={"speed": 0.0}
)  # fmt: skip


def motion(t, k, c, u0, v0):
    """The damped oscillation, also for complex arguments."""
    omega = np.sqrt(k - c * c / 4 + 0j)
    return np.exp(-c * t / 2) * (u0 * np.cos(omega * t) + (v0 + c * u0 / 2) / omega * np.sin(omega * t))


def complex_step(function, values, name):
    """The derivative to the last digits: no difference is taken."""
    return function(**{**values, name: values[name] + 1e-30j}).imag / 1e-30


def steps_of_rk4(f, u, v, h, count):
    """The displacements of the classical method of the order 4, for complex values too."""
    found = [u]
    for n in range(count):
        t = n * h
        u1, v1 = v, f(t, u, v)
        u2, v2 = v + h / 2 * v1, f(t + h / 2, u + h / 2 * u1, v + h / 2 * v1)
        u3, v3 = v + h / 2 * v2, f(t + h / 2, u + h / 2 * u2, v + h / 2 * v2)
        u4, v4 = v + h * v3, f(t + h, u + h * u3, v + h * v3)
        u, v = u + h / 6 * (u1 + 2 * u2 + 2 * u3 + u4), v + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
        found.append(u)
    return np.array(found)


@pytest.mark.parametrize(("method", "order"), [("eig3", 2), ("rk4", 4)])
def test_derivatives_converge_to_the_closed_forms_to_the_order_of_the_method(method, order):
    errors = []
    for h in (0.05, 0.025):
        found = eig3.sensitivities(OSCILLATOR, TRUE, h=h, method=method, save_every=2, check=True)
        exact = [complex_step(partial(motion, found.t), TRUE, name) for name in TRUE]
        errors.append(np.abs(found.derivatives.u - exact).max(axis=1))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)
    estimates = np.abs(found.step_errors.u).max(axis=1)
    assert estimates == pytest.approx(errors[1], rel=0.1)  # Richardson's estimate has a relative error of the size of h


def test_the_step_is_halved_where_it_does_not_divide_the_span():
    """The same times, with 7 and 14 steps. Half of the given step would need 13 steps."""
    found = eig3.sensitivities(OSCILLATOR, "k", h=1.6, t_end=10.0, method="rk4", check=True)
    assert found.t.shape == found.step_errors.u[0].shape == (8,)


EIGHTHS = st.integers(-16, 16).map(lambda i: i / 8)


@settings(max_examples=30, deadline=None)
@given(k=st.floats(0.5, 30.0), c=st.integers(0, 8).map(lambda i: i / 8), a=EIGHTHS, u0=EIGHTHS, v0=EIGHTHS)
def test_the_errors_are_bounds_of_the_differences_from_the_derivatives_of_the_steps(k, c, a, u0, v0):
    values = {"k": k, "c": c, "a": a, "u0": u0, "v0": v0}

    def steps(k, c, a, u0, v0):
        return steps_of_rk4(lambda t, u, v: a * t - c * v - k * u - u * u * u, u0, v0, 0.04, 100)

    problem = eig3.Problem("duffing", duffing, u0, v0, {"k": k, "c": c, "a": a}, (0, 4))
    found = eig3.sensitivities(problem, values, h=0.04, method="rk4")
    for i, name in enumerate(values):
        exact = complex_step(steps, values, name)
        error = np.abs(found.derivatives.u[i] - exact)
        last_bits = 1e-15 * np.abs(exact).max()
        assert (error <= found.errors.u[i] + last_bits).all(), name
        assert error.max() <= 1e-6 * np.abs(exact).max() + 1e-9


def test_a_linear_motion_is_the_sum_of_its_derivatives_by_the_start():
    found = eig3.sensitivities(OSCILLATOR, ["u0", "v0"], h=0.02)
    assert 1.0 * found["u0"].u + 0.5 * found["v0"].u == pytest.approx(found.states.u, abs=1e-11)
    other = eig3.sensitivities(OSCILLATOR.with_(u0=-3.0, v0=0.0), ["u0", "v0"], h=0.02)
    assert other.derivatives.u == pytest.approx(found.derivatives.u, abs=1e-11)
    assert found["u0"].u[0] == pytest.approx(1, abs=1e-12)
    assert found["v0"].v[0] == pytest.approx(1, abs=1e-12)


def test_derivatives_by_a_start_with_constraints_have_the_order_of_the_method():
    """A member that starts slightly off the constraints starts from the nearest state that keeps them."""
    scene = Scene(dimension=2)
    scene.add(Rod(), scene.fixed((0, 0)), scene.mass(1.0, (0.6, -0.8), velocity=(0.8, 0.6)))
    scene.add(Gravity((0, -9.81)))
    swing, names = scene.problem((0, 1)), ["u0[0]", "v0[0]"]
    coarse, fine = (eig3.sensitivities(swing, names, h=h, method="rk8", save_every=None) for h in (0.02, 0.01))
    for name in names:
        errors = 10 * coarse.errors[names.index(name)].u[-1].max()
        np.testing.assert_allclose(coarse[name].u[-1], fine[name].u[-1], rtol=0, atol=min(errors, 1e-6))
    for nearest in (coarse["u0[0]"].u[0], coarse["v0[0]"].v[0]):
        np.testing.assert_allclose(nearest, [0.64, 0.48], rtol=1e-6)  # (1, 0) less its part along the rod


def test_steps_of_differences_follow_the_size_of_the_value_or_of_the_motion():
    problem = OSCILLATOR.with_(u0=-3.0, v0=0.0, params={"k": 4.0, "c": 0.0})
    speed = np.abs(problem.integrate(h=0.02).v).max()
    steps = eig3.sensitivities(problem, ["u0", "v0", "c"], h=0.02).steps
    assert 4 < speed < 8
    assert steps == {"u0": 2.0**-11, "v0": 2.0**-10, "c": 2.0**-12}
    steps = eig3.sensitivities(CHAIN.with_(v0=[5e-324, 0.0]), ["u0[1]", "v0[0]"], h=0.02).steps
    assert 2.0**-18 < steps["u0[1]"] < 2.0**-12
    assert 2.0**-18 < steps["v0[0]"] < 2.0**-12
    assert eig3.sensitivities(problem, "u0", h=0.02, steps={"u0": 0.3}).steps == {"u0": 0.25}


def test_values_of_arrays_outputs_and_integrals_have_derivatives():
    """Beside central differences of single runs."""
    names, options = (
        ["k[1]", "m[0]", "u0[0]", "v0[1]"],
        {"h": 0.01, "method": "rk4", "outputs": {"forces": (forces, 2)}},
    )
    found = eig3.sensitivities(CHAIN, names, **options)
    assert found["m[0]"].outputs["forces"].shape == (501, 2)

    def run(name, change):
        values = {"k": [30.0, 20.0], "m": [1.0, 2.0], "u0": [0.1, 0.0], "v0": [0.0, 0.2]}
        head, i = name[:-3], int(name[-2])
        values[head][i] += change
        params = CHAIN.params._replace(**{key: np.array(values[key]) for key in "km"})
        problem = CHAIN.with_(u0=values["u0"], v0=values["v0"], params=params)
        return problem.integrate(**options)

    for name in names:
        more, less, own = run(name, 1e-5), run(name, -1e-5), found[name]
        assert own.u == pytest.approx((more.u - less.u) / 2e-5, abs=1e-6)
        assert own.v == pytest.approx((more.v - less.v) / 2e-5, abs=1e-6)
        assert own.z["speed"] == pytest.approx((more.z["speed"] - less.z["speed"]) / 2e-5, abs=1e-6)
        output = (more.outputs["forces"] - less.outputs["forces"]) / 2e-5
        assert own.outputs["forces"] == pytest.approx(output, abs=1e-5)


def test_at_other_times_derivatives_are_those_of_the_interpolated_motion():
    times = np.array([0.0, 0.013, 2.5, 4.996, 5.0])
    options = {"h": 0.01, "method": "rk4", "outputs": {"forces": (forces, 2)}}
    some = eig3.sensitivities(CHAIN, ["k[0]", "c"], t_eval=times, **options)
    fine = eig3.sensitivities(CHAIN, ["k[0]", "c"], **{**options, "h": 0.001})
    u, v = CHAIN.integrate(h=0.01, method="rk4").at(times)
    assert some.states.u == pytest.approx(u, abs=1e-12)
    assert some.states.v == pytest.approx(v, abs=1e-12)
    rows = np.round(times / 0.001).astype(int)
    for now, then in ((some.states, fine.states), (some["k[0]"], fine["k[0]"]), (some["c"], fine["c"])):
        assert now.u == pytest.approx(then.u[rows], abs=1e-6)
        assert now.v == pytest.approx(then.v[rows], abs=1e-5)
        assert now.outputs["forces"] == pytest.approx(then.outputs["forces"][rows], abs=1e-4)
        assert now.z["speed"] == pytest.approx(then.z["speed"][rows], abs=1e-5)


def test_impacts_have_derivatives_except_between_the_impacts_of_the_members():
    """The derivative jumps at an impact, which is at t = sqrt(2 h0 / g); the differences of h0 move it by 6e-5."""
    h0, after = 1.0, np.sqrt(2 / 9.81) + 3e-5
    times = np.array([0.1, 0.3, 0.5, 0.9, 1.1, 1.3])
    ball = problems.bouncing_ball(h0=h0, t_end=1.4)
    found = eig3.sensitivities(ball, "u0", h=0.02, t_eval=times)
    more, less = (problems.bouncing_ball(h0=h0 + d, t_end=1.4).exact(times)[0] for d in (1e-5, -1e-5))
    assert found["u0"].u == pytest.approx((more - less) / 2e-5, abs=1e-8)  # of the differences of the exact motion
    assert (found.errors.u < 1e-6).all()
    close = eig3.sensitivities(ball, "u0", h=0.02, t_eval=[0.3, after, 0.5])
    assert close.errors.u[0, 0] < 1e-6
    assert (close.errors.u[0, 1:] > 0.1).all()


def test_parameters_without_names_give_the_same_derivatives():
    array = eig3.Problem("oscillator", damped_of_array, 1.0, 0.5, [4.0, 0.2], (0, 10))
    found = eig3.sensitivities(array, ["p[1]", "p[0]"], h=0.02)
    named = eig3.sensitivities(OSCILLATOR, ["c", "k"], h=0.02)
    assert found.derivatives.u == pytest.approx(named.derivatives.u, abs=1e-9)
    assert eig3.sensitivities(array, "p[0]", h=0.02)["p[0]"].u == pytest.approx(found["p[0]"].u, abs=1e-9)


def test_a_structure_with_a_sparse_stiffness_has_derivatives():
    """Its motion is linear in the strength of the record, and the work is quadratic."""
    n = 30  # more than run in lanes
    K = 2e3 * scipy.sparse.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    ground = np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 0.0])
    frame = eig3.linear(np.ones(n), 0.1 * K, K, ground=ground, t_span=(0, 2), work=True)
    found = eig3.sensitivities(frame, ["ground_scale", "u0[3]"], h=1e-3)
    assert found["ground_scale"].u == pytest.approx(found.states.u, abs=1e-11)
    work = found.states.z["work"]
    assert found["ground_scale"].z["work"] == pytest.approx(2 * work, abs=1e-9 * np.abs(work).max())
    with pytest.raises(TypeError, match=r"^K is a sparse matrix"):
        eig3.sensitivities(frame, "K[3]", h=1e-3)


def test_a_member_that_diverges_is_named():
    problem = OSCILLATOR.with_(params={"k": 4e4, "c": 0.2})
    limit = problem.critical_step(method="rk4", safety=1.0).h
    with pytest.raises(eig3.IntegrationError, match=r"^The run with k = .* fails") as caught:
        eig3.sensitivities(problem.with_(t_span=(0, 1000 * limit)), "k", h=1.05 * limit, method="rk4")
    assert caught.value.solution.status is eig3.Status.DIVERGED
    with pytest.raises(ValueError, match=r"^outputs\['f'\] must be finite, but is not with k = 4\.$"):
        eig3.sensitivities(OSCILLATOR, "k", h=0.1, outputs={"f": undefined})


def test_the_picture_of_sensitivities_in_text_has_sizes_and_errors():
    found = eig3.sensitivities(OSCILLATOR, ["k", "c"], h=0.02, save_every=10)
    line = r"  k = 4: \|du/dk\| is at most 0\.\d+; error of differences \de-0\d\n  c = 0\.2: .*\n"
    last = r"  The error of the steps is not in these: check=True estimates it\."
    assert re.fullmatch(rf"Sensitivities at 51 times:\n{line}{last}", repr(found))
    found = eig3.sensitivities(OSCILLATOR, ["k", "c"], h=0.02, save_every=10, check=True)
    assert re.search(r"k = 4: .*; error of differences \de-0\d, of the steps 0\.00\d\n", repr(found))
    with pytest.raises(KeyError, match="no kk: did you mean k"):
        found["kk"]


def slopes(problem, names="k", **options):
    return eig3.sensitivities(problem, names, h=0.1, **options)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("kk", r"oscillator has no kk: did you mean k\?"),
        ("stiffness", r"oscillator has no stiffness: did you mean u0 or v0 or k or c\?"),
        ("k[0]", r"parameters must name k without an index of oscillator, not k\[0\]"),
        ("u0[1]", r"parameters must name u0 without an index"),
        ([], "parameters must name at least one parameter"),
        (["k", "c", "k"], "parameters must name each value once, but k is there twice"),
        ([3], r"parameters must hold names such as .* not 3"),
        ("k[", r"parameters must hold names such as"),
    ],
)
def test_wrong_names_are_refused(names, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        eig3.sensitivities(OSCILLATOR, names, h=0.1)


WHOLE = eig3.Problem("oscillator", damped, 1.0, 0.5, {"k": 4, "c": 0.2}, (0, 10))
test_wrong_entries_and_options_are_refused = refusals(
    {
        r"^parameters must name an entry k\[0\] to k\[1\] of chain, not k\[2\]\.$": lambda: slopes(CHAIN, "k[2]"),
        r"^parameters must name an entry u0\[0\] to u0\[1\] of chain, not u0\.$": lambda: slopes(CHAIN, "u0"),
        r"^array has no k: its parameters have numbers, p\[0\] to p\[1\], in the order of problem.params. Other names "
        r"are u0, v0\.$": lambda: slopes(eig3.Problem("array", damped_of_array, 1.0, 0.5, [4.0, 0.2], (0, 10))),
        "^t_eval must lie within t_span, from 0.0 to 10.0, not at 11.0": lambda: slopes(OSCILLATOR, t_eval=[0, 11]),
        "^steps must have names of parameters, which have no c": lambda: slopes(OSCILLATOR, steps={"c": 0.1}),
        r"^steps\['k'\] must be a positive, finite number, not 0\.$": lambda: slopes(OSCILLATOR, steps={"k": 0}),
    },
    {"^k is a whole number in the parameters: write it as a real one": lambda: slopes(WHOLE)},
)


@given(middle=st.floats(0.0, 1.0), coefficients=st.lists(st.floats(-3, 3), min_size=5, max_size=5))
def test_differences_are_exact_for_polynomials_of_the_degree_4(middle, coefficients):
    polynomial = np.polynomial.Polynomial(coefficients)
    chosen = differences(np.array([middle]), np.array([0.3]))
    values = polynomial(chosen.rows)
    found = chosen.derivatives(History(values, values, {}, {})).u
    assert found[0, 0] == pytest.approx(polynomial.deriv()(middle), abs=1e-10)
    error = chosen.errors(History(values, values, {}, {}), 1).u[0, 0]  # that of D(2 d) less that of D(d), where d = 1/4
    assert error == pytest.approx(abs(polynomial.deriv(3)(middle)) / 2 * 0.25**2, abs=1e-10)


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=5), st.integers(1, 9))
def test_resampled_values_are_those_of_a_polynomial_of_the_degree_5(times, count):
    t = np.linspace(0.0, 3.0, count + 1)
    polynomial = np.polynomial.Polynomial([1.0, -2.0, 0.5, 1.0, -0.3, 0.1][: count + 1])
    found = resampled(t, polynomial(t), np.array(times))
    assert found == pytest.approx(polynomial(np.array(times)), abs=1e-10)
    assert (resampled(t, polynomial(t), t) == polynomial(t)).all()


RK4 = {"h": 0.05, "method": "rk4"}


def exact_data(times=TIMES):
    return times, OSCILLATOR.integrate(**RK4).at(times)[0]


def test_a_fit_starts_its_runs_as_the_problem_does():
    """A link that moves back at the start turns, and a start off the constraints is refused."""
    turning = eig3.linear([1.0], links=[(GiuffreMenegottoPinto(1.0, 1.0, 0.05), None, 0)], t_span=(0, 5), u0=3.0, v0=-1)
    data = TIMES[:20], turning.integrate(h=0.01, t_eval=TIMES[:20]).u
    assert eig3.fit(turning, data, {"v0[0]": -1.1}, h=0.01).values["v0[0]"] == pytest.approx(-1, rel=1e-9)  # _TOLERANCE
    scene = Scene(dimension=2)
    scene.add(Rod(), scene.fixed((0, 0)), scene.mass(1.0, (1, 0)))
    scene.add(Gravity((0, -9.81)))
    swing = scene.problem((0, 1))
    data = [0.5, 1.0], np.ones((2, 2))
    with pytest.raises(ValueError, match=r"The run with u0\[0\] = 1.1 fails: u0 must keep the constraints"):
        eig3.fit(swing, data, {"u0[0]": 1.1}, h=0.01)
    with pytest.raises(ValueError, match=r"params must be 0 at \[..., 1\]"):
        eig3.fit(swing, data, "p[1]", h=0.01)


def test_a_fit_to_exact_data_finds_the_parameters_and_the_start():
    result = eig3.fit(OSCILLATOR, exact_data(), {"k": 3.5, "c": 0.0, "u0": 0.7, "v0": 0.0}, **RK4)
    assert result.success
    assert result.values == pytest.approx(TRUE, abs=1e-9)
    assert result.scatter < 1e-9
    assert result.problem.params == eig3.Parameters({name: result.values[name] for name in "kc"})
    assert (result.problem.u0, result.problem.v0) == (result.values["u0"], result.values["v0"])
    assert np.abs(result.residuals["u"]).max() < 1e-9
    assert result.n_runs > 17


@pytest.mark.parametrize("steps", [{"h": 0.05}, {"h": 0.07}, {"rtol": 1e-5}, {"rtol": 1e-5, "atol": [[1e-6], [1e-5]]}])
def test_the_time_steps_shift_the_parameters_by_their_error(steps):
    """The data are exact. The estimate is of the first order in h, and errors are only about in proportion to rtol."""
    data = TIMES, motion(TIMES, **TRUE).real
    result = eig3.fit(OSCILLATOR, data, TRUE, {"u0": (1.0, 1.0)}, **steps)
    for name in ("k", "c", "v0"):
        assert result.step_errors[name] == pytest.approx(abs(result.values[name] - TRUE[name]), rel=0.4)
    assert np.isnan(result.step_errors["u0"])
    assert "The time steps shift k, c" in result.message
    noisy = eig3.fit(OSCILLATOR, data, TRUE, sigma=1.0, h=0.05)
    assert "shift" not in noisy.message


@eig3.jit
def with_a_stop(t, u, v, p):
    return 0.3 * np.cos(t) - 0.1 * v - p.k * u - (p.stop * (u - 0.3) if u > 0.3 else 0.0)


@pytest.mark.parametrize("steps", [{"rtol": 1e-6}, {"rtol": 1e-10, "atol": 1e-6}])
def test_a_fit_with_tolerances_finds_the_parameters_of_a_motion_with_kinks(steps):
    """Other parameters have other steps, which change u by its error, up to 3e-5; the first values change it by 0.7."""
    problem, t = eig3.Problem("stop", with_a_stop, 1.0, 0.0, {"k": 1.0, "stop": 30.0}, (0, 20)), np.linspace(0, 20, 101)
    data = t, problem.integrate(rtol=1e-11, t_eval=t).u
    result = eig3.fit(problem, data, {"k": 1.1, "stop": 27.0}, **steps)
    assert result.values["k"] == pytest.approx(1.0, abs=1e-3)
    assert result.values["stop"] == pytest.approx(30.0, rel=1e-3)


def test_a_fit_takes_several_series_with_times_of_their_own():
    times = {
        "low": np.linspace(0, 4, 40),
        "v1": np.linspace(0.1, 3, 17),
        "speed": [1.0, 2.0],
        "forces": [0.25, 0.5, 4.5],
    }
    options = {"h": 0.005, "outputs": {"forces": (forces, 2)}}
    run = CHAIN.integrate(method="rk4", **options)
    measured = {name: CHAIN.integrate(method="rk4", t_eval=t, **options) for name, t in times.items()}
    data = {
        "low": (times["low"], measured["low"].u[:, 0]),
        "v1": (times["v1"], measured["v1"].v[:, 1]),
        "speed": (times["speed"], measured["speed"].z["speed"]),
        "forces": (times["forces"][::-1], measured["forces"].outputs["forces"][::-1]),  # in any order
    }
    sigma = {"low": 1e-3, "v1": np.full(17, 1e-2), "speed": 0.1, "forces": [[0.1, 0.2]]}
    first = {"k[0]": 25.0, "k[1]": 24.0, "m[1]": 1.7}
    result = eig3.fit(CHAIN, data, first, sigma=sigma, method="rk4", **options)
    assert result.values == pytest.approx({"k[0]": 30.0, "k[1]": 20.0, "m[1]": 2.0}, rel=1e-9)
    assert [*result.residuals] == ["low", "v1", "speed", "forces[0]", "forces[1]"]
    assert result.problem.params.k == pytest.approx([30.0, 20.0])
    assert result.problem.integrate(method="rk4", h=0.005).u == pytest.approx(run.u, abs=1e-9)
    both = eig3.fit(CHAIN, (run.t, run.u), ["c"], h=0.005, method="rk4")
    assert both.values["c"] == pytest.approx(0.3, rel=1e-9)
    assert [*both.residuals] == ["u0", "u1"]


def test_standard_errors_are_those_of_fits_to_other_noise():
    """With the covariance C, d C^-1 d of the p errors d has the distribution of chi^2 with p degrees of freedom.

    The sum over n seeds has n p of them. A right covariance fails for one choice of the seeds in 1000. It is that of
    linear regression, sigma^2 (J^T J)^-1 with the closed form of the derivatives J.
    """
    seeds, sigma, (t, u) = 40, 0.02, exact_data()
    freedom, distances, squares = len(t) - len(TRUE), [], []
    for seed in range(seeds):
        noisy = u + sigma * np.random.default_rng(seed).normal(size=u.size)
        result = eig3.fit(OSCILLATOR, (t, noisy), TRUE, sigma=sigma, **RK4)
        error = np.array([result.values[name] - value for name, value in TRUE.items()])
        assert (np.abs(error) < 5 * np.array([*result.errors.values()])).all()
        distances.append(error @ np.linalg.solve(result.covariance, error))
        squares.append(result.scatter**2)
        assert squares[-1] == pytest.approx(((result.residuals["u"] / sigma) ** 2).sum() / freedom)
    J = np.array([complex_step(partial(motion, t), result.values, name) for name in TRUE])
    spread = np.outer(*[[*result.errors.values()]] * 2)
    np.testing.assert_allclose(result.covariance / spread, sigma**2 * np.linalg.inv(J @ J.T) / spread, atol=1e-4)
    for total, count in ((np.sum(distances), seeds * len(TRUE)), (freedom * np.sum(squares), seeds * freedom)):
        low, high = chi2.ppf([0.0005, 0.9995], count)
        assert low < total < high
    assert np.diag(result.correlation) == pytest.approx(1)
    assert np.abs(result.correlation).max() <= 1 + 1e-12
    unknown = eig3.fit(OSCILLATOR, (t, noisy), TRUE, **RK4)
    assert unknown.values == pytest.approx(result.values, rel=1e-7)
    assert unknown.scatter == pytest.approx(sigma * result.scatter)
    np.testing.assert_allclose(unknown.covariance / spread, result.scatter**2 * result.covariance / spread, atol=1e-5)


@pytest.mark.parametrize(("first", "bounds"), [(0.5, {"c": (0.3, None), "k": (0, 20)}), (0.3, {"c": (0.3, 0.3)})])
def test_a_parameter_at_a_bound_is_held(first, bounds):
    data = exact_data()
    result = eig3.fit(OSCILLATOR, data, {"k": 3.5, "c": first}, bounds, **RK4)
    assert result.at_bound == ("c",)
    assert result.values["c"] == 0.3
    assert np.isnan(result.errors["c"])
    alone = eig3.fit(OSCILLATOR.with_(params={"k": 3.5, "c": 0.3}), data, "k", **RK4)
    equal = bounds["c"] == (0.3, 0.3)
    assert result.values["k"] == pytest.approx(alone.values["k"], rel=1e-12 if equal else 1e-6)
    assert result.errors["k"] == pytest.approx(alone.errors["k"], rel=1e-6 if equal else 1e-4)
    assert "c = 0.3 (held)" in repr(result)


@eig3.jit
def with_a_root(t, u, v, p):
    return -4 * u - np.sqrt(p.c) * v  # NaN beyond the bound


def test_no_run_has_values_beyond_the_bounds():
    problem = eig3.Problem("root", with_a_root, 1.0, 0.5, {"c": 0.0}, (0, 10))
    result = eig3.fit(problem, exact_data(), "c", {"c": (0, 1)}, **RK4)
    assert result.values["c"] == pytest.approx(0.04, rel=1e-6)


def test_a_fit_takes_the_runs_and_finds_the_least_squares_of_scipy(monkeypatch):
    """Over the runs that a user would prepare. The derivatives take one run for each parameter."""
    t, u = exact_data()
    noisy, first = u + 0.05 * np.random.default_rng(2).normal(size=u.size), {"k": 3.0, "c": 0.5}
    run = OSCILLATOR.prepare(t_eval=t, **RK4)

    def residuals(x):
        residuals.count += 1
        return run(params={"k": x[0], "c": x[1]}).u - noisy

    residuals.count = 0
    alone = least_squares(residuals, [*first.values()])
    result = eig3.fit(OSCILLATOR, (t, noisy), first, **RK4)
    assert result.n_runs <= 1.2 * residuals.count
    assert [*result.values.values()] == pytest.approx(alone.x, rel=1e-7)
    assert (result.residuals["u"] ** 2).sum() / 2 <= alone.cost * (1 + 1e-9)
    with_tolerances = eig3.fit(OSCILLATOR, (t, noisy), first, rtol=1e-8)
    assert with_tolerances.values == pytest.approx(result.values, rel=1e-4)
    assert with_tolerances.n_runs <= 1.2 * residuals.count


shaken = eig3.jit(lambda t, u, v, p: eig3.math.interp(t, p.t, p.force) - p.c * v - p.k * u - p.k3 * u**3)


def test_a_fit_with_tolerances_where_a_record_has_corners():
    """The steps, and so the errors, jump with the parameters: short differences would show nothing else.

    A fit with fixed steps, whose errors are far below the noise, finds the least squares.
    """
    rng, t = np.random.default_rng(0), np.linspace(0, 20, 2001)
    force = 3 * np.convolve(rng.normal(size=t.size), np.ones(20) / 20, "same")
    true = {"c": 0.3, "k": 20.0, "k3": 50.0, "t": t, "force": force}
    problem = eig3.Problem("shaken", shaken, 0.0, 0.0, true, (0, 20))
    u = problem.integrate(h=0.01, method="rk4").u + rng.normal(0, 1e-3, t.size)
    first = {"c": 0.5, "k": 15.0, "k3": 10.0}
    exact = eig3.fit(problem, (t, u), first, h=0.01, method="rk4")
    found = eig3.fit(problem, (t, u), first, rtol=1e-6)
    for name, value in exact.values.items():
        assert found.values[name] == pytest.approx(value, abs=0.5 * exact.errors[name])
        assert found.errors[name] == pytest.approx(exact.errors[name], rel=0.3)  # noise is a tenth of a difference
    assert "least sum" not in found.message


def test_a_fit_that_ended_early_says_so():
    """The residuals are along a derivative, unless they are errors of the steps; at a least sum, they are across."""
    jacobian, along, across = np.eye(3)[:, :2], np.array([1.0, 2.0, 0.0]), np.array([0.0, 0.0, 3.0])
    assert "not at the least sum" in early_note(jacobian, along, 1e-3 * along)
    assert not early_note(jacobian, along, along)
    assert not early_note(jacobian, across, 0 * across)


held_at = eig3.jit(lambda t, u, v, p: -p.k * (u - p.x))


def test_the_notes_of_the_run_are_in_sensitivities_and_fits():
    """With 3 steps in a period, a run has a note."""
    coarse = {"h": 1.0, "method": "rk4"}
    (note,) = OSCILLATOR.integrate(**coarse, save_every=None).notes
    found = eig3.sensitivities(OSCILLATOR, "k", **coarse)
    result = eig3.fit(OSCILLATOR, exact_data(), "k", **coarse)
    assert found.notes == (note,)
    assert result.notes == result.problem.integrate(**coarse, t_eval=TIMES).notes != ()
    assert note in repr(found)
    assert result.notes[0] in repr(result)


def test_a_parameter_with_the_least_influence_is_not_tied_to_itself():
    note = loose_note(["k", "c"], np.array([False, True]), np.diag([1.0, 2 * _DEPENDENT]))
    assert note == " The data do not depend on c: leave it out of parameters."


def test_residuals_that_are_larger_than_the_spread_of_the_data_are_reported():
    """No k moves the oscillation to the mean 9 of the data. In other fits, noise, round-off or sigma explain them."""
    t, u = exact_data()
    result = eig3.fit(OSCILLATOR, (t, u + 9), "k", **RK4)
    assert "and the data have only 0." in result.message
    assert "the standard errors mean nothing" in result.message
    assert not result.success
    resting = OSCILLATOR.with_(u0=0.0, v0=0.0)
    constant, still = np.full_like(t, 9.0), eig3.Problem("still", held_at, 9.0, 0.0, {"k": 4.0, "x": 8.9}, (0, 10))
    for problem, data, name, sigma in (
        (OSCILLATOR, u, "k", None),
        (still, constant, "x", None),
        (resting, np.random.default_rng(0).normal(size=t.size), "v0", None),
        (OSCILLATOR, u + 9, "k", 10.0),
    ):
        result = eig3.fit(problem, (t, data), name, sigma=sigma, **RK4)
        assert "mean nothing" not in result.message
        assert result.success


def test_missing_values_of_a_table_leave_out_their_entries_alone():
    run = CHAIN.integrate(h=0.01, method="rk4", save_every=10)
    table = run.u.copy()
    table[3, 0] = table[7, 1] = table[20] = np.nan
    result = eig3.fit(CHAIN, (run.t, table), {"c": 0.1}, h=0.01, method="rk4")
    assert result.values["c"] == pytest.approx(0.3, rel=1e-9)
    assert [*np.flatnonzero(np.isnan(result.residuals["u0"]))] == [3, 20]
    assert [*np.flatnonzero(np.isnan(result.residuals["u1"]))] == [7, 20]
    assert "to 98 values" in repr(result)


def test_tables_of_pandas_are_data():
    pandas = pytest.importorskip("pandas")
    run = CHAIN.integrate(h=0.01, method="rk4", save_every=10)
    frame, given = run.to_pandas(), {"h": 0.01, "method": "rk4"}
    for data in (frame[["low", "v_high"]], frame["low"], {"high": frame["high"]}):
        assert eig3.fit(CHAIN, data, {"c": 0.1}, sigma=0.1, **given).values["c"] == pytest.approx(0.3, rel=1e-9)
    u = pandas.Series(OSCILLATOR.integrate(**RK4).u, index=OSCILLATOR.integrate(**RK4).t)
    assert eig3.fit(OSCILLATOR, u, {"c": 0.1}, **RK4).values["c"] == pytest.approx(0.2, rel=1e-9)
    with pytest.raises(ValueError, match="data must have names of quantities, but there is no w"):
        eig3.fit(OSCILLATOR, u.rename("w"), {"c": 0.1}, **RK4)


def test_a_first_value_with_which_the_run_diverges_is_named_with_a_shorter_step():
    with pytest.raises(
        eig3.IntegrationError, match=r"^The run with k = 40000 fails: .* h = 0\.\d+ was tried and is stable"
    ):
        eig3.fit(OSCILLATOR, exact_data(), {"k": 4e4}, h=0.05)


with_a_mass = eig3.jit(lambda t, u, v, p: -(p.k * u + p.c * v) / p.m)


def test_parameters_that_the_data_do_not_determine_are_named():
    problem = eig3.Problem(
        "mass", with_a_mass, 1.0, 0.5, {"m": 1.0, "k": 4.0, "c": 0.2, "idle": 1.0, "none": 0.0}, (0, 10)
    )
    result = eig3.fit(problem, exact_data(), {"m": 1.1, "k": 4.0, "c": 0.2, "u0": 1.1}, **RK4)
    assert result.message.endswith("do not tell m, k and c apart: leave one of them out of parameters.")
    assert [result.errors[name] for name in "mkc"] == [np.inf] * 3
    assert result.errors["u0"] < 1
    result = eig3.fit(problem, exact_data(), ["k", "idle"], **RK4)
    assert result.message.endswith("The data do not depend on idle: leave it out of parameters.")
    all_of_them = ["m", "k", "c", "idle", "none", "u0"]
    result = eig3.fit(problem, exact_data(), all_of_them, **RK4)
    assert "The data do not depend on idle or none: leave them out of parameters." in result.message
    assert result.message.endswith("do not tell m, k and c apart: leave one of them out of parameters.")
    result = eig3.fit(problem, exact_data(), ["k", "idle"], **RK4)
    assert "idle = 1 +- inf" in repr(result)


with_an_edge = eig3.jit(lambda t, u, v, p: -4 * u - np.sqrt(p.c - 0.5) * v)


def test_a_fit_comes_back_from_trials_that_fail():
    """The first step of Gauss and Newton leads to the root of a negative number. Only the first run must not fail."""
    problem = eig3.Problem("edge", with_an_edge, 1.0, 0.5, {"c": 0.51}, (0, 1))
    t = np.linspace(0, 1, 21)
    data = t, problem.integrate(t_eval=t, **RK4).u
    result = eig3.fit(problem, data, {"c": 9.5}, **RK4)
    assert result.success
    assert result.values["c"] == pytest.approx(0.51, rel=1e-6)
    with pytest.raises(ValueError, match=r"^The run with c = 0\.4 fails: rhs gives nan"):
        eig3.fit(problem, data, {"c": 0.4}, **RK4)


T, U = exact_data()
GOOD = {"data": (T, U), "parameters": ["k", "c"], **RK4}


BAD_VALUES = [
    ({"data": {}}, "data must hold at least one series"),
    ({"data": (T, U[1:])}, r"data must have m times of shape \(m,\) and values of shape \(m,\), not \(41,\)"),
    ({"data": (T, U * np.nan)}, "data must have finite times and values; only missing"),
    ({"data": (T, U + 1e160)}, "data must have squares with a finite sum: take a larger unit"),
    ({"data": (T + 1, U)}, r"data must have times within the problem's t_span = \(0, 10\), not 1 to 11"),
    ({"data": (T - 1, U)}, r"data must have times .* not -1 to 9"),
    ({"data": ([0.0] * 3, [1.0] * 3)}, "data must have a time after the start of the run at t = 0"),
    ({"data": (T[:2], U[:2])}, "data must hold at least 3 values for 2 parameters and their scatter"),
    ({"data": (T[1:2], U[:1]), "sigma": 1}, "data must hold at least 2 values for 2 parameters, not 1"),
    (
        {"data": {"a": (T, U)}},
        "data must have names .*, and accelerations are none: give an output that calls rhs",
    ),
    ({"data": {"w": (T, U)}}, r"data must have names of quantities, but there is no w: did you mean"),
    ({"data": {"time": (T, T), "u": (T, U)}}, "data must have names of quantities, but there is no time: did you mean"),
    ({"data": {"u": (T, U), "v": (T, U)}}, "sigma must say how the series of data are weighted"),
    ({"data": {"u": (T, U)}, "sigma": {"v": 1}}, "sigma must have the standard deviation of u too"),
    ({"sigma": 0}, "sigma of u must be positive and finite"),
    ({"sigma": [1, 2]}, r"sigma of u must be a number or have the shape \(41,\) of the values, not \(2,\)"),
    ({"parameters": "kk"}, r"oscillator has no kk: did you mean k\?"),
    ({"parameters": {"k": np.nan}}, r"parameters\['k'\] must be a finite first value, not nan"),
    ({"bounds": {"u0": (0, 1)}}, "bounds must have names of parameters, which have no u0"),
    ({"bounds": {"k": (4, 4), "c": (0.2, 0.2)}}, "bounds must leave one parameter free"),
    ({"bounds": {"k": (5, 3)}}, r"bounds\['k'\] must be \(low, high\) with low <= high, not \(5, 3\)"),
    ({"bounds": {"k": (5, 7)}}, r"bounds\['k'\] = \(5, 7\) must contain the first value 4: .*\{'k': 6, "),
    ({"bounds": {"k": (None, 3)}}, r"bounds\['k'\] = \(-inf, 3\) must contain .*\{'k': -1, "),
    ({"h": 0}, "h must be a positive, finite number"),
    ({"h": None}, "give h for a fixed step, or rtol for tolerances"),
]
BAD_TYPES = [
    ({"data": U}, r"data must be a pair \(times, values\), not "),
    ({"data": (T, ["a"] * 41)}, "the values of data must be made of real numbers"),
    ({"outputs": restoring}, "outputs must be a dictionary of names and jitted functions"),
    ({"problem": damped}, r"problem must be an eig3\.Problem, not "),
    ({"parameters": 3}, "parameters must be a name such as 'k' or a sequence of names, not 3"),
    ({"parameters": {"k": "4"}}, r"parameters\['k'\] must be made of real numbers"),
    ({"bounds": (0, 1)}, r"bounds must be a dictionary such as \{'k': \(0, 10\)\}, not "),
    ({"bounds": {"k": 3}}, r"bounds\['k'\] must be a pair \(low, high\), not 3"),
]


@pytest.mark.parametrize(
    ("error", "change", "message"),
    [(ValueError, *row) for row in BAD_VALUES] + [(TypeError, *row) for row in BAD_TYPES],
)
def test_bad_arguments_of_a_fit_are_refused_before_anything_runs(change, error, message, monkeypatch):
    monkeypatch.setattr(eig3.Prepared, "member", None)
    with pytest.raises(error, match=f"^{message}"):
        eig3.fit(**{"problem": OSCILLATOR, **GOOD, **change})


def test_the_picture_of_a_fit(tmp_path, monkeypatch):
    output = {"force": restoring}
    force = OSCILLATOR.integrate(t_eval=T, outputs=output, **RK4).outputs["force"]
    data, sigma = {"u": (T, U), "force": (T[:30], force[:30])}, {"u": 0.1, "force": 1.0}
    result = eig3.fit(OSCILLATOR, data, ["k", "c"], outputs=output, sigma=sigma, **RK4)
    path = result.plot(tmp_path / "fit.svg", units={"force": "N/kg"})
    drawn = path.read_text()
    for label in ("u (m)", "force (N/kg)", "data - fit (m)", "data - fit (N/kg)", "t (s)", "k = 4.0"):
        assert f"<!-- {label}" in drawn
    assert drawn.count("<!-- data -->") == drawn.count("<!-- fit -->") == 2
    known = replace(result, problem=OSCILLATOR.with_(output_units={"force": "N/kg"}))
    assert "<!-- force (N/kg)" in known.plot(tmp_path / "known.svg").read_text()
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"^the picture of a fit needs matplotlib: pip install 'eig3\[plot\]'\.$"):
        result.plot(path)


def test_without_scipy_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    with pytest.raises(ImportError, match=r"^a fit needs SciPy: pip install 'eig3\[fitting\]'\.$"):
        eig3.fit(OSCILLATOR, **GOOD)


@pytest.mark.system
def test_the_derivatives_of_diffrax_are_the_same():
    pytest.importorskip("diffrax")
    from eig3.bench import gradients

    t_end, tolerance = 5.0, 1e-9
    exact = gradients.reference(t_end)
    for adjoint in ("forward", "reverse"):
        assert gradients._diffrax("Dopri8", adjoint, t_end, tolerance)() == pytest.approx(exact, abs=1e-6)
    lines = gradients.table(t_end, 1, has_diffrax=False).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == [
        f"eig3.sensitivities, {m}" for m in ("rk4", "rk8", "eig9")
    ]
