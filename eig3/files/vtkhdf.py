"""VTKHDF: all states in one file, which ParaView reads since version 5.12.

The format is described at https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html. States share
their cells if these are the same, and the data that do not change.
"""

from __future__ import annotations

import errno
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .libraries import library
from .mesh_parts import Cells, MeshParts
from .table import complete
from .trajectory import Snapshot, Trajectory

_NUMBERS = {"vertex": 1, "line": 3, "triangle": 5, "quad": 9, "tetra": 10, "hexahedron": 12}  # of VTK's cell types
_CHUNK = 2**17  # bytes
_LEAST_ROOM = 2**25  # bytes: a cache of 1 MB for each array, and the numbers of all states


@contextmanager
def opened(path: Path, trajectory: Trajectory, types: np.ndarray) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that writes one state after the other."""
    h5py = library("h5py", path.suffix)
    cells = Cells(trajectory, types)
    with complete(path) as part, h5py.File(part, "w") as file:
        grid = _Grid(file, cells.constant)

        def write(snapshot: Snapshot) -> None:
            parts = cells.of(snapshot)
            _check_room(path, parts)
            grid.add(snapshot.t, parts)

        yield write
        grid.finish()


def _check_room(path: Path, parts: MeshParts) -> None:
    """Raise an error if the disk may have no room for a state: HDF5 would crash the process."""
    arrays = [parts.points, *parts.data.values(), *(corners for _, corners in parts.cells)]
    # twice, for the types, offsets and data of cells too
    if shutil.disk_usage(path.parent).free < _LEAST_ROOM + 2 * sum(values.nbytes for values in arrays):
        raise OSError(errno.ENOSPC, "no room for the next state and 32 MB on the disk", str(path))


class _Grid:
    """An unstructured grid with a growing number of states. The numbers of all states are written at the end."""

    def __init__(self, file: Any, constant: dict[str, np.ndarray]) -> None:
        self._root = file.create_group("VTKHDF")
        self._root.attrs["Version"] = np.array([2, 0])
        self._root.attrs.create("Type", b"UnstructuredGrid", dtype=f"S{len('UnstructuredGrid')}")
        self._data: dict[str, Any] = {}
        self._steps: dict[str, list[Any]] = defaultdict(list)
        self._cells: list[tuple[str, np.ndarray]] = []
        self._points = 0
        self._place = {"PartOffsets": -1, "CellOffsets": 0, "ConnectivityIdOffsets": 0}  # of the present cells
        self._after = {"CellOffsets": 0, "ConnectivityIdOffsets": 0}
        self._constant = constant
        for name, values in constant.items():
            self._append(f"PointData/{name}", values)

    def add(self, t: float, parts: MeshParts) -> None:
        """Append a state, with its cells if they differ from the cells before."""
        if not self._has_cells(parts.cells):
            self._add_cells(parts)
        self._append("Points", parts.points)
        for name, values in parts.data.items():
            self._append(f"PointData/{name}", values)
        offsets = dict.fromkeys(parts.data, self._points) | dict.fromkeys(self._constant, 0)
        numbers: dict[str, Any] = {"Values": t, "NumberOfParts": 1, "PointOffsets": self._points}
        numbers |= {f"PointDataOffsets/{name}": offset for name, offset in offsets.items()}
        for name, of_cells in parts.cell_data.items():
            numbers[f"CellDataOffsets/{name}"] = len(self._data.get(f"CellData/{name}", ()))
            self._append(f"CellData/{name}", np.concatenate(of_cells))
        numbers |= {"PartOffsets": self._place["PartOffsets"]} | {name: [self._place[name]] for name in self._after}
        for name, number in numbers.items():
            self._steps[name].append(number)
        self._points += len(parts.points)

    def finish(self) -> None:
        steps = self._root.create_group("Steps")
        steps.attrs["NSteps"] = len(self._steps["Values"])
        for name, values in self._steps.items():
            steps[name] = np.array(values)

    def _has_cells(self, cells: list[tuple[str, np.ndarray]]) -> bool:
        return len(cells) == len(self._cells) > 0 and all(
            kind == old and np.array_equal(some, others)
            for (kind, some), (old, others) in zip(cells, self._cells, strict=True)
        )

    def _add_cells(self, parts: MeshParts) -> None:
        sizes = np.concatenate([np.full(len(some), some.shape[1]) for _, some in parts.cells])
        self._append("Types", np.concatenate([np.full(len(some), _NUMBERS[kind], "u1") for kind, some in parts.cells]))
        self._append("Connectivity", np.concatenate([some.ravel() for _, some in parts.cells]))
        self._append("Offsets", np.concatenate([[0], np.cumsum(sizes)]))
        counts = {"NumberOfPoints": len(parts.points), "NumberOfCells": sizes.size}
        for name, count in (counts | {"NumberOfConnectivityIds": int(sizes.sum())}).items():
            self._append(name, [count])
        self._cells = parts.cells
        self._place = {"PartOffsets": self._place["PartOffsets"] + 1, **self._after}
        self._after = {
            "CellOffsets": self._after["CellOffsets"] + sizes.size,
            "ConnectivityIdOffsets": self._after["ConnectivityIdOffsets"] + int(sizes.sum()),
        }

    def _append(self, name: str, values: Any) -> None:
        """Append rows to a dataset, which the first rows create."""
        rows = np.asarray(values)
        if name not in self._data:
            per_row = rows.itemsize * int(np.prod(rows.shape[1:]))
            chunks = (max(1, min(_CHUNK // per_row, max(len(rows), 64))), *rows.shape[1:])
            form = {"dtype": rows.dtype, "chunks": chunks, "compression": "gzip", "shuffle": True}
            self._data[name] = self._root.create_dataset(
                name, (0, *rows.shape[1:]), maxshape=(None, *rows.shape[1:]), **form
            )
        data = self._data[name]
        count = len(data)
        data.resize(count + len(rows), axis=0)
        data[count:] = rows
