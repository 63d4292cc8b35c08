"""Constraints phi(t, u) = 0 between points: the forces that keep them, and the way back to them after a step.

A row of the table in p is a constraint phi = s (D . E - c) of two arms. An arm is a sum of positions of points with
factors, and a constant vector: with D = E, a rod; with two arms, an angle; with a constant E, a point on a plane. The
gradient of a row is a sum of arms, one for each point of the other arm. A constraint of one's own has an arm for each
of its points, into which its function writes the gradient.

With the gradients G, a row each, and the inverse masses W, the matrix S = G W G^T is positive definite unless the
constraints depend on each other. Its rows are ordered so that it has a small profile, and it is factorised within the
profile, as L D L^T. Three things follow from a solve with it:

    the acceleration    a + W G^T l          with  G (a + W G^T l) + G' v = 0
    the velocity        v - W G^T l          with  G (v - W G^T l) + phi_t = 0
    the position        u - W G_0^T l        with  phi(t, u - W G_0^T l) = 0

The last one is found by Newton's method with the matrix S of the begin of the step: it converges at the rate at which
the gradients turn in a step. The formulas are those of SHAKE and RATTLE: E. Hairer, C. Lubich and G. Wanner, Geometric
Numerical Integration, 2nd ed., Springer (2006), section VII.1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numba.types import Array, boolean, float64, int32, int64, intp, none

from .compile.jit import element, of_library
from .compile.numba_internals import array_over, parts_of
from .neighbours import floats
from .protocol import index, vector_type

#: The numbers before the areas: of rows, of masses, of arms that follow from the points, of all arms, and of entries of
#: gradients; the largest length of the scene; and whether S is factorised, with the time.
ROWS, MASSES, SUMS, ARMS, ENTRIES, LENGTH, IS_FACTORED, FACTORED_AT = range(8)
HEAD = 8
#: What a function of constraints of one's own does: see `nothing_of_its_own`.
PLACE, SPEED = map(np.int64, range(2))

MOST_ITERATIONS = 60
EPS = np.finfo(np.float64).eps
CLOSE = 1e-9  # the residual, as a part of the largest length, at which an iteration may end because it no longer falls
SINGULAR = 1e-13  # a pivot, as a part of the entry on the diagonal


class Areas(NamedTuple):
    """The areas of a table in p, or in Python their places.

    Attributes
    ----------
    weights : array of n floats
        The inverse masses.
    fixed, arms, rates : array of 3 floats for each arm
        The constant vectors, and the arms in a state and their rates.
    factors : array of floats
        Of the points of arms.
    gradients : array of d floats for each entry
    parts : array of floats
        The factor of the arm in each entry.
    scales, targets, target_rates, target_curvatures : array of a float for each row
        s, which is 0 for a constraint of its own; c; s c', the rate at which phi falls in a fixed state; and c''.
    values, multipliers, pivots : array of a float for each row
        phi, l, and the inverses of D.
    profile : array of floats
        S or L, row by row.
    before, ways, forces, factored : array of floats
        Scratch for a value for each degree of freedom, and the u for which S is factorised.
    begins, points : array of int
        Where the points of each arm begin, and these points.
    first_arms, second_arms : array of int
        Of the rows.
    entries, entry_points, entry_arms : array of int
        Where the entries of each row begin, and their points and arms.
    lows, starts : array of int
        The first column of each row of the profile, and where the row begins.
    pairs, lefts, rights : array of int
        Where the pairs of entries of each number of the profile begin, and these entries.
    """

    weights: Any
    fixed: Any
    arms: Any
    rates: Any
    factors: Any
    gradients: Any
    parts: Any
    scales: Any
    targets: Any
    target_rates: Any
    target_curvatures: Any
    values: Any
    multipliers: Any
    pivots: Any
    profile: Any
    before: Any
    ways: Any
    forces: Any
    factored: Any
    begins: Any
    points: Any
    first_arms: Any
    second_arms: Any
    entries: Any
    entry_points: Any
    entry_arms: Any
    lows: Any
    starts: Any
    pairs: Any
    lefts: Any
    rights: Any


#: The number of areas of floats; the others are of 32-bit integers.
FLOATS = Areas._fields.index("begins")


_floats, _integers = vector_type, Array(int32, 1, "C")
_areas = types.NamedTuple([_floats if k < FLOATS else _integers for k in range(len(Areas._fields))], Areas)


@intrinsic
def areas(typingctx, p, place):  # type: ignore[no-untyped-def]
    """``areas(p, place)`` are the areas of the table at a place of p. They may be written."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data, whole = parts_of(context, builder, signature.args[0], args[0]).data, context.get_value_type(intp)

        def number(k):  # type: ignore[no-untyped-def]
            at = builder.add(args[1], context.get_constant(int64, HEAD + k))
            return builder.fptosi(builder.load(builder.gep(data, [at])), whole)

        def area(k):  # type: ignore[no-untyped-def]
            kind = _areas.types[k]
            begin = builder.bitcast(builder.gep(data, [number(2 * k)]), context.get_data_type(kind.dtype).as_pointer())
            stride = context.get_constant(intp, kind.dtype.bitwidth // 8)
            return array_over(context, builder, kind, begin, number(2 * k + 1), stride)

        return context.make_tuple(builder, _areas, [area(k) for k in range(len(_areas.types))])

    return _areas(p, int64), codegen


@element
def nothing_of_its_own(task, t, u, v, p):
    """Do nothing: the scene has no constraint of its own, and no target that depends on the time.

    Other functions in this place write to areas of p. At the task PLACE, they write the targets, and the values and
    the gradients of constraints of their own. At the task SPEED, they write the derivatives of the targets, and the
    curvatures v . phi_uu . v of constraints of their own into the values.
    """


@element
def sum_up(x, c, n, arms, fixed, out, d):
    """Write the arms, of positions with their constant vectors, or of velocities without them."""
    for k in range(arms):
        for axis in range(d):
            out[k * d + axis] = c.fixed[k * d + axis] if fixed else 0.0
        for q in range(index(c.begins[k]), index(c.begins[k + 1])):
            i, factor = index(c.points[q]), c.factors[q]
            for axis in range(d):
                out[k * d + axis] += factor * x[axis * n + i]


@element
def product(x, first, y, second, d):
    """Return the product of two arms."""
    total = 0.0
    for axis in range(d):
        total += x[first * d + axis] * y[second * d + axis]
    return total


@element
def evaluate(own, t, u, p, place, c, n, rows, d):
    """Write phi, and what the gradients need; return the largest |phi|, or infinity if one is NaN."""
    sum_up(u, c, n, int(p[place + SUMS]), True, c.arms, d)
    own(PLACE, t, u, u, p)
    worst = 0.0
    for k in range(rows):
        if c.scales[k] != 0:
            both = product(c.arms, index(c.first_arms[k]), c.arms, index(c.second_arms[k]), d)
            c.values[k] = c.scales[k] * (both - c.targets[k])
        size = abs(c.values[k])
        worst = max(worst, size if size == size else math.inf)
    return worst


@element
def incline(c, entries, d):
    """Write the gradients."""
    for e in range(entries):
        arm = index(c.entry_arms[e])
        for axis in range(d):
            c.gradients[e * d + axis] = c.parts[e] * c.arms[arm * d + axis]


@element
def factorise(c, rows, d):
    """Write S, and factorise it as L D L^T; return whether the constraints do not depend on each other."""
    for k in range(len(c.profile)):
        total = 0.0
        for q in range(index(c.pairs[k]), index(c.pairs[k + 1])):
            left, right = index(c.lefts[q]), index(c.rights[q])
            both = product(c.gradients, left, c.gradients, right, d)
            total += c.weights[index(c.entry_points[left])] * both
        c.profile[k] = total
    for i in range(rows):
        low, start = index(c.lows[i]), index(c.starts[i])
        for j in range(low, i):
            first, row = index(c.lows[j]), index(c.starts[j])
            entry = c.profile[start + j - low]
            for k in range(max(low, first), j):
                entry -= c.profile[start + k - low] * c.profile[row + k - first]
            c.profile[start + j - low] = entry  # L D, until the row is complete
        pivot = diagonal = c.profile[start + i - low]
        for j in range(low, i):
            entry = c.profile[start + j - low]
            c.profile[start + j - low] = entry * c.pivots[j]
            pivot -= entry * entry * c.pivots[j]
        if not pivot > SINGULAR * diagonal:
            return False
        c.pivots[i] = 1 / pivot
    return True


@element
def solve(c, x, rows):
    """Replace a vector x by the solution l of S l = x."""
    for i in range(rows):
        low, start, entry = index(c.lows[i]), index(c.starts[i]), x[i]
        for j in range(low, i):
            entry -= c.profile[start + j - low] * x[j]
        x[i] = entry
    for i in range(rows):
        x[i] *= c.pivots[i]
    for i in range(rows - 1, -1, -1):
        low, start, entry = index(c.lows[i]), index(c.starts[i]), x[i]
        for j in range(low, i):
            x[j] -= c.profile[start + j - low] * entry


@element
def along(c, k, n, v, d):
    """Return the product of the gradient of a row with a velocity."""
    total = 0.0
    for e in range(index(c.entries[k]), index(c.entries[k + 1])):
        i = index(c.entry_points[e])
        for axis in range(d):
            total += c.gradients[e * d + axis] * v[axis * n + i]
    return total


@element
def push(c, factor, rows, n, x, d):
    """Add W G^T l, times a factor, to x."""
    for k in range(rows):
        force = factor * c.multipliers[k]
        for e in range(index(c.entries[k]), index(c.entries[k + 1])):
            i = index(c.entry_points[e])
            for axis in range(d):
                x[axis * n + i] += c.weights[i] * c.gradients[e * d + axis] * force


@element
def stand(own, t, u, p, place, c, n, rows, d):
    """Have the gradients in a state, and S factorised; return whether the constraints do not depend on each other."""
    head = floats(p, place, HEAD)
    is_known = head[IS_FACTORED] == 1.0 and head[FACTORED_AT] == t
    if is_known:
        for j in range(d * n):
            is_known &= c.factored[j] == u[j]
    if is_known:
        return True
    evaluate(own, t, u, p, place, c, n, rows, d)
    incline(c, int(p[place + ENTRIES]), d)
    success = factorise(c, rows, d)
    for j in range(d * n):
        c.factored[j] = u[j]
    head[FACTORED_AT], head[IS_FACTORED] = t, 1.0 if success else 0.0
    return success


@element
def speeds(own, t, u, v, p, place, c, n, rows, d):
    """Write the rates of the arms and of the targets, and into the values phi'' without the accelerations."""
    sum_up(v, c, n, int(p[place + SUMS]), False, c.rates, d)
    own(SPEED, t, u, v, p)
    for k in range(rows):
        if c.scales[k] != 0:
            both = product(c.rates, index(c.first_arms[k]), c.rates, index(c.second_arms[k]), d)
            c.values[k] = c.scales[k] * (2 * both - c.target_curvatures[k])


@element
def react(own, t, u, v, p, place, a, d):
    """Find the multipliers l for accelerations a without them; return whether they exist."""
    c, n, rows = areas(p, place), int(p[place + MASSES]), int(p[place + ROWS])
    success = stand(own, t, u, p, place, c, n, rows, d)
    speeds(own, t, u, v, p, place, c, n, rows, d)
    for k in range(rows):
        c.multipliers[k] = -c.values[k] - along(c, k, n, a, d)
    solve(c, c.multipliers, rows)
    return success


@element
def constrain(own, t, u, v, p, place, a, d):
    """Add the accelerations from the constraints to a. They are NaN where the constraints depend on each other."""
    c, n, rows = areas(p, place), int(p[place + MASSES]), int(p[place + ROWS])
    success = react(own, t, u, v, p, place, a, d)
    push(c, 1.0 if success else math.nan, rows, n, a, d)


@element
def level(own, t, u, v, p, place, d):
    """Project the velocity at a place where S is factorised."""
    c, n, rows = areas(p, place), int(p[place + MASSES]), int(p[place + ROWS])
    own(SPEED, t, u, v, p)
    for k in range(rows):
        c.multipliers[k] = along(c, k, n, v, d) - c.target_rates[k]
    solve(c, c.multipliers, rows)
    push(c, -1.0, rows, n, v, d)


@element
def approach(own, t, u, x, p, place, c, n, rows, d):
    """Add W G^T l to x, with the gradients of a state before, until u + x keeps the constraints; return success.

    The iteration ends at the round-off: where phi is small, and falls no longer. If it does not fall before, the step
    is too long, or the constraints almost depend on each other.
    """
    last = math.inf
    for _ in range(MOST_ITERATIONS):
        for j in range(d * n):
            c.ways[j] = u[j] + x[j]
        worst = evaluate(own, t, c.ways, p, place, c, n, rows, d)
        if worst <= EPS * p[place + LENGTH]:
            return True
        if not worst < 0.5 * last:
            return worst <= CLOSE * p[place + LENGTH]
        last = worst
        for k in range(rows):
            c.multipliers[k] = c.values[k]
        solve(c, c.multipliers, rows)
        push(c, -1.0, rows, n, x, d)
    return False


@element
def project(own, t, u, v, p, place, d):
    """Move u and v to the nearest state that keeps the constraints. Without one, u becomes NaN."""
    c, n, rows = areas(p, place), int(p[place + MASSES]), int(p[place + ROWS])
    success = stand(own, t, u, p, place, c, n, rows, d)
    for j in range(d * n):
        c.before[j] = 0.0
    success &= approach(own, t, u, c.before, p, place, c, n, rows, d)
    for j in range(d * n):
        u[j] += c.before[j] if success else math.nan
    success = success and stand(own, t, u, p, place, c, n, rows, d)
    level(own, t, u, v, p, place, d)


@element
def leap(own, t, h, u, v, drift, p, place, d):
    """Take a step of EIG-3, from the accelerations in `forces` that the constraints do not know.

    `drift` is (u_n - u_{n-1}) / h. What u has after the coordinates is without constraints. If no state is found that
    keeps the constraints, u becomes NaN.
    """
    c, n, rows = areas(p, place), int(p[place + MASSES]), int(p[place + ROWS])
    success = stand(own, t, u, p, place, c, n, rows, d)
    for j in range(len(u)):
        c.before[j] = h * (drift[j] + h * c.forces[j])
    success &= approach(own, t + h, u, c.before, p, place, c, n, rows, d)
    for j in range(len(u)):
        u[j] += c.before[j] if success else math.nan
        now = c.before[j] / h
        v[j] = now + (now - drift[j]) / 2
        drift[j] = now
    success = success and stand(own, t + h, u, p, place, c, n, rows, d)
    level(own, t + h, u, v, p, place, d)


@element
def strike(own, t, u, v, p, place, free, d):
    """Let the constraints take part in an impulse that has changed the velocity from `before` to v.

    The impulse itself, of free points, is what v shows. With the reactions, its part along itself must have the same
    effect: for a change x of the velocity of free points, with the projection y, the change is y (x . M x) / (x . M y).
    So a coefficient of restitution, and the sum of the energies of two points that meet, are what they were. `free` is
    x . M x, where points that bodies carry may take part; it is computed here if it is negative.
    """
    c, n, rows = areas(p, place), int(p[place + MASSES]), int(p[place + ROWS])
    success = stand(own, t, u, p, place, c, n, rows, d)
    for j in range(d * n):
        c.ways[j] = v[j] - c.before[j]
    for k in range(rows):
        c.multipliers[k] = along(c, k, n, c.ways, d)
    solve(c, c.multipliers, rows)
    push(c, -1.0, rows, n, c.ways, d)
    square = held = 0.0
    for axis in range(d):
        for i in range(n):
            j = axis * n + i
            change = (v[j] - c.before[j]) / c.weights[i]
            square += change * (v[j] - c.before[j])
            held += change * c.ways[j]
    free = square if free < 0 else free
    scale = free / held if success and held > SINGULAR * free else 0.0
    for j in range(d * n):
        v[j] = c.before[j] + scale * c.ways[j]


_STATE = float64, _floats, _floats, _floats, int64
_ON_ACCELERATION, _REACT, _PROJECT = none(*_STATE, _floats), boolean(*_STATE, _floats), none(*_STATE)
_LEAP = none(float64, float64, _floats, _floats, _floats, _floats, int64)


@of_library(_ON_ACCELERATION)
def constrain_1d(t, u, v, p, place, a):
    constrain(nothing_of_its_own, t, u, v, p, place, a, 1)


@of_library(_ON_ACCELERATION)
def constrain_2d(t, u, v, p, place, a):
    constrain(nothing_of_its_own, t, u, v, p, place, a, 2)


@of_library(_ON_ACCELERATION)
def constrain_3d(t, u, v, p, place, a):
    constrain(nothing_of_its_own, t, u, v, p, place, a, 3)


@of_library(_REACT)
def react_1d(t, u, v, p, place, a):
    return react(nothing_of_its_own, t, u, v, p, place, a, 1)


@of_library(_REACT)
def react_2d(t, u, v, p, place, a):
    return react(nothing_of_its_own, t, u, v, p, place, a, 2)


@of_library(_REACT)
def react_3d(t, u, v, p, place, a):
    return react(nothing_of_its_own, t, u, v, p, place, a, 3)


@of_library(_PROJECT)
def project_1d(t, u, v, p, place):
    project(nothing_of_its_own, t, u, v, p, place, 1)


@of_library(_PROJECT)
def project_2d(t, u, v, p, place):
    project(nothing_of_its_own, t, u, v, p, place, 2)


@of_library(_PROJECT)
def project_3d(t, u, v, p, place):
    project(nothing_of_its_own, t, u, v, p, place, 3)


@of_library(_LEAP)
def leap_1d(t, h, u, v, drift, p, place):
    leap(nothing_of_its_own, t, h, u, v, drift, p, place, 1)


@of_library(_LEAP)
def leap_2d(t, h, u, v, drift, p, place):
    leap(nothing_of_its_own, t, h, u, v, drift, p, place, 2)


@of_library(_LEAP)
def leap_3d(t, h, u, v, drift, p, place):
    leap(nothing_of_its_own, t, h, u, v, drift, p, place, 3)


#: The functions of scenes without constraints of their own, by the number of dimensions.
LIBRARY = {
    1: (constrain_1d, react_1d, project_1d, leap_1d),
    2: (constrain_2d, react_2d, project_2d, leap_2d),
    3: (constrain_3d, react_3d, project_3d, leap_3d),
}
