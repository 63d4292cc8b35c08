"""The article's problems, spans and steps, grouped by problem: time and error of each step."""

import pytest

from eig3 import problems
from eig3.bench.article import TABLES

# without the smallest step of each table, which takes seconds
PROBLEMS_AND_STEPS = [(table.problem.__name__, h) for table in TABLES[:4] for h in table.steps[:-1]]


@pytest.mark.parametrize("method", ["eig3", "cd", "rk4"])
@pytest.mark.parametrize(("problem", "h"), PROBLEMS_AND_STEPS)
def test_step(benchmark, time_run, problem, h, method):
    benchmark.group = f"{problem} by step"
    time_run(getattr(problems, problem)(), h, method)
