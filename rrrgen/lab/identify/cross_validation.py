"""Blocked cross-validation: every part of the recordings is predicted by a model fitted to all other parts.

Parts are contiguous, because neighbouring samples are correlated, and have guard bands. Everything is fitted anew for
each part: filters, friction laws and their shapes, weights, and the physically consistent estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.tables import text_table
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.estimate.regression import RANK_TOLERANCE
from rrrgen.lab.estimate.remainder import (
    Errors,
    Remainder,
    all_errors,
    remainder_notes,
    remainder_record,
    remainders,
)
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_rows
from rrrgen.lab.identify.factoring import Progress
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.lab.identify.scores import Score, row_errors

# ------------------------------------------------------------------------------------------------------------------
# Convergence of the estimated parameters with the number of samples, as in Fig. 14.12.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Convergence:
    """Estimates ``x`` (points, p) from the first ``samples`` (points,) rows, with their ``condition`` numbers.

    ``condition`` (points,) is that of the regressor. Estimates are NaN, and the condition number is infinite, as long
    as the samples do not determine all parameters.
    """

    names: tuple[str, ...]
    samples: NDArray[np.int64]
    x: Array
    condition: Array


def convergence(
    blocks: Iterable[Rows],
    names: Sequence[str],
    weights: Array,
    transform: Callable[[JointFactors], JointFactors] | None = None,
    every: int = 1,
) -> Convergence:
    """Estimate the parameters by weighted least squares (14.20) from the first k samples, k = every, 2 every, ...

    ``blocks`` are the rows in order of time, ``names`` those of the p parameters, ``weights`` (n,) those of the joints;
    ``transform`` maps the triangular factors of the rows to those of the identifiable parameters.
    """
    total: JointFactors | None = None
    samples, estimates, conditions, seen = [], [], [], 0
    for rows in blocks:
        for start in range(0, len(rows.t), every):
            piece = _piece(rows, start, start + every)
            used = int(np.sum(np.any(piece.use, axis=1)))
            if used == 0:
                continue  # all rows held out or at rest: no new information, so no new point of the curve
            part = factor_rows(piece)
            total = part if total is None else total.merge(part)
            seen += used
            x, condition = _solve_triangular((transform(total) if transform else total).stack(weights))
            samples.append(seen)
            estimates.append(x)
            conditions.append(condition)
    return Convergence(tuple(names), np.array(samples), np.array(estimates), np.array(conditions))


def _piece(rows: Rows, start: int, stop: int) -> Rows:
    part = slice(start, stop)
    return Rows(rows.t[part], rows.W[part], rows.tau[part], rows.use[part], rows.segment[part])


def _solve_triangular(R: Array) -> tuple[Array, float]:
    """Solution (p,) of the triangular system R (p+1, p+1) and its condition number; NaN, inf if rank-deficient."""
    p = R.shape[1] - 1
    fit = solve(R[:p, :p], R[:p, p], RANK_TOLERANCE)
    if fit.rank < p:
        return np.full(p, np.nan), np.inf
    return fit.x, float(np.linalg.cond(R[:p, :p]))


# ------------------------------------------------------------------------------------------------------------------
# Blocked cross-validation
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CrossValidation:
    """Errors of cross-validation: ``parts[k]`` holds the score of each estimate on part k, which it was not fitted to.

    ``joints`` are the joint names. The scored rows are filtered and selected as the fitted ones are. ``left`` is what
    noise does not explain in the errors of all parts together.
    """

    joints: tuple[str, ...]
    parts: tuple[tuple[Score, ...], ...]
    left: tuple[Remainder, ...] = ()

    def pooled_errors(self, estimate: int) -> tuple[float, Array]:
        """Relative torque error of estimate number ``estimate`` over all parts, and that of every joint (n,)."""
        squares, size = np.zeros(len(self.joints)), np.zeros(len(self.joints))
        for part in self.parts:
            score = part[estimate]
            part_squares = np.square(score.joint_rms or 0.0) * np.array(score.joint_counts)
            squares += part_squares
            size += part_squares / np.maximum(np.square(score.joint_relative or 1.0), np.finfo(float).tiny)
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
        totals = [self.pooled_errors(i) for i in range(len(names))]
        rows.append(("all", *(f"{100 * total:.3g} %" for total, _ in totals)))
        rows += [
            (joint, *(f"{100 * joint_errors[j]:.3g} %" for _, joint_errors in totals))
            for j, joint in enumerate(self.joints)
        ]
        table = text_table(rows, width, indent="", right=range(1, len(names) + 1))
        return [title, *table, *(f"note: {note}" for note in self.notes)]

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what noise leaves unexplained in the parts left out."""
        return remainder_notes(self.left, "torque errors of cross-validation")

    def to_json(self) -> dict[str, Any]:
        """Errors of all parts and joints as plain data."""
        pooled = [self.pooled_errors(i) for i in range(len(self.estimates))]
        return {
            "parts": [[vars(score) for score in part] for part in self.parts],
            "relative_error": {name: total for name, (total, _) in zip(self.estimates, pooled, strict=True)},
            "joint_relative_error": {
                name: joint_errors for name, (_, joint_errors) in zip(self.estimates, pooled, strict=True)
            },
            "notes": list(self.notes),
            "remainder": remainder_record(self.left),
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
    scores = []
    fitted: list[Errors | None] = []
    left_out: list[Errors | None] = []
    for part in range(1, parts + 1):
        if progress is not None:
            progress(part, parts, f"cross-validation, part {part} of {parts}")
        result = identify(model, recordings, processing, replace(plain, split=Split("fold", float(part), parts=parts)))
        held_out = [score for score in result.scores if score.data == "held out"]
        if not held_out or held_out[0].relative_error is None:
            guard = f"guard bands of {result.split.guard:.3g} s"
            raise InputError(f"part {part} of {parts} has no rows beside {guard}: choose fewer parts")
        scores.append(tuple(score for score in held_out if score.where == held_out[0].where))
        fitted.append(row_errors(result.band.theta, result.blocks, result.tuning))
        left_out.append(row_errors(result.band.theta, result.held_out_blocks, result.tuning))
    joints = tuple(recordings[0].joints)
    return CrossValidation(joints, tuple(scores), remainders(all_errors(left_out), all_errors(fitted), joints))
