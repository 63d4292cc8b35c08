"""A collection for ParaView: a .pvd file with the times, and a .vtu file for each state in a folder beside it."""

from __future__ import annotations

import re
import tempfile
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
    """Yield a function that writes one state after the other. All files get their places when they are complete.

    States of an earlier run in the folder are removed.
    """
    meshio = library("meshio", path.suffix)
    cells = Cells(trajectory, types)
    folder = path.with_suffix("")
    digits = len(str(len(trajectory)))
    names: list[str] = []
    entries: list[str] = []

    def write(snapshot: Snapshot) -> None:
        parts = cells.of(snapshot)
        names.append(f"{folder.name}_{len(names):0{digits}d}.vtu")
        data = {"point_data": parts.data | cells.constant, "cell_data": parts.cell_data}
        meshio.Mesh(parts.points, parts.cells, **data).write(Path(unfinished, names[-1]))
        file = quoteattr(f"{folder.name}/{names[-1]}")
        entries.append(f'    <DataSet timestep="{snapshot.t:.17g}" file={file}/>\n')

    with tempfile.TemporaryDirectory(dir=path.parent, prefix="unfinished-") as unfinished:
        yield write
        folder.mkdir(exist_ok=True)
        is_state = re.compile(rf"{re.escape(folder.name)}_\d+\.vtu").fullmatch
        for old in [file for file in folder.iterdir() if is_state(file.name)]:
            old.unlink()
        for name in names:
            Path(unfinished, name).replace(folder / name)
        with text_file(path) as file:
            file.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n')
            file.write(f"  <Collection>\n{''.join(entries)}  </Collection>\n</VTKFile>\n")
