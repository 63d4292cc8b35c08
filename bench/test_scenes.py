"""Scenes and the same systems written by hand, grouped by system."""

import pytest

from eig3.bench.scene_pairs import SCENE_PAIRS

N_VALUES = 4_000_000  # steps times degrees of freedom


@pytest.mark.parametrize("by", ["scene", "hand"])
@pytest.mark.parametrize("pair", SCENE_PAIRS, ids=lambda pair: pair.title)
def test_scene(benchmark, time_steps, pair, by):
    benchmark.group = pair.title
    problem = pair.problems()[by == "hand"]
    time_steps(problem.stepper(h=pair.h), N_VALUES // problem.u0.size)
