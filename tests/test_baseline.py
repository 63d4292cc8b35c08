"""The C baseline: it computes what the kernels compute, and its table has all that it should."""

import numpy as np
import pytest

from eig3.bench import baseline, speed
from eig3.bench.timing import Storage
from eig3.cli import main

needs_compiler = pytest.mark.skipif(baseline.compiler() is None, reason="no C compiler here: the table says so")


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return baseline.build(baseline.FLAGS["-O3"], tmp_path_factory.mktemp("c"))


@needs_compiler
@pytest.mark.parametrize("inline", [False, True])
@pytest.mark.parametrize("method", baseline.METHOD_NAMES)
@pytest.mark.parametrize("make", [make for make, _ in speed.CASES])
def test_c_computes_what_the_kernels_do(library, make, method, inline, monkeypatch):
    monkeypatch.setattr(speed, "N_STEPS", 2000)
    problem = make()
    storage = Storage(2 if np.ndim(problem.u0) else None, 2000)
    kernel = speed.ours(problem, baseline.STEPS[problem.name], method, storage, inline=False)
    kernel()
    ours = storage.u.copy()
    assert library.loop(problem, method, storage, inline=inline)() > 0
    difference = np.abs(storage.u - ours).max()
    # the same formulas in another order of operations; AB3 in C starts with a constant past, an error of h^2 a
    assert difference < (0.05 if method == "ab3" else 1e-8)


def test_a_method_that_is_not_in_c_is_told():
    with pytest.raises(SystemExit, match="--method must be one of eig3, cd, rk2, rk3, ab2, ab3, not rk4"):
        main(["bench", "c", "--method", "rk4"])


@needs_compiler
def test_table_has_every_ratio(capsys, monkeypatch):
    monkeypatch.setattr(speed, "N_STEPS", 1000)
    assert main(["bench", "c", "--method", "eig3", "--repeats", "1"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "EIG-3" in line]
    assert len(rows) == 4
    assert all(" - " not in row for row in rows)


def test_without_a_compiler_the_table_says_so(capsys, monkeypatch):
    monkeypatch.setattr(baseline.shutil, "which", lambda name: None)
    monkeypatch.setattr(speed, "N_STEPS", 1000)
    monkeypatch.setattr(speed, "CASES", speed.CASES[:1])
    assert main(["bench", "c", "--method", "eig3", "--repeats", "1"]) == 0
    printed = capsys.readouterr().out
    assert "no compiler (cc) here" in printed
    assert printed.count(" - ") == 6
