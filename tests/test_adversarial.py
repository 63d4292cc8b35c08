"""Numbers at the edges of floating point and right-hand sides that misbehave: each ends in a status or an error."""

import numpy as np
import pytest

import eig3
from eig3 import integrate

from .conftest import ALL_METHODS, WITHOUT_VELOCITY, oscillator, oscillator_vector, python, spring
from .test_integrate import raises_later, raises_later_vector

EVERY_METHOD = ALL_METHODS + WITHOUT_VELOCITY
LEAST = 5e-324  # the distance of denormal numbers
EPS = 2.0**-52


def ids(method):
    if not isinstance(method, eig3.CentralDifference):
        return f"{method!r}{method.velocity}" if isinstance(method, eig3.EIG3) else repr(method)
    return f"CD({method.velocity}, {method.solver})"


every_method = pytest.mark.parametrize("method", EVERY_METHOD, ids=ids)
both_forms = pytest.mark.parametrize("form", ["scalar", "vector"])


@eig3.jit
def spring_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[0] * p[0] * u[j]


def linear(method, form, omega, u0, v0):
    """The arguments of an oscillator at 5 per cent damping, or none for a method without velocity."""
    scalar, vector = (spring, spring_vector) if method.ignores_velocity else (oscillator, oscillator_vector)
    params = (omega, 0.05)
    if form == "scalar":
        return {"rhs": scalar, "u0": u0, "v0": v0, "params": params, "method": method}
    weights = np.array([1.0, -0.5, 0.25])
    return {"rhs": vector, "u0": u0 * weights, "v0": v0 * weights, "params": params, "method": method}


# Small and large numbers ---------------------------------------------------------------------------------------------


@every_method
@both_forms
@pytest.mark.parametrize(("h", "u0"), [(0.25, 2.0**-1030), (64.0, 2.0**-1060), (64.0, LEAST)])
def test_denormal_amplitudes_are_those_of_the_larger_run(method, form, h, u0):
    """An evaluation errs by a few LEAST, which a step takes into u up to (1 + h)^2 times, and 80 steps add up."""
    span, omega, large = (0, 80 * h), 0.5 / h, 2.0**1000
    small = integrate(t_span=span, h=h, **linear(method, form, omega, u0, LEAST))
    scaled = integrate(t_span=span, h=h, **linear(method, form, omega, u0 * large, LEAST * large))
    assert small.success
    assert scaled.success
    np.testing.assert_allclose(small.u, scaled.u / large, rtol=0, atol=3 * 80 * (1 + h) ** 2 * LEAST)


@eig3.jit
def damped_chain(t, u, v, p, a):
    n = u.size
    for j in range(n):
        left, left_v = (u[j - 1], v[j - 1]) if j > 0 else (0.0, 0.0)
        right, right_v = (u[j + 1], v[j + 1]) if j < n - 1 else (0.0, 0.0)
        a[j] = p[0] * (left - 2 * u[j] + right) + p[1] * (left_v - 2 * v[j] + right_v)


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
def test_solves_at_denormal_amplitudes_end(solver):
    """The residual stops at the round-off of denormals, which no tolerance relative to v reaches."""
    method = eig3.CentralDifference(solver=solver)
    random = np.random.default_rng(1)
    for _ in range(60):
        h, u0 = 10 ** random.uniform(-2, 3), 10 ** random.uniform(-323, -305) * random.normal(size=20)
        omega, xi = random.uniform(0.05, 1.5) / h, random.uniform(0, 0.2)
        params = (omega**2 / 4, omega * xi / 2)
        run = integrate(damped_chain, (0, 100 * h), u0, omega * u0[::-1], h=h, params=params, method=method)
        assert run.success, run.message


@every_method
@both_forms
def test_denormal_parameters(method, form):
    """The stiffness is that of LEAST, the square of its root."""
    rhs, state = (spring, (1.0, 0.5)) if form == "scalar" else (spring_vector, ([1.0], [0.5]))
    run = integrate(rhs, (0, 8), *state, h=0.125, params=LEAST**0.5, method=method, save_every=None)
    assert LEAST**0.5 * LEAST**0.5 == LEAST
    assert run.success
    assert np.all(run.u[-1] == 5)  # powers of two: 1 + 8 / 2, and no force that could be seen
    assert np.all(run.v[-1] == 0.5)


