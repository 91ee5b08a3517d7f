"""Triangular factors of whole recordings, for fitted and held-out data, computed in parallel and resumable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.parallel import ordered_map
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_rows
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Observations, RowMaker, Window

IN_MEMORY = 64_000_000
"""Largest size (bytes) of rows kept in memory; more are recomputed in every pass over them."""

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, message)``; a total of 0 means unknown."""


@dataclass(frozen=True)
class Factors:
    """Triangular factors of the fitted rows (``fit``) and of the held-out rows (``score``)."""

    fit: JointFactors
    score: JointFactors


@dataclass(frozen=True)
class _Task:
    """Computes the triangular factors of the rows of one window; picklable, so that it can run in any process.

    ``split`` decides which rows are fitted and which are held out; ``spans`` are start and duration (s) of each
    recording.
    """

    maker: RowMaker
    split: Split
    spans: tuple[tuple[float, float], ...]  # start and duration of every recording

    def __call__(self, window: Window) -> tuple[JointFactors, JointFactors, int]:
        start, duration = self.spans[window.recording]
        total: list[JointFactors | None] = [None, None]
        for rows in self.maker.rows(window):
            for i, chosen in enumerate((self.split.is_fitted, self.split.is_scored)):
                part = factor_rows(rows.use_only(chosen(rows.t, start, duration)))
                before = total[i]
                total[i] = part if before is None else before.merge(part)
        fit, score = total
        if fit is None or score is None:  # all samples of the window are near the ends of their stretch
            joints, size = window.part.q.shape[1], self.maker.columns + 1
            fit = score = JointFactors(np.zeros((joints, size, size)), np.zeros(joints, np.int64))
        return fit, score, window.stop - window.start


def factor_recordings(
    observations: Observations,
    split: Split | None = None,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    checkpoint: Path | None = None,
    digest: str = "",
    progress: Progress | None = None,
) -> Factors:
    """Compute the triangular factors of all rows window by window, in constant memory.

    ``split`` chooses the fitted part of the data. ``jobs`` processes, or the Dask scheduler at ``cluster``, share the
    windows, which are always merged in order of time. The state is stored in the file ``checkpoint`` after every
    window; a repeated call with the same ``digest`` (of recordings and settings) resumes from it with a bit-identical
    result. Raises :class:`InputError` if the recordings hold no samples.
    """
    spans = tuple(recording.span for recording in observations.recordings)
    total = sum(len(recording) for recording in observations.recordings)
    state = _State(checkpoint, digest)
    task = _Task(observations.maker, split or Split(), spans)
    pending = (window for number, window in enumerate(observations.windows()) if number >= state.windows)
    for fit, scored, samples in ordered_map(task, pending, jobs, cluster):
        state.add(fit, scored, samples)
        if progress is not None:
            progress(state.samples, total, f"{state.samples} samples")
    return state.factors(observations)


def no_rows(observations: Observations) -> InputError:
    """The error for ``observations`` without any window of rows: the filter of the motion never settles, or no data."""
    cutoff = observations.maker.processing.cutoff
    if cutoff is None or not any(map(len, observations.recordings)):
        return InputError("the recordings hold no samples")
    longest = max(recording.span[1] for recording in observations.recordings)
    return InputError(
        f"no row is left: a filter with a cut-off of {cutoff:g} Hz needs more than the {longest:.3g} s of the longest "
        "recording to settle; raise the cut-off frequency, or record longer"
    )


