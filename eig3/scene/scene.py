"""Scenes: points and the effects on them. A scene is compiled to a problem that contains only these effects."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import deepcopy
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..animation.shapes import shape_of
from ..functions.checks import check_count, check_span, reals, shown
from ..keywords import with_suggestions
from ..problem import Problem
from . import codegen
from .assembly import assemble, first_order, names, note, numbered, sources, units
from .bodies import Rigid, RigidBody, plates, principal_moments, rotation_matrix
from .cell import Cell
from .description import Axes, Description, Points, spread
from .encounters import Encounters
from .mesh import check_cells, is_fixed, lumped, oriented
from .picture import geometry_and_view

__all__ = ["Scene"]


@with_suggestions()
class Scene(Description):
    """Points in one to three dimensions and the effects on them.

    The vector u of a scene's problem has the Cartesian coordinates of the masses: first the x of all masses, in the
    order in which the masses were added, then the y of all masses, then the z. If a mass has an inertia, the angles of
    all masses follow: one in the plane, and three in space, the integrals of the angular velocity about x, y and z. The
    states of effects, such as whether a string has broken, follow. `Points.positions` and `Points.angles` extract the
    values of some points.

    Parameters
    ----------
    dimension : {1, 2, 3}
    box : sequence of float or None, shape (dimension,), optional
        The sides of a periodic box, m; None or 0 along an axis that is not periodic. A link acts between the nearest
        images of its points. u is unwrapped: it does not jump where a point leaves the box.
    shear : float
        The shear rate of Lees-Edwards boundaries, 1/s: the images at y + box[1] are displaced by shear box[1] t along x
        at the time t. Give the masses the initial velocity shear y along x to start in the shear flow.

    Raises
    ------
    ValueError
        If dimension is not 1, 2 or 3, the box does not have a side for each dimension, or shear is given without sides
        along x and y.
    """

    @classmethod
    def read(
        cls,
        path: str | PathLike[str],
        *,
        dimension: int = 3,
        periodic: bool | Sequence[bool] = True,
        length: float = 1.0,
        mass: float = 1.0,
        time: float = 1.0,
        style: str | None = None,
        ignore: Collection[str] = (),
    ) -> Any:
        """Read the atoms, the mesh or the mechanism of a file into a new scene. Effects are added afterwards.

        Parameters
        ----------
        path : str or path
            A data file of LAMMPS (".data", ".lmp", ".lammps" or "data.*"), atoms that ASE reads (".xyz", ".extxyz",
            ".pdb"), a mechanism of MuJoCo (".xml"), or a mesh that meshio reads (".msh", ".inp", ".vtu" and others).
        dimension : {2, 3}
            Of the scene of a mesh.
        periodic : bool or sequence of bool, shape (3,)
            Whether the box of a file of atoms is periodic along x, y and z.
        length, mass, time : float
            The units of the file in the units of the scene, such as ``length=1e-10`` for Ångström.
        style : str, optional
            The style of the atoms of LAMMPS, such as "full", if the file does not name it.
        ignore : collection of str
            What a mechanism of MuJoCo has and the scene leaves out, such as ``("contact", "range")``. Without it, the
            error names everything that would change the motion.

        Returns
        -------
        FileOfAtoms
            With `scene`; `atoms`, and `points` by type; `bonds`, `angles`, `dihedrals` and `impropers` by type; and
            `types`, `charges`, `radii` and `coefficients`.
        FileOfMesh
            For a mesh: `scene`, `positions`, `cells`, `groups` of points and `cell_groups`.
        FileOfMechanism
            For a mechanism: `scene`, `bodies` and `sites` by name, `motors` and `drive`, and `timestep`. The scene has
            its joints, constraints and gravity. The spring of a hinge has an angle from -pi to pi: when the hinge turns
            past half a turn, the spring has another torque than in MuJoCo.

        Raises
        ------
        ValueError
            If the file has something that a scene does not support, such as a tilted box. The error names it.
        ImportError
            If ASE or meshio is not installed: ``pip install 'eig3[files]'``; or SciPy, for mechanisms.
        OSError
            If the file cannot be read.
        """
        from .reading import read

        return read(cls, Path(path), dimension, periodic, (length, mass, time), style, ignore)

    def body(
        self,
        mass: float,
        inertia: ArrayLike,
        position: ArrayLike,
        rotation: Any = None,
        *,
        velocity: ArrayLike = 0.0,
        angular_velocity: ArrayLike = 0.0,
        shape: tuple[str, ArrayLike] | None = None,
    ) -> RigidBody:
        """Add a rigid body, in two or three dimensions.

        Parameters
        ----------
        mass : float
            kg.
        inertia : float or array_like, shape (3,) or (3, 3)
            About the centre of mass, kg m^2: in the plane a number; in space the principal moments, or the matrix, in
            the frame of the body.
        position : array_like, shape (dimension,)
            Of the centre of mass, m.
        rotation : optional
            The rotation from the frame of the body to the frame of the scene: in the plane an angle, rad; in space a
            quaternion (x, y, z, w), a 3 x 3 matrix or a SciPy ``Rotation``. By default the frames are the same.
        velocity : array_like, shape (dimension,)
            Of the centre of mass, m/s.
        angular_velocity : float or array_like, shape (3,)
            rad/s; in space in the frame of the scene.
        shape : (str, float or sequence of float), optional
            For pictures, in the frame of the body: ``("box", sides)`` or ``("sphere", radius)``, m; in space also
            ``("cylinder", (radius, length))`` and ``("capsule", (radius, length))`` along z, with the length between
            the centres of the caps. By default a box with the mass and the inertia of the body.

        Returns
        -------
        RigidBody
            It has methods for points, on which effects act, and for joints.

        Raises
        ------
        TypeError, ValueError
            If an argument does not match the dimension, or is not possible for a body.
        """
        if self.dimension == 1:
            raise ValueError("a rigid body needs a scene of 2 or 3 dimensions.")
        if self._box.any():
            raise ValueError("a scene with a periodic box has no rigid bodies: their points have no nearest images.")
        squares, principal = principal_moments(inertia, self.dimension)
        axes = (rotation_matrix(rotation, self.dimension) @ principal).T
        turning = reals(angular_velocity, "angular_velocity")
        if turning.shape not in ((), (3,)) or ((turning.shape == (3,)) != (self.dimension == 3) and turning.any()):
            wanted = "a number" if self.dimension == 2 else "3 numbers"
            raise ValueError(f"angular_velocity of a body in {self.dimension} dimensions must be {wanted}, in rad/s.")
        across = axes @ np.array([[0.0, 1.0], [-1.0, 0.0]]) if self.dimension == 2 else axes
        rates = turning * across if self.dimension == 2 else np.cross(np.broadcast_to(turning, 3), axes)
        solid = None if shape is None else shape_of(shape, self.dimension)
        moving = reals(velocity, "velocity")
        if moving.shape not in ((), (self.dimension,)):
            raise ValueError(f"velocity of a body must be {self.dimension} numbers, in m/s, not {shown(velocity)}.")
        centre = self.mass(mass, position, np.broadcast_to(moving, (self.dimension,)))
        vectors = Axes(self, self.mass(squares, axes, rates).numbers)
        if solid is not None:
            kind, semi_axes = solid
            middle = np.zeros(self.dimension)
            self._bodies.shapes[int(centre.numbers)] = [(kind, middle, np.diag(semi_axes) @ principal)]
        self._bodies.vectors.extend(vectors.numbers.tolist())
        self._bodies.plates.extend(plates(squares, vectors.numbers))
        number = 1 + max(self._bodies.numbers.values(), default=-1)
        self._bodies.numbers.update(dict.fromkeys([int(centre.numbers), *vectors.numbers.tolist()], number))
        self.add(Rigid(), *vectors)
        return RigidBody(self, centre, vectors, principal)

    def add_mesh(
        self,
        points: ArrayLike,
        cells: ArrayLike,
        effect: Cell,
        *,
        density: ArrayLike,
        velocity: ArrayLike = 0.0,
        fixed: ArrayLike = (),
        rest: ArrayLike | None = None,
    ) -> Points:
        """Add the points and the cells of a mesh, such as the triangles of a sheet or the tetrahedra of a solid.

        The mass of each cell, its density times its volume at rest, is lumped equally to its corners; the volume of a
        triangle is its area times the thickness of the effect. To add an effect to some points of a mesh, index the
        returned points, as in ``scene.add(effect, *sheet[eig3.scene.edges(cells)])``.

        Parameters
        ----------
        points : array_like, shape (points, dimension)
            Their positions at the start, m, as in ``meshio.Mesh.points``.
        cells : array_like of int, shape (cells, corners)
            The numbers of the corners of each cell, as in ``meshio.CellBlock.data``. Every point belongs to a cell. If
            all cells are inverted, two corners of each are exchanged.
        effect : Triangle or Tetrahedron
            Its parameters are numbers, or arrays with one number for each cell.
        density : float or array_like, shape (cells,)
            kg/m^3.
        velocity : array_like, shape (points, dimension), optional
            m/s; 0 if not given.
        fixed : array_like of int, or of bool with shape (points,)
            The points that do not move, unless a `Motion` moves them.
        rest : array_like, shape (points, dimension), optional
            The stress-free positions, m; by default the positions at the start. Other cells on these points, such as
            the cells of `HingeBending`, also take their rest shape from `rest`.

        Returns
        -------
        Points
            Of shape (points,).

        Raises
        ------
        TypeError, ValueError
            If the arrays do not match each other or the effect, or some cells are degenerate or inverted at rest. The
            error names the argument, or the effect and the cells.

        Warns
        -----
        UserWarning
            If all cells are inverted.
        """
        if not isinstance(effect, Cell) or not effect.extent:
            raise TypeError("effect of add_mesh must be a Triangle or a Tetrahedron: it has a volume, and thus a mass.")
        effect.check(self.dimension)
        places = self._vectors(points, "points of a mesh")
        if places.ndim != 2:
            raise ValueError(f"points of a mesh must have the shape (points, {self.dimension}), not {places.shape}.")
        corners = check_cells(cells, effect.takes[0], len(places))
        at_rest = places if rest is None else self._vectors(rest, "rest of a mesh")
        if at_rest.shape != places.shape:
            raise ValueError(f"rest of a mesh must have the shape {places.shape} of its points, not {at_rest.shape}.")
        corners = oriented(corners, at_rest)
        volumes = effect.shape_columns(list(at_rest[corners.T]))[effect.extent]
        m = lumped(corners, volumes, density, len(places))
        m[is_fixed(fixed, len(places))] = 0.0
        columns = effect.columns((len(corners),), self.dimension)
        effect.check_points(list(m[corners.T]), list(places[corners.T]), columns)  # before the points are in the scene
        zero = np.ndim(velocity) == 0 and velocity == 0
        speeds = np.zeros_like(places) if zero else self._vectors(velocity, "velocity of a mesh")
        mesh = self._added(places, m, spread(speeds, places.shape, "velocity"), at_rest)
        self.add(effect, *mesh[corners.T])
        return mesh

    def problem(
        self, t_span: Sequence[float], *, name: str = "scene", work: bool = False, threads: int | None = None
    ) -> Problem:
        """Compile the scene as it is now.

        Parameters
        ----------
        t_span : (float, float)
            s.
        name : str
        work : bool
            Integrate the work, J, of effects without a potential and of moving supports, with the motion and to the
            same order. ``solution.z["work"]`` is the work at the saved times, and
            ``solution.drift["energy"]`` is the largest change of the mechanical energy minus the work, which is
            constant in the exact motion. The work includes the energy that events dissipate. For a scene with constant
            mechanical energy, `work` has no effect.
        threads : int, optional
            The number of threads of a run, which share the pair forces of thousands of points, and all forces if there
            are thousands of cells. The results are bitwise the same for every number of threads; without `threads`, the
            compiler may round some forces differently. In an ensemble, each member has one thread.

        Returns
        -------
        Problem
            `energy`, J, is None if an effect has no potential or an event changes the state, and `work` is False.
            `names` are x0, x1, ..., then y0, ... and z0, ..., by the number of the mass, and the names of events with a
            state. `events` have names such as "rigid stop 0", numbered for each kind in the order in which they were
            added. `note` lists the content of the scene. To read the code, use
            ``inspect.getsource(problem.rhs.py_func)``.

        Raises
        ------
        ValueError
            If the scene has no masses, or the parameters of an effect do not match the number of masses.
        """
        check_span(t_span)
        cloud = replace(self._cloud(), bodies=deepcopy(self._bodies))
        assembly = assemble(cloud, self._placed, self._pair_forces, work=work)
        if assembly.angles and cloud.bodies.vectors:
            raise ValueError("a scene with rigid bodies cannot have masses with an inertia: add them with scene.body.")
        code = codegen.compiled(assembly, None if threads is None else check_count(threads, "threads"))
        u0, v0 = assembly.start(cloud.positions), assembly.start(cloud.velocities, cloud.spins)
        if assembly.constraints:
            from .constraint_system import fitting  # it needs SciPy

            v0 = fitting(assembly.constraints, u0, v0, float(t_span[0]))
        geometry, view = geometry_and_view(cloud, numbered(cloud, self._placed)[0], self._pair_forces)
        return Problem(
            name=name,
            u0=u0,
            v0=v0,
            t_span=(t_span[0], t_span[1]),
            source=sources(assembly),
            note=note(assembly),
            names=names(assembly),
            units=units(assembly),
            z0=first_order(assembly),
            encounters=Encounters.of(assembly, self._placed),
            masses=assembly.inertias,
            view=view,
            geometry=geometry,
            **code,
        )