@every_method
@both_forms
def test_overflow_keeps_the_finite_part(method, form):
    problem = linear(method, form, 3.0, 1e300, 0.0)
    if method.is_implicit:
        problem["params"] = (3.0, 0.0)  # a solve could fail first
    run = integrate(t_span=(0, 300), h=3.0, **problem)
    assert run.status is eig3.Status.DIVERGED
    assert "non-finite" in run.message
    assert 0 < run.n_steps < 100
    assert run.t.tolist() == [3.0 * i for i in range(run.n_steps + 1)]
    whole = eig3.Stepper(t0=0.0, h=3.0, **problem)
    for u, v in zip(run.u, run.v, strict=True):
        np.testing.assert_array_equal(u, whole.u)
        np.testing.assert_array_equal(v, whole.v)
        assert whole.is_finite
        whole.advance(1)


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
@both_forms
def test_solve_whose_tolerance_overflows_is_not_taken_for_solved(solver, form):
    """|v| + |w| of 1e308 each is infinite, and so is the tolerance that is a part of it."""
    method = eig3.CentralDifference(solver=solver)
    problem = linear(method, form, 1.0, 0.0, 1e308)
    run = integrate(t_span=(0, 1), h=0.1, **{**problem, "params": (1.0, 0.5)})
    assert run.status is eig3.Status.DIVERGED
    assert run.n_steps == 0


@every_method
@both_forms
@pytest.mark.parametrize("t_end", [1e200, 1.7e308])
def test_step_whose_square_overflows(method, form, t_end):
    run = integrate(t_span=(0, t_end), h=t_end / 3, save_every=2, **linear(method, form, 1.0, 1.0, 1.0))
    assert run.status is eig3.Status.DIVERGED
    assert np.isfinite(run.u).all()
    assert np.isfinite(run.v).all()


@every_method
@both_forms
def test_step_longer_than_the_span_is_the_span(method, form):
    problem = linear(method, form, 1.0, 1.0, 1.0)
    run = integrate(t_span=(0, 1), h=1e300, **problem)
    assert (run.n_steps, run.h, run.t.tolist()) == (1, 1.0, [0, 1])
    np.testing.assert_array_equal(run.u, integrate(t_span=(0, 1), h=1.0, **problem).u)


@every_method
@both_forms
def test_short_spans(method, form):
    for t_end, h in ((1e-300, 1e-302), (1e-318, 1e-320)):
        run = integrate(t_span=(0, t_end), h=h, **linear(method, form, 1.0, 1.0, 1.0))
        assert run.success
        assert run.n_steps in (100, 101)  # 1e-318 has five digits
        np.testing.assert_array_equal(run.u[-1], run.u[0])
        np.testing.assert_array_equal(run.v[-1], run.v[0])


@pytest.mark.parametrize(
    ("t_span", "h", "message"),
    [
        ((0, 1), LEAST, "so that steps can be counted"),
        ((0, 1e300), 1.0, "so that steps can be counted"),
        ((0, LEAST), LEAST, "for floating-point times"),
        ((0, 1e-322), 1e-323, "for floating-point times"),
        ((1, 1 + 1e-14), 1e-16, "for floating-point times"),
        ((1e300, 1.0001e300), 1e283, "for floating-point times"),
    ],
)
def test_steps_too_small_are_refused(t_span, h, message):
    with pytest.raises(ValueError, match=message):
        integrate(oscillator, t_span, 1.0, 0.0, h=h, params=(1.0, 0.1))


def test_times_saved_do_not_overflow_past_the_span():
    free = eig3.jit(lambda t, u, v, p: 0.0)
    # three steps, of which every second is saved: a fourth would end past the largest number
    run = integrate(free, (0, 1.7e308), 1.0, 0.0, h=6e307, save_every=2, method="ab2")
    assert run.success
    assert run.t.tolist() == [0, 2 * run.h, 1.7e308]
    assert run.u.tolist() == [1, 1, 1]


@pytest.mark.parametrize("method", WITHOUT_VELOCITY, ids=ids)
@both_forms
@pytest.mark.parametrize(("u0", "v0"), [(0.0, 1e20), (1e300, 0.0), (1e300, 1e300), (0.0, 1e308), (LEAST, LEAST)])
def test_force_that_reads_velocity_is_seen_at_every_amplitude(method, form, u0, v0):
    problem = linear(eig3.RK2(), form, 1.0, u0, v0)
    with pytest.raises(ValueError, match="ignores v"):
        integrate(t_span=(0, 1), h=0.1, **{**problem, "method": method})


