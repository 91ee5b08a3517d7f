"""Warnings where torques that were not fitted are predicted badly: unexplained joints, deviations that are too small.

A small total error hides a light joint: its torque hardly counts in the norm over all joints.
"""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.lab.identify.bands import Coverage
from rrrgen.lab.identify.scores import Score

UNEXPLAINED = 0.3  # relative error of a joint's torque above which it counts as not explained
WORSE = 2.0  # and how many times that of the fitted rows it is; otherwise the diagnosis of the fit tells of it
COVERED = 0.85  # share of rows in a 95 % band below which the band is too narrow; residuals are correlated


def held_out_notes(scores: Sequence[Score], covered: Coverage | None, joints: Sequence[str]) -> tuple[str, ...]:
    """Sentences on the ``joints`` whose torque on held-out rows is not explained, or lies outside its band.

    ``scores`` are those of all estimates, of which the last is the written model; ``covered`` is the coverage of the
    held-out rows by its 95 % band. Empty if nothing was held out.
    """
    first: dict[str, Score] = {}
    for score in scores:
        if scores and score.estimate == scores[-1].estimate and score.joint_relative is not None:
            first.setdefault(score.data, score)
    fitted, held_out = (getattr(first.get(data), "joint_relative", None) for data in ("in sample", "held out"))
    if not fitted or not held_out or covered is None:
        return ()
    notes, narrow = [], []
    for joint, inside, before, after in zip(joints, covered.joints, fitted, held_out, strict=True):
        if after > max(UNEXPLAINED, WORSE * before):
            notes.append(
                f"the torque of {joint} is not explained where it was not fitted: {100 * after:.2g} % of it is left "
                f"({100 * before:.2g} % in sample), and the 95 % band covers {100 * inside:.0f} % of its rows; do not "
                "rely on its parameters and their deviations: its friction or load changed, or the fitted rows "
                "hardly move it"
            )
        elif inside < COVERED:
            narrow.append(f"{joint} ({100 * inside:.0f} %)")
    if narrow:
        notes.append(
            f"the 95 % band covers too few held-out rows of {', '.join(narrow)}: the standard deviations of their "
            "parameters are too small, since the model errs in another way there than on the fitted rows"
        )
    return tuple(notes)
