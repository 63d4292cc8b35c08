"""How many functions eleven first uses compile, each in a new process with an empty cache; none in the next process.

The counts are budgets: a change that compiles more functions for one of these uses must earn it. Only a frame, or a
program that uses SciPy, imports its linear algebra, which takes as long as the whole first run from compiled code.
"""

import pytest

from .conftest import BLOCKS, python

pytestmark = pytest.mark.system

_README = [text for language, text in BLOCKS["README.md"] if language == "python"]
_HEAD = "import numpy as np\nimport eig3\n"
_ORBIT, _OSCILLATOR = _README[1].split("solution =")[0], _README[0].split("solution =")[0]
_INLINE = """
@eig3.jit
def pendulum(t, u, v, p):
    return -p[0] * np.sin(u)

eig3.integrate(pendulum, (0, 10), 1.0, 0.0, h=0.01, params=[9.81], inline=True)
"""

#: The program of each first use, and the largest number of functions that it compiles.
USES = {
    "README, a first run": (_README[0], 12),
    "README, outputs": (_HEAD + _README[1], 38),
    "README, a problem": (_HEAD + _README[2], 15),
    "README, an event": (_HEAD + _ORBIT + _README[3], 81),
    "README, a scene": (_HEAD + _README[4], 50),
    "README, an ensemble": (_OSCILLATOR + _README[5], 21),
    "README, a run in files": (_OSCILLATOR + _README[6], 13),
    "a scene with contacts": (_HEAD + "eig3.problems.sand_column().integrate(h=1e-4, t_end=1e-3, invariants={})", 107),
    "a structure with hinges": (_HEAD + "eig3.problems.yielding_frame().integrate(h=1e-4, t_end=0.02)", 114),
    "an ensemble with tolerances": (
        _HEAD + "eig3.problems.duffing().ensemble(u0=np.linspace(1, 2, 32), rtol=1e-6)",
        57,
    ),
    "inline=True": (_HEAD + _INLINE, 15),
}
_COUNTED = """
import runpy, sys
from eig3.kernels.compile.numba_internals import compilations
with compilations() as functions:
    runpy.run_path(sys.argv[1], run_name="__main__")
print("compiled", len(functions), "scipy.linalg" in sys.modules)
"""


@pytest.mark.parametrize("use", USES)
def test_a_first_use_compiles_few_functions_and_the_next_process_none(use, tmp_path):
    program, most = USES[use]
    (tmp_path / "program.py").write_text(program)
    counts = []
    for folder in (tmp_path / "first", tmp_path / "second"):
        folder.mkdir()
        given = {"cwd": folder, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        count, has_scipy = python("-c", _COUNTED, tmp_path / "program.py", **given).split()[-2:]
        counts.append(int(count))
        assert has_scipy == str("scipy" in program or "frame" in program)
    assert counts[0] <= most
    assert counts[1] == 0
