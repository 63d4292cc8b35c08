"""Cold and warm start: the time to the first result in a new process, and in a process that has run before."""

import itertools
import os
import subprocess
import sys

import pytest

from eig3.bench.start import error, new_function, result

ROUNDS = 5
pytestmark = [pytest.mark.benchmark(group="start"), pytest.mark.parametrize("mode", ["pointer", "inline"])]


def test_new_process_empty_cache(benchmark, tmp_path, mode):
    folders = (tmp_path / str(i) for i in itertools.count())
    benchmark.pedantic(new_process, setup=lambda: ((mode, next(folders)), {}), rounds=ROUNDS)
    note(benchmark, result(new_function(), mode))


def test_new_process_filled_cache(benchmark, tmp_path, mode):
    new_process(mode, tmp_path)
    benchmark.pedantic(new_process, (mode, tmp_path), rounds=ROUNDS)
    note(benchmark, result(new_function(), mode))


def test_warm_process_new_function(benchmark, mode):
    result(new_function(), mode)
    note(benchmark, benchmark.pedantic(lambda: result(new_function(), mode), rounds=ROUNDS))


def test_warm_process_known_function(benchmark, mode):
    known = new_function()
    result(known, mode)
    note(benchmark, benchmark.pedantic(result, (known, mode), rounds=ROUNDS))


def new_process(mode, cache):
    command = [sys.executable, "-m", "eig3.bench.start", mode]
    subprocess.run(command, env={**os.environ, "NUMBA_CACHE_DIR": str(cache)}, check=True)


def note(benchmark, solution):
    assert solution.success
    benchmark.extra_info.update(h=solution.h, evaluations=solution.n_rhs, error=error(solution))
