"""Forces of effects on a few points are those of LAMMPS and of OpenMM."""

import json
from pathlib import Path

import numpy as np
import pytest

from eig3.bench.forces import in_lammps, in_openmm, systems
from eig3.bench.rivals import lammps

from .test_neighbours import by_python

STORED = json.loads(Path(__file__).with_name("forces_of_lammps.json").read_text())


def compare(found, expected, tolerance):
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def of_the_scene(name):
    problem = systems.problem(name)
    return by_python(problem).reshape(3, -1).T


@pytest.mark.parametrize("name", systems.NAMES)
def test_forces_are_those_of_lammps(name):
    """As `python -m eig3.bench.forces tests/forces_of_lammps.json` has written them."""
    compare(of_the_scene(name), np.array(STORED[name]), in_lammps.TOLERANCES.get(name, 1e-10))


@pytest.mark.system
@pytest.mark.skipif(not lammps.is_there(), reason=lammps.INSTALL)
@pytest.mark.parametrize("name", systems.NAMES)
def test_the_stored_forces_are_those_of_lammps(name):
    compare(np.array(STORED[name]), in_lammps.forces(name), 1e-12)


@pytest.mark.system
@pytest.mark.parametrize("name", systems.NAMES)
def test_forces_are_those_of_openmm(name):
    pytest.importorskip("openmm")
    compare(of_the_scene(name), in_openmm.forces(name), 1e-10)
