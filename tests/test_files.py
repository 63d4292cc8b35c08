"""Files of other programs, read back by their own libraries."""

import re
import tracemalloc
import warnings
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from types import SimpleNamespace

import ase.io
import h5py
import MDAnalysis
import meshio
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eig3
from eig3.cli import main
from eig3.effects import (
    Breaking,
    BreakingString,
    Gravity,
    HertzContact,
    HertzMindlin,
    LennardJones,
    LinearSpring,
    Link,
    NeoHookean,
    SupportMotion,
)
from eig3.problems import double_pendulum, duffing, ten_storey_frame
from eig3.scene import Scene
from eig3.scene.force_chains import ForceChains

TEXT = 5.1e-10  # half a unit of the last of ten digits, relative to 1


@pytest.fixture(scope="module")
def atoms():
    """Atoms that leave a box of unequal sides, and a run of them."""
    rng = np.random.default_rng(3)
    scene = Scene(dimension=3, box=(6.0, 7.0, 8.0))
    places = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3) * np.array([1.5, 1.75, 2.0])
    points = scene.mass(rng.uniform(1, 2, 64), places, rng.normal(0, 3.0, (64, 3)))
    scene.add(LennardJones(1.0, 1.0, cutoff=2.5), points)
    problem = scene.problem((0, 2.0))
    solution = problem.integrate(h=1 / 512, save_every=256)
    return problem, solution, points.positions(solution.u), points.velocities(solution.v)


@pytest.fixture(scope="module")
def mixed():
    """A rigid body that turns, a solid with a string that breaks, and a support that moves."""
    scene = Scene(dimension=3)
    body = scene.body(2.0, (0.1, 0.2, 0.25), (5, 0, 1), angular_velocity=(1, 2, 3))
    shaken = scene.fixed((0, 0, 3))
    cube = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
    solid = scene.add_mesh(cube, [[0, 1, 2, 3]], NeoHookean(1e5, 0.3), density=1000.0)
    scene.add(BreakingString(100.0, 1.0, 150.0), shaken, solid[3])
    scene.add(LinearSpring(50.0, 0.8), shaken, body.point((0.1, 0.1, 0.2)))
    scene.add(SupportMotion(sway, (1.0, 0.0, 0.0)), shaken)
    scene.add(Gravity((0, 0, -9.81)))
    problem = scene.problem((0, 1.0))
    return problem, problem.integrate(h=1e-3, save_every=100), shaken, solid, body


sway = eig3.jit(lambda t: (np.sin(t), np.cos(t)))


def test_extended_xyz_is_read_by_ase(atoms, tmp_path):
    problem, solution, x, v = atoms
    species = np.where(np.arange(64) < 32, "Ar", "Kr")
    problem.export(solution, tmp_path / "run.extxyz", types=species, scale=2.0)
    problem.export(solution, tmp_path / "run.xyz", types=species, scale=2.0)
    assert (tmp_path / "run.xyz").read_text() == (tmp_path / "run.extxyz").read_text()
    frames = ase.io.read(tmp_path / "run.xyz", index=":")
    assert len(frames) == len(solution.t) == 5
    for frame, t, row, rates in zip(frames, solution.t, x, v, strict=True):
        np.testing.assert_allclose(frame.positions, 2 * row, rtol=TEXT)
        np.testing.assert_allclose(frame.arrays["velo"], 2 * rates, rtol=TEXT)
        np.testing.assert_array_equal(frame.cell.array, np.diag([12.0, 14.0, 16.0]))
        assert frame.info["Time"] == t
        assert frame.pbc.all()
        assert frame.get_chemical_symbols() == species.tolist()
        np.testing.assert_allclose(frame.get_masses(), problem.masses[:64], rtol=TEXT)


def test_a_dump_of_lammps_has_image_flags(atoms, tmp_path):
    """ASE and MDAnalysis read positions in the box; with the images, MDAnalysis finds the positions of the run."""
    problem, solution, x, v = atoms
    assert abs(x).max() > 8.5  # some atoms leave the box
    path = problem.export(solution, tmp_path / "run.dump", types=["Kr"] * 10 + ["Ar"] * 54)
    frames = ase.io.read(path, index=":", format="lammps-dump-text")
    for frame, row in zip(frames, x, strict=True):
        inside = row % frame.cell.lengths()
        np.testing.assert_allclose(frame.positions, inside, rtol=0, atol=8 * TEXT)
        np.testing.assert_array_equal(frame.arrays["type"], [2] * 10 + [1] * 54)
    options = {"lammps_coordinate_convention": "unscaled", "unwrap_images": True, "dt": 0.5}
    frames = frames_of(path, format="LAMMPSDUMP", **options)
    assert [frame["time"] for frame in frames] == [0, 128, 256, 384, 512]  # the numbers of the steps, times dt
    for frame, row, rates in zip(frames, x, v, strict=True):
        np.testing.assert_allclose(frame["positions"], row, atol=2e-6)  # in single precision
        np.testing.assert_allclose(frame["velocities"], rates, rtol=2e-7)
        np.testing.assert_array_equal(frame["dimensions"], [6, 7, 8, 90, 90, 90])


