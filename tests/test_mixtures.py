"""Pair forces whose parameters differ between the points: mixing rules and charges."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

import eig3
from eig3.bench.rivals import lammps, openmm
from eig3.effects import Coulomb, Ewald, LennardJones, Link
from eig3.scene import Scene

from .conftest import acceleration
from .test_neighbours import by_python

MADELUNG = 1.7475645946331822  # of rock salt, for the distance of two ions


def rock_salt(n, effect, *others):
    """The ions of a crystal with n ions along each edge of its periodic box, at a distance of 1 m."""
    index = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    charges = (-1.0) ** index.sum(axis=1)
    scene = Scene(3, box=(n, n, n))
    ions = scene.mass(1.0, index)
    for each in (effect, *others):
        scene.add(each(charges), ions)
    return scene.problem((0.0, 1.0))


def test_the_damped_shifted_sum_approaches_madelungs():
    """Within the 1e-4 of the docstring; without the energies of single charges it would be 30 % less."""
    problem = rock_salt(8, lambda q: Coulomb(1.0, 3.0 / 4.0, 4.0, charges=q))
    energy = problem.energy_of(problem.u0, problem.v0) / (8**3 / 2)
    assert energy == pytest.approx(-MADELUNG, rel=1e-4)


@pytest.mark.parametrize(("accuracy", "cutoff"), [(1e-12, 2.0), (1e-4, 1.5)])
def test_ewalds_sum_has_madelungs_number(accuracy, cutoff):
    """The accuracy is the ratio of the neglected terms; they are many, and alternate in sign."""
    problem = rock_salt(4, lambda q: Ewald(1.0, q, cutoff, accuracy))
    energy = problem.energy_of(problem.u0, problem.v0) / (4**3 / 2)
    assert energy == pytest.approx(-MADELUNG, rel=10 * accuracy)


def ions(count, side, accuracy=1e-12):
    """Ions of several charges in a box that is no cube, of which the last is fixed."""
    rng = np.random.default_rng(7)
    sites = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:count]
    places, charges = sites * (1.0, 1.1, 1.2) + rng.uniform(-0.2, 0.2, sites.shape), rng.uniform(-1, 1, count)
    charges -= charges.mean()
    box = side * np.array([1.0, 1.1, 1.2])
    scene = Scene(3, box=box)
    points = scene._added(places, np.append(np.ones(count - 1), 0.0), 0 * places)
    scene.add(Ewald(2.0, charges, 0.45 * side, accuracy), points)
    return scene.problem((0.0, 1.0)), places, charges, box


def test_ewalds_force_is_the_gradient():
    """Of more ions than are computed together, along some coordinates: differences err by h^2 and by 1e-15 / h."""
    problem, *_ = ions(200, 6, 1e-10)
    a = acceleration(problem, problem.u0, problem.v0)
    h = 1e-4
    for k in (0, 5, 250, 400, 596):
        energies = [problem.energy_of(problem.u0 + h * sign * (np.arange(a.size) == k), problem.v0) for sign in (-1, 1)]
        assert a[k] == pytest.approx(-(energies[1] - energies[0]) / (2 * h), rel=1e-5, abs=1e-6)


def test_ewalds_forces_forget_a_state_that_was_not_finite():
    """A run with tolerances rejects a step to such a state, and goes on with a shorter one."""
    problem = rock_salt(4, lambda q: Ewald(1.0, q, 1.9))
    params, a = problem.params.copy(), np.empty(problem.u0.size)
    for u in (problem.u0, np.full(a.size, np.nan), problem.u0):
        problem.rhs(0.0, u, problem.v0, params, a)
    np.testing.assert_array_equal(a, acceleration(problem, problem.u0, problem.v0))


def test_ewalds_energy_leaves_out_what_fixed_charges_share_up_to_the_cutoff():
    """As the docstring says; the sum over the waves has all charges."""
    effect, energies = Ewald(2.0, [1.0, 0.5, -1.5], 2.0, 1e-8), []
    for masses in ([1.0, 1.0, 1.0], [1.0, 0.0, 0.0]):
        scene = Scene(3, box=(4.0, 4.0, 4.0))
        x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.9, 1.0, 0.0]])
        scene.add(effect, scene._added(x, np.array(masses), 0 * x))
        problem = scene.problem((0.0, 1.0))
        energies.append(problem.energy_of(problem.u0, problem.v0))
    r = np.hypot(1.1, 1.0)
    shared = 2.0 * 0.5 * -1.5 * math.erfc(effect.alpha * r) / r
    assert energies[0] - energies[1] == pytest.approx(shared, rel=1e-12)


@pytest.mark.system
def test_ewalds_sum_is_openmms():
    """Whose 1 / (4 pi epsilon_0) is 138.93545764438198 kJ/mol nm."""
    pytest.importorskip("openmm")
    from openmm import NonbondedForce

    problem, places, charges, box = ions(60, 4)
    force = NonbondedForce()
    for charge in charges:
        force.addParticle(charge, 1.0, 0.0)
    force.setNonbondedMethod(NonbondedForce.Ewald)
    force.setCutoffDistance(1.8)
    force.setEwaldErrorTolerance(1e-13)
    simulation = openmm.Simulation([force], places, 0 * places, 1e-3, box=box)
    found = acceleration(problem, problem.u0, problem.v0).reshape(3, -1).T
    scale = 2.0 / 138.93545764438198
    expected = scale * simulation.forces()[:-1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    energy = simulation.context.getState(getEnergy=True).getPotentialEnergy()._value
    assert problem.energy_of(problem.u0, problem.v0) == pytest.approx(scale * energy, rel=1e-10)


@pytest.mark.system
@pytest.mark.skipif(not lammps.is_there(), reason=lammps.INSTALL)
def test_rock_salt_is_as_in_lammps():
    """With the energy of single charges. The erfc of LAMMPS has errors up to 1.5e-7, which add up to 9e-7 J an ion."""
    problem = rock_salt(
        6, lambda q: Coulomb(1.0, 1.0, 3.0, charges=q), lambda q: LennardJones(0.1 + 0.05 * q, 1 + 0.1 * q, 2.5)
    )
    places = problem.u0 + np.random.default_rng(1).uniform(-0.1, 0.1, problem.u0.size)
    before = """units lj
