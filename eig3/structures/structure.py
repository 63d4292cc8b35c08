"""`Structure`: the problem of a linear structure, which knows its modes."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike

from ..functions.checks import check_count, reals
from ..problem import Problem
from .matrices import Mass
from .modes import Modes, modes_of


class Structure(Problem):
    """A problem of `eig3.linear`: M u'' + C u' + K u = f."""

    def modes(self, count: int, *, influence: ArrayLike | None = None) -> Modes:
        """Return the lowest natural modes of M and K: without C, whether it is damping or gyroscopic.

        Parameters
        ----------
        count : int
            The number k of modes.
        influence : array_like, shape (n,), optional
            The influence of a ground motion, for the participation of the modes. The default is the influence of the
            problem's ground motion, or 1 for all degrees of freedom if it has none.

        Returns
        -------
        Modes

        Raises
        ------
        TypeError, ValueError
            If the structure has no K or fewer modes, or the influence does not have n finite values.
        """
        has = self.params._asdict()
        if "K" not in has:
            raise ValueError("modes need K: the frequencies of the structure depend on it.")
        n = has["size"]
        r = reals(has.get("influence", 1.0) if influence is None else influence, "influence")
        if r.shape not in ((), (n,)) or not np.isfinite(r).all():
            raise ValueError(f"influence must be {n} finite numbers, not of the shape {r.shape}.")
        return modes_of(mass_of(has), matrix_of(has["K"]), check_count(count, "count"), np.array(np.broadcast_to(r, n)))


def mass_of(has: dict[str, Any]) -> Mass:
    """Return the mass in the parameters of a structure."""
    m = has.get("m")
    return Mass(m, matrix_of(has["M"]) if m is None else scipy.sparse.diags_array(m).tocsr())


def matrix_of(A: Any) -> Any:
    """Return a sparse matrix in the parameters of a structure as a SciPy array."""
    make = scipy.sparse.csr_array if A.edge == 1 else scipy.sparse.bsr_array
    return make((A.data, A.indices, A.indptr), shape=A.shape).tocsr()