def test_two_states_in_a_step_have_different_numbers(tmp_path):
    """Two states a step: with equal numbers, some readers keep one of them."""
    scene = Scene(dimension=2)
    scene.add(LinearSpring(50.0, 1.0), scene.fixed((0, 0)), scene.mass(1.0, (1.2, 0)))
    problem = scene.problem((0, 1))
    solution = problem.integrate(h=0.1, t_eval=np.linspace(0, 1, 21))
    path = problem.export(solution, tmp_path / "run.dump")
    assert re.findall("TIMESTEP\n(.*)\n", path.read_text()) == [str(k) for k in range(21)]


def frames_of(*files, **options):
    """Return the values of each frame as MDAnalysis reads it, without its warnings about guesses."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(*files, topology_format="LAMMPSDUMP", **options)
        names = ["time", "positions", "dimensions"] + ["velocities"] * (len(files) == 1)
        return [{name: np.array(getattr(frame, name)) for name in names} for frame in universe.trajectory]


def test_dcd_is_read_by_mdanalysis(atoms, tmp_path):
    problem, solution, x, _ = atoms
    with_times = replace(solution, t=solution.t * 1e-12)
    problem.export(with_times, tmp_path / "run.dcd")
    topology = problem.export(solution, tmp_path / "run.dump")
    frames = frames_of(topology, tmp_path / "run.dcd")
    for frame, t, row in zip(frames, solution.t, x, strict=True):
        assert frame["time"] == pytest.approx(t, rel=1e-6)  # ps
        np.testing.assert_array_equal(frame["positions"], row.astype(np.float32))
        np.testing.assert_array_equal(frame["dimensions"], [6, 7, 8, 90, 90, 90])


def test_a_box_that_shears_is_tilted(tmp_path):
    """The positions, the images and the box of a file give the positions of the run, in ASE's reading of the cell."""
    scene = Scene(dimension=3, box=(4.0, 3.0, None), shear=0.7)
    x = np.array([(0.5, 0.5, 0.0), (3.5, 2.5, 1.0)])
    points = scene.mass(1.0, x, [(1.0, 5.0, 0.0), (-9.0, -7.0, 0.5)])
    scene.add(LennardJones(1e-9, 0.1, cutoff=0.3), points)
    problem = scene.problem((0, 2.0))
    solution = problem.integrate(h=0.01, save_every=50)
    path = problem.export(solution, tmp_path / "run.dump")
    frames = ase.io.read(path, index=":", format="lammps-dump-text")
    again = ase.io.read(problem.export(solution, tmp_path / "run.extxyz"), index=":")
    blocks = path.read_text().split("ITEM: TIMESTEP\n")[1:]
    for block, frame, other, t, u in zip(blocks, frames, again, solution.t, solution.u, strict=True):
        shift = 0.7 * 3.0 * t
        cell = frame.cell.array[:2, :2]
        np.testing.assert_allclose(cell, [[4.0, 0.0], [shift - 4.0 * round(shift / 4.0), 3.0]], atol=1e-14)
        np.testing.assert_allclose(other.cell.array[:2, :2], cell, atol=1e-14)
        images = np.array([line.split()[5:8] for line in block.splitlines()[-2:]], dtype=float)
        edges = np.diag([4.0, 3.0, 1.0])
        edges[1, 0] = cell[1, 0]
        np.testing.assert_allclose(frame.positions + images @ edges, points.positions(u), atol=20 * TEXT)
        parts = frame.positions @ np.linalg.inv(edges)
        assert ((parts[:, :2] >= -1e-9) & (parts[:, :2] <= 1 + 1e-9)).all()
        assert not images[:, 2].any()
        assert frame.pbc.tolist() == other.pbc.tolist() == [True, True, False]