atom_style charge
atom_modify map array
boundary p p p
region box block 0 6 0 6 0 6
create_box 2 box"""
    positive = " ".join(str(k + 1) for k in np.flatnonzero(np.indices((6, 6, 6)).sum(axis=0).ravel() % 2 == 0))
    after = f"""mass * 1.0
group positive id {positive}
set group all type 2 charge -1.0
set group positive type 1 charge 1.0
pair_style hybrid/overlay coul/dsf 1.0 3.0 lj/smooth/linear 2.5
pair_coeff * * coul/dsf
pair_coeff 1 1 lj/smooth/linear 0.15 1.1
pair_coeff 2 2 lj/smooth/linear 0.05 0.9
pair_coeff 1 2 lj/smooth/linear {np.sqrt(0.15 * 0.05):.17g} 1.0
fix motion all nve"""
    other = lammps.Simulation(before, after, places.reshape(3, -1).T % 6.0, np.zeros((216, 3)))
    found = acceleration(problem, places, problem.v0).reshape(3, -1).T
    np.testing.assert_allclose(found, other.forces(), rtol=0, atol=1e-6 * np.abs(found).max())
    energy = problem.energy_of(places, problem.v0) / 216
    assert energy == pytest.approx(other.solver.get_thermo("pe"), abs=2e-6)


@dataclass(frozen=True, eq=False)
class Bonding(Link):
    """A law with each rule of mixing."""

    strength: object
    length: object
    sign: object
    reach: float = 3.0

    cutoff_field = "reach"
    mixed = {"strength": "geometric", "length": "arithmetic", "sign": "product"}  # noqa: RUF012

    tension = eig3.jit(lambda r, strength, length, sign: sign * strength * (r - 3.0) * (r - length))


def by_hand(x, pairs, of_pair):
    a = np.zeros_like(x)
    for i, j in pairs:
        way = x[j] - x[i]
        r = np.sqrt(way @ way)
        strength, length, sign = of_pair(i, j)
        pull = sign * strength * (r - 3.0) * (r - length) * way / r if r < 3.0 else 0.0
        a[i], a[j] = a[i] + pull, a[j] - pull
    return a


def test_each_rule_of_a_law_of_ones_own():
    """A sign that is equal in all points is squared too, and a pair of two groups has the values of its first point."""
    rng = np.random.default_rng(5)
    x, strength, length = rng.uniform(0, 4, (30, 2)), rng.uniform(1, 2, 30), rng.uniform(0.5, 2, 30)
    sign = rng.choice([-1.0, 1.0], 30)
    one = [(i, j) for i in range(30) for j in range(i)]
    two = [(i, j) for i in range(20) for j in range(20, 30)]
    cases = [
        (
            sign,
            None,
            one,
            lambda i, j: (np.sqrt(strength[i] * strength[j]), (length[i] + length[j]) / 2, sign[i] * sign[j]),
        ),
        (-2.0, None, one, lambda i, j: (np.sqrt(strength[i] * strength[j]), (length[i] + length[j]) / 2, 4.0)),
        (sign[:20], 20, two, lambda i, j: (strength[i], length[i], sign[i])),
    ]
    for signs, count, pairs, of_pair in cases:
        scene = Scene(2)
        points = scene.mass(1.0, x)
        effect = Bonding(strength[:count], length[:count], signs)
        scene.add(effect, points[:count], **({} if count is None else {"others": points[count:]}))
        problem = scene.problem((0.0, 1.0))
        found = by_python(problem).reshape(2, -1).T
        np.testing.assert_allclose(found, by_hand(x, pairs, of_pair), atol=1e-12)


def test_a_mixture_with_charges_conserves_its_energy():
    """The force is the derivative of the energy: halving the step divides the error of order 4 by 16."""
    rng = np.random.default_rng(2)
    index = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    kind = index.sum(axis=1) % 2
    scene = Scene(3, box=(5.0, 5.0, 5.0))
    ions = scene.mass(np.where(kind, 2.0, 1.0), 1.25 * index + rng.normal(0, 0.05, index.shape))
    scene.add(LennardJones(np.where(kind, 1.0, 0.3), np.where(kind, 1.2, 0.9), cutoff=2.4), ions)
    scene.add(Coulomb(2.0, 1.2, 2.4, charges=1.0 - 2.0 * kind), ions)
    problem = scene.problem((0.0, 0.25))
    drifts = [problem.integrate(h=h, method="rk4", save_every=None).drift["energy"] for h in (0.005, 0.0025)]
    assert drifts[0] / drifts[1] > 10
    assert drifts[1] < 1e-5 * abs(problem.energy_of(problem.u0, problem.v0))


def test_opposite_charges_limit_the_step():
    """As if each charge were in the prefactor of the one pair: two equal charges would repel each other."""

    def pair(coulomb):
        scene = Scene(3)
        ends = scene.mass(1.0, [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
        scene.add(LennardJones(1.0, 1.0, 2.5), ends)
        scene.add(coulomb, ends)
        return scene.problem((0.0, 10.0)).critical_step().limit

    limit = pair(Coulomb(-30.0, 0.4, 2.5, charges=(1.0, 1.0)))
    assert pair(Coulomb(30.0, 0.4, 2.5, charges=(1.0, -1.0))) == pytest.approx(limit, rel=1e-6)
    assert pair(Coulomb(30.0, 0.4, 2.5, charges=(1.0, 1.0))) > 1.1 * limit


@dataclass(frozen=True, eq=False)
class Wrong(Bonding):
    """A rule that does not exist, or a cutoff that is not a mean."""

    mixed = {"length": "harmonic"}  # noqa: RUF012


@dataclass(frozen=True, eq=False)
class WrongCutoff(Bonding):
    """A list of neighbours has sums of cutoffs."""

    mixed = {"reach": "geometric"}  # noqa: RUF012


def ewald(box=(5.0, 5.0, 5.0), charges=(1.0, -1.0), accuracy=1e-6, **options):
    scene = Scene(3, box=box)
    points = scene.mass(1.0, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]][: len(charges)])
    scene.add(Ewald(1.0, charges, 2.0, accuracy), points, **options)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda s, a: LennardJones(1.0, 1.0, 2.5, mixing="sixthpower"), "mixing of LennardJones must be 'lorentz"),
        (lambda s, a: s.add(LennardJones([1.0, 2.0], 0.3, 0.7), a), r"epsilon of LennardJones has the shape \(2,\)"),
        (lambda s, a: Coulomb(1.0, charges=[1.0, -1.0]), "cutoff of Coulomb must be given with charges"),
        (
            lambda s, a: s.add(Coulomb(1.0, 0.0, 2.0, charges=1.0), a[0], a[1]),
            "charges of Coulomb must be of one array",
        ),
        (lambda s, a: s.add(Coulomb(1.0, 0.0, 2.0, charges=1.0), a[:1], others=a[1:]), "charges of Coulomb must be of"),
        (lambda s, a: s.add(Bonding(1.0, 1.0, [1.0, 2.0], 2.0), a), r"sign of Bonding has the shape \(2,\)"),
        (lambda s, a: s.add(Bonding([1.0, -1.0, 1.0], 1.0, 1.0, 2.0), a), "strength of Bonding must not be negative"),
        (lambda s, a: s.add(Wrong(1.0, 1.0, 1.0, 2.0), a), "mixed of Wrong has the rule 'harmonic' of length"),
        (
            lambda s, a: s.add(WrongCutoff(1.0, 1.0, 1.0, 2.0), a),
            "mixed of WrongCutoff must have the rule 'arithmetic'",
        ),
        (lambda s, a: Ewald(1.0, [1.0, -1.0], 2.0, accuracy=2.0), "accuracy of Ewald must be above 0 and below 1"),
        (lambda s, a: Ewald([1.0, 2.0], [1.0, -1.0], 2.0), "prefactor of Ewald must be one number"),
        (lambda s, a: s.add(Ewald(1.0, [1.0, -1.0, 0.0], 2.0), a), "Ewald needs a scene of 3 dimensions"),
        (lambda s, a: ewald(box=(5.0, 5.0, None)), "Ewald needs a scene with a periodic box along x, y and z"),
        (lambda s, a: ewald(charges=(1.0, 1.0)), "charges of Ewald must have the sum 0"),
        (lambda s, a: ewald(charges=(0.0,)), "charges of Ewald must be of at least two points"),
        (lambda s, a: ewald((50.0, 50.0, 5e4)), "accuracy of Ewald must be larger, or the cutoff: .* 3e.09 waves"),
        (lambda s, a: ewald(accuracy=0.5), "accuracy of Ewald must be smaller, or the cutoff: .* would have no waves"),
        (lambda s, a: ewald(exclude_bonded=("1-2",)), "Ewald acts between all charges"),
        (
            lambda s, a: s.add(Coulomb(1.0, 0.0, 2.0, charges=1.0), a, exclude_bonded=("1-2",)),
            "charges of Coulomb act between all points: leave out exclude_bonded, and add",
        ),
    ],
)
def test_errors(act, message):
    scene = Scene(2, box=(5.0, None))
    points = scene.mass(1.0, [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]])
    with pytest.raises((TypeError, ValueError), match=message):
        act(scene, points)
