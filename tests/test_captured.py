"""Values from outside that Numba compiles into a function: the next run has those that hold when it begins."""

import gc
import time
import types
import weakref

import numba
import numpy as np
import pytest

import eig3
from eig3.functions.inlining import inlined
from eig3.kernels.compile.numba_internals import compile_results
from eig3.kernels.protocol import SCALAR

from .conftest import python

MODULE = types.ModuleType("settings")
MODULE.inner = types.ModuleType("settings.inner")
SOURCE = """
@numba.njit
def spring(u):
    return -K * u

@numba.extending.register_jitable
def same(x):
    return x

@eig3.jit
def rhs(t, u, v, p):
    factor = settings.factor * settings.inner.factor * (1.0 if FACTOR is None else FACTOR)
    return same(spring(u)) * W[0] * PAIR[1][0] * RECORD.k * factor + 0 * p.size

@eig3.jit
def energy(t, u, v, p):
    return K * u * u / 2
"""


@pytest.fixture
def names():
    MODULE.factor = MODULE.inner.factor = 1.0
    namespace = {"eig3": eig3, "numba": numba, "K": 1.0, "W": np.ones(2), "settings": MODULE}
    namespace |= {"PAIR": (1, np.ones(2)), "RECORD": np.ones(2, [("k", "f8")])[0], "FACTOR": None, "size": 0}
    exec(SOURCE, namespace)
    return namespace


def omega(names, **options):
    """Return the circular frequency of the oscillation that a run gives."""
    solution = eig3.integrate(names["rhs"], (0, 0.1), 1.0, 0.0, h=1e-3, method="rk4", **options)
    return round(float(np.arccos(solution.u[-1])) / 0.1, 6)


@pytest.mark.parametrize(
    "change",
    [
        "K = 4.0",
        "W[0] = 4.0",
        "PAIR[1][0] = 4.0",
        "RECORD['k'] = 4.0",
        "FACTOR = 4.0",
        "settings.factor = 4.0",
        "settings.inner.factor = 4.0",
        "inner = settings.inner\nsettings = type(settings)('other')\nsettings.factor, settings.inner = 4.0, inner",
        "@numba.njit\ndef spring(u):\n    return -4.0 * u",
        "@numba.extending.register_jitable\ndef same(x):\n    return 4.0 * x",
    ],
)
def test_the_next_run_has_the_new_value(names, change):
    assert omega(names) == 1
    assert names["rhs"](0.0, 1.0, 0.0, np.empty(0)) == -1
    exec(change, names)
    assert omega(names) == 2
    assert omega(names) == 2
    assert names["rhs"](0.0, 1.0, 0.0, np.empty(0)) == -4


def test_also_with_an_inlined_loop(names):
    for k in (1.0, 4.0):
        names["K"] = k
        solution = eig3.integrate(names["rhs"], (0, 0.1), 1.0, 0.0, h=1e-3, inline=True)
        assert solution.u[-1] == pytest.approx(np.cos(0.1 * k**0.5), abs=1e-6)  # the error of EIG-3 is below 1e-8


def test_what_was_compiled_before_the_first_run_is_renewed(names):
    assert names["spring"](1.0) == -1.0
    names["K"] = 4.0
    assert omega(names) == 2


def test_a_variable_of_an_outer_function():
    def made():
        k = 1.0

        @eig3.jit
        def rhs(t, u, v, p):
            return -k * u

        def change(value):
            nonlocal k
            k = value

        return {"rhs": rhs}, change

    names, change = made()
    assert omega(names) == 1
    change(4.0)
    assert omega(names) == 2


def test_invariants_see_the_new_value_and_a_run_that_is_extended_the_old_one(names):
    options = {"h": 1e-3, "method": "rk4", "invariants": {"energy": names["energy"]}}
    first = eig3.integrate(names["rhs"], (0, 0.1), 1.0, 0.0, **options)
    names["K"] = 4.0
    assert eig3.integrate(names["rhs"], (0, 0.1), 1.0, 0.0, **options).extremes["energy"].high == pytest.approx(2.0)
    assert first.extend(0.2).u[-1] == pytest.approx(np.cos(0.2), abs=1e-9)