def test_grains_have_radii_spins_and_force_chains(tmp_path):
    """Without friction, the normal forces of grains and walls are the masses times the accelerations, to round-off.

    Two more grains touch across a side of the box: they have no line.
    """
    scene = Scene(dimension=2, box=(3.0, None))
    radii = np.array([0.1, 0.2, 0.15, 0.1])
    x = np.array([(0.5, 0.0), (0.79, 0.0), (0.75, 0.34), (2.95, 0.5)])
    spins = {"inertia": 0.01, "angular_velocity": [3.0, -1.0, 0.0, 0.5]}  # which without friction change no force
    grains = scene.mass(2.0, x, [(0, -0.2), (-0.5, 0.1), (0.2, 0.3), (0, 0)], **spins)
    walls = scene.fixed([(0.5, -0.19), (0.05, 0.5)])
    contact = {"E": 1e6, "nu": 0.3, "friction": 0.0, "restitution": 0.6}
    scene.add(HertzMindlin(**contact, radii=radii), grains)
    scene.add(HertzMindlin(**contact, contact_distance=radii + 0.1, wall_radius=0.1), grains, others=walls)
    problem = scene.problem((0, 1e-6))
    solution = problem.integrate(h=1e-6)
    path = problem.export(solution, tmp_path / "run.pvd", scale=10.0)
    _, meshes = states(path)
    mesh = next(iter(meshes))
    kind, pairs = mesh.cells[-1].type, mesh.cells[-1].data
    *without, forces = mesh.cell_data["normal_force"]
    assert kind == "line"
    assert not np.any(np.concatenate(without))
    assert sorted(map(tuple, np.sort(pairs).tolist())) == [(0, 1), (0, 4), (1, 2)]
    total = np.zeros((6, 3))
    way = mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]]
    each = forces[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
    np.add.at(total, pairs[:, 1], each)
    np.add.at(total, pairs[:, 0], -each)
    a = np.zeros(problem.u0.size)
    problem.rhs(0.0, problem.u0, problem.v0, problem.params, a)
    expected = np.column_stack([a[:4], a[4:8]])[:3]
    np.testing.assert_allclose(total[:3, :2] / 2.0, expected, rtol=0, atol=1e-12 * abs(expected).max())
    with h5py.File(problem.export(solution, tmp_path / "run.vtkhdf")) as file:
        root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
        begin, cells = int(steps["CellDataOffsets/normal_force"][0]), int(root["NumberOfCells"][0])
        np.testing.assert_array_equal(root["CellData/normal_force"][begin : begin + cells][-len(forces) :], forces)
        assert int(steps["CellDataOffsets/normal_force"][1]) == cells
    frames = ase.io.read(problem.export(solution, tmp_path / "run.extxyz"), index=":")
    for frame, u, v in zip(frames, solution.u, solution.v, strict=True):
        np.testing.assert_allclose(frame.arrays["radius"][:4], radii, rtol=TEXT)
        np.testing.assert_allclose(frame.positions[:4, :2], grains.positions(u), rtol=TEXT, atol=1e-300)
        found = frame.arrays["angular_velocity"][:4]
        np.testing.assert_allclose(found[:, 2], grains.angular_velocities(v), rtol=TEXT)
        assert not frame.positions[:, 2].any()
        assert not found[:, :2].any()


@dataclass(frozen=True, eq=False)
class Mixed(Link):
    """A contact of two materials."""

    stiffness: object
    contact_distance: float

    cutoff_field = "contact_distance"
    mixed = {"stiffness": "geometric"}  # noqa: RUF012
    picture = "discs"

    @staticmethod
    @eig3.jit
    def tension(r, stiffness, contact_distance):
        return stiffness * (r - contact_distance) if r < contact_distance else 0.0


def force_chains(scene):
    return ForceChains.of(scene._cloud(), scene._placed, scene._pair_forces)


def test_force_chains_mix_as_the_law_and_leave_out_fixed_pairs_and_states():
    """The stiffness sqrt(4 N/m 9 N/m) and the overlap 0.5 m push with 3 N. Geometries do not know which links broke."""
    scene = Scene(dimension=2)
    x = np.column_stack([[0.0, 0.5, 1.25, 1.5], np.zeros(4)])
    points = scene._added(x, np.array([1.0, 1.0, 0.0, 0.0]), 0 * x)
    scene.add(Mixed([4.0, 9.0, 1.0, 1.0], 1.0), points)
    pairs, forces = force_chains(scene)(0.0, x, 0 * x)
    assert dict(zip(map(tuple, pairs.tolist()), forces, strict=True)) == {(0, 1): 3.0, (1, 2): 0.75}
    scene = Scene(dimension=2)
    scene.add(Breaking(HertzContact(9.0, 1.0), max_energy=5.0), scene.fixed((0, 0)), scene.mass(1.0, (0, 0.5)))
    assert force_chains(scene) is None


def states(path):
    """Return the times and meshes of a collection."""
    sets = ET.parse(path).getroot().iter("DataSet")
    return zip(*[(float(x.get("timestep")), meshio.read(path.parent / x.get("file"))) for x in sets], strict=True)


def test_paraview_gets_cells_links_and_bodies(mixed, tmp_path):
    problem, solution, shaken, solid, body = mixed
    times, meshes = states(problem.export(solution, tmp_path / "run.pvd"))
    np.testing.assert_array_equal(times, solution.t)
    broken = solution.u[:, problem.names.index("breaking string 0")] != 0
    assert broken[-1]
    assert not broken[0]
    for row, mesh in enumerate(meshes):
        t, u, v = solution.t[row], solution.u[row], solution.v[row]
        number = mesh.cells_dict
        assert len(number["line"]) == 3 - broken[row]  # the string, the spring, and the arm of the body
        np.testing.assert_array_equal(mesh.points[number["tetra"][0]], solid.positions(u, t))
        velocity = mesh.point_data["velocity"]
        np.testing.assert_array_equal(velocity[number["tetra"][0]], solid.velocities(v, t))
        at = int(np.flatnonzero((abs(mesh.points - shaken.positions(u, t)) < 1e-12).all(axis=1))[0])
        np.testing.assert_allclose(velocity[at], [np.cos(t), 0, 0], atol=1e-15)
        np.testing.assert_allclose(mesh.points - mesh.point_data["displacement"], meshes[0].points, rtol=0, atol=1e-14)
        corners = number["hexahedron"][0]
        places = mesh.points[corners]
        np.testing.assert_allclose(places.mean(axis=0), body.centre.positions(u, t), atol=1e-14)
        sides = np.linalg.norm(places[[1, 3, 4]] - places[0], axis=1)
        of_a_box = 2.0 / 12 * (np.sum(sides**2) - sides**2)  # the moments of inertia of a box of 2 kg
        np.testing.assert_allclose(of_a_box, [0.1, 0.2, 0.25], rtol=1e-12)


def test_vtkhdf_has_the_same_states_as_the_collection(mixed, tmp_path):
    """The offsets are followed as VTK's description of the format says."""
    problem, solution, *_ = mixed
    _, meshes = states(problem.export(solution, tmp_path / "run.pvd"))
    with h5py.File(problem.export(solution, tmp_path / "run.vtkhdf")) as file:
        root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
        assert root.attrs["Type"] == b"UnstructuredGrid"
        assert steps.attrs["NSteps"] == len(solution.t)
        np.testing.assert_array_equal(steps["Values"], solution.t)
        assert len(root["NumberOfCells"]) == 2  # with the string, and without
        for k, mesh in enumerate(meshes):
            part, first, cell, place = (
                int(np.ravel(steps[name][k])[0])
                for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets")
            )
            points, cells, size = (
                int(root[name][part]) for name in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")
            )
            np.testing.assert_array_equal(root["Points"][first : first + points], mesh.points)
            data = root["PointData/velocity"][int(steps["PointDataOffsets/velocity"][k]) :][:points]
            np.testing.assert_array_equal(data, mesh.point_data["velocity"])
            corners = np.concatenate([block.data.ravel() for block in mesh.cells])
            np.testing.assert_array_equal(root["Connectivity"][place : place + size], corners)
            ends = np.cumsum([block.data.shape[1] for block in mesh.cells for _ in block.data])
            np.testing.assert_array_equal(root["Offsets"][cell + part :][: cells + 1], [0, *ends])
            kinds = {"vertex": 1, "line": 3, "tetra": 10, "hexahedron": 12}
            expected = [kinds[block.type] for block in mesh.cells for _ in block.data]
            np.testing.assert_array_equal(root["Types"][cell : cell + cells], expected)


@pytest.mark.system
def test_vtk_reads_both_files_of_paraview(mixed, tmp_path):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    problem, solution, *_ = mixed
    _, meshes = states(problem.export(solution, tmp_path / "run.pvd"))
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(problem.export(solution, tmp_path / "run.vtkhdf")))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == len(solution.t)
    for k, mesh in enumerate(meshes):
        reader.SetStep(k)
        reader.Update()
        grid = reader.GetOutput()
        np.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), mesh.points)
        assert grid.GetNumberOfCells() == sum(len(block.data) for block in mesh.cells)
        for name in ("id", "velocity"):
            of_points = vtk_to_numpy(grid.GetPointData().GetArray(name))
            np.testing.assert_array_equal(of_points, mesh.point_data[name])
        single = vtk.vtkXMLUnstructuredGridReader()
        single.SetFileName(str(tmp_path / f"run/run_{k:02d}.vtu"))
        single.Update()
        np.testing.assert_array_equal(vtk_to_numpy(single.GetOutput().GetPoints().GetData()), mesh.points)


