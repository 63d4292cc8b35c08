"""Corotational members in space: large displacements and rotations, with small strains in the member frame.

The forces are the exact gradient of a strain energy. It depends on the length of the chord, and on scalar products of
its direction e and of the axes x, y, z of the member at each of its ends, a and b. An end bends about y and z by the
angles phi z.e / sin(phi) and -phi y.e / sin(phi), the components of the rotation vector from e to x, with the angle phi
between them. The twist is 2 atan2(q_1, q_0), from the quaternion q of the rotation from a to b. See Crisfield,
Non-linear Finite Element Analysis of Solids and Structures, volume 2, chapters 16 (rotations) and 17 (members). A hinge
transmits torsion, as a constant-velocity joint.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import atan2, nan, pi, sin, sqrt
from typing import Any

import numpy as np

from ..effects.vector import cross, dot, scale
from ..functions.callbacks import jit
from ..kernels.compile.jit import element
from .corotational import chords, entry
from .frame_members import Member

_SMALL = 1e-4  # below this square of an angle, series are exact to round-off


def chords_in_space(
    names: Sequence[str], members: Sequence[Member], ends: Sequence[Sequence[str]]
) -> dict[str, np.ndarray]:
    """Return the parameters of corotational members in space.

    Returns
    -------
    dict
        The parameters of `chords`; `axes`, shape (members, 9): the axes of the members at rest; `rotations`: the degree
        of freedom rx of each node that can rotate, before its ry and rz.

    Raises
    ------
    ValueError
        If only some rotations of a node are fixed.
    """
    for node, count in Counter(name.rpartition(".")[0] for name in names if ".r" in name).items():
        if count < 3:
            raise ValueError(f"corotational members in space need all rotations of {node} fixed, or none.")
    return {
        **chords(names, members, ends),
        "axes": np.array([member.axes.ravel() for member in members]),
        "rotations": np.array([i for i, name in enumerate(names) if name.endswith(".rx")], dtype=int),
    }


@element
def _sum(f: Any, x: Any, g: Any, y: Any) -> Any:
    """Return f x + g y."""
    return f * x[0] + g * y[0], f * x[1] + g * y[1], f * x[2] + g * y[2]


@element
def _three(u: Any, places: Any, k: Any) -> Any:
    return entry(u, places[k]), entry(u, places[k + 1]), entry(u, places[k + 2])


@element
def _add(out: Any, places: Any, k: Any, x: Any) -> Any:
    for i in range(3):
        if places[k + i] >= 0:
            out[places[k + i]] += x[i]


@element
def _series(square: Any) -> Any:
    """Return (1 - cos(r)) / r^2 and (r - sin(r)) / r^3 of an angle r, and their derivatives by r, divided by r."""
    if square < _SMALL:
        a, b = 0.5 - square * (1 / 24 - square / 720), 1 / 6 - square * (1 / 120 - square / 5040)
        return a, b, square / 180 - 1 / 12, square / 1260 - 1 / 60
    r = sqrt(square)
    half = sin(r / 2) / r
    a, b = 2 * half * half, (1 - sin(r) / r) / square
    return a, b, (1 - square * b - 2 * a) / square, (a - 3 * b) / square


@element
def _turned(turn: Any, axes: Any, k: Any) -> Any:
    """Return the axis k, rotated by a rotation vector with Rodrigues' formula."""
    square = dot(turn, turn)
    a, b, _, _ = _series(square)
    axis = axes[3 * k], axes[3 * k + 1], axes[3 * k + 2]
    across = cross(turn, axis)
    return _sum(1.0, _sum(1.0, axis, 1 - square * b, across), a, cross(turn, across))


