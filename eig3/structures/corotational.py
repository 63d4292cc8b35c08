"""Corotational members in the plane: large displacements and rotations, with small strains in the member frame.

See Crisfield, Non-linear Finite Element Analysis of Solids and Structures, volume 1, section 7.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, pi, sqrt
from typing import Any

import numpy as np

from ..functions.callbacks import jit
from ..kernels.compile.jit import element
from .frame_members import Member


def chords(names: Sequence[str], members: Sequence[Member], ends: Sequence[Sequence[str]]) -> dict[str, np.ndarray]:
    """Return the parameters of corotational members in the plane, or the parameters that members in space share.

    Parameters
    ----------
    names : sequence of str
        The names of all degrees of freedom.
    members : sequence of Member
    ends : sequence of sequence of str
        For each member, the names of the degrees of freedom of both ends.

    Returns
    -------
    dict
        `ends`, shape (members, 6 or 12): the degrees of freedom of both nodes, -1 where they are fixed; `chords`, shape
        (members, 2 or 3): the vectors between the nodes, m; `stiffness`, shape (members, 9 or 36): see
        `Member.stiffness_of_chord`.
    """
    number = {name: i for i, name in enumerate(names)}
    return {
        "ends": np.array([[number.get(name, -1) for name in of_member] for of_member in ends]),
        "chords": np.array([member.end - member.start for member in members]),
        "stiffness": np.array([member.stiffness_of_chord.ravel() for member in members]),
    }


@element
def entry(u: Any, i: Any) -> Any:
    """Return the entry i, or 0 where a degree of freedom is fixed."""
    return u[i] if i >= 0 else 0.0


@element
def _turned(angle: Any) -> Any:
    """Return an angle between -pi and pi."""
    return angle - 2 * pi * round(angle / (2 * pi))


@element
def _deformed(u: Any, p: Any, m: Any) -> Any:
    """Return the direction and the length of a chord, the elongation, and the rotations of the ends relative to it."""
    x, y = p.chords[m, 0], p.chords[m, 1]
    ends = p.ends[m]
    move_x, move_y = entry(u, ends[3]) - entry(u, ends[0]), entry(u, ends[4]) - entry(u, ends[1])
    dx, dy = x + move_x, y + move_y
    length, rest = sqrt(dx * dx + dy * dy), sqrt(x * x + y * y)
    # the round-off of the rotation and of the elongation is relative to the displacements, and not to the lengths
    angle = atan2(x * move_y - y * move_x, x * dx + y * dy)  # rotation of the chord
    longer = (move_x * (dx + x) + move_y * (dy + y)) / (length + rest)
    turns = _turned(entry(u, ends[2]) - angle), _turned(entry(u, ends[5]) - angle)
    return dx / length, dy / length, length, longer, turns[0], turns[1]


@jit
def turning_members(t, u, v, p, out):  # type: ignore[no-untyped-def]
    """Add the forces of the members to the forces on the nodes."""
    for m in range(p.ends.shape[0]):
        c, s, length, longer, turn_0, turn_1 = _deformed(u, p, m)
        k, ends = p.stiffness[m], p.ends[m]
        pull = k[0] * longer
        moment_0, moment_1 = k[4] * turn_0 + k[5] * turn_1, k[7] * turn_0 + k[8] * turn_1
        shear = (moment_0 + moment_1) / length
        fx, fy = -c * pull - s * shear, -s * pull + c * shear
        forces = (fx, fy, moment_0, -fx, -fy, moment_1)
        for j in range(6):
            if ends[j] >= 0:
                out[ends[j]] -= forces[j]


@jit
def energy_of_members(t, u, v, p):  # type: ignore[no-untyped-def]
    """Return the kinetic energy plus the strain energy of the members."""
    energy = 0.0
    for i in range(p.size):
        energy += 0.5 * p.m[i] * v[i] * v[i]
    for m in range(p.ends.shape[0]):
        _, _, _, longer, turn_0, turn_1 = _deformed(u, p, m)
        k = p.stiffness[m]
        energy += 0.5 * (k[0] * longer**2 + k[4] * turn_0**2 + k[8] * turn_1**2) + k[5] * turn_0 * turn_1
    return energy