def test_bodies_have_their_given_shapes(tmp_path):
    """Triangles with the area of the shape, turned outwards; a polyhedron of 24 sides has up to 2 % less."""
    radius, length, sides = 0.2, 0.6, np.array([0.2, 0.3, 0.4])
    shapes = {
        ("capsule", (radius, length)): 2 * np.pi * radius * (length + 2 * radius),
        ("cylinder", (radius, length)): 2 * np.pi * radius * (length + radius),
        ("sphere", radius): 4 * np.pi * radius**2,
        ("box", tuple(sides)): 2 * (sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0]),
    }
    scene = Scene(dimension=3)
    turn = {"rotation": (0.1, 0.2, 0.3, 0.9), "angular_velocity": (1.0, 2.0, 3.0)}
    inertia = [(0.3, 0.02, 0.01), (0.02, 0.2, 0.03), (0.01, 0.03, 0.25)]
    bodies = [scene.body(1.0, inertia, (2 * k, 0, 0), **turn, shape=shape) for k, shape in enumerate(shapes)]
    plain = scene.body(1.0, inertia, (8, 0, 0))
    problem = scene.problem((0, 0.5))
    solution = problem.integrate(h=0.01, save_every=25)
    mesh = meshio.read(problem.export(solution, tmp_path / "run.pvd").with_suffix("") / "run_2.vtu")
    (box,), cells = mesh.cells_dict["hexahedron"], mesh.cells_dict["triangle"]
    np.testing.assert_allclose(mesh.points[box].mean(axis=0), plain.centre.positions(solution.u[-1]), atol=1e-14)
    a, b, c = np.moveaxis(mesh.points[cells], 1, 0)
    for body, (shape, area) in zip(bodies, shapes.items(), strict=True):
        centre = body.centre.positions(solution.u[-1])
        near = np.abs((a - centre)[:, 0]) < 0.9
        normals = np.cross(b - a, c - a)[near] / 2
        assert 0.98 * area < np.linalg.norm(normals, axis=1).sum() < area * (1 + 1e-12)
        volume = ((a - centre)[near] * normals).sum() / 3
        assert volume > 0.3 * area * sides[0] / 2  # the faces are at least this far from the centre
        if shape[0] == "capsule":
            local = (a[near] - centre) @ Rotation.from_quat(body.rotation(solution.u[-1])).as_matrix()
            beyond = np.maximum(np.abs(local[:, 2]) - length / 2, 0)
            np.testing.assert_allclose(np.hypot(np.hypot(*local[:, :2].T), beyond), radius, rtol=1e-9)


