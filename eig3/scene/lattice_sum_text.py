"""Write the sum over the waves of a box of charges as lines of Python source, after the forces between near points."""

from __future__ import annotations

from ..kernels import ewald
from .assembly import Assembly
from .lattice_sum import LatticeSum
from .pair_force import PairForce
from .pair_force_text import PairForceText
from .source import Source, entry


class LatticeSumText(PairForceText):
    """Ewald's sum in the source. It reads the positions that the neighbour list has just copied."""

    def __init__(self, assembly: Assembly, source: Source, pair_force: PairForce, number: int) -> None:
        super().__init__(assembly, source, pair_force, number)
        effect, listing = pair_force.effect, self.listing
        assert isinstance(effect, LatticeSum)
        places = listing.areas.x, listing.own["charges"]
        self._waves = source.add(effect.block(assembly.cloud.box, listing.points, *places))
        source.functions["sum_of_waves"] = ewald.sum_of_waves

    def forces(self) -> None:
        super().forces()
        self._line(f"sum_of_waves(kept, int64({self._waves}))")
        with self._block(f"for point in range({self.listing.masses})"):
            self._line(f"i = {self._mass('point')}")
            for k, axis in enumerate(self._axes):
                force = entry("kept", self._waves + ewald.FORCES + k, "3 * point")
                self._line(f"{self._at('a', axis, 'i')} += {force} * {self._w('i')}")

    def potential(self) -> None:
        super().potential()
        self._line(f"total += sum_of_waves(kept, int64({self._waves}))")
