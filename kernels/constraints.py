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
the gradients turn in a step. These are the formulas of SHAKE and RATTLE: E. Hairer, C. Lubich and G. Wanner, Geometric
Numerical Integration, 2nd ed., Springer (2006), section VII.1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numba.types import boolean, float64, int32, int64, intp, none

from .compile.jit import element, function_at, of_library
from .compile.numba_internals import Strip, array_over, parts_of
from .neighbours import floats
from .protocol import index, vector_type

#: The numbers before the areas: of rows, of masses, of arms that follow from the points, of all arms, and of entries of
#: gradients; the largest length of the scene; and whether S is factorised, with the time.
ROWS, MASSES, SUMS, ARMS, ENTRIES, LENGTH, IS_FACTORED, FACTORED_AT = range(8)
HEAD = 8
#: What `hold` does.
STAND, CONSTRAIN, REACT, PROJECT, CONSTRAINED_STEP = map(np.int64, range(5))
#: What a function of constraints of one's own does: see `evaluate_own`.
PLACE, SPEED = map(np.int64, range(2))

MOST_ITERATIONS = 60
EPS = np.finfo(np.float64).eps
CLOSE = 1e-9  # the residual, relative to the largest length, at which an iteration may end because it no longer falls
SINGULAR = 1e-13  # a pivot, relative to the entry on the diagonal


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
        s, which is 0 for a constraint of the user; c; s c', the rate at which phi falls in a fixed state; and c''.
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


_floats = vector_type
#: Areas that are used as arrays. The others are addresses: code with them compiles in less time.
_ARRAYS = "scales", "profile", "before", "ways", "forces"
_areas = types.NamedTuple(
    [
        _floats if name in _ARRAYS else Strip(None, float64 if k < FLOATS else int32)
        for k, name in enumerate(Areas._fields)
    ],
    Areas,
)


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
            if isinstance(kind, Strip):
                return begin
            return array_over(context, builder, kind, begin, number(2 * k + 1))

        return context.make_tuple(builder, _areas, [area(k) for k in range(len(_areas.types))])

    return _areas(p, int64), codegen


FUNCTION_OF_SCENE = none(int64, float64, _floats, _floats, _floats)
_own_at = function_at(FUNCTION_OF_SCENE)


@element
def evaluate_own(own, task, t, u, v, p):
    """Call the function at the address `own`, or none at 0: no constraint has functions, and no target changes.

    The function writes to areas of p. At the task PLACE, it writes the targets, and the values and the gradients of
    constraints of their own. At the task SPEED, it writes the derivatives of the targets, and the curvatures
    v . phi_uu . v of constraints of their own into the values.
    """
    if own != 0:
        _own_at(own)(task, t, u, v, p)


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
    sum_up(u, c, n, int64(p[place + SUMS]), True, c.arms, d)
    evaluate_own(own, PLACE, t, u, u, p)
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
    incline(c, int64(p[place + ENTRIES]), d)
    success = factorise(c, rows, d)
    for j in range(d * n):
        c.factored[j] = u[j]
    head[FACTORED_AT], head[IS_FACTORED] = t, 1.0 if success else 0.0
    return success


@element
def speeds(own, t, u, v, p, place, c, n, rows, d):
    """Write the rates of the arms and of the targets, and into the values phi'' without the accelerations."""
    sum_up(v, c, n, int64(p[place + SUMS]), False, c.rates, d)
    evaluate_own(own, SPEED, t, u, v, p)
    for k in range(rows):
        if c.scales[k] != 0:
            both = product(c.rates, index(c.first_arms[k]), c.rates, index(c.second_arms[k]), d)
            c.values[k] = c.scales[k] * (2 * both - c.target_curvatures[k])


@element
def react(own, t, u, v, p, place, c, n, rows, a, d):
    """Find the multipliers l for accelerations a without them, where S is factorised."""
    speeds(own, t, u, v, p, place, c, n, rows, d)
    for k in range(rows):
        c.multipliers[k] = -c.values[k] - along(c, k, n, a, d)
    solve(c, c.multipliers, rows)


@element
def level(own, t, u, v, p, c, n, rows, d):
    """Project the velocity at a place where S is factorised."""
    evaluate_own(own, SPEED, t, u, v, p)
    for k in range(rows):
        c.multipliers[k] = along(c, k, n, v, d) - c.target_rates[k]
    solve(c, c.multipliers, rows)
    push(c, -1.0, rows, n, v, d)