def test_frames_and_views_have_points(tmp_path):
    """A frame moves by its displacements, and a view that is a mechanism gives its points and links."""
    frame = ten_storey_frame(t_end=0.2)
    solution = frame.integrate(h=frame.h, save_every=50)
    _, meshes = states(frame.export(solution, tmp_path / "frame.pvd", every=2))
    assert len(meshes) == len(solution.t[::2])
    sideways = [i for i, name in enumerate(frame.names) if name.endswith(".ux")]
    mesh = meshes[-1]
    row = 2 * (len(meshes) - 1)
    moved = mesh.point_data["displacement"][:, 0]
    change = solution.u[row, sideways] - solution.u[0, sideways]
    np.testing.assert_allclose(np.sort(moved[moved != 0]), np.sort(change), rtol=0, atol=1e-13)
    rates = mesh.point_data["velocity"][:, 0]
    np.testing.assert_array_equal(np.sort(rates[rates != 0]), np.sort(solution.v[row, sideways]))
    pendulum = double_pendulum()
    run = pendulum.integrate(h=0.01, t_end=0.1)
    last = ase.io.read(pendulum.export(run, tmp_path / "pendulum.extxyz"), index=-1)
    np.testing.assert_allclose(last.positions[:, :2], pendulum.view.places(run.t[-1:], run.u[-1:])[0], rtol=TEXT)


def test_a_weight_on_a_line_is_upright(tmp_path):
    scene = Scene(dimension=1)
    scene.add(LinearSpring(50.0, 1.0), scene.fixed(2.0), scene.mass(1.0, 1.0, 0.5))
    scene.add(Gravity(-9.81))
    problem = scene.problem((0, 1))
    first = ase.io.read(problem.export(problem.integrate(h=0.01), tmp_path / "run.extxyz"), index=0)
    np.testing.assert_array_equal(first.positions, [(0, 2, 0), (0, 1, 0)])
    np.testing.assert_array_equal(first.arrays["velo"], [(0, 0, 0), (0, 0.5, 0)])
    assert first.arrays["type_number"].tolist() == [2, 1]


@pytest.mark.parametrize("ending", ["extxyz", "dump", "dcd", "pvd", "vtkhdf"])
def test_a_saved_run_is_written_row_by_row(ending, tmp_path):
    """Much less memory is held than the run has, and each access of the run is to one row."""
    scene = Scene(dimension=3)
    rope = scene.mass(1.0, np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)]))
    scene.add(LinearSpring(100.0, 1.0), rope[:-1], rope[1:])
    problem = scene.problem((0, 1.0))
    problem.integrate(h=2**-10, save_to=tmp_path / "saved")
    solution = problem.load(tmp_path / "saved")
    assert isinstance(solution.u, np.memmap)
    u, v = Rows(solution.u), Rows(solution.v)
    problem.export(replace(solution, u=u, v=v, t=solution.t[:3]), tmp_path / f"first.{ending}")  # loads the library
    u.asked.clear()
    tracemalloc.start()
    try:
        problem.export(replace(solution, u=u, v=v), tmp_path / f"run.{ending}", every=8)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert set(u.asked) == set(range(0, 1025, 8))
    assert peak < solution.u.nbytes / 3


class Rows:
    """Rows of a run that keep the index of each access, and refuse all but one row at a time."""

    def __init__(self, rows):
        self.rows, self.shape, self.ndim, self.asked = rows, rows.shape, rows.ndim, []

    def __len__(self):
        return len(self.rows)

    def __getitem__(self, row):
        assert isinstance(row, int)
        self.asked.append(row)
        return self.rows[row]


@pytest.mark.parametrize("name", ["run.dump", "run.pvd"])
def test_an_interrupted_file_is_not_left(atoms, name, tmp_path):
    """What was there before stays."""
    problem, solution, *_ = atoms
    path = tmp_path / name
    path.write_text("before")

    class Stopping(Rows):
        def __getitem__(self, row):
            if row > 1:
                raise KeyboardInterrupt
            return super().__getitem__(row)

    with pytest.raises(KeyboardInterrupt):
        problem.export(replace(solution, u=Stopping(solution.u)), path)
    assert path.read_text() == "before"
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_dcd_file_that_cannot_be_written_to_its_end_is_an_error(atoms, limited_files, tmp_path):
    """A state has 64 * 12 bytes; MDAnalysis writes what fits, and says nothing."""
    problem, solution, *_ = atoms
    message = r"run\.dcd could not be written to its end: is the disk full\?$"
    with limited_files(3000), pytest.raises(OSError, match=message):
        problem.export(solution, tmp_path / "run.dcd")
    assert [*tmp_path.iterdir()] == []


def test_vtkhdf_stops_before_the_disk_is_full(atoms, monkeypatch, tmp_path):
    """When a write fails, HDF5 crashes the process."""
    problem, solution, *_ = atoms
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=2**25))
    with pytest.raises(OSError, match=r"no room for the next state and 32 MB on the disk: .*run\.vtkhdf"):
        problem.export(solution, tmp_path / "run.vtkhdf")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("write", ["animate", "show", "export"])
