"""Pair forces whose parameters differ between the points: mixing rules and charges."""

from dataclasses import dataclass

import numpy as np
import pytest

import eig3
from eig3.effects import Coulomb, LennardJones, Link
from eig3.scene import Scene

from .conftest import acceleration

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


@dataclass(frozen=True, eq=False)
class Bonding(Link):
    """A law with each rule of mixing."""

    strength: object
    length: object
    sign: object
    reach: float = 3.0

    cutoff_field = "reach"
    mixed = {"strength": "geometric", "length": "arithmetic", "sign": "product"}  # noqa: RUF012

    @staticmethod
    @eig3.jit
    def tension(r, strength, length, sign):
        return sign * strength * (r - 3.0) * (r - length)


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
        found = acceleration(problem, problem.u0, problem.v0).reshape(2, -1).T
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

    def pair(coulomb, charge_of_second=-1.0):
        scene = Scene(3)
        ends = scene.mass(1.0, [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
        scene.add(LennardJones(1.0, 1.0, 2.5), ends)
        scene.add(coulomb, ends)
        return scene.problem((0.0, 10.0)).critical_step().limit

    limit = pair(Coulomb(-30.0, 0.4, 2.5))
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
    ],
)
def test_errors(act, message):
    scene = Scene(2, box=(5.0, None))
    points = scene.mass(1.0, [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]])
    with pytest.raises((TypeError, ValueError), match=message):
        act(scene, points)
