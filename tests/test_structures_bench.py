"""The benchmark of structures: its cube, its C loop, its rivals and its tables."""

import numpy as np
import pytest

import eig3
from eig3.bench import structures
from eig3.bench.c import has_compiler
from eig3.bench.rivals import opensees
from eig3.bench.solids import YOUNG, cube, element_stiffness, size
from eig3.cli import main

SYSTEM = pytest.mark.system


def test_an_element_has_six_rigid_motions_and_stretches_as_it_must():
    K = element_stiffness(0.5)
    assert np.sum(np.abs(np.linalg.eigvalsh(K)) < 1e-9 * YOUNG) == 6
    corners = 0.5 * np.array(list(np.ndindex(2, 2, 2)))
    stretched = corners * [1.0, -0.3, -0.3]  # strain 1 along x, with Poisson's ratio
    assert stretched.ravel() @ K @ stretched.ravel() == pytest.approx(YOUNG * 0.5**3, rel=1e-12)


def test_the_cube_is_symmetric_and_stretches_as_a_bar():
    """With the strain of a bar, only its fixed and its free side carry forces."""
    masses, K = cube(3)
    assert masses.size == K.shape[0] == size(3)
    assert masses.sum() == pytest.approx(3 * (1 - 1 / 6), rel=1e-14)  # half of a layer is fixed
    assert abs(K - K.T).max() < 1e-12 * YOUNG
    places = np.array(list(np.ndindex(4, 4, 4)))[16:] / 3
    forces = (K @ (places * [1.0, 0.0, 0.0]).ravel()).reshape(-1, 3)[:, 0]
    np.testing.assert_allclose(forces[:32], 0.0, atol=1e-9 * YOUNG)
    lame = YOUNG * 0.3 / (1.3 * 0.4)
    assert forces[32:].sum() == pytest.approx(lame + YOUNG / 1.3, rel=1e-12)


@SYSTEM
@pytest.mark.parametrize("method", ["eig3", "cd"])
def test_the_c_loop_computes_the_same(method):
    if not has_compiler():
        pytest.fail("a C compiler is needed by the system tests")
    (masses, K), h, steps = cube(2), 1e-3, 50
    state = np.zeros((4, masses.size))
    v0 = np.random.default_rng(2).normal(size=masses.size)
    state[1] = v0 if method == "eig3" else h * v0
    structures.in_c(method, masses, K.tocsr(), h, steps, state)()
    stepper = eig3.linear(masses, None, K, t_span=(0, 1), v0=v0).stepper(h=h, method=method)
    stepper.advance(steps)
    np.testing.assert_allclose(state[0], stepper.u, rtol=0, atol=1e-12)


@SYSTEM
def test_the_command_prints_the_tables(capsys, monkeypatch):
    """OpenSees is another package's choice: its rows are there where it is installed."""
    monkeypatch.setattr(structures, "_METHODS", ("eig3", "rk4"))
    monkeypatch.setattr(structures, "_WITHOUT_DAMPING", ("bm6",))
    monkeypatch.setattr(structures, "_SECONDS", 1e-3)
    monkeypatch.setattr(structures, "_ERRORS", (1e-2,))
    monkeypatch.setattr(structures, "_TRUTH", 1e-4)
    assert main(["bench", "structures", "--sides", "2", "--repeats", "1"]) == 0
    printed = capsys.readouterr().out
    rows = ["54, EIG-3 ", "54, CD ", "54, EIG-3, consistent mass", "54, CD, SciPy's product", "frame, record, RK4"]
    rows += ["54, EIG-3 in C, rows", "frame, struck, EIG-3", "frame, struck, BM6"]
    rows += ["0.01  | ", *["54, OpenSees Newmark"] * opensees.is_there()]
    for row in rows:
        assert f"| {row}" in printed
