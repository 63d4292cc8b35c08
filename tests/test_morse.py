"""Morse between all near points of a group, as morse/smooth/linear of LAMMPS, and as a bond without a cutoff."""

import numpy as np
import pytest

from eig3.effects import Coulomb, LennardJones, Morse
from eig3.scene import Scene

from .test_neighbours import by_python, energy_by_python

D, A, R0, CUTOFF = 0.7, 1.9, 1.1, 2.5


def shifted(r):
    """The energy and the force, by the formulas of the manual of LAMMPS."""
    e, slope = (lambda s: D * (1 - np.exp(-A * (s - R0))) ** 2), 2 * D * A * (np.exp(-A * (CUTOFF - R0)))
    slope *= 1 - np.exp(-A * (CUTOFF - R0))
    near = np.exp(-A * (r - R0))
    energy = e(r) - e(CUTOFF) - (r - CUTOFF) * slope
    return np.where(r < CUTOFF, energy, 0.0), np.where(r < CUTOFF, 2 * D * A * near * (1 - near) - slope, 0.0)


@pytest.mark.parametrize("pairs", ["near", "named"])
def test_a_cutoff_shifts_the_force(pairs):
    x = np.random.default_rng(3).uniform(0.0, 4.0, (12, 3))
    i, j = np.triu_indices(12, 1)
    scene = Scene(3)
    atoms = scene.mass(1.0, x)
    scene.add(Morse(D, A, R0, CUTOFF), *([atoms] if pairs == "near" else [atoms[i], atoms[j]]))
    problem = scene.problem((0.0, 1.0))
    way = x[j] - x[i]
    r = np.linalg.norm(way, axis=1)
    energy, tension = shifted(r)
    assert energy_by_python(problem) == pytest.approx(energy.sum(), rel=1e-12)
    force = np.zeros_like(x)
    np.add.at(force, i, (tension / r)[:, None] * way)
    np.add.at(force, j, -(tension / r)[:, None] * way)
    np.testing.assert_allclose(atoms.velocities(by_python(problem)), force, rtol=0, atol=1e-12)


def test_without_a_cutoff_it_is_a_bond():
    bond, pair = Morse(D, A, R0), Morse(D, A, R0, CUTOFF)
    assert (bond.picture, pair.picture) == ("line", "")
    scene = Scene(2)
    with pytest.raises(TypeError, match="Morse has no cutoff, and thus needs two arguments of points"):
        scene.add(bond, scene.mass(1.0, [(0.0, 0.0), (1.0, 0.0)]))
    for effect in (Morse, LennardJones):
        with pytest.raises(ValueError, match=f"cutoff of {effect.__name__} must be positive"):
            effect(1.0, 1.0, *[1.0] * (effect is Morse), cutoff=0.0)


def test_coulombs_law_without_a_cutoff():
    """The plain and the damped law at any distance, as the limit of a far cutoff."""
    for alpha in (0.0, 0.3):
        forces, energies = [], []
        for cutoff in (None, 1e9):
            scene = Scene(3)
            scene.add(Coulomb(-1.3, alpha, cutoff), scene.mass(1.0, (0.0, 0.0, 0.0)), scene.mass(1.0, (1.0, 2.0, 2.0)))
            problem = scene.problem((0.0, 1.0))
            forces.append(by_python(problem))
            energies.append(energy_by_python(problem))
        np.testing.assert_allclose(forces[0], forces[1], rtol=0, atol=1e-15)
        assert energies[0] == pytest.approx(energies[1], abs=1e-8)
        if not alpha:
            assert energies[0] == -1.3 / 3
            np.testing.assert_allclose(forces[0][::2], 1.3 / 27 * np.array([1, 2, 2]), rtol=1e-14)
