"""The estimate that is written to the robot file, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array


@dataclass(frozen=True)
class Delivered:
    """The estimate written to ``robot.yaml``: identifiable combinations ``x`` (r,) and their ``covariance`` (r, r).

    ``origin`` names the estimate: the physically consistent one if it was computed. ``at_bound`` (r,) marks drive
    parameters that lie on their bound of 0.
    """

    origin: str
    x: Array
    covariance: Array
    at_bound: NDArray[np.bool_]

    @property
    def std(self) -> Array:
        """Standard deviations (r,)."""
        return np.asarray(np.sqrt(np.maximum(0.0, np.diag(self.covariance))))