class _State:
    """The triangular factors of the windows merged so far, stored in a file if ``path`` is given."""

    def __init__(self, path: Path | None, digest: str) -> None:
        self.path, self.digest = path, digest
        self.fit: JointFactors | None = None
        self.score: JointFactors | None = None
        self.windows, self.samples = 0, 0
        if path is not None and path.exists():
            self._read(path)

    def add(self, fit: JointFactors, score: JointFactors, samples: int) -> None:
        self.fit = fit if self.fit is None else self.fit.merge(fit)
        self.score = score if self.score is None else self.score.merge(score)
        self.windows, self.samples = self.windows + 1, self.samples + samples
        if self.path is not None:
            self._write(self.path)

    def factors(self, observations: Observations) -> Factors:
        """The merged factors; raises InputError if the ``observations`` have no window of rows."""
        if self.fit is None or self.score is None:
            raise no_rows(observations)
        return Factors(self.fit, self.score)

    def _read(self, path: Path) -> None:
        """Restore the state from the file ``path``; a damaged file or one of other data or settings is ignored."""
        try:
            with np.load(path, allow_pickle=False) as data:
                if str(data["digest"]) != self.digest:
                    return
                fit = JointFactors(data["R_fit"], data["n_fit"])
                score = JointFactors(data["R_score"], data["n_score"])
                self.windows, self.samples = int(data["windows"]), int(data["samples"])
                self.fit, self.score = fit, score
        except (OSError, ValueError, KeyError, EOFError):
            return

    def _write(self, path: Path) -> None:
        assert self.fit is not None
        assert self.score is not None
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        with part.open("wb") as stream:
            np.savez(
                stream,
                digest=np.array(self.digest),
                R_fit=self.fit.R,
                n_fit=self.fit.counts,
                R_score=self.score.R,
                n_score=self.score.counts,
                windows=np.array(self.windows),
                samples=np.array(self.samples),
            )
        os.replace(part, path)


def score(factors: JointFactors, theta: Array) -> dict[str, Any]:
    """Torque errors of the parameters ``theta`` (p,): ``rows``, ``relative_error``, ``rms`` and ``joint_rms``, N m (N).

    The errors are None if there are no rows, the relative one also if all torques are zero, as in flight.
    """
    count = int(np.sum(factors.counts))
    if count == 0:
        return {"rows": 0, "relative_error": None, "rms": None, "joint_rms": None}
    squares, size = factors.residual_squares(theta), float(np.sum(factors.torque_squares))
    return {
        "rows": count,
        "relative_error": float(np.sqrt(np.sum(squares) / size)) if size else None,
        "rms": float(np.sqrt(np.sum(squares) / count)),
        "joint_rms": [float(v) for v in np.sqrt(squares / np.maximum(1, factors.counts))],
    }


def fits_in_memory(observations: Observations, limit: int = IN_MEMORY) -> bool:
    """Whether the rows of all recordings take less than ``limit`` bytes."""
    samples = sum(len(recording) for recording in observations.recordings)
    width = len(observations.recordings[0].joints) * observations.maker.columns * 8
    return samples // (observations.maker.processing.decimate or 1) * width <= limit


def rows_of_recordings(
    observations: Observations, split: Split, progress: Progress | None = None
) -> tuple[Factors, list[Rows], list[Rows]]:
    """Compute the triangular factors of all rows in memory; returns them, the fitted and the held-out rows."""
    total = sum(len(recording) for recording in observations.recordings)
    state = _State(None, "")
    fitted: list[Rows] = []
    scored: list[Rows] = []
    for window in observations.windows():
        start, duration = observations.recordings[window.recording].span
        for rows in observations.maker.rows(window):
            fitted.append(rows.use_only(split.is_fitted(rows.t, start, duration)))
            scored.append(rows.use_only(split.is_scored(rows.t, start, duration)))
            state.add(factor_rows(fitted[-1]), factor_rows(scored[-1]), 0)
        state.samples += window.stop - window.start
        if progress is not None:
            progress(state.samples, total, f"{state.samples} samples")
    return state.factors(observations), fitted, scored


@dataclass(frozen=True)
class FittedRows:
    """Iterable of the fitted rows, which are recomputed in every iteration.

    Points in time that ``split`` does not assign to the fitted part are kept and marked as not in use.
    """

    observations: Observations
    split: Split

    def __iter__(self) -> Iterator[Rows]:
        for window in self.observations.windows():
            start, duration = self.observations.recordings[window.recording].span
            for rows in self.observations.maker.rows(window):
                yield rows.use_only(self.split.is_fitted(rows.t, start, duration))


@dataclass(frozen=True)
class ScoredRows(FittedRows):
    """Iterable of the held-out rows, which are recomputed in every iteration.

    Points in time that ``split`` does not hold out are kept and marked as not in use.
    """

    def __iter__(self) -> Iterator[Rows]:
        for window in self.observations.windows():
            start, duration = self.observations.recordings[window.recording].span
            for rows in self.observations.maker.rows(window):
                yield rows.use_only(self.split.is_scored(rows.t, start, duration))
