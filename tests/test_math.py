"""eig3.math against mpmath, on a million points; and that LLVM vectorises a loop over each function."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import libmp, mp

import eig3
from eig3 import math as compiled

LARGEST_ANGLE = 1e8
OVERFLOW = math.log(np.finfo(float).max)
UNDERFLOW = -1074.9 * math.log(2)  # the smallest subnormal number is 2^-1074
NAMES = [name for name in compiled.__all__ if name not in ("sincos", "interp")]
EXACT = {
    "sin": libmp.mpf_sin, "cos": libmp.mpf_cos, "exp": libmp.mpf_exp, "log": libmp.mpf_log,
    "tanh": libmp.mpf_tanh, "sqrt": libmp.mpf_sqrt, "erfc": libmp.mpf_erfc
}  # fmt: skip
#: Largest errors in ulp. They are those that the docstrings promise.
BOUNDS = {"sin": 2, "cos": 2, "exp": 1, "log": 1, "tanh": 1, "sqrt": 0.5 + 1e-5, "erfc": 6}
PRECISION = 70  # bits of the exact values: 53 of the nearest double, and 17 beyond, so that an ulp is known to 1e-5

random = np.random.default_rng(14)


def values(name, x):
    function, out = getattr(compiled, name), np.empty(x.size)

    @eig3.jit
    def loop(x, out):
        for i in range(x.size):
            out[i] = function(x[i])

    loop(x, out)
    return out


def errors(name, x, computed=None):
    """The errors of values at x in ulp of the exact ones, which mpmath computes for every point."""
    exact, shift = EXACT[name], PRECISION - 53
    signs, heads, tails, exponents = [], [], [], []
    for number in x.tolist():
        sign, mantissa, exponent, length = exact(libmp.from_float(number), PRECISION, "n")
        mantissa = int(mantissa) << (PRECISION - length)
        signs.append(sign)
        heads.append(mantissa >> shift)
        tails.append(mantissa & ((1 << shift) - 1))
        exponents.append(exponent - (PRECISION - length) + shift)
    exponent = np.array(exponents)
    computed = values(name, x) if computed is None else computed
    computed = np.ldexp(computed * np.where(signs, -1, 1), -exponent)  # in units of the last bit of the head
    error = (computed - np.array(heads)) - np.ldexp(np.array(tails), -shift)
    return np.ldexp(abs(error), np.minimum(0, exponent + 1074))  # subnormal numbers have an ulp of 2^-1074


def spread(low, high, count):
    """Random numbers between two positive ones, uniform in their logarithm."""
    return np.exp(random.uniform(math.log(low), math.log(high), count))


def with_neighbours(x):
    x = np.asarray(x)
    return np.concatenate([x, np.nextafter(x, np.inf), np.nextafter(x, -np.inf)])


def closest_to_zeros():
    """The doubles closest to multiples of pi / 2, from the continued fractions of pi / 2 in units of their ulp."""
    found = []
    with mp.workprec(300):
        for exponent in range(-60, -25):
            rest = mp.pi / 2 * mp.mpf(2) ** -exponent
            numerator, before, multiple, multiple_before = 1, 0, 0, 1
            while multiple < LARGEST_ANGLE:
                whole = int(rest)
                numerator, before = whole * numerator + before, numerator
                multiple, multiple_before = whole * multiple + multiple_before, multiple
                found += [math.ldexp(j * numerator, exponent) for j in range(1, 9) if j * numerator < 2**53]
                rest = 1 / (rest - whole)
    return np.array([x for x in found if 0 < x <= LARGEST_ANGLE])


def angles():
    multiples = np.concatenate([np.arange(20_000), random.integers(0, 63_000_000, 40_000)])
    x = [
        random.uniform(0, 7, 50_000),
        random.uniform(0, LARGEST_ANGLE, 35_000),
        spread(1e-308, LARGEST_ANGLE, 20_000),
        multiples * (math.pi / 2),
        (random.integers(0, 63_000_000, 20_000) + 0.5) * (math.pi / 2),
        (random.integers(0, 63_000_000, 20_000) + random.uniform(0.31, 0.34, 20_000)) * (math.pi / 2),
        with_neighbours(2.0 ** np.arange(-1074, 27)),
        closest_to_zeros(),
        around(np.array([1, 3, 5]) * (math.pi / 4)),
        [0.0, LARGEST_ANGLE],
    ]
    return signed(x)


def signed(parts):
    x = np.concatenate(parts)
    return x * random.choice([-1.0, 1.0], x.size)


def around(centres, count=15_000):
    """Random numbers within 3 % of each centre, where a function passes from one polynomial or power to the next."""
    return np.concatenate([centre * random.uniform(0.97, 1.03, count) for centre in centres])


POINTS = {
    "sin": angles,
    "cos": angles,
    "exp": lambda: np.concatenate(
        [
            random.uniform(-1, 1, 70_000),
            random.uniform(UNDERFLOW, OVERFLOW, 60_000),
            random.uniform(UNDERFLOW, -708, 20_000),
            signed([spread(1e-308, 1, 10_000)]),
            with_neighbours((np.arange(-2149, 2047) / 2) * math.log(2)),
            around(np.array([-3, -1, 1, 3]) * (math.log(2) / 2)),
            [0.0, OVERFLOW, np.nextafter(OVERFLOW, 0), -5e-324],
        ]
    ),
    "log": lambda: np.concatenate(
        [
            random.uniform(0.5, 2, 80_000),
            random.integers(1, 0x7FF0000000000000, 60_000).view(float),  # every positive double is equally likely
            1 + signed([spread(1e-16, 0.5, 20_000)]),
            random.integers(1, 1 << 52, 20_000).view(float),  # subnormal
            with_neighbours(np.ldexp(1.0, np.arange(-1073, 1024))),
            with_neighbours(np.ldexp(math.sqrt(2), np.arange(-1022, 1023))),
            1 + np.arange(-500, 500) * 2.0**-53,
            around(math.sqrt(0.5) * np.array([1, 2, 4])),
            around([1.0]),
            [5e-324, np.finfo(float).max],
        ]
    ),
    "tanh": lambda: signed(
        [
            random.uniform(0, 1, 80_000),
            random.uniform(0, 20, 60_000),
            random.uniform(17.5, 19.5, 5_000),  # beside 1
            spread(1e-308, 30, 20_000),
            random.random(5_000) * 1e-307,  # partly subnormal
            with_neighbours((np.arange(1, 60) / 4) * math.log(2)),
            around(np.array([1, 3, 5]) * (math.log(2) / 4)),
            # Above ln(2) / 4, tanh is the small difference of 1 and a quotient. Here the error of the growth counted
            # most when it was rounded as that of exp: up to 1.05 ulp.
            random.uniform(math.log(2) / 4, 0.18, 30_000),
            [float.fromhex(f"0x1.{digits}p-3") for digits in ("68bdaccb4aadc", "6325092b588d0", "6a04962fb5f52")],
            with_neighbours([22.0, 5e-324, 2.0**-1022, 300.0, 1e300]),
        ]
    ),
    "sqrt": lambda: random.integers(1, 0x7FF0000000000000, 50_000).view(float),
    "erfc": lambda: np.concatenate(  # below 26.5 its values are not subnormal
        [random.uniform(-6, 6, 12_000), random.uniform(0, 26.5, 8_000), with_neighbours([0.0, 5e-324, -6.0, 3.75])]
    ),
}


@pytest.mark.parametrize("name", NAMES)
def test_errors_are_within_the_bound(name):
    x = POINTS[name]()
    error = errors(name, x)
    assert error.max() < BOUNDS[name], x[error.argmax()].hex()


def test_angles_include_the_hardest():
    # n multiples of pi / 2 below 1e8 have doubles at random distances, so that the closest are some 2^-53 away
    with mp.workprec(200):
        distances = [float(abs(mp.sin(2 * mp.mpf(float(x))))) for x in closest_to_zeros()]
    assert min(distances) < 2.0**-53


@pytest.mark.parametrize("name", NAMES)
def test_one_at_a_time_is_as_in_a_loop(name):
    # the compiler may fuse other products, so that two errors below 2 ulp differ
    function, x = getattr(compiled, name), random.permutation(POINTS[name]())[:20_000]
    alone = np.array([function(number) for number in x.tolist()])
    np.testing.assert_allclose(alone, values(name, x), rtol=4 * 2.0**-52)
    assert errors(name, x, alone).max() < BOUNDS[name]


OUTSIDE = {
    "sin": {1.0000000000000002e8: math.nan, -1e300: math.nan, math.inf: math.nan, -math.inf: math.nan},
    "cos": {1.0000000000000002e8: math.nan, -1e300: math.nan, math.inf: math.nan, -math.inf: math.nan},
    "exp": {709.79: math.inf, 1e308: math.inf, math.inf: math.inf, -745.2: 0.0, -1e308: 0.0, -math.inf: 0.0, -0.0: 1.0},
    "log": {0.0: -math.inf, -5e-324: math.nan, -1.0: math.nan, math.inf: math.inf, -math.inf: math.nan, 1.0: 0.0},
    "tanh": {math.inf: 1.0, -math.inf: -1.0, 1e308: 1.0, 0.0: 0.0},
    "erfc": {0.0: 1.0, math.inf: 0.0, -math.inf: 2.0, 30.0: 0.0, -30.0: 2.0},
    "sqrt": {-5e-324: math.nan, -1.0: math.nan, math.inf: math.inf, 0.0: 0.0},
}


@pytest.mark.parametrize("name", NAMES)
def test_special_values(name):
    expected = {**OUTSIDE[name], math.nan: math.nan}
    np.testing.assert_array_equal(values(name, np.array([*expected])), [*expected.values()])
    np.testing.assert_array_equal([getattr(compiled, name)(x) for x in expected], [*expected.values()])


def test_log_of_negative_zero():
    assert compiled.log(-0.0) == -math.inf


def test_tanh_has_the_sign_of_its_argument():
    assert np.signbit(values("tanh", np.array([-0.0, 0.0, -5e-324]))).tolist() == [True, False, True]


@pytest.mark.parametrize("name", NAMES)
def test_integers(name):
    assert getattr(compiled, name)(3) == getattr(compiled, name)(3.0)


@pytest.mark.parametrize("name", [*NAMES, "sincos"])
def test_an_array_is_refused(name):
    with pytest.raises(TypeError, match="takes one real number, not an array: call it in a loop over the entries"):
        getattr(compiled, name)(np.ones(3))


def test_an_array_in_a_right_hand_side_is_refused():
    @eig3.jit
    def rhs(t, u, v, p, a):
        a[:] = -compiled.sin(u)

    with pytest.raises(TypeError, match=r"rhs does not compile .* one real number, not an array"):
        eig3.integrate(rhs, (0, 1), [1.0, 2.0], [0.0, 0.0], h=0.1)


@eig3.jit
def sum_of_both(x):
    sine, cosine = compiled.sincos(x)
    return sine + cosine


@eig3.jit
def distance(x):
    return compiled.sqrt(1.0 + x * x)  # for a root alone, two lanes are no gain, and LLVM leaves them


VECTORISED = [*(getattr(compiled, name) for name in NAMES if name != "sqrt"), sum_of_both, distance]


@pytest.mark.parametrize("function", VECTORISED, ids=lambda function: function.__name__)
def test_a_loop_is_vectorised(function):
    @eig3.jit(cache=False)  # code from the disk has no text
    def loop(x, out):
        for i in range(64):
            out[i] = function(x[i])

    x = np.full(64, 0.5)
    loop(x, np.empty(64))
    (code,) = loop.for_python.inspect_llvm().values()
    assert re.search(r"f(add|mul) .*<\d+ x double>", code)
    assert not re.search(r"call .*@(llvm\.)?(sin|cos|exp|log|tanh)(\.f64)?\(", code)


@given(st.floats(-LARGEST_ANGLE, LARGEST_ANGLE))
def test_sine_and_cosine(x):
    sine, cosine = compiled.sincos(x)
    # 2 ulp are a relative error of at most 2^-51, which a square doubles; the rest is the rounding of the sum
    assert abs(sine * sine + cosine * cosine - 1) <= 2.0**-50 + 2.0**-52
    assert sine == pytest.approx(compiled.sin(x), rel=4 * 2.0**-52, abs=0)
    assert cosine == pytest.approx(compiled.cos(x), rel=4 * 2.0**-52, abs=0)
    assert compiled.sincos(-x) == (-sine, cosine)


@given(st.floats(np.finfo(float).tiny, 1e308))
def test_exp_of_log(x):
    logarithm = compiled.log(x)
    # the error of the logarithm, 1 ulp, is the relative error of its exponential, which has one of 1 ulp itself
    assert compiled.exp(logarithm) == pytest.approx(x, rel=math.ulp(logarithm) + 2 * 2.0**-52, abs=0)


@given(st.floats(-700, 700))
def test_exp_of_the_opposite_is_the_inverse(x):
    assert compiled.exp(x) * compiled.exp(-x) == pytest.approx(1, rel=3 * 2.0**-52)


@given(st.floats(-1e300, 1e300))
def test_tanh_is_odd_and_bounded(x):
    assert compiled.tanh(-x) == -compiled.tanh(x)
    assert abs(compiled.tanh(x)) <= min(1.0, abs(x))


@eig3.jit
def between(x, xp, fp, out):
    for i in range(x.size):
        out[i] = compiled.interp(x[i], xp, fp)


@pytest.mark.parametrize(
    "xp", [np.arange(300) * 0.05 - 2, np.sort(random.uniform(-2, 13, 300)), np.array([-2.0, 13.0])]
)
def test_interpolation_is_as_in_numpy(xp):
    fp, out = random.normal(size=xp.size), np.empty(1000 + xp.size)
    x = np.concatenate([random.uniform(-4, 15, 1000), xp])
    between(x, xp, fp, out)
    slopes = np.abs(np.diff(fp) / np.diff(xp)).max()
    np.testing.assert_allclose(out, np.interp(x, xp, fp), rtol=0, atol=1e-15 * (10 + 15 * slopes))  # some ulp
    np.testing.assert_array_equal(out[1000:], fp)
    assert [compiled.interp(x, xp, fp) for x in (-math.inf, math.inf)] == [fp[0], fp[-1]]
    assert math.isnan(compiled.interp(math.nan, xp, fp))
    assert math.isnan(compiled.interp(0.0, xp, fp[:-1]))


wheel = eig3.jit(lambda t, u, v, p: p.k * (compiled.interp(p.speed * t, p.x, p.road) - u))


def test_a_run_refuses_a_table_whose_lengths_differ():
    params = {"k": 40.0, "speed": 1.0, "x": np.array([0.0, 1.0, 2.0]), "road": np.zeros(2)}
    with pytest.raises(ValueError, match="rhs gives nan"):
        eig3.integrate(wheel, (0, 1), 0.0, 0.0, h=0.01, params=params)


def test_members_of_an_ensemble_read_a_table():
    x = np.linspace(0, 50, 501)
    params = {"k": 40.0, "speed": np.linspace(1, 9, 20), "x": x, "road": 0.1 * np.sin(x)}
    members = eig3.ensemble(wheel, (0, 5), np.zeros(20), 0.0, h=0.01, params=params)
    assert not any("one at a time" in note for note in members.notes)
    for i in (0, 19):
        alone = eig3.integrate(wheel, (0, 5), 0.0, 0.0, h=0.01, params={**params, "speed": params["speed"][i]})
        assert members.u[i, -1] == pytest.approx(alone.u[-1], abs=1e-12)  # round-off of 500 steps, u is about 0.1
