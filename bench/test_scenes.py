"""Scenes and the same systems written by hand, grouped by system."""

import pytest

from eig3.bench.scenes import CASES

N_VALUES = 4_000_000  # steps times degrees of freedom


@pytest.mark.parametrize("by", ["scene", "hand"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_scene(benchmark, case, by):
    benchmark.group = case.title
    problem = case.problems()[by == "hand"]
    n_steps = N_VALUES // problem.u0.size
    start = problem.stepper(h=case.h)

    def run(stepper):
        stepper.advance(n_steps)
        return stepper

    end = benchmark.pedantic(run, setup=lambda: ((start.fork(),), {}), rounds=10, warmup_rounds=1)
    assert end.index == n_steps
    assert end.is_finite
    benchmark.extra_info.update(h=case.h, evaluations=end.n_rhs)
    if benchmark.enabled:
        benchmark.extra_info["ns_per_step"] = 1e9 * benchmark.stats["median"] / n_steps
