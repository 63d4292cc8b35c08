"""Members of frames: stiffness and lumped mass of bars and of Euler-Bernoulli beams, in the plane and in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..functions.checks import reals

#: The directions of a node: displacements, m, and rotations, rad.
DIRECTIONS = {2: ("ux", "uy", "rz"), 3: ("ux", "uy", "uz", "rx", "ry", "rz")}
_ALONG = 0.999  # with a larger cosine, a member counts as parallel to the reference direction of its local axes


@dataclass(frozen=True)
class Section:
    """The section and the material of a member.

    A member with I = 0 is a bar with hinges at both ends.

    Parameters
    ----------
    E : float
        Young's modulus, Pa.
    A : float
        Area, m^2.
    I : float
        Second moment of area, m^4, for bending in the plane; in space, for bending in the plane of the member and `up`.
    density : float
        kg/m^3.
    I_side : float, optional
        In space: for bending perpendicular to `up`; I by default.
    G, J : float
        In space: shear modulus, Pa, and torsion constant, m^4.

    Raises
    ------
    TypeError, ValueError
        If E and A are not positive, or another value is negative.

    Notes
    -----
    Other codes: OpenSees ``element elasticBeamColumn``, with ``geomTransf Linear``, or ``Corotational`` for a problem
    with ``corotational=True``; a section with I = 0 is ``element truss`` or ``corotTruss``. Masses are lumped.

    Not included: shear deformation (``ElasticTimoshenkoBeam``), plasticity along the member, offsets of the ends, and
    loads along the member.
    """

    E: float
    A: float
    I: float = 0.0  # noqa: E741
    density: float = 0.0
    I_side: float | None = None
    G: float = 0.0
    J: float = 0.0

    def __post_init__(self) -> None:
        for name in ("E", "A", "I", "density", "I_side", "G", "J"):
            least, given = name in "EA", getattr(self, name)
            value = reals(self.I if name == "I_side" and given is None else given, name)
            if value.shape != () or not np.isfinite(value) or value < 0 or (least and value == 0):
                raise ValueError(
                    f"{name} must be a {'positive number' if least else 'number of at least 0'}, not {value}."
                )

    @property
    def is_bar(self) -> bool:
        """Whether the member has no bending stiffness."""
        return self.I == 0


@dataclass(frozen=True, eq=False)
class Member:
    """A straight member between two nodes.

    Parameters
    ----------
    section : Section
    start, end : ndarray, shape (2,) or (3,)
        The positions of its nodes, m.
    releases : frozenset of str
        The ends, "start" or "end", without a moment.
    up : ndarray, shape (3,)
        In space: a direction in the plane of the first bending stiffness.
    """

    section: Section
    start: np.ndarray
    end: np.ndarray
    releases: frozenset[str]
    up: np.ndarray

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """The stiffness, shape (2 d, 2 d), and the lumped masses, shape (2 d,), of the d directions of both nodes."""
        turn = self._turn()
        K = turn.T @ self._local_stiffness() @ turn
        return 0.5 * (K + K.T), self._masses()

    @property
    def stiffness_of_chord(self) -> np.ndarray:
        """The stiffness for the elongation and the rotations of the ends, shape (3, 3) in the plane.

        In space, shape (6, 6): the elongation, the rotations of both ends about z and about y, and the twist.
        """
        s = self.section
        bends = np.kron(np.diag([s.E * s.I, s.E * self._side]), [[4, 2], [2, 4]])
        K = scipy.linalg.block_diag(s.E * s.A, bends, s.G * s.J) / self.length
        K = _released(K, [i + (name == "end") for name in sorted(self._hinges) for i in (1, 3)])
        return K if self.start.size == 3 else K[:3, :3]

    @property
    def axes(self) -> np.ndarray:
        """The local axes of the member in space, with x along the member, shape (3, 3)."""
        x = (self.end - self.start) / self.length
        other = [1.0, 0.0, 0.0] if abs(x[0]) < _ALONG else [0.0, 0.0, 1.0]
        up = self.up if abs(x @ self.up) < _ALONG else np.array(other)
        y = up - (up @ x) * x
        y /= np.linalg.norm(y)
        return np.array([x, y, np.cross(x, y)])

    @property
    def _side(self) -> float:
        return self.section.I if self.section.I_side is None else self.section.I_side

    @property
    def _hinges(self) -> frozenset[str]:
        return frozenset({"start", "end"}) if self.section.is_bar else self.releases

    def _local_stiffness(self) -> np.ndarray:
        s, length, d = self.section, self.length, len(DIRECTIONS[self.start.size])
        K = np.zeros((2 * d, 2 * d))
        _add_pair(K, 0, d, s.E * s.A / length)
        if self.start.size == 2:
            _add_bending(K, [1, 2, 4, 5], s.E * s.I, length, 1)
            return _released(K, [2 + 3 * (name == "end") for name in sorted(self._hinges)])
        _add_pair(K, 3, d, s.G * s.J / length)
        _add_bending(K, [1, 5, 7, 11], s.E * s.I, length, 1)
        _add_bending(K, [2, 4, 8, 10], s.E * self._side, length, -1)
        return _released(K, [i + 6 * (name == "end") for name in sorted(self._hinges) for i in (4, 5)])

    def _masses(self) -> np.ndarray:
        """Half of the mass at each node, with the rotary inertia of half of a rod about its end, m L^2 / 24.

        In space it is the same about all axes, which keeps the mass diagonal but slows the torsion of members.
        """
        d, mass = len(DIRECTIONS[self.start.size]), self.section.density * self.section.A * self.length
        masses = np.zeros((2, d))
        masses[:, : self.start.size] = mass / 2
        for k, end in enumerate(("start", "end")):
            if end not in self._hinges:
                masses[k, self.start.size :] = mass * self.length**2 / 24
        return masses.ravel()

    def _turn(self) -> np.ndarray:
        """The matrix that transforms displacements and rotations of the nodes to the local axes."""
        if self.start.size == 3:
            return np.kron(np.eye(4), self.axes)
        x = (self.end - self.start) / self.length
        return np.kron(np.eye(2), np.array([[x[0], x[1], 0], [-x[1], x[0], 0], [0, 0, 1]]))


def _add_pair(K: np.ndarray, i: int, d: int, k: float) -> None:
    """Add a spring between direction i of both nodes."""
    K[np.ix_([i, i + d], [i, i + d])] += k * np.array([[1, -1], [-1, 1]])


def _add_bending(K: np.ndarray, places: list[int], EI: float, length: float, sign: int) -> None:
    """Add an Euler-Bernoulli beam; `sign` is the sign of the deflection by a positive rotation."""
    c, h = sign * 6 * length, 4 * length**2
    K[np.ix_(places, places)] += (
        EI / length**3 * np.array([[12, c, -12, c], [c, h, -c, h / 2], [-12, -c, 12, -c], [c, h / 2, -c, h]])
    )


def _released(K: np.ndarray, hinges: list[int]) -> np.ndarray:
    """Return the stiffness after static condensation of the rotations at hinges."""
    for i in hinges:
        if K[i, i] > 0:
            K = K - np.outer(K[:, i], K[i]) / K[i, i]
    return K
