import contextlib
import functools
import gc
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads that wait for each other on small matrices; before NumPy

import numpy as np
import pytest

import eig3
from eig3.functions.callbacks import check_callback
from eig3.kernels.protocol import VECTOR

ROOT = Path(__file__).parent.parent
README_FILES = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "STABILITY.md")
README_FILES += ("bench/README.md", "eig3/OTHER_CODES.md", "eig3/diagnosis/README.md")
README_FILES += ("eig3/ensembles/README.md", "eig3/files/README.md")
README_FILES += ("eig3/ensembles/STUDIES.md", "eig3/fitting/README.md", "eig3/run/README.md", "eig3/scene/README.md")
README_FILES += ("eig3/structures/README.md", "kernels/README.md", "problems/README.md")
#: The fenced blocks of each README, as (language, text).
BLOCKS = {
    name: re.findall(r"^```(\w+)\n(.*?)^```$", (ROOT / name).read_text(), flags=re.MULTILINE | re.DOTALL)
    for name in README_FILES
}
#: The method in the kernels' README: the whole file of a user's own.
OWN_METHOD = next(text for language, text in BLOCKS["kernels/README.md"] if language == "python")

ALL_METHODS = [
    eig3.EIG3(), eig3.EIG3(alpha=1.2), eig3.CentralDifference(), eig3.CentralDifference(solver="newton"),
    eig3.CentralDifference(velocity="lagged"), eig3.RK2(), eig3.RK3(), eig3.RK4(), eig3.AB2(), eig3.AB3()
]  # fmt: skip

WITHOUT_VELOCITY = [eig3.EIG3(velocity="none"), eig3.CentralDifference(velocity="none")]


def pytest_sessionstart():
    # a compiler makes millions of objects: collections took an eighth of the time; nearly all that survives one stays
    gc.set_threshold(10**6, 1000, 1000)


def pytest_collection_finish():
    gc.freeze()  # what is imported stays: collections need not visit it


@pytest.hookimpl(trylast=True)
def pytest_unconfigure():
    gc.freeze()  # pytest has just visited what is left: the end of the process need not do it twice more


oscillator = eig3.jit(lambda t, u, v, p: -p[0] * p[0] * u - 2 * p[1] * p[0] * v)


@eig3.jit
def oscillator_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[0] * p[0] * u[j] - 2 * p[1] * p[0] * v[j]


@eig3.jit
def gyroscope(t, u, v, p, a):
    a[0] = -p[0] * v[1]
    a[1] = p[0] * v[0]
    a[2:] = 0.0


spring = eig3.jit(lambda t, u, v, p: -p[0] * p[0] * u)


@eig3.jit
def structure(t, u, v, p, a):
    """u'' = -K u - C v, with the matrices in p."""
    n = u.size
    for i in range(n):
        total = 0.0
        for j in range(n):
            total -= p[i * n + j] * u[j] + p[n * n + i * n + j] * v[j]
        a[i] = total


@eig3.jit
def coupled(t, u, v, p, a):
    """Three masses in a row between walls, with dampers and a force: linear, with different masses and springs."""
    for j in range(3):
        left = u[j - 1] if j > 0 else 0.0
        right = u[j + 1] if j < 2 else 0.0
        a[j] = p[j] * (left - 2 * u[j] + right) - 0.1 * (j + 1) * v[j] + np.sin(t)


#: With u(0) = 1 and v(0) = 0, the exact motion is cos t.
damped = eig3.jit(lambda t, u, v, p: -u - 0.2 * v - 0.2 * np.sin(t))


hardening = eig3.jit(lambda t, u, v, p: np.sin(t) - p[0] * u * (1 + u * u))


@eig3.jit
def hardening_chain(t, u, v, p, a):
    """Three masses in a row between walls, with hardening springs and a force: nothing reads v."""
    for j in range(3):
        left = u[j] - u[j - 1] if j > 0 else u[j]
        right = u[j + 1] - u[j] if j < 2 else -u[j]
        a[j] = p[j] * (right * (1 + right * right) - left * (1 + left * left)) + np.sin(t)


position = eig3.jit(lambda t, u, v, p: u)
velocity = eig3.jit(lambda t, u, v, p: v)
first_position = eig3.jit(lambda t, u, v, p: u[0])
energy = eig3.jit(lambda t, u, v, p: u * u + v * v)
above_level = eig3.jit(lambda t, u, v, p: u - p[1])
harmonic = eig3.jit(lambda t, u, v, p: -u)


@eig3.jit
def harmonic_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j]


linear_spring = eig3.jit(lambda t, u, v, p: -p[0] * u)


