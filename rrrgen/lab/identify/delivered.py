"""The estimate that is written to the robot file, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.regression import Estimate
from rrrgen.lab.estimate.tsqr import JointFactors
from rrrgen.lab.identify.consistency import ConsistentEstimate
from rrrgen.lab.identify.parametrisation import Parametrisation

if TYPE_CHECKING:
    from rrrgen.lab.identify.options import Options


@dataclass(frozen=True)
class Delivered:
    """The estimate written to ``robot.yaml``: identifiable combinations ``x`` (r,) and their ``covariance`` (r, r).

    ``origin`` is the name of the estimate, the physically consistent one if it was computed. ``at_bound`` (r,) marks
    drive parameters that lie on their lower bound 0.
    """

    origin: str
    x: Array
    covariance: Array
    at_bound: NDArray[np.bool_]

    @property
    def std(self) -> Array:
        """Standard deviations (r,) of ``x``."""
        return np.asarray(np.sqrt(np.maximum(0.0, np.diag(self.covariance))))

    @classmethod
    def of(
        cls,
        estimate: Estimate,
        consistent: ConsistentEstimate | None,
        reduced: JointFactors,
        chosen: Parametrisation,
        names: Sequence[str],
        options: Options,
        base: int,
    ) -> Delivered:
        """Choose the estimate to write: ``consistent``, or ``estimate`` if that is None; compute its covariance.

        ``reduced`` are the triangular factors of the fitted rows for x. ``names`` are the parameters of all regressor
        columns, of which the first ``base`` are base parameters.
        """
        if consistent is None or consistent.near is None:
            return cls(options.method, estimate.x, estimate.covariance, np.zeros(len(estimate.x), bool))
        weights = None if options.method == "robust" else estimate.weights
        R = reduced.stacked(weights)[:-1, :-1]
        information = R.T @ R
        scores = information @ estimate.covariance @ information
        moving = [k for k, name in enumerate(names) if name not in options.fixed or k < base]
        directions = np.zeros((len(names), consistent.near.directions.shape[1]))
        directions[moving] = consistent.near.directions
        along = chosen.contract(directions)
        covariance = consistent.near.covariance(along, scores, estimate.variance if weights is not None else 1.0)
        x = chosen.contract(consistent.theta)
        fixed = np.all(along == 0.0, axis=1) | ((x == 0.0) & (np.diag(covariance) <= 0.0))
        return cls("physically consistent", x, covariance, fixed)
