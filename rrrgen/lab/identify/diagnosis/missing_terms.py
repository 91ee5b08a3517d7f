"""Rule: friction, torque offset or drive inertia that the torques show, but the robot file does not state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.trial import AllTerms, Fit, Trial

CLEAR = 6.0  # standard deviations by which a coefficient differs from zero, as for signs
FALL = 0.95  # ratio of the joint's residuals with and without a term, below which the term counts
WORTH = 0.005  # of the joint's RMS torque: smaller residuals need no explanation


TERMS = (
    ("friction", {"fv": "viscous", "fc": "coulomb"}, "friction"),
    ("friction", {"off": "offset"}, "a constant torque (offset)"),
    ("drive", {"Ia": "inertia"}, "the drive inertia"),
)


def missing_terms(
    regressor: AllTerms, estimated: Sequence[str], trial: Trial, mix: Array, words: Wording
) -> Iterator[Cause]:
    """Report terms whose addition to the model lowers the error of a joint significantly.

    ``regressor`` holds all terms at all joints, ``estimated`` names those in the model. The fit
    is of the torques ``tau @ mix``, where ``mix`` (n, n) holds the corrections already found.
    """
    names = list(regressor.names)
    inside = [k for k, name in enumerate(names) if name in estimated]
    before = trial.fit(mix, inside)
    for i, joint in enumerate(words.joints):
        for section, keys, what in TERMS:
            lacking = {f"{symbol}{i + 1}": key for symbol, key in keys.items() if f"{symbol}{i + 1}" not in estimated}
            if not lacking or before.error[i] <= WORTH:
                continue
            columns = [names.index(name) for name in lacking]
            after = trial.fit(mix, sorted([*inside, *columns]))
            if after.error[i] < FALL * before.error[i] and _clear(after, columns):
                values = ", ".join(f"{name} = {after.theta[k]:.3g}" for name, k in zip(lacking, columns, strict=True))
                yield words.missing(i, section, list(lacking.values()), what).because(
                    f"with {values} the torque error of {joint} falls from {100 * before.error[i]:.3g} % to "
                    f"{100 * after.error[i]:.2g} %"
                )
                inside, before = sorted([*inside, *columns]), after


def _clear(fit: Fit, columns: Sequence[int]) -> bool:
    """Whether the coefficient of one of ``columns`` differs from zero by more than CLEAR standard deviations."""
    std = np.sqrt(np.maximum(np.diag(fit.covariance)[list(columns)], 0.0))
    return bool(np.any(np.abs(fit.theta[list(columns)]) > CLEAR * std))
