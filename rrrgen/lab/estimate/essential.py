"""Essential parameters: the smallest set that explains the torques as well as all parameters do, within the noise.

Parameters are left out one at a time, the one with the largest relative standard deviation first (Khalil and Dombre,
Modeling, Identification and Control of Robots, ch. 12), as long as the fit does not suffer: an F test compares every
reduced model with the full one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rrrgen.base.errors import InputError
from rrrgen.lab.estimate.regression import Estimate, weighted_least_squares
from rrrgen.lab.estimate.tsqr import JointFactors

LARGEST_SPREAD = 30.0  # ratio of largest to smallest relative standard deviation at which the reduction ends
SIGNIFICANCE = 0.05

Estimator = Callable[[JointFactors, Sequence[str]], Estimate]


@dataclass(frozen=True)
class Essential:
    """Essential parameters: the ``estimate`` of the reduced model and how it was reached.

    ``kept`` are the indices of the remaining parameters, ``dropped`` the names of the others in the order of removal,
    ``stopped_by`` the reason why the reduction ended, in words.
    """

    estimate: Estimate
    kept: tuple[int, ...]
    dropped: tuple[str, ...]
    stopped_by: str


def essential_parameters(
    factors: JointFactors,
    names: Sequence[str],
    estimator: Estimator = weighted_least_squares,
    spread: float = LARGEST_SPREAD,
    significance: float = SIGNIFICANCE,
    samples_per_independent: float = 1.0,
) -> Essential:
    """Reduce the parameters of ``factors``; ``estimator(factors, names)`` estimates each reduced model.

    Stops when the relative standard deviations lie within ``spread`` of each other, or when leaving out one more would
    raise the weighted residual significantly (F test at ``significance``, with the number of samples divided by
    ``samples_per_independent`` to allow for correlated residuals).
    """
    if not 0.0 < significance < 1.0 or samples_per_independent < 1.0:
        raise InputError("the significance must lie between 0 and 1, and samples per independent one be 1 or more")
    from scipy.stats import f as fisher

    full = estimator(factors, names)
    weights = full.weights
    reference = float(np.sum(factors.residual_squares(full.x) * weights**2))
    independent = float(np.sum(factors.counts)) / samples_per_independent
    freedom = max(1.0, independent - full.rank)
    kept, estimate, dropped = list(range(len(names))), full, []
    stopped = "one parameter is left"
    while len(kept) > 1:
        relative = estimate.relative_std
        if np.max(relative) <= spread * np.min(relative):
            stopped = f"relative standard deviations within a factor of {spread:g}"
            break
        worst = int(np.argmax(relative))
        fewer = kept[:worst] + kept[worst + 1 :]
        selected = factors.selected(fewer)
        reduced = estimator(selected, [names[i] for i in fewer])
        squares = float(np.sum(selected.residual_squares(reduced.x) * weights**2))
        rise = (squares - reference) / samples_per_independent / (len(names) - len(fewer))
        if reference > 0 and rise / (reference / samples_per_independent / freedom) > fisher.isf(
            significance, len(names) - len(fewer), freedom
        ):
            stopped = f"leaving out {names[kept[worst]]} would be significant"
            break
        dropped.append(names[kept[worst]])
        kept, estimate = fewer, reduced
    return Essential(estimate, tuple(kept), tuple(dropped), stopped)
