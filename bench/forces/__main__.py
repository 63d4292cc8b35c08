"""Write the forces that LAMMPS computes to a file, for tests on machines without LAMMPS.

``python -m eig3.bench.forces tests/forces_of_lammps.json``
"""

import json
import sys
from pathlib import Path

from . import in_lammps
from .systems import NAMES

if __name__ == "__main__":
    rows = [f'"{name}": {json.dumps(in_lammps.forces(name).tolist())}' for name in NAMES]
    Path(sys.argv[1]).write_text("{\n" + ",\n".join(rows) + "\n}\n")