def test_a_run_of_another_problem_is_refused(tmp_path, write):
    """The angle of an oscillator would be drawn as a pendulum."""
    run = duffing().integrate(h=0.1, t_end=1.0)
    with pytest.raises(ValueError, match=r"solution must be a run of double_pendulum, with .* \(2,\), not \(\)\.$"):
        getattr(double_pendulum(), write)(run, tmp_path / "a.html")


def test_bad_exports_are_refused(atoms, tmp_path, monkeypatch):
    problem, solution, *_ = atoms

    def fails(kind, message, name="run.extxyz", source=problem, run=solution, **options):
        with pytest.raises(kind, match=message):
            source.export(run, tmp_path / name, **options)

    fails(ValueError, r"path must end with \.extxyz, .*, not 'run.pdb'", "run.pdb")
    fails(ValueError, r"path must end with \.vtkhdf or \.pvd, .* not with \.xdmf: 'run\.xdmf'", "run.xdmf")
    fails(FileNotFoundError, "create .*nowhere' first", "nowhere/run.dump")
    fails(ValueError, r"types must be one for all points, or have the shape \(64,\)", types=[1, 2])
    fails(ValueError, "types must be words without spaces", types="an atom")
    fails(ValueError, "types must be words, or whole numbers of at least 1", types=0)
    fails(ValueError, "scale must be a positive number", scale=-1.0)
    fails(ValueError, "every", every=0)
    fails(ValueError, "duffing has no points in space", source=duffing())
    fails(TypeError, "solution must be a Solution", run=problem.ensemble(u0=problem.u0[None], h=1e-3, t_end=0.01))
    uneven = problem.integrate(h=1 / 512, t_end=5 / 512, save_every=2)
    fails(ValueError, "not at equal distances in time", "run.dcd", run=uneven)
    assert list(tmp_path.iterdir()) == []
    for module, name in (("meshio", "run.pvd"), ("h5py", "run.vtkhdf"), ("MDAnalysis", "run.dcd")):
        monkeypatch.setitem(__import__("sys").modules, module, None)
        fails(ImportError, rf"files need {module}: pip install 'eig3\[files\]'", name)


def test_a_file_in_the_place_of_the_folder_of_states_is_refused(atoms, tmp_path):
    problem, solution, *_ = atoms
    (tmp_path / "run").write_text("other")
    with pytest.raises(FileExistsError, match=r"another name than 'run\.pvd': its folder 'run' is a file\.$"):
        problem.export(solution, tmp_path / "run.pvd")


def test_no_states_of_an_earlier_run_are_left(tmp_path):
    """Other files in the folder stay."""
    problem = double_pendulum()
    run = problem.integrate(h=0.01, t_end=0.2)
    folder = problem.export(run, tmp_path / "run.pvd").with_suffix("")
    (folder / "run_notes.vtu").write_text("other")
    path = problem.export(run, tmp_path / "run.pvd", every=3)
    listed = [x.get("file") for x in ET.parse(path).getroot().iter("DataSet")]
    assert len(listed) == 7
    assert {f"run/{file.name}" for file in folder.iterdir()} == {*listed, "run/run_notes.vtu"}


def test_the_command_line_saves_dcd_at_equal_times(tmp_path, monkeypatch):
    """A run of 21 steps of which every second is saved would end at another distance in time."""
    monkeypatch.setattr("eig3.run_report._STATES", 10)
    path = tmp_path / "run.dcd"
    assert main(["run", "double_pendulum", "--t-end", "0.21", "--h", "0.01", "--out", str(path)]) == 0
    assert path.is_file()


def test_the_command_line_writes_a_file(tmp_path, capsys):
    path = tmp_path / "run.extxyz"
    assert main(["run", "double_pendulum", "--t-end", "1", "--out", str(path)]) == 0
    assert f"Written: {path}" in capsys.readouterr().out
    frames = ase.io.read(path, index=":")
    assert frames[-1].info["Time"] == 1.0
    with pytest.raises(SystemExit, match="duffing has no points in space"):
        main(["run", "duffing", "--out", str(path)])


DATA = """a chain of four atoms and a fifth, in a box that does not begin at 0

5 atoms
3 bonds
2 angles
1 dihedrals
2 atom types
2 bond types
1 angle types
1 dihedral types

-1.0 9.0 xlo xhi
0.0 11.0 ylo yhi
0.0 12.0 zlo zhi

Masses

1 12.0  # C
2 1.5

Bond Coeffs

1 100.0 1.5
2 50.0 1.1

Atoms  # full

3 1 1 -0.5 2.0 1.0 0.0 0 0 0
1 1 2 0.25 8.5 0.0 0.0 -1 0 0
2 1 1 0.0 1.0 0.0 0.0 0 0 0
4 1 2 0.25 3.0 1.5 0.5 0 1 0
5 2 2 0.0 5.0 5.0 5.0 0 0 0

Velocities

1 0.1 0.2 0.3
2 0 0 0
3 0 -1.5 0
4 0 0 0
5 1 0 0

Bonds

1 2 1 2
2 1 2 3
3 2 3 4

Angles

1 1 1 2 3
2 1 2 3 4

Dihedrals

1 1 1 2 3 4
"""


def read_text(tmp_path, text, name="chain.data", **options):
    (tmp_path / name).write_text(text)
    return Scene.read(tmp_path / name, **options)