# A right-hand side that is not finite, or raises ----------------------------------------------------------------------

bad_once = eig3.jit(lambda t, u, v, p: p[1] if t == p[0] else -u)


@eig3.jit
def bad_once_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j]
    if t == p[0]:
        a[1] = p[1]


STEP = 1 / 64  # so that t0 + i h is exact
STATES = {"scalar": (bad_once, 1.0, 0.0), "vector": (bad_once_vector, np.array([1.0, 2.0, 3.0]), np.zeros(3))}


def run_bad_once(method, form, time, value, **options):
    rhs, u0, v0 = STATES[form]
    return integrate(rhs, (0, 1), u0, v0, h=STEP, params=(time, value), method=method, **options)


@every_method
@both_forms
@pytest.mark.parametrize(("value", "time"), [(np.nan, STEP), (np.inf, 0.5), (-np.inf, 0.5)])
def test_one_value_that_is_not_finite_ends_the_run(method, form, value, time):
    run = run_bad_once(method, form, time, value, save_every=3)
    assert run.status is eig3.Status.DIVERGED
    assert time - STEP <= run.t[-1] <= time  # where the last step before that evaluation ends
    assert np.isfinite(run.u).all()
    assert np.isfinite(run.v).all()
    assert "non-finite at t = " in run.message
    assert f"rhs gives {value} at t = {time}" in run.explain()
    healthy = run_bad_once(method, form, 2.0, value)
    np.testing.assert_array_equal(run.u[-1], healthy.u[run.n_steps])


@pytest.mark.parametrize(("method", "form"), [("eig3", "vector"), ("cd", "scalar")])
def test_one_nan_ends_the_run_inline(method, form):
    run = run_bad_once(method, form, 0.5, np.nan, inline=True)
    assert run.status is eig3.Status.DIVERGED


@every_method
@both_forms
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_stage_that_is_not_finite_ends_the_run(method, form, value):
    """Half a step after t_n there is a stage of RK3 and RK4, and no other method looks."""
    run = run_bad_once(method, form, 0.5 + STEP / 2, value)
    if isinstance(method, eig3.RK3 | eig3.RK4):
        assert run.status is eig3.Status.DIVERGED
        assert run.t[-1] == 0.5
    else:
        assert run.success
        np.testing.assert_array_equal(run.u, run_bad_once(method, form, 2.0, value).u)


@pytest.mark.parametrize(("alpha", "beta"), [(-1.0, 0.5), (1.0, -1.0), (-1.0, -1.0)])
@both_forms
def test_nan_of_no_weight_is_not_lost(alpha, beta, form):
    """alpha or beta of -1 gives a_n the weight zero, and zero times NaN is NaN."""
    run = run_bad_once(eig3.EIG3(alpha=alpha, beta=beta), form, 0.5, np.nan)
    assert run.status is eig3.Status.DIVERGED
    assert run.t[-1] == 0.5


undefined_slope = eig3.jit(lambda t, u, v, p: np.nan)


@eig3.jit
def undefined_slope_vector(t, u, v, p, J):
    J[0, 0] = np.nan


@both_forms
def test_jacobian_that_is_not_finite_is_a_failed_solve(form):
    method = eig3.CentralDifference(jacobian=undefined_slope_vector if form == "vector" else undefined_slope)
    run = integrate(t_span=(0, 1), h=0.1, **linear(method, form, 1.0, 1.0, 0.0))
    assert run.status is eig3.Status.NOT_CONVERGED
    assert run.n_steps == 0


