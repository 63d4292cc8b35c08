"""Fixtures that the suites of `pytest bench --benchmark-only` share."""

import math

import pytest

from eig3.bench.article_runs import error_of
from eig3.bench.timing import Storage
from eig3.run.fixed_run import divide


def pytest_benchmark_update_machine_info(machine_info):
    """Leave out the current clock rates: with them --benchmark-compare would report one machine as two."""
    cpu = machine_info["cpu"]
    machine_info["cpu"] = {name: cpu[name] for name in cpu if not name.startswith("hz_")}


@pytest.fixture
def time_steps(benchmark):
    """Time steps of a stepper from where it stands, again and again; every state is stored if there is storage."""

    def time_steps(start, n_steps, storage=None):
        rows = () if storage is None else (1, storage.u, storage.v)

        def run(stepper):
            stepper.advance(n_steps, *rows)
            return stepper

        end = benchmark.pedantic(run, setup=lambda: ((start.fork(),), {}), rounds=10, warmup_rounds=1)
        assert end.index == n_steps
        assert end.is_finite
        benchmark.extra_info.update(h=start.h, evaluations=end.n_rhs)
        if benchmark.enabled:
            benchmark.extra_info["ns_per_step"] = 1e9 * benchmark.stats["median"] / n_steps

    return time_steps


@pytest.fixture
def time_run(benchmark, time_steps):
    """Time the kernel alone over the whole span of a problem, every state stored in memory written before."""

    def time_run(problem, h, method, mode="pointer"):
        n_steps, h = divide(*problem.t_span, h)
        start = problem.stepper(h=h, method=method, inline=mode == "inline")
        time_steps(start, n_steps, Storage.for_runs(problem, [h]))
        solution, error = error_of(problem, h, method)
        assert solution.success
        assert math.isfinite(error)
        benchmark.extra_info["error"] = error

    return time_run