@eig3.jit
def linear_springs(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[0] * u[j]


falling = eig3.jit(lambda t, u, v, p: -p[0])
rebound = eig3.jit(lambda t, u, v, p: (u, -0.5 * v))
bounce = eig3.jit(lambda t, u, v, p: (u, -0.9 * v))


#: A support's displacement and velocity.
shaken = eig3.jit(lambda t: (0.1 * np.sin(3 * t), 0.3 * np.cos(3 * t)))


def acceleration(problem, u, v, t=0.0, rhs=None):
    """What rhs writes to a, by default the rhs of the problem; an entry that it does not write is NaN.

    The problem's rhs is called as a kernel calls it, so that it compiles once: Python would call it with other types.
    """
    if problem.unknowns.is_read:
        u, v = problem.unknowns.start(u, v, problem.unknowns.joined(problem.z0))
    a = np.full(np.size(u), np.nan)
    rhs = rhs or check_callback(problem.rhs, "rhs", VECTOR).call
    rhs(float(t), *(np.array(values, dtype=float) for values in (u, v, problem.params)), a)
    return a


def python(*arguments, cwd=None, **environment):
    """Return what a new process of Python prints."""
    command, env = [sys.executable, *map(str, arguments)], os.environ | environment
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=True).stdout


@functools.cache
def short_run():
    return eig3.problems.single_dof(t_end=1.0).integrate(h=0.1)


def made_up(t, u):
    """Return a run with these states, so that no right-hand side needs to be compiled."""
    return replace(short_run(), t=t, u=u, v=np.gradient(u, t, axis=0), _accelerations=None)


#: What two runs, or two ensembles, have in common if one of them was saved, cut into parts, or went on.
@pytest.fixture
def limited_files():
    """A context in which no file can have more than so many bytes, as on a full disk."""
    resource = pytest.importorskip("resource")

    @contextlib.contextmanager
    def limited(size):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return limited


SAME = ["t", "u", "v", "z", "h", "steps", "params", "n_steps", "n_rhs", "n_iterations", "n_rejected", "status"]
SAME += ["message", "labels", "drift", "extremes", "outputs", "events"]


def assert_same(one, other, names=(*SAME, "notes")):
    """Two runs, or two ensembles, have the same bits and the same words."""
    for name in names:
        ours, theirs = (getattr(each, name, None) for each in (one, other))
        if isinstance(ours, dict):
            assert list(ours) == list(theirs)
        if name == "events":
            ours, theirs = ([vars(found) for found in each.values()] for each in (ours, theirs))
        np.testing.assert_equal(ours, theirs, name)


def flying(problem):
    """Return a run of a scene as if no force acted."""
    t = np.linspace(*problem.t_span, 701)
    return made_up(t, problem.u0 + t[:, None] * problem.v0)


def refusals(values, types=()):
    """Make a test of calls, each under the words of the ValueError or TypeError that it gets: a sentence."""
    cases = [(ValueError, *row) for row in dict(values).items()] + [(TypeError, *row) for row in dict(types).items()]

    @pytest.mark.parametrize(("error", "words", "call"), cases)
    def test(error, words, call):
        with pytest.raises(error, match=words) as caught:
            call()
        assert re.fullmatch(r".*[.?]", str(caught.value))

    return test


@pytest.fixture(params=ALL_METHODS, ids=lambda method: repr(method).partition(", jacobian")[0])
def method(request):
    return request.param


@pytest.fixture(scope="session")
def users_folder(tmp_path_factory):
    """The folder of a user's method. All tests share it, so that its kernels are compiled only once."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "symplectic_euler.py").write_text(OWN_METHOD)
    return folder


@pytest.fixture
def symplectic_euler(users_folder, monkeypatch):
    """The method that the README of the kernels defines."""
    monkeypatch.syspath_prepend(users_folder)
    yield importlib.import_module("symplectic_euler").SymplecticEuler
    del sys.modules["symplectic_euler"], eig3.METHODS["symplectic-euler"]


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    path = os.environ.get("CHROME") or next((found for name in names if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("There is no Chromium here: install it, or give its path in the environment variable CHROME.")
    software = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL without a GPU
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=path, args=software)
        yield started
        started.close()


@pytest.fixture
def python_handler():
    """Python's own handler of SIGINT: a shell starts jobs in the background with the signal ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def few_reported(monkeypatch):
    """A report of a user's problem runs some methods of each kind: to compile more kernels would only take time."""
    few = "eig3", "cd", "rk4", "rk8", "bm6", "eig9"
    monkeypatch.setattr("eig3.bench.report.own_problem._INLINED", 1)
    monkeypatch.setattr("eig3.bench.report.parts.MODES", ("prepared", "pointer"))

    def plan(*given, methods, **options):
        return eig3.plan(*given, methods=few, **options)

    monkeypatch.setattr("eig3.bench.report.own_problem.plan", plan)