@every_method
@pytest.mark.parametrize(
    ("rhs", "u0", "v0"), [(raises_later, 1.0, 0.0), (raises_later_vector, [1.0, 2.0, 3.0], [0.0] * 3)]
)
def test_exception_comes_through_with_the_part_before(method, rhs, u0, v0):
    options = {"u0": u0, "v0": v0, "h": STEP, "method": method}
    with pytest.raises(ValueError, match="past the end of the record") as caught:
        integrate(rhs, (0, 8), params=5.0, **options)
    partial = caught.value.solution
    assert partial.status is eig3.Status.INTERRUPTED
    assert "raised ValueError" in partial.message
    assert 5 - STEP <= partial.t[-1] <= 5 + STEP  # a step may look further ahead, or only at its start
    if method == eig3.EIG3():  # f is evaluated at t = 5 + STEP in the step that begins there
        assert (partial.t[-1], partial.n_steps) == (5 + STEP, 5 / STEP + 1)
    whole = integrate(rhs, (0, 8), params=9.0, **options)
    np.testing.assert_array_equal(partial.u, whole.u[: partial.n_steps + 1])
    np.testing.assert_array_equal(partial.v, whole.v[: partial.n_steps + 1])
    with pytest.raises(ValueError, match="past the end of the record") as caught:
        integrate(rhs, (0, 8), params=-1.0, **options)
    assert not hasattr(caught.value, "solution")  # it never ran


# A right-hand side that writes where it must not ---------------------------------------------------------------------

WITHIN_BOUNDS = """
import eig3

@eig3.jit
def oscillator(t, u, v, p, a):
    a[:] = -u

eig3.integrate(oscillator, (0, 1), [1.0, 2.0], [0.0, 0.0], h=0.01)
"""

OUT_OF_BOUNDS = """
import eig3

@eig3.jit
def writes_past_the_end(t, u, v, p, a):
    for j in range(u.size + (t > p[0])):
        a[j] = -u[j]

for inline in (False, True):
    try:
        eig3.integrate(writes_past_the_end, (0, 1), [1.0, 2.0], [0.0, 0.0], h=0.01, params=0.5, inline=inline)
    except IndexError as error:
        assert 0.5 < error.solution.t[-1] < 0.52
        assert "IndexError" in error.solution.message
    else:
        raise AssertionError("not noticed")
"""


@pytest.mark.system
def test_index_out_of_bounds_is_an_error_where_it_is_asked_for(tmp_path):
    for checked in ("0", "1"):  # checked code does not take the place of unchecked code in one cache, and vice versa
        code = OUT_OF_BOUNDS if checked == "1" else WITHIN_BOUNDS
        python("-c", code, cwd=tmp_path, NUMBA_BOUNDSCHECK=checked, NUMBA_CACHE_DIR=str(tmp_path))


@eig3.jit
def changes_u(t, u, v, p, a):
    a[0] = -u[0]
    if t >= p[0]:
        u[0] = 0.5


@eig3.jit
def changes_v(t, u, v, p, a):
    a[0] = -u[0]
    if t >= p[0]:
        v[0] *= 0.5


@eig3.jit
def changes_p(t, u, v, p, a):
    a[0] = -u[0]
    if t >= p[0]:
        p[1] += 1


@eig3.jit
def changes_p_scalar(t, u, v, p):
    if t >= p[0]:
        p[1] += 1
    return -u


@pytest.mark.parametrize("method", ["eig3", "cd"])
@pytest.mark.parametrize("rhs", [changes_u, changes_v, changes_p, changes_p_scalar])
def test_rhs_that_writes_to_what_it_is_given_is_refused(method, rhs):
    """Whenever it would do so: it does not compile."""
    state = (1.0, 1.0) if rhs is changes_p_scalar else ([1.0], [1.0])
    for inline in (False, True):
        with pytest.raises(TypeError, match=r"rhs must not write to u, v or p; it may only read them\."):
            integrate(rhs, (0, 1), *state, h=STEP, params=(0.5, 0.0), method=method, inline=inline)


@eig3.jit
def jacobian_that_writes(t, u, v, p, J):
    u[0] = 1.0
    J[0, 0] = 0.0


@eig3.jit
def invariant_that_writes(t, u, v, p):
    v[0] = 1.0
    return 0.0


def test_jacobian_and_invariant_only_read_too():
    start = {"t_span": (0, 1), "u0": [1.0], "v0": [0.0], "h": STEP, "params": (2.0, 0.0)}
    with pytest.raises(TypeError, match="jacobian must not write"):
        integrate(
            spring_vector, **start, method=eig3.CentralDifference(velocity="implicit", jacobian=jacobian_that_writes)
        )
    with pytest.raises(TypeError, match=r"invariants\['e'\] must not write"):
        integrate(spring_vector, **start, invariants={"e": invariant_that_writes})


# Size ----------------------------------------------------------------------------------------------------------------


