"""Kernels are loaded from disk where they were compiled before: compilations are counted, not seconds."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import eig3.kernels.fixed
import eig3.kernels.jit

SCRIPT = """
import sys

import numba
from numba.core import event

class Count(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__module__)
    def on_end(self, event):
        pass

count = Count()
event.register("numba:compile", count)
import eig3

@eig3.jit
def rhs(t, u, v, p):
    return -u - 0.1 * v

@eig3.jit
def vector_rhs(t, u, v, p, a):
    a[0] = -u[0] - 0.1 * v[0]

@eig3.jit
def energy(t, u, v, p):
    return v * v + u * u

for method in [eig3.METHODS[name] for name in sys.argv[1:] or eig3.METHODS]:
    assert eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.01, method=method(), invariants={"energy": energy}).success
    assert eig3.integrate(vector_rhs, (0, 1), [1.0], [0.0], h=0.01, method=method()).success
print(sum(name.startswith("eig3.kernels") for name in count.names), sum(name == "__main__" for name in count.names))
"""


def compilations(*methods, cache=None):
    """How many functions of the kernels and of the script a new process compiles, for these methods or for all."""
    environment = os.environ if cache is None else {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", SCRIPT, *methods]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert result.stderr == ""  # no warning of Numba's reaches the user
    return tuple(map(int, result.stdout.split()))


def test_second_process_compiles_only_the_users_functions(tmp_path):
    kernels, own = compilations("rk2", cache=tmp_path)
    assert kernels > 0
    assert own == 3
    assert compilations("rk2", cache=tmp_path) == (0, 3)


@pytest.mark.usefixtures("compiled_kernels")
def test_no_method_compiles_a_kernel_that_is_on_disk():
    assert compilations() == (0, 3)


def test_a_change_of_any_kernel_file_is_noticed(tmp_path, monkeypatch):
    copy = tmp_path / "kernels"
    shutil.copytree(Path(eig3.kernels.jit.__file__).parent, copy)
    monkeypatch.setattr(eig3.kernels.jit, "__file__", str(copy / "jit.py"))
    fingerprint = eig3.kernels.jit.fingerprint
    before = fingerprint()
    (copy / "march.py").write_text((copy / "march.py").read_text() + "\n")
    assert fingerprint() != before


def test_without_a_place_for_the_cache_kernels_are_compiled(monkeypatch):
    def nowhere(*arguments, **options):
        if options.get("cache"):
            raise RuntimeError("cannot cache function 'scalar': no locator available for file 'x'")
        return njit(*arguments, **options)

    njit = eig3.kernels.jit.numba.njit
    monkeypatch.setattr(eig3.kernels.jit.numba, "njit", nowhere)
    kernel = eig3.kernels.fixed.pointer_kernel.__wrapped__(eig3.RK4().formulas, eig3.kernels.protocol.SCALAR)
    assert callable(kernel)


def test_other_errors_of_the_compiler_come_through(monkeypatch):
    def broken(*arguments, **options):
        raise RuntimeError("out of registers")

    monkeypatch.setattr(eig3.kernels.jit.numba, "njit", broken)
    with pytest.raises(RuntimeError, match="out of registers"):
        eig3.kernels.jit.cached(test_other_errors_of_the_compiler_come_through, "int64()")
