"""Subspace identification by the package nfoursid (extra ``response``): no search, no local minima."""

from __future__ import annotations

from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.base.extras import require
from rrrgen.base.option_names import option_name
from rrrgen.lab.response.equations import Equation

MOST_BLOCK_ROWS = 30
ROWS_PER_BLOCK_ROW = 12  # samples
MOST_ROWS = 3000  # the library's memory grows with their square


def check_rows(rows: int) -> None:
    """Raise :class:`DerivationError` if there are more rows than the memory of the library's method allows."""
    if rows > MOST_ROWS:
        raise DerivationError(
            f"{rows} rows are too many for subspace identification, whose library needs memory that grows with their "
            f"square: choose up to {MOST_ROWS} with {option_name('fit_rows')}"
        )


class SubspaceIdentification:
    """N4SID/PO-MOESP models of the rows [start, stop) of an input ``u`` and an output ``y`` (N,), order by order.

    Raises :class:`MissingExtraError` without nfoursid, :class:`DerivationError` for too few rows.
    """

    def __init__(self, u: Array, y: Array, start: int, stop: int) -> None:
        require(f"{option_name('method')} subspace", "nfoursid", "pandas")
        from nfoursid.nfoursid import NFourSID
        from pandas import DataFrame

        self.rows = min(MOST_BLOCK_ROWS, (stop - start) // ROWS_PER_BLOCK_ROW)
        if self.rows < 2:
            raise DerivationError(f"{stop - start} rows are too few for subspace identification")
        # both scaled to size 1, because tolerances of the library's pseudo-inverses are relative
        self.scale_u, self.scale_y = (max(float(np.std(x[start:stop])), 1e-300) for x in (u, y))
        frame = DataFrame({"u": u[start:stop] / self.scale_u, "y": y[start:stop] / self.scale_y})
        self._found: Any = NFourSID(frame, ["y"], ["u"], num_block_rows=self.rows)
        self._found.subspace_identification()

    @property
    def highest_order(self) -> int:
        """The highest order that the number of block rows allows."""
        return self.rows - 1

    def model(self, order: int) -> Equation:
        """The model of the given ``order`` as a difference equation without delay."""
        system, _ = self._found.system_identification(rank=order)
        A, B, C, D = (np.asarray(getattr(system, name)) for name in "abcd")
        denominator = np.poly(A).real
        numerator = np.poly(A - B @ C).real + (float(D[0, 0]) - 1.0) * denominator
        b = numerator * self.scale_y / self.scale_u
        return Equation(-denominator[1:], b, 0)
