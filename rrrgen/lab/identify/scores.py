"""Torque errors of a model, each with the data, the filter and the share of rows it refers to.

The rows of a fit are filtered, and slow ones may be left out, which makes the error smaller. A model is therefore also
scored on all rows, and on the unfiltered torques, sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.tables import text_table
from rrrgen.lab.estimate.tsqr import Rows
from rrrgen.lab.identify.bandwidth import Tuning
from rrrgen.lab.identify.friction_columns import Sliding
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import KnownTorque, Observations, Recording, RowMaker

TorqueModels = Callable[..., Array]
"""Motion (q, dq, ddq), (N, n) each, to the joint torques (N, n, k) of k models."""

Selection = Literal["moving", "all"]


@dataclass(frozen=True)
class Score:
    """The error of one estimate on one set of rows.

    ``relative_error`` is ``|tau - tau_model| / |tau|`` over all joints, ``rms`` the root mean square of the error, N m
    (N); ``joint_rms``, ``joint_relative`` and ``joint_counts`` (n,) are the same joint by joint. ``data`` states
    whether the rows were fitted, ``torque`` how they are filtered, ``rows`` whether slow ones are left out (``moving``)
    or not (``all``). ``count`` rows are scored, a ``share`` of all rows of these data; rows with an invalid torque
    never are. The errors are None if no row is left.
    """

    estimate: str
    data: str
    torque: str
    rows: Selection
    count: int
    share: float
    relative_error: float | None
    rms: float | None
    joint_rms: tuple[float, ...] | None
    joint_relative: tuple[float, ...] | None = None
    joint_counts: tuple[int, ...] = ()

    @property
    def where(self) -> str:
        """The data, rows and filter that the error refers to, in words."""
        slow = ", slow ones left out" if self.rows == "moving" else ""
        return f"{self.data}, {100 * self.share:.0f} % of the rows{slow}, {self.torque}"


def torque_filter(tuning: Tuning) -> str:
    """The filter on torque and regressor in words, such as ``filtered at 4 Hz``."""
    return "unfiltered" if tuning.torque_cutoff is None else f"filtered at {tuning.torque_cutoff:.3g} Hz"


def score_models(
    names: Sequence[str],
    torques: TorqueModels,
    recordings: Sequence[Recording],
    tuning: Tuning,
    split: Split | None = None,
    *,
    known: KnownTorque | None = None,
    columns: int = 1,
    sliding: Sliding | None = None,
    labels: tuple[str, str] = ("in sample", "held out"),
) -> tuple[Score, ...]:
    """Score several models on the fitted and the held-out part of ``recordings``.

    ``names`` are those of the models, ``torques(q, dq, ddq)`` computes their joint torques. For each part, the scores
    are those on the rows as fitted, on all rows, and on unfiltered torques at all samples; duplicates are left out.
    ``tuning`` holds the filters; ``columns`` is the width of the regressor, which bounds the size of the blocks;
    ``known`` is a torque subtracted from the measured one; ``sliding`` computes the states of friction that ``torques``
    takes as a fourth argument; ``labels`` name the two parts.
    """
    split = split or Split()
    filtered = RowMaker(torques, tuning.processing, columns, known, sliding)
    plain = replace(filtered, processing=replace(tuning.processing, low_speed=(), decimate=1))
    sums: dict[tuple[str, str, Selection], _Sums] = {}
    observations = Observations(tuple(recordings), filtered)
    for window in observations.windows():
        start, duration = recordings[window.recording].span
        for maker in (filtered, plain) if tuning.torque_cutoff is not None else (filtered,):
            torque = torque_filter(tuning) if maker is filtered else "unfiltered"
            for rows in maker.rows(window):
                parts = (split.fitted(rows.t, start, duration), split.scored(rows.t, start, duration))
                for label, mask in zip(labels, parts, strict=True):
                    if maker is filtered and tuning.processing.low_speed:
                        sums.setdefault((label, torque, "moving"), _Sums()).add(rows, mask, rows.use)
                    sums.setdefault((label, torque, "all"), _Sums()).add(rows, mask, rows.sound)
    ordered = sorted(sums.items(), key=lambda item: labels.index(item[0][0]))
    return tuple(
        found.score(name, i, *key) for key, found in ordered if found.total > 0 for i, name in enumerate(names)
    )


class _Sums:
    """Sums of squared torques and torque errors of every joint and model, accumulated block by block."""

    def __init__(self) -> None:
        self.total = 0
        self.counts: NDArray[np.int64] = np.zeros(0, np.int64)
        self.torque = np.zeros(0)
        self.error = np.zeros((0, 0))

    def add(self, rows: Rows, mask: NDArray[np.bool_], use: NDArray[np.bool_]) -> None:
        """Add the torques in ``use`` (N, n) of the instants in ``mask`` (N,)."""
        chosen = use & mask[:, None]
        if not len(self.counts):
            joints, models = rows.W.shape[1:]
            self.counts, self.torque = np.zeros(joints, np.int64), np.zeros(joints)
            self.error = np.zeros((joints, models))
        self.total += int(np.sum(mask)) * use.shape[1]
        self.counts += np.sum(chosen, axis=0)
        self.torque += np.sum(np.square(np.where(chosen, rows.tau, 0.0)), axis=0)
        self.error += np.sum(np.square(np.where(chosen[..., None], rows.tau[..., None] - rows.W, 0.0)), axis=0)

    def score(self, estimate: str, model: int, data: str, torque: str, rows: Selection) -> Score:
        """The score of model number ``model``, named ``estimate``, from the accumulated sums."""
        count, squares = int(np.sum(self.counts)), self.error[:, model]
        known: dict[str, Any] = {"relative_error": None, "rms": None, "joint_rms": None}
        known["joint_counts"] = tuple(int(v) for v in self.counts)
        if count:
            size = max(float(np.sum(self.torque)), np.finfo(float).tiny)
            known["relative_error"] = float(np.sqrt(np.sum(squares) / size))
            known["rms"] = float(np.sqrt(np.sum(squares) / count))
            known["joint_rms"] = tuple(float(v) for v in np.sqrt(squares / np.maximum(1, self.counts)))
            own = np.maximum(self.torque, np.finfo(float).tiny)
            known["joint_relative"] = tuple(float(v) for v in np.sqrt(squares / own))
        return Score(estimate, data, torque, rows, count, count / self.total, **known)


def score_table(scores: Sequence[Score], width: int | None = None) -> list[str]:
    """Lines of a table with one row per set of rows and one column of relative errors per estimate.

    It is folded to lines of ``width`` characters; None: lines of any length.
    """
    names = list(dict.fromkeys(score.estimate for score in scores))
    by_rows: dict[str, dict[str, Score]] = {}
    for score in scores:
        by_rows.setdefault(score.where, {})[score.estimate] = score
    rows = [("relative torque error", *names)]
    for where, found in by_rows.items():
        errors = (found[name].relative_error for name in names)
        rows.append((where, *("-" if error is None else f"{100 * error:.3g} %" for error in errors)))
    return text_table(rows, width, indent="", right=range(1, len(names) + 1))


def joint_table(scores: Sequence[Score], joints: Sequence[str], width: int | None = None) -> list[str]:
    """Lines of a table of the relative errors of each joint, on rows filtered and selected as for the fit.

    It is folded to lines of ``width`` characters; None: lines of any length.
    """
    first: dict[tuple[str, str], Score] = {}
    for score in scores:
        if score.joint_relative is not None:
            first.setdefault((score.data, score.estimate), score)
    rows = [("by joint", *joints)]
    for (data, estimate), score in first.items():
        errors = (f"{100 * error:.3g} %" for error in score.joint_relative or ())
        rows.append((f"{data}, {estimate}", *errors))
    return text_table(rows, width, indent="", right=range(1, len(joints) + 1))
