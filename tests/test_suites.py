"""The suites of pytest-benchmark are found; saving, comparing and drawing work on one small benchmark of each."""

import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytestmark = pytest.mark.system

ROOT = Path(__file__).parent.parent
SMALL = (
    "test_methods.py::test_method[single_dof-eig3-pointer]",
    "test_steps.py::test_step[single_dof-0.1-cd]",
    "test_start.py::test_warm_process_known_function[pointer]",
)


def run_pytest(*arguments):
    """Return the output of `pytest -q` outside any worker of xdist, in which benchmarks refuse to run."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_XDIST_")}
    command = [sys.executable, "-m", "pytest", "-q", *arguments]
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture
def run_small(tmp_path):
    options = ("--benchmark-only", f"--benchmark-storage={tmp_path / 'saved'}")
    return lambda *more: run_pytest(*(f"bench/{name}" for name in SMALL), *options, *more)


def test_all_are_found_and_nothing_to_compare_with_is_a_warning(tmp_path):
    options = ("--benchmark-only", "--benchmark-compare", f"--benchmark-storage={tmp_path}")
    found = run_pytest("bench", "--collect-only", *options)
    assert all(f"bench/{name}" in found for name in SMALL)
    for method in ("eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3"):
        for problem in ("single_dof", "hardening_spring", "softening_spring", "spring_pendulum"):
            for mode in ("pointer", "inline"):
                assert f"test_method[{problem}-{method}-{mode}]" in found
    assert "test_scenes.py::test_scene[200 masses in space, springs-scene]" in found


def test_save_compare_and_histogram(run_small, tmp_path):
    run_small("--benchmark-autosave", f"--benchmark-json={tmp_path / 'run.json'}")
    benchmarks = json.loads((tmp_path / "run.json").read_text())["benchmarks"]
    assert {b["group"] for b in benchmarks} == {"single_dof", "single_dof by step", "start"}
    notes = [b["extra_info"] for b in benchmarks]
    assert [note["h"] for note in notes] == [1e-3, 0.1, 1e-3]
    assert [note["evaluations"] for note in notes] == [500_001, 10_001, 10_001]
    assert [note["error"] for note in notes] == pytest.approx([1.33e-3, 2.0, 3.3e-7], rel=0.01)

    table = run_small("--benchmark-compare", f"--benchmark-histogram={tmp_path / 'drawn'}")
    assert table.count("(NOW)") == table.count("(0001_") == len(SMALL)
    for group in ("single_dof", "single_dof_by_step", "start"):
        assert ElementTree.parse(tmp_path / f"drawn-{group}.svg").getroot().tag.endswith("svg")
