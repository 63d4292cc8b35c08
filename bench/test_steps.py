"""The article's problems, spans and steps, grouped by problem: what a smaller step costs, and what it brings."""

import pytest

from eig3 import problems
from eig3.bench.article import TABLES

# without each table's smallest step, which takes seconds
CASES = [(table.problem.__name__, h) for table in TABLES[:4] for h in table.steps[:-1]]


@pytest.mark.parametrize("method", ["eig3", "cd", "rk4"])
@pytest.mark.parametrize(("problem", "h"), CASES)
def test_step(benchmark, time_run, problem, h, method):
    benchmark.group = f"{problem} by step"
    time_run(getattr(problems, problem)(), h, method)
