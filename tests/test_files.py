"""Files of other programs, read back by their own libraries."""

import tracemalloc
import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace

import ase.io
import h5py
import MDAnalysis
import meshio
import numpy as np
import pytest

import eig3
from eig3.cli import main
from eig3.effects import BreakingString, Gravity, HertzMindlin, LennardJones, LinearSpring, NeoHookean, SupportMotion
from eig3.problems import double_pendulum, duffing, ten_storey_frame
from eig3.scene import Scene

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


@eig3.jit
def sway(t):
    return np.sin(t), np.cos(t)


def test_extended_xyz_is_read_by_ase(atoms, tmp_path):
    problem, solution, x, v = atoms
    species = np.where(np.arange(64) < 32, "Ar", "Kr")
    problem.export(solution, tmp_path / "run.extxyz", types=species, scale=2.0)
    frames = ase.io.read(tmp_path / "run.extxyz", index=":")
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


def test_grains_have_radii_and_spins(tmp_path):
    scene = Scene(dimension=2)
    radii = np.array([0.1, 0.2])
    x = [(0.0, 0.0), (0.29, 0.0)]
    grains = scene.mass(1.0, x, [(0, 0), (0, 1.0)], inertia=0.01, angular_velocity=[3.0, -1.0])
    scene.add(HertzMindlin(1e6, 0.3, 0.5, radii=radii), grains)
    problem = scene.problem((0, 0.01))
    solution = problem.integrate(h=1e-5, save_every=500)
    frames = ase.io.read(problem.export(solution, tmp_path / "run.extxyz"), index=":")
    for frame, u, v in zip(frames, solution.u, solution.v, strict=True):
        np.testing.assert_allclose(frame.arrays["radius"], radii, rtol=TEXT)
        np.testing.assert_allclose(frame.positions[:, :2], grains.positions(u), rtol=TEXT, atol=1e-300)
        np.testing.assert_allclose(frame.arrays["angular_velocity"][:, 2], grains.angular_velocities(v), rtol=TEXT)
        assert not frame.positions[:, 2].any()
        assert not frame.arrays["angular_velocity"][:, :2].any()


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
        problem.export(replace(solution, u=u, v=v), tmp_path / f"run.{ending}", every=4)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert set(u.asked) == set(range(0, 1025, 4))
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


def test_an_interrupted_file_is_not_left(atoms, tmp_path):
    """What was there before stays."""
    problem, solution, *_ = atoms
    path = tmp_path / "run.dump"
    path.write_text("before")

    class Stopping(Rows):
        def __getitem__(self, row):
            if row > 1:
                raise KeyboardInterrupt
            return super().__getitem__(row)

    with pytest.raises(KeyboardInterrupt):
        problem.export(replace(solution, u=Stopping(solution.u)), path)
    assert path.read_text() == "before"
    assert [file.name for file in tmp_path.iterdir()] == ["run.dump"]


def test_bad_exports_are_refused(atoms, tmp_path, monkeypatch):
    problem, solution, *_ = atoms

    def fails(kind, message, name="run.extxyz", source=problem, run=solution, **options):
        with pytest.raises(kind, match=message):
            source.export(run, tmp_path / name, **options)

    fails(ValueError, r"path must end with \.extxyz, .*, not 'run.xyz'", "run.xyz")
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


def test_the_command_line_writes_a_file(tmp_path, capsys):
    path = tmp_path / "run.extxyz"
    assert main(["run", "double_pendulum", "--t-end", "1", "--out", str(path)]) == 0
    assert f"Written: {path}" in capsys.readouterr().out
    frames = ase.io.read(path, index=":")
    assert frames[-1].info["Time"] == 1.0
    with pytest.raises(SystemExit, match="duffing has no points in space"):
        main(["run", "duffing", "--out", str(path)])
