"""Pairs that bonds join are left out of forces between near points, by how many bonds they are apart."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pytest

import eig3
from eig3 import effects
from eig3.effects import Link
from eig3.scene import Scene

from .test_neighbours import energy_by_python

CHAIN = [(0, 1), (1, 2), (2, 3)]
BRANCHED = [(0, 1), (1, 2), (2, 3), (1, 4), (4, 5)]
RING = [(0, 1), (1, 2), (2, 3), (3, 0)]
CHOICES = [("1-2",), ("1-3",), ("1-4",), ("1-2", "1-3"), ("1-2", "1-3", "1-4"), ()]


@dataclass(frozen=True, eq=False)
class Count(Link):
    """An energy of 1 J for each pair."""

    cutoff: float

    cutoff_field = "cutoff"

    tension = eig3.jit(lambda r, cutoff: 0.0)
    potential = eig3.jit(lambda r, cutoff: 1.0)


def distances(bonds, count):
    """The numbers of bonds between all points, by powers of the matrix of neighbours."""
    near = np.zeros((count, count), dtype=int)
    near[tuple(np.array(bonds).T)] = 1
    near += near.T
    found, walks = np.full((count, count), 99), np.eye(count, dtype=int)
    for length in range(count):
        found = np.where((walks > 0) & (found == 99), length, found)
        walks = walks @ near
    return found


def molecule(bonds, effect, exclude, bond=None, x=None):
    count = 1 + max(map(max, bonds))
    rng = np.random.default_rng(7)
    x = rng.uniform(0, 1.5, (count, 3)) if x is None else x
    scene = Scene(3)
    atoms = scene.mass(1.0, x)
    for i, j in bonds:
        scene.add(bond or effects.Morse(1.0, 1.0, 1.0), atoms[i], atoms[j])
    for k in range(len(bonds) - 1):  # angles and a dihedral are no bonds
        if bonds is CHAIN:
            scene.add(effects.HarmonicAngle(1.0, 1.9), *atoms[k : k + 3])
    alone = scene.problem((0.0, 1.0)) if effect is not None else None
    scene.add(effect, atoms, exclude_bonded=exclude)
    whole = scene.problem((0.0, 1.0))
    return x, energy_by_python(whole) - energy_by_python(alone)


@pytest.mark.parametrize("exclude", CHOICES)
@pytest.mark.parametrize("bonds", [CHAIN, BRANCHED, RING], ids=["chain", "branched", "ring"])
def test_pairs_are_counted(bonds, exclude):
    """In a ring of four, neighbours are 1-2 and not 1-4 around it, as in LAMMPS."""
    between = distances(bonds, 1 + max(map(max, bonds)))
    orders = [int(order[-1]) - 1 for order in exclude]
    expected = sum(between[i, j] not in orders for i, j in combinations(range(len(between)), 2))
    assert molecule(bonds, Count(9.0), exclude)[1] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("exclude", CHOICES)
def test_the_energy_is_a_direct_sum(exclude):
    """The shifted force of Lennard-Jones, over the pairs of butane that are left."""
    x, energy = molecule(CHAIN, effects.LennardJones(0.7, 0.9, 2.5), exclude, x=np.array(BUTANE))

    def potential(r):
        return 4 * 0.7 * ((0.9 / r) ** 12 - (0.9 / r) ** 6)

    slope = 24 * 0.7 * ((0.9 / 2.5) ** 6 - 2 * (0.9 / 2.5) ** 12) / 2.5
    r = [np.linalg.norm(x[i] - x[j]) for i, j in combinations(range(4), 2) if f"1-{j - i + 1}" not in exclude]
    assert energy == pytest.approx(
        sum(potential(d) - potential(2.5) - (d - 2.5) * slope for d in r if d < 2.5), rel=1e-12
    )


BUTANE = [(0.0, 0.0, 0.0), (1.0, 0.4, 0.0), (1.9, -0.2, 0.2), (2.4, 0.6, 0.5)]


def test_rods_and_rigid_bodies_have_bonds():
    scene = Scene(2)
    ends = scene.mass(1.0, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
    scene.add(effects.Rod(), ends[:2], ends[1:])
    body = scene.body(1.0, 1.0, (3.0, 1.0))
    ears = body.point([(0.5, 0.0), (-0.5, 0.0)])
    scene.add(effects.LinearSpring(1.0, 1.0), ears[0], ends[2])
    before = scene.problem((0.0, 1.0))
    for points, exclude, count in ((ends, ("1-2",), 1), (ears, ("1-2",), 0), (ears, (), 1)):
        counted = Scene(2)
        counted.__dict__.update({k: v.copy() if isinstance(v, list) else v for k, v in vars(scene).items()})
        counted.add(Count(9.0), Points(counted, points), exclude_bonded=exclude)
        problem = counted.problem((0.0, 1.0))
        energies = [p.energy_of(p.u0, p.v0) for p in (problem, before)]
        assert energies[0] - energies[1] == pytest.approx(count, abs=1e-12)


def Points(scene, points):  # noqa: N802, the points of a copy of their scene
    return type(points)(scene, points.numbers)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (True, TypeError, r'exclude_bonded must name pairs that bonds join, such as \("1-2", "1-3", "1-4"\), not True'),
        ("1-2", TypeError, "exclude_bonded must name pairs"),
        (("1-5",), ValueError, "exclude_bonded must name pairs .*, not '1-5'"),
    ],
)
def test_wrong_orders_are_refused(given, error, message):
    scene = Scene(2)
    with pytest.raises(error, match=message):
        scene.add(Count(1.0), scene.mass(1.0, [(0.0, 0.0), (1.0, 0.0)]), exclude_bonded=given)