def test_nothing_is_compiled_anew_where_nothing_has_changed(names):
    omega(names)
    before = next(iter(compile_results(names["rhs"]).values()))
    names["K"], names["W"], names["PAIR"] = float("1.0"), np.ones(2), (1, np.ones(2))
    names["size"] = 1  # not a variable of rhs, which reads p.size
    omega(names)
    assert next(iter(compile_results(names["rhs"]).values())) is before


def test_a_run_keeps_no_variable_that_it_does_not_use(names):
    names["solution"] = np.ones(2)
    freed = weakref.ref(names["solution"])
    omega(names)
    del names["solution"]
    assert freed() is None


def test_a_function_is_freed_with_the_kernels_that_inline_it(names):
    inlined(lambda rhs, jacobian, quantities: rhs, ("kernel",), SCALAR, names["rhs"])
    freed = weakref.ref(names.pop("rhs"))
    gc.collect()
    assert freed() is None


def test_a_jacobian_that_is_inlined():
    namespace = {"eig3": eig3, "C": 0.5}
    exec("@eig3.jit\ndef rhs(t, u, v, p):\n    return -u - p[0] * v", namespace)
    exec("@eig3.jit\ndef jacobian(t, u, v, p):\n    return -C", namespace)

    def iterations():
        method = eig3.CentralDifference(solver="newton", jacobian=namespace["jacobian"])
        options = {"h": 0.1, "params": 0.5, "method": method, "inline": True}
        return eig3.integrate(namespace["rhs"], (0, 1), 1.0, 0.0, **options).n_iterations

    exact = iterations()
    namespace["C"] = -0.5  # Newton's method needs more iterations with a wrong derivative
    assert iterations() > exact


PROGRAM = """
import sys
import eig3
import captured_module
from eig3.kernels.compile.numba_internals import compilations
captured_module.K = float(sys.argv[1])
with compilations() as compiled:
    print(eig3.integrate(captured_module.rhs, (0, 0.1), 1.0, 0.0, h=1e-3).a[0])
print("compiled" if captured_module.rhs in compiled else "loaded")
"""


@pytest.mark.system
def test_code_on_the_disk_has_the_value_of_this_process(tmp_path, monkeypatch):
    text = "import eig3\nK = 1.0\n\n@eig3.jit(cache=True)\ndef rhs(t, u, v, p):\n    return -K * u if t < "
    text += f"{time.time_ns()} else 0.0\n"  # other code than in an earlier run of this test
    (tmp_path / "captured_module.py").write_text(text)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)

    def run(k):
        return python("-c", PROGRAM, k, cwd=tmp_path).split()

    assert run(1.0) == ["-1.0", "compiled"]
    assert run(4.0) == ["-4.0", "compiled"]
    assert run(1.0) == ["-1.0", "loaded"]


def test_random_numbers_are_refused():
    @numba.njit
    def noise(u):
        return u + np.random.normal()

    @eig3.jit
    def noisy(t, u, v, p):
        return -noise(u)

    @eig3.jit
    def rhs(t, u, v, p):
        return -u

    @eig3.jit
    def apply(t, u, v, p):
        return u, -v * np.random.random()

    events = {"impact": eig3.Event(rhs, apply=apply)}
    for name, f, options in (
        ("rhs", noisy, {}),
        ("outputs", rhs, {"outputs": {"noisy": noisy}}),
        ("apply of events", rhs, {"events": events}),
    ):
        with pytest.raises(ValueError, match=rf"^{name}.* draws random numbers \(np.random\).* pass them in params"):
            eig3.integrate(f, (0, 1), 1.0, 0.0, h=0.1, **options)
    with pytest.raises(ValueError, match="rhs draws random numbers"):
        eig3.ensemble(noisy, (0, 1), np.ones(3), 0.0, h=0.1)


def test_a_normal_distribution_that_was_imported_is_refused():
    from numpy.random import normal

    @eig3.jit
    def rhs(t, u, v, p):
        return -u + normal()

    with pytest.raises(ValueError, match=r"rhs draws random numbers \(normal\)"):
        eig3.integrate(rhs, (0, 1), 1.0, 0.0, rtol=1e-3)
