"""How far the torques of a model are off, on rows that are named: which data, which filter, which share.

An error depends on what it is measured on. The rows that are fitted are filtered, and slow ones may be left out; the
same model is therefore also scored on all rows, and on the torques as they were recorded, sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.identify.estimation.observations import KnownTorque, Observations, Recording, RowMaker
from rrrgen.identify.estimation.tsqr import Rows
from rrrgen.identify.scoring.bandwidth import Tuning
from rrrgen.identify.scoring.split import Split

TorqueModels = Callable[[Array, Array, Array], Array]
"""Motion (q, dq, ddq), (N, n) each, to the joint torques (N, n, k) of k models."""

Selection = Literal["moving", "all"]


@dataclass(frozen=True)
class Score:
    """The error of one estimate on one set of rows: ``|tau - tau_model| / |tau|`` over all joints, and N m (N) RMS.

    ``data`` says whether the rows were fitted; ``torque`` how they are filtered; ``rows`` whether slow ones are left
    out (``moving``) or not (``all``). ``share`` is how many of the rows of these data count: those with an invalid
    torque never do. The errors are None where no row is left.
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

    @property
    def where(self) -> str:
        """What the figure was measured on, in words."""
        slow = ", slow ones left out" if self.rows == "moving" else ""
        return f"{self.data}, {100 * self.share:.0f} % of the rows{slow}, {self.torque}"


def torque_filter(tuning: Tuning) -> str:
    """What happened to the torques of filtered rows, in words."""
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
    labels: tuple[str, str] = ("in sample", "held out"),
) -> tuple[Score, ...]:
    """Scores of the models ``names``, whose ``torques`` are given, on both parts of ``recordings``.

    The rows as they are fitted come first, then all of them, then unfiltered torques on all samples; what would be the
    same figure again is left out. ``columns`` is the width of the regressor behind the models, which bounds the blocks
    they are evaluated in; ``known`` a torque that is subtracted from the measured one; ``labels`` name the two parts.
    """
    split = split or Split()
    filtered = RowMaker(torques, tuning.processing, columns, known)
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
    """Squares of torques and errors, gathered block by block."""

    def __init__(self) -> None:
        self.total = 0
        self.counts: NDArray[np.int64] = np.zeros(0, np.int64)
        self.torque = np.zeros(0)
        self.error = np.zeros((0, 0))

    def add(self, rows: Rows, mask: NDArray[np.bool_], use: NDArray[np.bool_]) -> None:
        """Count the rows of ``mask`` (N,), and of those the torques in ``use`` (N, n)."""
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
        """The errors of one model."""
        count, squares = int(np.sum(self.counts)), self.error[:, model]
        known: dict[str, Any] = {"relative_error": None, "rms": None, "joint_rms": None}
        if count:
            size = max(float(np.sum(self.torque)), np.finfo(float).tiny)
            known["relative_error"] = float(np.sqrt(np.sum(squares) / size))
            known["rms"] = float(np.sqrt(np.sum(squares) / count))
            known["joint_rms"] = tuple(float(v) for v in np.sqrt(squares / np.maximum(1, self.counts)))
        return Score(estimate, data, torque, rows, count, count / self.total, **known)


def score_table(scores: Sequence[Score]) -> list[str]:
    """Lines for a screen: one for every set of rows, the relative errors of the estimates side by side."""
    names = list(dict.fromkeys(score.estimate for score in scores))
    by_rows: dict[str, dict[str, Score]] = {}
    for score in scores:
        by_rows.setdefault(score.where, {})[score.estimate] = score
    width = max((len(where) for where in by_rows), default=0)
    lines = [f"{'relative torque error':<{width}}" + "".join(f"  {name:>12}" for name in names)]
    for where, found in by_rows.items():
        errors = (found[name].relative_error for name in names)
        cells = ("-" if error is None else f"{100 * error:.3g} %" for error in errors)
        lines.append(f"{where:<{width}}" + "".join(f"  {cell:>12}" for cell in cells))
    return lines
