"""The constraints of a scene: their rows, and a check that they hold and are independent at the start."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

try:
    from scipy.sparse import csc_array, csr_array, diags_array
    from scipy.sparse.linalg import splu
except ImportError as error:
    raise ImportError("Constraints and rigid bodies need SciPy: pip install 'eig3[mechanisms]'.") from error

from .constraint import TINY, Constraint
from .constraint_table import Arm, ConstraintTable, Row
from .effect import Effect, Motion
from .joint_law import HingeLaw, SlideLaw
from .names import words
from .placed import Placed

_WRONG = 1e-9  # the largest phi at the start, relative to the largest length, that is round-off
_DEPENDENT = 1e-10  # the least pivot of independent rows, relative to the diagonal entry
_FREE = 1e-8  # the largest mobility of a vector that a joint holds, relative to the mobility without joints
_NOTED = 1e-6  # a change of the initial velocities, relative to the largest velocity, that is reported
_MOST_NAMED = 4  # constraints that an error names


@dataclass(frozen=True, eq=False)
class ConstraintSystem:
    """The constraints of a scene.

    Attributes
    ----------
    table : ConstraintTable
    names : list of str
        The name of each row, such as "rod 3" or "revolute joint 2 (body 1, ground)".
    units : list of str
        The unit of the reaction of each row.
    counts : Counter
        The number of constraints by the title of their effect.
    effects : list of Effect
    kinds : list of (Placed, ndarray of int, shape (members,))
        The constraints that define `phi`, or have a target that depends on the time, and their rows.
    hinged : list of (str, Arm, Arm)
        For laws about an axis in space: the name, a vector of one body across the axis, and the axis as a vector of the
        other body.
    """

    table: ConstraintTable
    names: list[str]
    units: list[str]
    counts: Counter[str]
    effects: list[Effect]
    kinds: list[tuple[Placed, np.ndarray]]
    hinged: list[tuple[str, Arm, Arm]]

    @property
    def rows(self) -> tuple[str, ...]:
        """A different name for each row: the name, and the number of the row if several have it."""
        several, seen = Counter(self.names), Counter[str]()
        found = []
        for name in self.names:
            found.append(f"{name} {seen[name]}" if several[name] > 1 else name)
            seen[name] += 1
        return tuple(found)

    @property
    def depends_on_time(self) -> bool:
        return any({"distance", "target"} & law.effect.functions().keys() for law, _ in self.kinds)


def collected(cloud: Any, placed: Sequence[Placed], degrees: int) -> ConstraintSystem:
    """Collect the constraints of a scene."""
    laws = [law for law in placed if isinstance(law.effect, Constraint)]
    moved = np.concatenate([[], *(law.points[0] for law in placed if isinstance(law.effect, Motion))])
    for law in laws:
        if np.isin(np.concatenate(law.points), moved).any():
            raise ValueError(
                f"{law.effect.title} takes fixed points that no motion moves: move a mass with a PrescribedDistance."
            )
    arms: list[Arm] = []
    rows: list[Row] = []
    names: list[str] = []
    units: list[str] = []
    counts: Counter[str] = Counter()
    kinds: list[tuple[Placed, np.ndarray]] = []
    slopes = 0
    for law in laws:
        effect, first = law.effect, len(rows)
        assert isinstance(effect, Constraint)
        functions = effect.functions()
        for member, points in enumerate(zip(*(array.tolist() for array in law.points), strict=True)):
            name = _name(cloud, f"{words(effect.title)} {counts[effect.title]}", points)
            counts[effect.title] += 1
            if "phi" in functions:
                places = tuple(len(arms) + k for k in range(len(points)))
                arms += [_arm(cloud, (point,), (1.0,), np.zeros(len(cloud.box))) for point in points]
                rows.append(Row(places, slopes=tuple(slopes + k for k in range(len(points)))))
                names.append(name)
                units.append("N m" if effect.period else "N")  # an angle has no unit
                slopes += len(points)
                continue
            positions = [cloud.positions[point] for point in points]
            values = {key: column[member] for key, column in law.columns.items() if key not in functions}
            for equation in effect.equations(positions, values):
                both: list[int] = []
                for vector in (equation.first, equation.second):
                    if both and vector is equation.first:
                        both.append(both[0])
                        continue
                    both.append(len(arms))
                    arms.append(_arm(cloud, points, *vector))
                rows.append(Row((both[0], both[1]), equation.scale, equation.target))
                names.append(name)
                units.append(equation.unit)
        if functions:
            kinds.append((law, np.arange(first, len(rows))))
    _check_turns(cloud, placed, names)
    rows = [Row(row.arms, slopes=tuple(len(arms) + k for k in row.slopes)) if row.slopes else row for row in rows]
    length = max(np.abs(cloud.positions).max(), *(np.sqrt(abs(row.target)) for row in rows)) or 1.0
    table = ConstraintTable(1 / cloud.masses[cloud.is_own], len(cloud.box), arms, rows, slopes, length, degrees)
    return ConstraintSystem(table, names, units, counts, [law.effect for law in laws], kinds, _hinged(cloud, placed))


def _check_turns(cloud: Any, placed: Sequence[Placed], names: Sequence[str]) -> None:
    """Refuse a law about an axis between two bodies if a joint prevents each rotation between them."""
    held = {name.partition("(")[2]: name for name in names if name.startswith(("prismatic joint", "weld"))}
    for law in placed:
        if not isinstance(law.effect, HingeLaw) or isinstance(law.effect, SlideLaw):
            continue
        for points in zip(*(array.tolist() for array in law.points), strict=True):
            name = _name(cloud, words(law.effect.title), points)
            if joint := held.get(name.partition("(")[2]):
                remedy = "leave it out"
                if joint.startswith("prismatic"):
                    remedy += ", or for a force along the joint add CoulombFriction to body.centre, or a LinearDamper"
                raise ValueError(f"{name} acts on a rotation, which {joint} prevents: {remedy}.")


def _hinged(cloud: Any, placed: Sequence[Placed]) -> list[tuple[str, Arm, Arm]]:
    """Return two vectors of the first body of each law about an axis in space, and the axis."""
    found = []
    for law in (law for law in placed if law.effect.needs_hinge):
        for points in zip(*(array.tolist() for array in law.points), strict=True):
            name, unit = _name(cloud, words(law.effect.title), points), list(cloud.bodies.carried[points[0]][0])[1:]
            vector, _, axis = cloud.positions[list(points)]
            other = _arm(cloud, points[2:], (1.0,), np.zeros(3))
            for across in (vector, np.cross(axis, vector)):
                found.append((name, _arm(cloud, unit, cloud.positions[unit] @ across, np.zeros(3)), other))
    return found


def _name(cloud: Any, constraint: str, points: Sequence[int]) -> str:
    """Return the name of a constraint by what the user wrote: the joint to which it belongs, and its bodies."""
    bodies = [cloud.bodies.body_of(point) for point in points]
    if bodies == [None] * len(bodies):
        return constraint
    of_others = ["mass" if cloud.masses[point] else "ground" for point in points]
    whose = [of if body is None else f"body {body}" for body, of in zip(bodies, of_others, strict=True)]
    return f"{cloud.bodies.joints.get(points[0], constraint)} ({', '.join(sorted(set(whose)))})"


def _arm(cloud: Any, points: Sequence[int], factors: Any, constant: np.ndarray) -> Arm:
    """Return a sum of positions of points as an arm of masses."""
    constant, found = np.array(constant, dtype=float), dict[int, float]()
    for point, factor in zip(points, factors, strict=True):
        for part, share in zip(*cloud.bodies.carried.get(point, ((point,), (1.0,))), strict=True):
            if cloud.masses[part] > 0:
                mass = int(cloud.free[part])
                found[mass] = found.get(mass, 0.0) + float(factor * share)
            else:
                constant = constant + factor * share * cloud.positions[part]
    kept = {mass: factor for mass, factor in found.items() if factor}
    return Arm(np.array(list(kept), dtype=int), np.array(list(kept.values()), dtype=float), constant)


def fitting(system: ConstraintSystem, u0: np.ndarray, v0: np.ndarray, t: float) -> np.ndarray:
    """Check the constraints at the start; return the velocities nearest to v0 that satisfy them.

    Parameters
    ----------
    system : ConstraintSystem
    u0, v0 : ndarray, shape (degrees,)
    t : float
        The time at the start, s.

    Raises
    ------
    ValueError
        If a constraint does not hold, or some depend on each other. The error names them.

    Warns
    -----
    UserWarning
        If v0 violates the constraints.
    """
    table = system.table
    size = table.dimension * len(table.weights)
    values, gradients = _linearised(system, u0[:size].reshape(table.dimension, -1).T)
    places = values.copy()
    rates = _driven(system, t, values)
    wrong = np.flatnonzero(~(np.abs(values) <= _WRONG * table.length))
    if wrong.size:
        row, value, place = wrong[0], values[wrong[0]], places[wrong[0]]
        what = _lengths(table.rows[row], place, value) or f"does not hold at the start, where its phi is {value:.3g}"
        raise ValueError(f"{system.names[row]} {what}: move its points.")
    weights = np.tile(table.weights, table.dimension)
    solve = _factors(system, gradients, weights)
    _check_hinges(system, u0[:size].reshape(table.dimension, -1).T, gradients, weights, solve)
    wanted = solve(gradients @ v0[:size] + rates)
    change = -weights * (gradients.T @ wanted)
    if np.abs(change).max() > _NOTED * np.abs(v0[:size]).max(initial=0.0):
        row = int(np.argmax(np.abs(gradients @ v0[:size] + rates)))
        warnings.warn(
            f"the velocities at the start do not keep {system.names[row]}: the run starts with the nearest ones that "
            "do.",
            stacklevel=4,
        )
    return np.concatenate([v0[:size] + change, v0[size:]])


def _check_hinges(
    system: ConstraintSystem, places: np.ndarray, gradients: csr_array, weights: np.ndarray, solve: Any
) -> None:
    """Refuse a law about an axis if the axes in the two bodies can part: their torques would not be opposite."""
    for name, *arms in system.hinged:
        vectors, slope = [arm.factors @ places[arm.points] + arm.constant for arm in arms], np.zeros_like(places)
        for arm, vector in zip(arms, reversed(vectors), strict=True):
            slope[arm.points] += np.outer(arm.factors, vector)
        moved = weights * slope.T.ravel()
        free = moved - weights * (gradients.T @ solve(gradients @ moved))
        if slope.T.ravel() @ free > _FREE * (slope.T.ravel() @ moved):
            raise ValueError(
                f"{name} needs a revolute joint with the same axis between the same bodies: add "
                "body.revolute(other, position, axis)."
            )


def _lengths(row: Row, place: float, value: float) -> str:
    """Say which length a rod has, and how far apart its ends are; empty for another constraint.

    `value` is phi at the start, and `place` is phi with the target in the row, which does not depend on the time.
    """
    if row.slopes or row.arms[0] != row.arms[1]:
        return ""
    square = place / row.scale + row.target
    return f"has the length {np.sqrt(square - value / row.scale):.6g} m, but its ends are {np.sqrt(square):.6g} m apart"


def _driven(system: ConstraintSystem, t: float, values: np.ndarray) -> np.ndarray:
    """Subtract targets that depend on the time from the values of phi; return their rates."""
    rates = np.zeros(len(values))
    for law, its_rows in system.kinds:
        assert isinstance(law.effect, Constraint)
        functions = law.effect.functions()
        for member, row in enumerate(its_rows):
            if "distance" in functions:
                length, rate, _ = law.call("distance", member, {"t": t})
                scale, target = system.table.rows[row].scale, system.table.rows[row].target
                values[row] -= scale * (length * length - target)
                rates[row] = -2 * scale * length * rate
            if "target" in functions:
                target, rate, _ = law.call("target", member, {"t": t})
                values[row] -= target
                rates[row] = -rate
            if period := law.effect.period:
                values[row] -= period * np.rint(values[row] / period)
    return rates


def _linearised(system: ConstraintSystem, places: np.ndarray) -> tuple[np.ndarray, csr_array]:
    """Return phi and its gradients for masses at given positions."""
    table = system.table
    arms = np.array([arm.factors @ places[arm.points] + arm.constant for arm in table.arms])
    values, slopes = np.zeros(len(table.rows)), np.zeros((table.own_arms, table.dimension))
    for law, rows in system.kinds:
        if "phi" in law.effect.functions():
            for member, row in enumerate(rows):
                values[row], slope = _own(law, member, arms[list(table.rows[row].arms)])
                slopes[np.array(table.rows[row].slopes) - len(arms)] = slope
    for k, row in enumerate(table.rows):
        if not row.slopes:
            values[k] = row.scale * (arms[row.arms[0]] @ arms[row.arms[1]] - row.target)
    entries = table.entries()
    row, point, arm = entries[:, :3].T.astype(int)
    parts = entries[:, 3:] * np.concatenate([arms, slopes])[arm]
    columns = point[:, None] + len(table.weights) * np.arange(table.dimension)
    shape = len(table.rows), len(table.weights) * table.dimension
    return values, csr_array((parts.ravel(), (np.repeat(row, table.dimension), columns.ravel())), shape=shape)


def _own(law: Placed, member: int, places: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the value and the gradients of a constraint that defines `phi`."""

    def call(function: str, x: np.ndarray) -> Any:
        return law.call(function, member, {f"x{k}": tuple(place) for k, place in enumerate(x.tolist())})

    if "gradient" in law.effect.functions():
        slope = np.reshape(call("gradient", places), places.shape)
    else:
        slope = np.empty(places.shape)
        for at in np.ndindex(places.shape):
            moved = places.astype(complex)
            moved[at] += 1j * TINY
            slope[at] = complex(call("phi", moved)).imag / TINY
    return float(call("phi", places)), slope


