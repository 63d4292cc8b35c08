"""Compiled code is found by all that it depends on: a change of any part of this is noticed, and nothing else is."""

import ctypes
import enum
import os
import types
from collections import namedtuple
from concurrent.futures import ThreadPoolExecutor

import numba
import numba.experimental
import numpy as np
import pytest

import eig3
from eig3.kernels.compile.content import content

from .conftest import python

MODULE = types.ModuleType("settings")
SOURCE = """
@eig3.jit
def helper(x):
    return K * x

@eig3.jit
def function(x, y=1.0):
    return helper(x) + W[0] * settings.factor + np.sin(y) + 0.5
"""


def defined(old="", new="", factor=1.0, **changes):
    """The function of the source with a change."""
    MODULE.factor = factor
    names = {"__name__": __name__, "eig3": eig3, "np": np, "settings": MODULE, "K": 2.0, "W": np.ones(2), **changes}
    exec(SOURCE.replace(old, new), names)
    return names["function"]


def test_the_same_function_has_the_same_content():
    assert content(defined()) == content(defined())
    assert len(content(defined())) == 32


@pytest.mark.parametrize(
    "change",
    [
        {"old": "0.5", "new": "0.25"},
        {"old": "y=1.0", "new": "y=2.0"},
        {"old": "np.sin", "new": "np.cos"},
        {"old": "K * x", "new": "x * K * x"},
        {"old": "@eig3.jit", "new": "@eig3.jit(fastmath=True)"},
        {"K": 3.0},
        {"K": 2},
        {"W": np.zeros(2)},
        {"factor": 2.0},
    ],
    ids=str,
)
def test_a_change_is_noticed(change):
    assert content(defined(**change)) not in ("", content(defined()))


def test_the_names_in_a_named_tuple_are_noticed():
    first, second = (namedtuple("Pair", names)(1.0, 2.0) for names in ("k c", "c k"))
    assert content(defined(K=first)) != content(defined(K=second))


def test_a_value_of_an_outer_function_is_noticed():
    def outer(k):
        return eig3.jit(lambda x: k * x)

    assert content(outer(1.0)) == content(outer(1.0)) != content(outer(2.0))


def test_which_function_a_name_means_is_noticed():
    """Helpers are listed before those that call them: here in the same order."""

    @eig3.jit
    def inner(x):
        return 2.0 * x

    @eig3.jit
    def outer(x):
        return inner(x) + 1.0

    def difference(first, second):
        return eig3.jit(lambda x: first(x) - second(x))

    assert content(difference(inner, outer)) != content(difference(outer, inner))


class Colour(enum.IntEnum):
    RED = 1


SIZE = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(abs)
FUNCTIONS = (defined(),)
AT_AN_ADDRESS = numba.cfunc("f8(f8)")(lambda x: x)


@numba.experimental.jitclass({"k": numba.float64})
class Spring:
    def __init__(self, k):
        self.k = k


@eig3.jit
def odd(n):
    return n > 0 and even(n - 1)


@eig3.jit
def even(n):
    return n == 0 or odd(n - 1)


@eig3.jit
def factorial(n):
    return 1.0 if n == 0 else n * factorial(n - 1)


@pytest.mark.parametrize("function", [lambda x: np.linalg.norm(x), lambda x: np.dot(x, x), lambda x: x[None, :]])
def test_what_numpy_has_is_known(function):
    assert content(eig3.jit(function))


@pytest.mark.parametrize(
    "function",
    [
        lambda x: Colour.RED * x,
        lambda x: SIZE(x),
        lambda x: FUNCTIONS[0](x),
        lambda x: AT_AN_ADDRESS(x),
        lambda x: Spring(x).k,
        lambda x: even(x),
        lambda x: factorial(x),  # Numba would abort the process that loads it
        lambda x: os.path.join(x),  # noqa: PTH118  # a module in a module
    ],
)
def test_what_is_not_known_is_not_kept(function):
    assert not content(eig3.jit(function))


@pytest.mark.parametrize("name", eig3.math.__all__)
def test_functions_of_the_library_are_known(name):
    """The attribute math.sqrt in the function sqrt once looked like a call of itself, whose code cannot be kept."""
    assert content(getattr(eig3.math, name))


ONE_NAME = r"""
import sys

import eig3

namespace = {"eig3": eig3, "__name__": "__main__"}
for k in sys.argv[1].split(","):
    exec(f"@eig3.jit\ndef inner(x):\n    return {k} * x if x > 0 else x ** {k}\n", namespace)
    exec("@eig3.jit\ndef rhs(t, u, v, p):\n    return inner(u)", namespace)
    print(eig3.integrate(namespace["rhs"], (0, 0.1), 1.0, 0.0, h=0.1, method="rk4").v[-1])
"""


@pytest.mark.system
def test_functions_of_one_name_from_several_processes_do_not_mix(tmp_path):
    """In each process they are the first ones: without random numbers in their symbols, these would be the same."""

    def printed(numbers):
        return python("-c", ONE_NAME, numbers, NUMBA_CACHE_DIR=str(tmp_path)).split()

    printed("9")  # the kernel
    with ThreadPoolExecutor(2) as pool:
        alone = [values[0] for values in pool.map(printed, "1234")]
    assert len(set(alone)) == 4
    assert printed("1,2,3,4,5")[:4] == alone