def test_a_data_file_of_lammps_is_read_as_by_mdanalysis(tmp_path):
    found = read_text(tmp_path, DATA)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        other = MDAnalysis.Universe(tmp_path / "chain.data", topology_format="DATA", format="DATA")
    np.testing.assert_array_equal(found.types, other.atoms.types.astype(int))
    np.testing.assert_allclose(found.charges, other.atoms.charges)
    images = np.array([(-1, 0, 0), (0, 0, 0), (0, 0, 0), (0, 1, 0), (0, 0, 0)])
    np.testing.assert_allclose(found.atoms.position, other.atoms.positions + images * [10.0, 11.0, 12.0])
    for name, mine in (("bonds", found.bonds), ("angles", found.angles), ("dihedrals", found.dihedrals)):
        theirs = getattr(other, name)
        expected = {(kind, *row) for kind, row in zip(theirs._bondtypes, theirs.to_indices().tolist(), strict=True)}
        rows = {
            (str(kind), *row)
            for kind, ends in mine.items()
            for row in np.column_stack([end.numbers for end in ends]).tolist()
        }
        assert rows == expected
    assert found.points[2].shape == (3,)
    assert found.impropers == {}
    assert found.coefficients == {"Bond Coeffs": {1: ("100.0", "1.5"), 2: ("50.0", "1.1")}}
    for kind, (stiffness, length) in found.coefficients["Bond Coeffs"].items():  # LAMMPS has K (r - r0)^2
        found.scene.add(LinearSpring(2 * float(stiffness), float(length)), *found.bonds[kind])
    problem = found.scene.problem((0, 1))
    v = np.array([(0.1, 0.2, 0.3), (0, 0, 0), (0, -1.5, 0), (0, 0, 0), (1, 0, 0)])  # MDAnalysis does not sort these
    np.testing.assert_array_equal(found.atoms.velocities(problem.v0), v)
    np.testing.assert_array_equal(problem.masses[:5], other.atoms.masses)
    lengths = [2.5, np.sqrt(2.0), np.sqrt(1.5)]  # of the nearest images
    energy = sum(k * (r - r0) ** 2 for k, r0, r in zip([50.0, 100.0, 50.0], [1.1, 1.5, 1.1], lengths, strict=True))
    kinetic = (np.array([1.5, 12, 12, 1.5, 1.5]) * (v**2).sum(axis=1)).sum() / 2
    assert problem.energy_of(problem.u0, problem.v0) == pytest.approx(energy + kinetic, rel=1e-12)


def test_units_of_a_file_become_units_of_the_scene(tmp_path):
    found = read_text(tmp_path, DATA, length=1e-10, mass=1.66e-27, time=1e-15, periodic=(True, False, True))
    np.testing.assert_allclose(found.atoms.position[4], [5e-10] * 3)
    found.scene.add(LinearSpring(1.0, 1e-10), *found.bonds[1])
    problem = found.scene.problem((0, 1e-12))
    np.testing.assert_allclose(found.atoms.velocities(problem.v0)[4], [1e5, 0, 0])
    np.testing.assert_allclose(problem.masses[0], 1.5 * 1.66e-27)
    np.testing.assert_allclose(problem.geometry.box, [1e-9, 0, 12e-10])


def test_spheres_of_lammps_have_masses_and_radii(tmp_path):
    text = "grains\n\n1 atoms\n1 atom types\n0 2 xlo xhi\n0 2 ylo yhi\n0 2 zlo zhi\n\nAtoms # sphere\n\n"
    found = read_text(tmp_path, f"{text}1 1 0.5 2000.0 1.0 1.0 1.0\n", name="data.grains")
    np.testing.assert_array_equal(found.radii, [0.25])
    problem = found.scene.problem((0, 1))
    np.testing.assert_allclose(problem.masses, 2000 * 4 / 3 * np.pi * 0.25**3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.0 12.0 zlo zhi", "0.0 12.0 zlo zhi\n0.5 0 0 xy xz yz", "has a tilted box"),
        ("Atoms  # full", "Atoms", "give style=, one of atomic, charge, bond"),
        ("Atoms  # full", "Atoms  # dipole", "of the style dipole: give style="),
        ("Atoms  # full", "Atoms  # atomic", "must have the columns id type x y z in Atoms"),
        ("5 atoms", "6 atoms", "must have 6 atoms with different numbers, not 5"),
        ("2 1.5\n", "", "has no mass of the type 2 in Masses"),
        ("Dihedrals\n", "Ellipsoids\n", "has the section Ellipsoids, which is not supported"),
        ("3 2 3 4\n\nAngles", "3 2 3 9\n\nAngles", "has the atom 9 in Bonds, but not in Atoms"),
        ("2 atom types", "2 atom types\n1 ellipsoids", "has ellipsoids, which a scene does not support"),
    ],
)
def test_what_a_scene_does_not_support_is_named(old, new, message, tmp_path):
    assert old in DATA
    with pytest.raises(ValueError, match=message):
        read_text(tmp_path, DATA.replace(old, new, 1))