@element
def _bent(chord: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the angles by which an end bends about y and z, the factor phi / sin(phi), and its slope by cos(phi)."""
    c, s_y, s_z = dot(chord, x), dot(chord, z), -dot(chord, y)
    square = s_y * s_y + s_z * s_z
    if square < 1e-30:
        return s_y, s_z, 1.0, -1 / 3
    s = sqrt(square)
    factor = atan2(s, c) / s
    return factor * s_y, factor * s_z, factor, (c * factor - 1) / square


@element
def _by_chord(moment_y: Any, moment_z: Any, bent: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the derivative of the energy of an end with respect to the direction of the chord."""
    angle_y, angle_z, factor, slope = bent
    by_cosine = slope * (moment_y * angle_y + moment_z * angle_z) / factor
    return _sum(by_cosine, x, factor, _sum(moment_y, z, -moment_z, y))


@element
def _twist(y_a: Any, z_a: Any, y_b: Any, z_b: Any) -> Any:
    """Return the sine and the cosine of the twist, times a common factor."""
    return dot(z_a, y_b) - dot(y_a, z_b), dot(y_a, y_b) + dot(z_a, z_b)


@element
def _torque(stiffness: Any, y_a: Any, z_a: Any, y_b: Any, z_b: Any) -> Any:
    """Return the derivative of the torsional energy with respect to a rotation of b."""
    if stiffness == 0:
        return 0.0, 0.0, 0.0
    s, c = _twist(y_a, z_a, y_b, z_b)
    k = stiffness * atan2(s, c) / (s * s + c * c)
    return _sum(k, cross(y_b, _sum(c, z_a, -s, y_a)), -k, cross(z_b, _sum(c, y_a, s, z_a)))


@element
def _deformed(u: Any, p: Any, m: Any) -> Any:
    """Return the chord's direction and length, the elongation, and for each end the axes and the bending angles."""
    rest, ends = (p.chords[m, 0], p.chords[m, 1], p.chords[m, 2]), p.ends[m]
    move = _sum(1.0, _three(u, ends, 6), -1.0, _three(u, ends, 0))
    now = _sum(1.0, rest, 1.0, move)
    length, before = sqrt(dot(now, now)), sqrt(dot(rest, rest))
    chord = scale(1 / length, now)
    longer = dot(move, _sum(1.0, rest, 1.0, now)) / (length + before)
    axes_a, axes_b = _axes(_three(u, ends, 3), p.axes[m]), _axes(_three(u, ends, 9), p.axes[m])
    return chord, length, longer, axes_a, axes_b, _bent(chord, *axes_a), _bent(chord, *axes_b)


@element
def _axes(turn: Any, axes: Any) -> Any:
    return _turned(turn, axes, 0), _turned(turn, axes, 1), _turned(turn, axes, 2)


@element
def _pull(u: Any, p: Any, m: Any, out: Any) -> Any:
    """Add the forces and moments of a member on its nodes: k are the rows of `Member.stiffness_of_chord`."""
    k, ends = p.stiffness[m], p.ends[m]
    chord, length, longer, (x_a, y_a, z_a), (x_b, y_b, z_b), a, b = _deformed(u, p, m)
    by_a = _by_chord(k[21] * a[0] + k[22] * b[0], k[7] * a[1] + k[8] * b[1], a, x_a, y_a, z_a)
    by_b = _by_chord(k[27] * a[0] + k[28] * b[0], k[13] * a[1] + k[14] * b[1], b, x_b, y_b, z_b)
    torque = _torque(k[35], y_a, z_a, y_b, z_b)
    both = _sum(1.0, by_a, 1.0, by_b)
    force = _sum(k[0] * longer - dot(both, chord) / length, chord, 1 / length, both)
    _add(out, ends, 0, force)
    _add(out, ends, 6, scale(-1.0, force))
    _add(out, ends, 3, _sum(1.0, cross(chord, by_a), 1.0, torque))
    _add(out, ends, 9, _sum(1.0, cross(chord, by_b), -1.0, torque))


@element
def _of_rotation_vector(u: Any, v: Any, i: Any, inertia: Any, out: Any) -> Any:
    """Replace the moments on a node by its inertia times the second derivative of its rotation vector.

    The angular velocity is T turn' with T w = w + a turn x w + b turn x (turn x w), and its derivative is
    moment / inertia = T turn'' + T' turn'. At the angle 2 pi, a is 0 and T is singular: NaN ends the run.
    """
    turn, rate, moment = (u[i], u[i + 1], u[i + 2]), (v[i], v[i + 1], v[i + 2]), (out[i], out[i + 1], out[i + 2])
    square, along = dot(turn, turn), dot(turn, rate)
    a, b, slope_a, slope_b = _series(square)
    across = cross(turn, rate)
    own = _sum(along * slope_a, across, along * slope_b, cross(turn, across))
    rest = _sum(1.0, moment, -inertia, _sum(1.0, own, b, cross(rate, across)))
    across = cross(turn, rest)
    back = _sum(1.0, _sum(1.0, rest, -0.5, across), -0.5 * slope_a / a, cross(turn, across))
    for k in range(3):
        out[i + k] = back[k] if square < 4 * pi * pi else nan


@jit
def turning_members_in_space(t, u, v, p, out):  # type: ignore[no-untyped-def]
    """Add the forces of the members to the forces on the nodes, and write the moments for the rotation vectors."""
    for m in range(p.ends.shape[0]):
        _pull(u, p, m, out)
    for i in p.rotations:
        _of_rotation_vector(u, v, i, p.m[i], out)


@element
def _strain(u: Any, p: Any, m: Any) -> Any:
    """Return the energy of a member."""
    k = p.stiffness[m]
    _, _, longer, (_, y_a, z_a), (_, y_b, z_b), a, b = _deformed(u, p, m)
    s, c = _twist(y_a, z_a, y_b, z_b)
    twist = atan2(s, c) if k[35] > 0 else 0.0
    bends = k[7] * a[1] ** 2 + k[14] * b[1] ** 2 + k[21] * a[0] ** 2 + k[28] * b[0] ** 2
    return 0.5 * (k[0] * longer**2 + k[35] * twist**2 + bends) + k[8] * a[1] * b[1] + k[22] * a[0] * b[0]


@jit
def energy_of_members_in_space(t, u, v, p):  # type: ignore[no-untyped-def]
    """Return the kinetic energy, by the angular velocities of the nodes, and the energy of the members."""
    energy = 0.0
    for i in range(p.size):
        energy += 0.5 * p.m[i] * v[i] * v[i]
    for i in p.rotations:
        turn, rate = (u[i], u[i + 1], u[i + 2]), (v[i], v[i + 1], v[i + 2])
        a, b, _, _ = _series(dot(turn, turn))
        across = cross(turn, rate)
        omega = _sum(1.0, _sum(1.0, rate, a, across), b, cross(turn, across))
        energy += 0.5 * p.m[i] * (dot(omega, omega) - dot(rate, rate))
    for m in range(p.ends.shape[0]):
        energy += _strain(u, p, m)
    return energy
