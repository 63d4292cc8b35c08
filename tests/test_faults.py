"""The faults of `faults.py`, with a part of its trials: each must come out as it should."""

import pytest

from . import faults

pytestmark = pytest.mark.system

TRIALS = {"flipped_bit": 3}


@pytest.fixture(scope="module")
def warm_cache(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    faults.warm_cache(folder)
    return folder


@pytest.mark.parametrize(("name", "number"), [(name, k) for name in faults.FAULTS for k in range(TRIALS.get(name, 1))])
def test_fault_comes_out_as_it_should(name, number, warm_cache):
    assert faults.outcome(name, number, warm_cache) == faults.HELD