def _factors(system: ConstraintSystem, gradients: csr_array, weights: np.ndarray) -> Any:
    """Return the function that solves with G W G^T, after a check of its pivots for dependent constraints."""
    product = csc_array(gradients @ diags_array(weights) @ gradients.T)
    diagonal = product.diagonal()
    try:
        factors = splu(product, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        pivots = np.abs(factors.U.diagonal()) / diagonal[np.argsort(factors.perm_c)]
        if pivots.min() > _DEPENDENT:
            return factors.solve
    except RuntimeError:  # exactly singular
        pass
    some = _dependent(system, product)[1]
    surplus = _dependent(system, gradients @ gradients.T)[0]
    if not surplus:
        raise ValueError(
            f"the reactions of {some} cannot be computed, because a mass is too small beside the others, or a body too "
            "thin: increase the mass, or make the largest moment of the body smaller than the sum of the others by a "
            "factor of 1 - 1e-6."
        )
    in_space = (
        "; two revolute joints can be a spherical and a universal joint, and a motion in a plane can have dimension=2"
    )
    raise ValueError(
        f"these constraints depend on each other at the start: {some}; the number of their conditions is too large by "
        f"{surplus}: leave out those that the others imply already, or begin in another position"
        f"{in_space if system.table.dimension == 3 and 'revolute' in some else ''}."
    )


def _dependent(system: ConstraintSystem, product: csr_array) -> tuple[int, str]:
    """Return how many conditions depend on the others, and the names of the constraints that have them."""
    diagonal = product.diagonal()
    values, vectors = np.linalg.eigh(product.toarray() / np.sqrt(np.outer(diagonal, diagonal)))
    surplus = int((values <= _DEPENDENT).sum())
    share = np.abs(vectors[:, : surplus or 1]).max(axis=1)
    named = list(dict.fromkeys(system.names[k] for k in np.argsort(-share, kind="stable") if share[k] > 1e-6))
    named = [name for name in named if not name.startswith("rigid ")]  # a body alone is no constraint too many
    return surplus, ", ".join(named[:_MOST_NAMED]) + " and others" * (len(named) > _MOST_NAMED)