@every_method
def test_a_million_degrees_of_freedom(method):
    n = 10**6
    u0 = np.linspace(-1, 1, n)
    problem = {"h": 0.1, "params": (2.0, 0.0), "method": method, "save_every": None}
    run = integrate(spring_vector, (0, 0.4), u0, -u0, **problem)
    assert run.success
    for j in (0, 1, 314159, n - 1):  # four steps, multiply-adds fused or not
        scalar = integrate(spring, (0, 0.4), u0[j], -u0[j], **problem)
        np.testing.assert_allclose(run.u[:, j], scalar.u, rtol=0, atol=16 * EPS)
        np.testing.assert_allclose(run.v[:, j], scalar.v, rtol=0, atol=16 * EPS)


# Arrays of every kind ------------------------------------------------------------------------------------------------


def read_only(values):
    values.flags.writeable = False
    return values


@pytest.mark.parametrize(
    "u0",
    [
        [1, 2, 3],
        (1.0, 2.0, 3.0),
        np.array([1, 2, 3], dtype=np.int8),
        np.array([1, 2, 3], dtype=np.uint64),
        np.array([1, 2, 3], dtype=np.float32),
        np.array([1, 2, 3], dtype=np.float16),
        np.array([1, 2, 3], dtype=np.longdouble),
        np.array([1, 2, 3], dtype=">f8"),
        np.array([1.0, 9.0, 2.0, 9.0, 3.0])[::2],
        np.array([3.0, 2.0, 1.0])[::-1],
        np.asfortranarray([[1.0, 9.0], [2.0, 9.0], [3.0, 9.0]])[:, 0],
        np.frombuffer(b"x" + np.array([1.0, 2.0, 3.0]).tobytes(), dtype=np.uint8)[1:].view(np.float64),
        read_only(np.array([1.0, 2.0, 3.0])),
        np.ma.array([1.0, 2.0, 3.0], mask=False),
    ],
    ids=lambda u0: f"{type(u0).__name__}-{getattr(u0, 'dtype', '')}-{getattr(u0, 'strides', '')}",
)
def test_arrays_of_every_kind_are_taken_as_they_read(u0):
    options = {"h": 0.01, "params": (2.0, 0.1)}
    run = integrate(oscillator_vector, (0, 1), u0, u0, **options)
    plain = integrate(oscillator_vector, (0, 1), np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]), **options)
    np.testing.assert_array_equal(run.u, plain.u)
    np.testing.assert_array_equal(run.v, plain.v)


@pytest.mark.parametrize("one", [1, True, np.float32(1), np.int16(1), np.bool_(True), np.array(1.0), np.array(1)])
def test_numbers_of_every_kind_are_taken_as_they_read(one):
    run = integrate(oscillator, (0, one), one, one, h=one, params=one * np.array([1.0, 0.0]))
    plain = integrate(oscillator, (0, 1), 1.0, 1.0, h=1.0, params=(1.0, 0.0))
    assert run.u.tolist() == plain.u.tolist()
    assert run.u.ndim == 1


@pytest.mark.parametrize(
    "values",
    [
        np.ma.array([1.0, 2.0], mask=[False, True]),
        np.array([1.0, None]),
        np.array([1.0, 2j]),
        np.array(["1", "2"]),
        np.array(["2020", "2021"], dtype="M8[Y]"),
        np.array([(1.0, 2.0)], dtype=[("x", float), ("y", float)]),
        [1.0, [2.0, 3.0]],
        {"x": 1.0},
        None,
    ],
    ids=lambda values: f"{type(values).__name__}-{getattr(values, 'dtype', '')}",
)
@pytest.mark.parametrize("argument", ["u0", "v0", "params", "t_span", "h"])
def test_what_is_not_made_of_numbers_is_refused(values, argument):
    if argument == "params" and isinstance(values, dict):
        values = {1.0}  # a dictionary gives names to parameters
    if argument == "h" and values is None:
        values = "none"  # None stands for tolerances
    good = {"t_span": (0, 1), "u0": [1.0, 2.0], "v0": [1.0, 2.0], "h": 0.1, "params": (1.0, 0.0)}
    with pytest.raises(TypeError, match=f"{argument} must be made of real numbers, not ") as caught:
        integrate(oscillator_vector, **{**good, argument: values})
    assert "\n" not in str(caught.value)