def test_xyz_and_pdb_are_read_by_ase(tmp_path):
    """Water: elements, masses, the box of the PDB file, and its bonds."""
    pdb = "CRYST1   10.000   12.000   14.000  90.00  90.00  90.00 P 1\n"
    for k, (name, x) in enumerate({"O": (1.0, 2.0, 3.0), "H1": (1.96, 2.0, 3.0), "H2": (0.76, 2.93, 3.0)}.items()):
        place = "".join(f"{value:8.3f}" for value in x)
        pdb += f"ATOM  {k + 7:5d} {name:^4s} HOH A   1    {place}  1.00  0.00          {name[0]:>2s}\n"
    found = read_text(tmp_path, f"{pdb}CONECT    7    8    9\nCONECT    8    7\nCONECT    9    7\nEND\n", "water.pdb")
    assert found.types.tolist() == ["O", "H", "H"]
    np.testing.assert_allclose(found.atoms.position[2], [0.76, 2.93, 3.0])
    assert np.column_stack([end.numbers for end in found.bonds[1]]).tolist() == [[0, 1], [0, 2]]
    problem = found.scene.problem((0, 1))
    np.testing.assert_allclose(problem.masses[:3], [15.999, 1.008, 1.008])
    np.testing.assert_array_equal(problem.geometry.box, [10.0, 12.0, 14.0])
    with pytest.raises(ValueError, match="several models"):
        read_text(tmp_path, f"{pdb}ENDMDL\n{pdb}ENDMDL\n", "two.pdb")


def test_an_export_is_read_again(mixed, atoms, tmp_path):
    """The last state with its velocities, masses, box and fixed points becomes a scene."""
    problem, solution, x, v = atoms
    found = Scene.read(problem.export(solution, tmp_path / "run.extxyz", types="Ar"))
    again = found.scene.problem((0, 1))
    np.testing.assert_allclose(found.atoms.position, x[-1], rtol=TEXT)
    np.testing.assert_allclose(found.atoms.velocities(again.v0), v[-1], rtol=TEXT)
    np.testing.assert_allclose(again.masses, problem.masses, rtol=TEXT)
    np.testing.assert_array_equal(again.geometry.box, [6.0, 7.0, 8.0])
    problem, solution, shaken, *_ = mixed
    found = Scene.read(problem.export(solution, tmp_path / "mixed.extxyz"))
    fixed = found.atoms[found.scene.problem((0, 1)).geometry.fixed]
    moved = shaken.positions(solution.u[-1], solution.t[-1])
    assert (abs(fixed.position - moved) < 3 * TEXT).all(axis=1).any()


def test_a_mesh_has_groups(tmp_path):
    """Physical groups of Gmsh and sets of cells; a point without a cell is left out."""
    x = np.array([(9, 9, 9), (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], dtype=float)
    cells = [("triangle", [[1, 2, 3]]), ("tetra", [[1, 2, 3, 4], [2, 3, 4, 5]])]
    tags = {"gmsh:physical": [np.array([7]), np.array([3, 4])], "gmsh:geometrical": [np.array([1]), np.array([1, 1])]}
    names = {"clamped": np.array([7, 2]), "soft": np.array([3, 3])}
    mesh = meshio.Mesh(x, cells, cell_data=tags, field_data=names)
    mesh.write(tmp_path / "part.msh", file_format="gmsh22")
    found = Scene.read(tmp_path / "part.msh", length=1e-3)
    np.testing.assert_allclose(found.positions, 1e-3 * x[1:])
    assert found.groups["clamped"].tolist() == [0, 1, 2]
    assert found.cell_groups["soft"].tolist() == [0]
    assert found.cell_groups["4"].tolist() == [1]
    law = NeoHookean(np.where(np.isin([0, 1], found.cell_groups["soft"]), 1e4, 1e6), 0.3)
    solid = found.scene.add_mesh(found.positions, found.cells, law, density=1000.0, fixed=found.groups["clamped"])
    assert found.scene.problem((0, 1)).u0.size == 6
    assert solid.shape == (5,)


def test_other_meshes_are_refused(tmp_path):
    x = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.5)], dtype=float)
    meshio.Mesh(x, [("quad", [[0, 1, 2, 3]])]).write(tmp_path / "quads.vtu")
    with pytest.raises(ValueError, match="must have tetrahedra or triangles of 4 or 3 points, but it has quad"):
        Scene.read(tmp_path / "quads.vtu")
    meshio.Mesh(x, [("triangle", [[0, 1, 2], [0, 2, 3]])]).write(tmp_path / "sheet.vtu")
    assert Scene.read(tmp_path / "sheet.vtu").cells.tolist() == [[0, 1, 2], [0, 2, 3]]
    with pytest.raises(ValueError, match="not in a plane of constant z"):
        Scene.read(tmp_path / "sheet.vtu", dimension=2)
    with pytest.raises(FileNotFoundError, match="there is no file"):
        Scene.read(tmp_path / "none.msh")
    for name in ("empty.xml", "unknown.foo"):
        (tmp_path / name).write_text("")
        with pytest.raises(
            ValueError, match=f"{name} is not a mesh that meshio reads .* such as .dump and .dcd are only written"
        ):
            Scene.read(tmp_path / name)
    with pytest.raises(ValueError, match="length, mass and time must be positive"):
        Scene.read(tmp_path / "sheet.vtu", length=0.0)
    with pytest.raises(ValueError, match="style is for data files of LAMMPS"):
        Scene.read(tmp_path / "sheet.vtu", style="full")
