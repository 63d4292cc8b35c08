"""The functions of `eig3.math`: without branches or calls, so that a loop over them is vectorised.

``math.sin`` and its kind call the C library once for each number, also inside a loop over many members. The functions
here are arithmetic only: LLVM computes several numbers with each instruction. They work in every function compiled by
Numba, and can be called from Python.

The arithmetic holds with and without fused multiply-adds, which the compiler may or may not use: where a product must
be exact, its factors have few enough bits.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit, types
from numba.extending import intrinsic

from .compile.cache import keep_on_disk
from .compile.jit import KERNEL_OPTIONS

#: The sum of a number below 2^51 and this one is rounded to an integer, which is in the low bits of the sum. A
#: conversion to an integer is possible too, but most processors convert only one number at a time.
_ROUND = 6755399441055744.0  # 1.5 * 2^52
_ROUND_BITS = 0x4338000000000000

#: sin and cos are computed up to this argument.
_LARGEST_ANGLE = 1e8

# pi / 2 as a sum, after Cody and Waite. The first three parts have 27 bits, so that their products with integers up to
# 2^26 are exact.
_HALF_PI_1 = 1.570796325802803
_HALF_PI_2 = 9.920935184482005e-10
_HALF_PI_3 = 6.123233932053594e-17
_HALF_PI_4 = 6.36831716351095e-25

# fdlibm's coefficients: k_sin.c and k_cos.c
_SIN_3 = -1.66666666666666324348e-01
_SIN_5 = 8.33333333332248946124e-03
_SIN_7 = -1.98412698298579493134e-04
_SIN_9 = 2.75573137070700676789e-06
_SIN_11 = -2.50507602534068634195e-08
_SIN_13 = 1.58969099521155010221e-10
_COS_4 = 4.16666666666666019037e-02
_COS_6 = -1.38888888888741095749e-03
_COS_8 = 2.48015872894767294178e-05
_COS_10 = -2.75573143513906633035e-07
_COS_12 = 2.08757232129817482790e-09
_COS_14 = -1.13596475577881948265e-11

# ln 2 as a sum, from fdlibm's e_exp.c. The first part has 32 bits, so that its products with exponents are exact.
_LN2_1 = 6.93147180369123816490e-01
_LN2_2 = 1.90821492927058770002e-10

#: exp is infinite above the first number and 0 below the second.
_EXP_OVERFLOW = 710.0
_EXP_UNDERFLOW = -746.0

#: tanh is rounded to 1 above this number.
_TANH_IS_1 = 22.0

# fdlibm's coefficients: e_log.c
_LOG_2 = 6.666666666666735130e-01
_LOG_4 = 3.999999999940941908e-01
_LOG_6 = 2.857142874366239149e-01
_LOG_8 = 2.222219843214978396e-01
_LOG_10 = 1.818357216161805012e-01
_LOG_12 = 1.531383769920937332e-01
_LOG_14 = 1.479819860511658591e-01

#: The power series of (1 + 2 x) exp(x^2) erfc(x) in (x - 3.75) / (x + 3.75), for x from 0, to which a series of
#: Chebyshev polynomials was converted; its error is below 1e-16.
_ERFC_MIDDLE = 3.75
_ERFC = (
    (1.2375126308378275, -0.14024059858554697, 0.0035854154854790257, 0.0822767384901452),
    (-0.10880393014244462, 0.09230432116037748, -0.05869339857664934, 0.028362277418956406),
    (-0.009746579683265262, 0.0017556258528952954, 0.000293714378044958, -0.0002901540805408417),
    (5.164652974177416e-05, 2.238423915508223e-05, -1.1438048033346894e-05, -9.73559896736775e-07),
    (1.7419821586224816e-06, -5.7218230603224086e-08, -2.4857126248016745e-07, 2.3263508708859124e-08),
    (3.197926671666804e-08, -3.744210080962018e-09, -2.623107347133476e-09, 3.1114333809799254e-10),
)
#: erfc is 0 above this number.
_ERFC_UNDERFLOW = 28.0

_SMALLEST_NORMAL = 2.0**-1022
_SIGN_BIT = -(1 << 63)
_LOW_27_BITS = (1 << 27) - 1
_FRACTION_BITS = (1 << 52) - 1
_EXPONENT_MASK = 0x7FF
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_TWO_52_BITS = 0x4330000000000000


def inlined(function: Any) -> Any:
    """Compile a function that is inlined where it is called, and keep it on the disk."""
    return keep_on_disk(njit(forceinline=True, **KERNEL_OPTIONS)(function))


@intrinsic
def number(context: Any, x: Any) -> Any:
    """The argument of a function as a float."""
    if not isinstance(x, (types.Float, types.Integer)):
        given = "an array: call it in a loop over the entries" if isinstance(x, types.Array) else str(x)
        raise TypeError(f"A function of eig3.math takes one real number, not {given}.")
    return types.float64(x), lambda target, builder, signature, args: target.cast(builder, args[0], x, types.float64)


def _bitcast(target: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.bitcast(args[0], target.get_value_type(signature.return_type))


@intrinsic
def _bits(context: Any, x: Any) -> Any:
    """The bits of a float as an integer."""
    return types.int64(types.float64), _bitcast


@intrinsic
def _from_bits(context: Any, i: Any) -> Any:
    """The float with these bits."""
    return types.float64(types.int64), _bitcast


@inlined
def sincos(x: float) -> tuple[float, float]:
    """Compute sin(x) and cos(x) together, in little more time than one of them.

    Parameters
    ----------
    x : float
        Angle, rad, from -1e8 to 1e8.

    Returns
    -------
    sine, cosine : float
        Each with an error below 2 ulp. Both are NaN for other angles. The sine of -0.0 may be 0.0.

    Notes
    -----
    Multiples of pi / 2 are subtracted as by Cody and Waite, in four parts, so that the error bound also holds beside
    the zeros. Beyond 1e8 the differences would not be exact. The polynomials are from fdlibm.
    """
    x = number(x)
    known = x if abs(x) <= _LARGEST_ANGLE else math.nan
    shifted = x * (2 / math.pi) + _ROUND
    n = shifted - _ROUND
    near = (known - n * _HALF_PI_1) - n * _HALF_PI_2  # exact
    small = n * _HALF_PI_3 + n * _HALF_PI_4
    rest = (n * _HALF_PI_3 - small) + n * _HALF_PI_4  # the rounding error of small, which counts beside a zero
    rough = near - small
    y = rough - rest

    z = rough * rough  # ready before the square of y, and small beside a zero
    w = z * z
    high_sine = (_SIN_7 + z * _SIN_9) + w * (_SIN_11 + z * _SIN_13)
    sine = y + z * y * ((_SIN_3 + z * _SIN_5) + w * high_sine)
    high_cosine = (_COS_8 + z * _COS_10) + w * (_COS_12 + z * _COS_14)
    cosine = 1.0 - (0.5 * z - w * ((_COS_4 + z * _COS_6) + w * high_cosine))

    quadrant = _bits(shifted)
    if quadrant & 1:
        sine, cosine = cosine, sine
    return _negated_if(quadrant & 2, sine), _negated_if((quadrant + 1) & 2, cosine)


@inlined
def _negated_if(bit_1: int, x: float) -> float:
    """-x if bit 1 of an integer without others is set, else x."""
    return _from_bits(_bits(x) ^ (bit_1 << 62))


@inlined
def sin(x: float) -> float:
    """Compute the sine of an angle in rad; see `sincos`, which is faster where both are needed.

    The error is below 2 ulp for abs(x) <= 1e8; the result for other x is NaN.
    """
    return sincos(x)[0]


@inlined
def cos(x: float) -> float:
    """Compute the cosine of an angle in rad; see `sincos`, which is faster where both are needed.

    The error is below 2 ulp for abs(x) <= 1e8; the result for other x is NaN.
    """
    return sincos(x)[1]


@inlined
def _reduced(x: float) -> tuple[int, float, float]:
    """Return k, r and its rounding error `rest` with e^x = 2^k e^(r + rest), where k is the integer next to x / ln 2.

    With abs(r) <= ln(2) / 2, Taylor's polynomial of degree 13 has an error below 0.05 ulp of e^r.
    """
    shifted = x * (1 / math.log(2.0)) + _ROUND
    k = shifted - _ROUND
    near = x - k * _LN2_1
    r = near - k * _LN2_2
    return _bits(shifted) - _ROUND_BITS, r, (near - r) - k * _LN2_2


@inlined
def _power_of_2(k: int) -> float:
    return _from_bits((k + 1023) << 52)


@inlined
def exp(x: float) -> float:
    """Compute e^x.

    The error is below 1 ulp for all x, also where the result is subnormal. The result is inf or 0 where e^x has no
    float, and NaN for NaN.

    Notes
    -----
    e^x is 2^k e^r with abs(r) <= ln(2) / 2. The reduction is Cody and Waite's, the polynomial Taylor's.
    """
    x = number(x)
    x = _EXP_OVERFLOW if x > _EXP_OVERFLOW else x
    x = _EXP_UNDERFLOW if x < _EXP_UNDERFLOW else x
    k, r, rest = _reduced(x)
    z = r * r
    w = z * z
    low = (1 / 2 + r * (1 / 6)) + z * (1 / 24 + r * (1 / 120))
    middle = (1 / 720 + r * (1 / 5040)) + z * (1 / 40320 + r * (1 / 362880))
    high = (1 / 3628800 + r * (1 / 39916800)) + z * (1 / 479001600 + r * (1 / 6227020800))
    half = k >> 1  # 2^k may have no float where 2^k e^r has one
    growth = r + (rest + z * (low + w * (middle + w * high)))
    return (1.0 + growth) * _power_of_2(half) * _power_of_2(k - half)


@inlined
def _growth(x: float) -> tuple[int, float, float]:
    """Return k, g and its rounding error `rest` with e^x = 2^k (1 + g + rest).

    The two largest terms of the polynomial are added without error: a difference such as 2^k (1 + g) - 1 would make it
    count.
    """
    k, r, rest = _reduced(x)
    z = r * r
    w = z * z
    low = (1 / 6 + r * (1 / 24)) + z * (1 / 120 + r * (1 / 720))
    middle = (1 / 5040 + r * (1 / 40320)) + z * (1 / 362880 + r * (1 / 3628800))
    high = (1 / 39916800 + r * (1 / 479001600)) + z * (1 / 6227020800)
    rest += (z * r) * (low + w * (middle + w * high))
    rough = r + 0.5 * z
    growth = rough + rest
    return k, growth, ((rough - growth) + rest) + ((r - rough) + 0.5 * z)


@inlined
def tanh(x: float) -> float:
    """Compute the hyperbolic tangent.

    The error is below 1 ulp for all x. The result has the sign of x, and is NaN for NaN.

    Notes
    -----
    With E = e^(2 abs(x)) - 1, the size of tanh(x) is E / (E + 2) for small x, and 1 - 2 / (E + 2) for others. Both
    parts of the fraction are sums of a rounded number and the rest. The quotient is computed to 26 bits first, so that
    its products with the halves of the divisor are exact. The remainder then corrects it.
    """
    x = number(x)
    size = abs(x)
    k, growth, rest = _growth(2.0 * (_TANH_IS_1 if size > _TANH_IS_1 else size))
    power = _power_of_2(k)
    is_small = power == 1.0
    limit = 0.0 if is_small else 1.0
    above, above_rest = (growth, rest) if is_small else (-2.0, 0.0)
    growth *= power
    below = (power + 1.0) + growth
    below_rest = (((power + 1.0) - below) + growth) + power * rest

    inverse = 1.0 / below
    quotient = _shortened(above * inverse)
    high = _shortened(below)
    remainder = ((above - quotient * high) - quotient * (below - high)) + (above_rest - quotient * below_rest)
    result = limit + quotient
    result += ((limit - result) + quotient) + remainder * inverse
    return _from_bits(_bits(result) | (_bits(x) & _SIGN_BIT))


@inlined
def _shortened(x: float) -> float:
    """x rounded towards 0 to 26 bits."""
    return _from_bits(_bits(x) & ~_LOW_27_BITS)


@inlined
def log(x: float) -> float:
    """Compute the natural logarithm.

    The error is below 1 ulp for all x > 0, also subnormal ones. The result is -inf for 0, and NaN for negative x and
    NaN.

    Notes
    -----
    x is 2^k (1 + f) with 1 + f from sqrt(1/2) to sqrt(2); log(1 + f) is fdlibm's polynomial in f / (2 + f).
    """
    x = number(x)
    is_subnormal = x < _SMALLEST_NORMAL
    bits = _bits(x * 2.0**54 if is_subnormal else x)
    biased = bits - _SQRT_HALF_BITS + (1023 << 52)
    shifted = _from_bits(((biased >> 52) & _EXPONENT_MASK) | _TWO_52_BITS)  # 2^52 + 1023 + the exponent
    k = (shifted - (2.0**52 + 1023)) - (54.0 if is_subnormal else 0.0)
    f = _from_bits((biased & _FRACTION_BITS) + _SQRT_HALF_BITS) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = z * (_LOG_2 + w * (_LOG_6 + w * (_LOG_10 + w * _LOG_14)))
    even = w * (_LOG_4 + w * (_LOG_8 + w * _LOG_12))
    half = 0.5 * f * f
    result = k * _LN2_1 - ((half - (s * (half + (odd + even)) + k * _LN2_2)) - f)
    special = -math.inf if x == 0.0 else (math.nan if x < 0.0 else x)
    return result if (x > 0.0) & (x < math.inf) else special


@inlined
def sqrt(x: float) -> float:
    """Compute the square root, rounded correctly as by ``math.sqrt``; the result is NaN for negative x."""
    return math.sqrt(number(x))


@inlined
def _cubic(y: float, z: float, c: tuple[float, ...]) -> float:
    """A polynomial of degree 3 in y with z = y^2."""
    return (c[0] + y * c[1]) + z * (c[2] + y * c[3])


@inlined
def gauss_and_erfc(x: float) -> tuple[float, float]:
    """Compute exp(-x^2) and erfc(x) together, for x from 0; see `erfc`.

    Notes
    -----
    x is rounded to 26 bits, so that its square is exact, and the rest corrects the exponential function. erfc(x) is
    this and a series in (x - 3.75) / (x + 3.75), after M. M. Shepherd and J. G. Laframboise, Mathematics of
    Computation 36 (1981).
    """
    size = _ERFC_UNDERFLOW if x > _ERFC_UNDERFLOW else x
    rough = _shortened(size)
    rest = (rough - size) * (rough + size)
    gauss = exp(-rough * rough)
    gauss += gauss * (rest * (1.0 + rest * (0.5 + rest * (1 / 6))))
    y = (size - _ERFC_MIDDLE) / (size + _ERFC_MIDDLE)
    z = y * y
    w = z * z
    high = _cubic(y, z, _ERFC[3]) + w * (_cubic(y, z, _ERFC[4]) + w * _cubic(y, z, _ERFC[5]))
    scaled = _cubic(y, z, _ERFC[0]) + w * (_cubic(y, z, _ERFC[1]) + w * (_cubic(y, z, _ERFC[2]) + w * high))
    return gauss, gauss * (scaled / (1.0 + 2.0 * size))


@inlined
def erfc(x: float) -> float:
    """Compute the complementary error function.

    The error is below 6 ulp for all x. The result is NaN for NaN.
    """
    x = number(x)
    beyond = gauss_and_erfc(abs(x))[1]
    return 2.0 - beyond if x < 0.0 else beyond
