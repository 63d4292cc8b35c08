"""Problems go to the workers of a pool, and solutions come back, as from a user's script."""

import os
import pickle
import signal
import subprocess
import sys

import numpy as np
import pytest

import eig3

from .conftest import BLOCKS

pytestmark = pytest.mark.system

#: "fork" is the last: its workers know the compiled functions that they inherit only if these were pickled before.
STARTS = ["spawn", "forkserver", "fork"]
#: The tasks of "forkserver", one of each kind: its workers get them as those of "spawn" do, and compile them again.
KINDS = ["kepler", "shear_building", "own", "closure", "diverges", "grows slowly"]

SCRIPT = (
    f"KINDS = {KINDS}\n"
    + """
import multiprocessing
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor

import eig3
from eig3 import problems
from eig3.planning.suggested_step import first_step
from eig3.kernels.compile.numba_internals import compilations


@eig3.jit
def rhs(t, u, v, p):
    return -p[0] * u * (1.0 + u * u) ** -1.5  # a root in the workers too


def spring(stiffness):
    @eig3.jit
    def rhs(t, u, v, p):
        return -stiffness * u

    @eig3.jit
    def energy(t, u, v, p):
        return v * v / 2 + stiffness * u * u / 2

    return eig3.Problem(name="closure", rhs=rhs, energy=energy, u0=1.0, v0=0.0, params=(), t_span=(0.0, 10.0))


def run(task):
    problem, options = task
    with compilations() as functions:
        solution = problem.integrate(**options)
    return solution, [function.__qualname__ for function in functions]


if __name__ == "__main__":
    options = {"curtain": {"n": 10}, "shear_building": {"work": True}}
    built = {name: getattr(problems, name)(**options.get(name, {})) for name in problems.__all__}
    built["own"] = eig3.Problem(name="own", rhs=rhs, u0=1.0, v0=0.0, params=(4.0,), t_span=(0.0, 10.0), h=0.05)
    built["closure"] = spring(4.0)
    tasks = {}
    for name, problem in built.items():
        h = first_step(problem, "eig3", problem.t_span[1])
        tasks[name] = problem, {"h": h, "t_end": 100 * h}
    tasks["diverges"] = built["single_dof"], {"h": 0.7}
    tasks["grows slowly"] = built["single_dof"], {"h": 0.05, "method": "rk2", "save_every": None}
    solutions = {"parent": {name: run(task) for name, task in tasks.items()}}
    for start in sys.argv[1:]:
        given = {name: task for name, task in tasks.items() if start == "spawn" or name in KINDS}
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(start)) as pool:
            solutions[start] = dict(zip(given, pool.map(run, given.values()), strict=True))
    pickle.dump(solutions, sys.stdout.buffer)
"""
)


def output(path, text, *arguments, seconds=300):
    """What a script prints. If it hangs, it is killed together with its workers."""
    path.write_text(text)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, path, *arguments], **pipes, start_new_session=True) as process:
        try:
            printed, errors = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert errors.decode() == ""
    assert process.returncode == 0
    return printed


def test_workers_return_the_solutions_of_the_parent(tmp_path):
    """The script forks while it has no other thread; a worker of pytest-xdist always has one."""
    solutions = pickle.loads(output(tmp_path / "script.py", SCRIPT, *STARTS))
    for start in STARTS:
        compiled = {name: functions for name, (_, functions) in solutions[start].items() if functions}
        assert compiled == {}, start  # the workers load what the parent compiled, also of scenes and structures

    def plain(solution):
        events = {name: vars(occurrences) for name, occurrences in solution.events.items()}
        return {**vars(solution), "events": events, "kernel_seconds": None}

    fields = {start: {name: plain(run) for name, (run, _) in runs.items()} for start, runs in solutions.items()}
    parent = fields.pop("parent")
    assert {*eig3.problems.__all__, "own", "closure"} <= {*parent}
    assert parent["shear_building"]["z"]["work"].any()
    assert parent["diverges"]["status"] is eig3.Status.DIVERGED
    assert "non-finite" in parent["diverges"]["message"]
    assert parent["grows slowly"]["drift"]["energy"] > 0
    assert parent["grows slowly"]["notes"][0].startswith("energy grows steadily")
    some = {name: parent[name] for name in KINDS}
    np.testing.assert_equal(fields, {"spawn": parent, "forkserver": some, "fork": some})


def test_the_example_of_the_readme_is_a_script(tmp_path):
    """`test_readme` does not run what the script does only where it is the main module."""
    (example,) = (text for _, text in BLOCKS["problems/README.md"] if "ProcessPoolExecutor" in text)
    expected = ""
    for e in (0.0, 0.3, 0.6, 0.9):
        solution = eig3.problems.kepler(e=e).integrate(h=1e-3)
        expected += f"e = {e}: drift {solution.drift['energy']:.1e} J/kg\n"
    assert output(tmp_path / "example.py", example).decode() == expected
