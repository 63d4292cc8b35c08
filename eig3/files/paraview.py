"""A collection for ParaView: a .pvd file with the times, and a .vtu file for each state in a folder beside it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from .libraries import library
from .mesh_parts import Cells
from .table import text_file
from .trajectory import Snapshot, Trajectory


@contextmanager
def opened(path: Path, trajectory: Trajectory, types: np.ndarray) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that writes one state after the other. The .pvd file is written at the end.

    States of an earlier run in the folder are then removed, if they are not replaced.
    """
    meshio = library("meshio", path.suffix)
    cells = Cells(trajectory, types)
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    digits = len(str(len(trajectory)))
    entries: list[str] = []
    is_state = re.compile(rf"{re.escape(folder.name)}_\d+\.vtu").fullmatch
    earlier = {file for file in folder.iterdir() if is_state(file.name)}

    def write(snapshot: Snapshot) -> None:
        parts = cells.of(snapshot)
        file = folder / f"{folder.name}_{len(entries):0{digits}d}.vtu"
        data = {"point_data": parts.data | cells.constant, "cell_data": parts.cell_data}
        meshio.Mesh(parts.points, parts.cells, **data).write(file)
        earlier.discard(file)
        name = quoteattr(f"{folder.name}/{file.name}")
        entries.append(f'    <DataSet timestep="{snapshot.t:.17g}" file={name}/>\n')

    yield write
    with text_file(path) as file:
        file.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n')
        file.write(f"  <Collection>\n{''.join(entries)}  </Collection>\n</VTKFile>\n")
    for old in earlier:
        old.unlink()