@element
def approach(own, t, u, x, p, place, c, n, rows, d):
    """Add W G^T l to x, with the gradients of a state before, until u + x keeps the constraints; return success.

    The iteration ends at the round-off: where phi is small, and falls no longer. If it does not fall in two iterations
    before, the step is too long, or the constraints almost depend on each other. In one of them it may rise: the
    largest phi is small by chance where it changes its sign along the run.
    """
    last = before = math.inf
    for _ in range(MOST_ITERATIONS):
        for j in range(d * n):
            c.ways[j] = u[j] + x[j]
        worst = evaluate(own, t, c.ways, p, place, c, n, rows, d)
        if worst <= EPS * p[place + LENGTH]:
            return True
        is_close = worst <= CLOSE * p[place + LENGTH]
        if not worst < 0.5 * last and (is_close or not worst < 0.5 * before):
            return is_close
        last, before = worst, last
        for k in range(rows):
            c.multipliers[k] = c.values[k]
        solve(c, c.multipliers, rows)
        push(c, -1.0, rows, n, x, d)
    return False


@of_library(none(boolean, _floats, float64, _floats, int64, int64))
def strike(success, v, free, p, place, d):
    """Let the constraints take part in an impulse that has changed the velocity from `before` to v.

    S is factorised, with `success`.

    The impulse itself, of free points, is what v shows. With the reactions, its part along itself must have the same
    effect: for a change x of the velocity of free points, with the projection y, the change is y (x . M x) / (x . M y).
    So a coefficient of restitution, and the sum of the energies of two points that meet, are what they were. `free` is
    x . M x, where points that bodies carry may take part; it is computed here if it is negative.
    """
    c, n, rows = areas(p, place), int64(p[place + MASSES]), int64(p[place + ROWS])
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


@element
def hold(task, own, t, h, u, v, x, p, place, d):
    """Do a task with the constraints; return success. It is one function, so that their matrix compiles once for all.

    - STAND has the gradients, and S factorised.
    - CONSTRAIN adds the accelerations from the constraints to x: NaN where the constraints depend on each other.
    - REACT finds the multipliers for accelerations x without them.
    - PROJECT moves u and v to the nearest state that keeps the constraints. Without one, u becomes NaN.
    - CONSTRAINED_STEP takes a step of EIG-3, from the accelerations in `forces` without reactions. Here x is the drift
      (u_n - u_{n-1}) / h. The entries of u after the coordinates are without constraints.
    """
    c, n, rows = areas(p, place), int64(p[place + MASSES]), int64(p[place + ROWS])
    success = stand(own, t, u, p, place, c, n, rows, d)
    if task <= REACT:
        if task != STAND:
            react(own, t, u, v, p, place, c, n, rows, x, d)
        if task == CONSTRAIN:
            push(c, 1.0 if success else math.nan, rows, n, x, d)
        return success
    for j in range(len(u)):
        c.before[j] = h * (x[j] + h * c.forces[j]) if task == CONSTRAINED_STEP else 0.0
    success &= approach(own, t + h, u, c.before, p, place, c, n, rows, d)
    for j in range(len(u)):
        u[j] += c.before[j] if success else math.nan
        if task == CONSTRAINED_STEP:
            now = c.before[j] / h
            v[j] = now + (now - x[j]) / 2
            x[j] = now
    success = success and stand(own, t + h, u, p, place, c, n, rows, d)
    level(own, t + h, u, v, p, c, n, rows, d)
    return success


_HOLD = boolean(int64, int64, float64, float64, _floats, _floats, _floats, _floats, int64)


@of_library(_HOLD)
def hold_1d(task, own, t, h, u, v, x, p, place):
    return hold(task, own, t, h, u, v, x, p, place, 1)


@of_library(_HOLD)
def hold_2d(task, own, t, h, u, v, x, p, place):
    return hold(task, own, t, h, u, v, x, p, place, 2)


@of_library(_HOLD)
def hold_3d(task, own, t, h, u, v, x, p, place):
    return hold(task, own, t, h, u, v, x, p, place, 3)


#: `hold` by the number of dimensions.
LIBRARY = {1: hold_1d, 2: hold_2d, 3: hold_3d}
