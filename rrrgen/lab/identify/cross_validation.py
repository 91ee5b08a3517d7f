"""Blocked cross-validation: every part of the recordings is predicted by a model fitted to all other parts.

Parts are contiguous, because neighbouring samples are correlated, and have guard bands. Everything is fitted anew for
each part: filters, friction laws and their shapes, weights, and the physically consistent estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.tables import text_table
from rrrgen.lab.data.processing import Processing
from rrrgen.lab.identify.factoring import Progress
from rrrgen.lab.identify.full_regressor import RigidModel
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import identify
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.identify.options import Options
from rrrgen.lab.identify.scores import Score


@dataclass(frozen=True)
class CrossValidation:
    """Errors of cross-validation: ``parts[k]`` holds the score of each estimate on part k, which it was not fitted to.

    ``joints`` are the joint names. The scored rows are filtered and selected as the fitted ones are.
    """

    joints: tuple[str, ...]
    parts: tuple[tuple[Score, ...], ...]

    def pooled(self, estimate: int) -> tuple[float, Array]:
        """Relative torque error of estimate number ``estimate`` over all parts, and that of every joint (n,)."""
        squares, size = np.zeros(len(self.joints)), np.zeros(len(self.joints))
        for part in self.parts:
            score = part[estimate]
            own = np.square(score.joint_rms or 0.0) * np.array(score.joint_counts)
            squares += own
            size += own / np.maximum(np.square(score.joint_relative or 1.0), np.finfo(float).tiny)
        size = np.maximum(size, np.finfo(float).tiny)
        return float(np.sqrt(np.sum(squares) / np.sum(size))), np.sqrt(squares / size)

    @property
    def estimates(self) -> tuple[str, ...]:
        """The names of the estimates."""
        return tuple(score.estimate for score in self.parts[0])

    def lines(self, width: int | None = None) -> list[str]:
        """A table of the errors of every part and joint, as lines of text folded to ``width`` characters."""
        names = self.estimates
        title = f"cross-validation, {len(self.parts)} parts: relative torque error on the part left out"
        rows = [("part", *names)]
        for k, part in enumerate(self.parts):
            errors = ("-" if s.relative_error is None else f"{100 * s.relative_error:.3g} %" for s in part)
            rows.append((str(k + 1), *errors))
        found = [self.pooled(i) for i in range(len(names))]
        rows.append(("all", *(f"{100 * total:.3g} %" for total, _ in found)))
        rows += [(joint, *(f"{100 * each[j]:.3g} %" for _, each in found)) for j, joint in enumerate(self.joints)]
        return [title, *text_table(rows, width, indent="", right=range(1, len(names) + 1))]

    def to_json(self) -> dict[str, Any]:
        """Errors of all parts and joints as plain data."""
        pooled = [self.pooled(i) for i in range(len(self.estimates))]
        return {
            "parts": [[vars(score) for score in part] for part in self.parts],
            "relative_error": {name: total for name, (total, _) in zip(self.estimates, pooled, strict=True)},
            "joint_relative_error": {name: each for name, (_, each) in zip(self.estimates, pooled, strict=True)},
        }


def cross_validate(
    model: RigidModel,
    recordings: Sequence[Recording],
    processing: Processing,
    options: Options,
    parts: int,
    progress: Progress | None = None,
) -> CrossValidation:
    """Fit to all but one of ``parts`` equal parts of the recordings and score on that one, for each in turn.

    ``options`` are those of the fit, without a split. Raises InputError for fewer than two parts, for a split, and for
    parts of which nothing is left between guard bands.
    """
    if parts < 2:
        raise InputError(f"{parts} part: cross-validation needs two or more")
    if options.split.kind != "none":
        raise InputError("cross-validation holds out every part in turn: leave the split of the data away")
    plain = replace(options, correlated=False, essential=False, poses=2)
    found = []
    for part in range(1, parts + 1):
        if progress is not None:
            progress(part, parts, f"cross-validation, part {part} of {parts}")
        result = identify(model, recordings, processing, replace(plain, split=Split("fold", float(part), parts=parts)))
        held_out = [score for score in result.scores if score.data == "held out"]
        if not held_out or held_out[0].relative_error is None:
            guard = f"guard bands of {result.split.guard:.3g} s"
            raise InputError(f"part {part} of {parts} has no rows beside {guard}: choose fewer parts")
        found.append(tuple(score for score in held_out if score.where == held_out[0].where))
    return CrossValidation(tuple(recordings[0].joints), tuple(found))
