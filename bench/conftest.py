"""What the suites of `pytest bench --benchmark-only` share."""

import math

import pytest

from eig3.bench.paper import error_of
from eig3.bench.timing import Storage
from eig3.integration import divide


def pytest_benchmark_update_machine_info(machine_info):
    """Leave out the clock of the moment, by which --benchmark-compare takes a machine for another."""
    cpu = machine_info["cpu"]
    machine_info["cpu"] = {name: cpu[name] for name in cpu if not name.startswith("hz_")}


@pytest.fixture
def time_run(benchmark):
    """Time the kernel alone over a problem's whole span, every state stored in memory touched before."""

    def time_run(problem, h, method, mode="pointer"):
        n_steps, h = divide(problem.t_span[1] - problem.t_span[0], h)
        storage = Storage.for_runs(problem, [h])
        start = problem.stepper(h=h, method=method, inline=mode == "inline")

        def run(stepper):
            stepper.advance(n_steps, 1, storage.u, storage.v)
            return stepper

        end = benchmark.pedantic(run, setup=lambda: ((start.fork(),), {}), rounds=10, warmup_rounds=1)
        assert end.index == n_steps
        assert end.is_finite
        solution, error = error_of(problem, h, method)
        assert solution.success
        assert math.isfinite(error)
        benchmark.extra_info.update(h=h, evaluations=end.n_rhs, error=error)
        if benchmark.enabled:
            benchmark.extra_info["ns_per_step"] = 1e9 * benchmark.stats["median"] / n_steps

    return time_run
