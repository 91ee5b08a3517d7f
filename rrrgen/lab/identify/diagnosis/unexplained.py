"""Rule: a large torque error that is not noise and that no other rule explains."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rrrgen.lab.estimate.statistics import Whiteness
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording

LARGE = 0.3  # relative torque error; sound recordings have some percent, joints of light wrists up to 20 percent
COLOURED = 1.0
"""Durbin-Watson: 2 for noise, below 1 where neighbouring residuals correlate by more than a half."""


def unexplained(joint_errors: Any, whiteness: tuple[Whiteness, ...], words: Wording) -> Iterator[Cause]:
    """Report joints with a large relative error (``joint_errors``, (n,)) and correlated residuals (``whiteness``)."""
    for i, (error, white) in enumerate(zip(np.asarray(joint_errors), whiteness, strict=False)):
        if error > LARGE and white.durbin_watson < COLOURED:
            name = words.joints[i]
            yield Cause(
                f"the model does not describe joint {name}",
                f"check column, unit, sign and zero of {name} in the mapping, and its row of the Denavit-Hartenberg "
                f"table, limits and friction in {words.robot}",
                (
                    f"{100 * error:.3g} % of its torque is left, and that is no noise: Durbin-Watson "
                    f"{white.durbin_watson:.2f}, 2 for noise",
                ),
            )
