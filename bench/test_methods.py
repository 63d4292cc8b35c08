"""Every method in both modes, grouped by problem."""

from dataclasses import replace

import pytest

from eig3 import problems
from eig3.bench.choices import ARTICLE_METHODS
from eig3.bench.loops import ARTICLE_PROBLEMS, N_STEPS


@pytest.mark.parametrize("mode", ["pointer", "inline"])
@pytest.mark.parametrize("method", ARTICLE_METHODS)
@pytest.mark.parametrize(("problem", "h"), [pytest.param(f.__name__, h, id=f.__name__) for f, h in ARTICLE_PROBLEMS])
def test_method(benchmark, time_run, problem, h, method, mode):
    benchmark.group = problem
    time_run(replace(getattr(problems, problem)(), t_span=(0.0, N_STEPS * h)), h, method, mode)
