"""Torque errors of a model, each with the data, the filter and the share of rows it refers to.

The rows of a fit are filtered, and slow ones may be left out, which makes the error smaller. A model is therefore also
scored on all rows, and on the unfiltered torques, sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.tables import text_table
from rrrgen.lab.data.uniform_stream import Part, join_parts
from rrrgen.lab.estimate.regression import Estimate, least_squares
from rrrgen.lab.estimate.remainder import Errors, Remainder, remainder_notes, remainders, row_pieces
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_blocks
from rrrgen.lab.identify.bandwidth import Tuning
from rrrgen.lab.identify.friction_columns import Sliding
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import KnownTorque, Observations, Recording, RowMaker
from rrrgen.lab.identify.regressor import Parametrisation

# ------------------------------------------------------------------------------------------------------------------
# Uncertainty of predicted torques: a band from the covariance of the parameters and the scatter of the residuals.
#
# The variance of a measured torque about the prediction ``W theta`` is ``w C w' + sigma_j^2``: that of the
# parameters, with the covariance C, and that of the residuals of the joint on the fitted rows.
# ------------------------------------------------------------------------------------------------------------------

BAND = 1.96
"""Half width of a 95 % band in standard deviations."""


@dataclass(frozen=True)
class Coverage:
    """Share of measured torques inside their 95 % band: ``share`` over all rows, ``joints`` (n,) joint by joint.

    ``parameters`` is the part of the band's width that the parameters cause: the RMS ratio of their standard deviation
    to the total. A joint without rows has NaN.
    """

    share: float
    parameters: float
    joints: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class TorqueBand:
    """Uncertainty of the torques that a model predicts.

    ``theta`` (p,) are the parameters of all columns, ``root root'`` (p, p) is their covariance, ``sigma`` (n,) the
    standard deviation of the residuals of each joint, N m (N); the 95 % band is ``factor`` (n,) times as wide on either
    side as the total standard deviation.
    """

    theta: Array
    root: Array
    sigma: Array
    factor: Array | float = BAND

    @classmethod
    def of(cls, theta: Array, to_columns: Array, covariance: Array, sigma: Array) -> TorqueBand:
        """Build the band from the ``covariance`` (r, r) of the identifiable parameters.

        ``to_columns`` (p, r) maps these to ``theta`` (p,); ``sigma`` (n,) is that of the residuals.
        """
        values, V = np.linalg.eigh(0.5 * (covariance + covariance.T))
        return cls(theta, to_columns @ (V * np.sqrt(np.maximum(values, 0.0))), sigma)

    def parameters(self, W: Array) -> Array:
        """Standard deviation (N, n) of the predicted torque, N m (N), from the parameters alone; W is (N, n, p)."""
        return np.asarray(np.linalg.norm(W @ self.root, axis=-1))

    def total(self, W: Array) -> Array:
        """Standard deviation (N, n) of the measured torque about the prediction, N m (N)."""
        return np.asarray(np.hypot(self.parameters(W), self.sigma))

    def coverage(self, blocks: Iterable[Rows]) -> Coverage | None:
        """Coverage of the rows in use by the 95 % band; None without rows."""
        n = len(self.sigma)
        inside, count = np.zeros(n, np.int64), np.zeros(n, np.int64)
        parameter_variance = all_ = 0.0
        for rows in blocks:
            total = self.total(rows.W)
            inside += np.sum(rows.use & (np.abs(rows.tau - rows.W @ self.theta) <= self.factor * total), axis=0)
            count += np.sum(rows.use, axis=0)
            parameter_variance += float(np.sum(np.where(rows.use, self.parameters(rows.W), 0.0) ** 2))
            all_ += float(np.sum(np.where(rows.use, total, 0.0) ** 2))
        if not count.any() or all_ == 0.0:
            return None
        pairs = zip(inside.tolist(), count.tolist(), strict=True)
        joints = tuple(a / b if b else float("nan") for a, b in pairs)
        return Coverage(int(np.sum(inside)) / int(np.sum(count)), float(np.sqrt(parameter_variance / all_)), joints)


FOLDS = 5
DRAWS = 200  # bootstrap draws of blocks of residuals
CERTAIN = 0.9  # quantile over the draws: the band holds with this probability, not in the mean only
BLOCK = 1.0  # s; a quarter of it in recordings of some seconds
FEWEST_BLOCKS = 36
FEWEST_ROWS = 20  # per parameter in the fitted part of a fold


def conformal_band(
    band: TorqueBand, blocks: Sequence[Rows], estimate: Estimate, chosen: Parametrisation, seed: int = 0
) -> TorqueBand:
    """The band with a width that holds where the model errs, by conformal prediction over blocks.

    Five contiguous parts of the fitted rows ``blocks`` are each predicted by a fit to the others, weighted as
    ``estimate``. The factor of a joint is a quantile of the 95 % quantiles of ``|error| / deviation`` over bootstrap
    draws of blocks, which keep the correlation of errors in time. It is never below that of the normal distribution.
    Unchanged if a part leaves too few rows.
    """
    t = np.concatenate([rows.t for rows in blocks])
    if len(t) < 2:
        return band
    start, duration = float(np.min(t)), float(np.ptp(t))
    pieces: list[list[Rows]] = [[] for _ in range(FOLDS)]
    for rows in blocks:
        part = np.minimum((FOLDS * (rows.t - start) / max(duration, 1e-300)).astype(int), FOLDS - 1)
        for fold in np.unique(part):
            pieces[fold].append(rows.use_only(part == fold))
    if not all(pieces):
        return band
    factors = [factor_blocks(part) for part in pieces]
    errors, times = [], []
    for fold, part in enumerate(pieces):
        others = [factor for k, factor in enumerate(factors) if k != fold]
        training = reduce(JointFactors.merge, others)
        if np.sum(training.counts) < FEWEST_ROWS * len(estimate.x):
            return band
        theta = chosen.expand(least_squares(chosen.transform(training), estimate.names, estimate.weights).x)
        for rows in part:
            error = np.where(rows.use, np.abs(rows.tau - rows.W @ theta), np.nan)
            z = error / np.where(rows.use, band.total(rows.W), 1.0)
            errors.append(z[rows.use.any(axis=1)])
            times.append(rows.t[rows.use.any(axis=1)])
    z, when = np.concatenate(errors), np.concatenate(times)
    number = np.unique(((when - start) / min(BLOCK, duration / FEWEST_BLOCKS)).astype(int), return_inverse=True)[1]
    members = [np.flatnonzero(number == k) for k in range(int(number[-1]) + 1 if len(number) else 0)]
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(DRAWS):
        rows_drawn = np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])
        drawn.append([_quantile(column[rows_drawn], 0.95) for column in z.T])
    return replace(band, factor=np.maximum(BAND, np.quantile(np.array(drawn), CERTAIN, axis=0)))


def _quantile(values: Array, share: float) -> float:
    """Quantile of the finite ``values``; 0 if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, share)) if len(finite) else 0.0


# ------------------------------------------------------------------------------------------------------------------
# Fingerprints of recorded samples, which show whether a model is scored on samples that it was fitted to.
#
# A *window* consists of k samples of a recording, 20 ms apart (consecutive if the sampling is slower), with the
# positions and torques of all joints in SI. Positions are rounded to 2^-12 of the power of two above the largest
# position in the window, torques likewise, and the results are hashed. Points in time and file format do not enter: the
# same samples give the same hashes from CSV, NumPy, MATLAB, Parquet or a bag, in radians or degrees, whole or in
# part, with other filters, splits and versions of the program. Rounding the samples to six significant digits
# preserves most hashes, to five enough to recognise the data in part, to four none. Changed samples (another zero,
# sign, gear ratio or torque constant, resampling, a filter) give other hashes, and so does the noise of a repeated
# measurement of the same motion.
#
# A fingerprint keeps the smallest hashes, which amounts to a random selection of windows. All hashes of another
# recording within the same range occur in it if the samples are the same, and none if they are not; the share of
# common samples is therefore estimated from a few hundred hashes (a sketch, as in Broder's minwise hashing).
# ------------------------------------------------------------------------------------------------------------------

SPACING = 0.02  # s between the samples of a window
VALUES = 12  # smallest number of values in a window
BITS = 48  # length of a hash
SMALLEST, LARGEST = 512, 4096  # smallest and largest number of hashes in a fingerprint
WINDOWS_PER_HASH = 64  # windows per stored hash of a long recording
CELL_BITS = 12  # values are rounded to 2^-12 of the power of two above the largest
SHIFT = 0.381966  # offset of the rounding, so that quantised values do not fall on a rounding boundary
COINCIDENCE = 0.01
"""Share of common windows that counts as coincidence, such as rest in the same pose."""
NEARLY_ALL = 0.95

Hashes = NDArray[np.uint64]
Label = Literal["held-out data", "partly its own data", "its own data", "data of unknown origin"]
OWN: Label = "its own data"
UNKNOWN: Label = "data of unknown origin"
"""Label if it is not recorded what the model was fitted to, or the recording has too few windows to decide."""


@dataclass(frozen=True)
class Fingerprint:
    """The smallest ``hashes``, in rising order, of the ``windows`` of a recording; all of them if there are few."""

    hashes: tuple[int, ...]
    windows: int

    @property
    def range(self) -> int:
        """The largest number up to which :attr:`hashes` holds every hash of the recording."""
        return self.hashes[-1] if len(self.hashes) >= SMALLEST else (1 << BITS) - 1


@dataclass(frozen=True)
class Common:
    """Estimated ``share`` of the windows of a recording that occur in known ones, from ``looked`` compared hashes."""

    share: float
    looked: int

    @property
    def label(self) -> Label:
        """The origin of the data in words: held out, partly or wholly the model's own, or unknown."""
        if self.looked == 0:
            return UNKNOWN
        if self.share < COINCIDENCE:
            return "held-out data"
        return OWN if self.share >= NEARLY_ALL else "partly its own data"


def fingerprint(recordings: Sequence[Recording], split: Split | None = None) -> Fingerprint:
    """Fingerprint of the fitted part of ``recordings``, including the guard bands, into which the filters reach."""
    whole = Split() if split is None else replace(split, guard=0.0)
    kept: Hashes = np.zeros(0, np.uint64)
    windows = 0
    for recording in recordings:
        for hashes in window_hashes(recording, whole):
            windows += len(hashes)
            kept = np.unique(np.concatenate([kept, hashes]))[:LARGEST]
    size = max(SMALLEST, windows // WINDOWS_PER_HASH)
    return Fingerprint(tuple(int(value) for value in kept[:size]), windows)


def common_share(known: Sequence[Fingerprint], recordings: Sequence[Recording], split: Split | None = None) -> Common:
    """Estimate the share of the windows of ``recordings`` that occur in the ``known`` fingerprints.

    With a ``split``, only windows of its held-out part are compared.
    """
    top = max((fingerprint.range for fingerprint in known), default=(1 << BITS) - 1)
    seen: Hashes = np.zeros(0, np.uint64)
    for recording in recordings:
        for hashes in window_hashes(recording, split or Split(), held_out=split is not None and split.kind != "none"):
            seen = np.unique(np.concatenate([seen, hashes[hashes <= np.uint64(top)]]))
    share, looked = 0.0, len(seen)
    for fingerprint in known:
        inside = seen[seen <= np.uint64(fingerprint.range)]
        looked = min(looked, len(inside))
        if len(inside):
            share += float(np.mean(np.isin(inside, np.array(fingerprint.hashes, np.uint64))))
    return Common(min(1.0, share), looked)


def window_hashes(recording: Recording, split: Split, held_out: bool = False) -> Iterator[Hashes]:
    """Iterate over the hashes of all windows in the fitted or the held-out part of a recording, in blocks."""
    chosen = split.is_scored if held_out else split.is_fitted
    start, duration = recording.span
    step = recording.period * max(1, int(SPACING / recording.period + 0.25))
    pending: Part | None = None
    for part in recording.samples():
        rows = part if pending is None else join_parts([pending, part])
        if rows.tau is None:
            return
        count = max(2, -(-VALUES // (2 * rows.q.shape[1])))
        reach = (count - 1) * step
        # the first samples of windows whose last sample cannot be in a later block
        length = int(np.searchsorted(rows.t, rows.t[-1] - reach - 0.5 * recording.period))
        wanted = rows.t[:length, None] + step * np.arange(count)
        at = np.minimum(np.searchsorted(rows.t, wanted - 0.5 * recording.period), len(rows) - 1)
        there = np.all(np.abs(rows.t[at] - wanted) <= 0.5 * recording.period, axis=1)
        usable = chosen(rows.t, start, duration) & np.all(np.isfinite(rows.tau), axis=1)
        at = at[there & usable[at].all(axis=1)]
        if len(at):  # a block may hold no window of the fitted part
            yield _hash_windows(rows.q[at].reshape(len(at), -1), rows.tau[at].reshape(len(at), -1))
        pending = rows.slice_samples(length, len(rows))


def _hash_windows(q: Array, tau: Array) -> Hashes:
    """Hashes of windows with positions ``q`` and torques ``tau``, (N, values) each; all-zero windows are left out."""
    largest = np.max(np.abs(q), axis=1), np.max(np.abs(tau), axis=1)
    some = (largest[0] > 0) & (largest[1] > 0)
    state = np.full(int(np.sum(some)), q.shape[1], np.uint64)
    for values, size in zip((q, tau), largest, strict=True):
        exponent = np.frexp(size[some])[1]
        cells = np.floor(np.ldexp(values[some], (CELL_BITS - exponent)[:, None]) + SHIFT).astype(np.int64)
        for column in (exponent.astype(np.int64), *cells.T):
            state = _mix(state, column.astype(np.uint64))
    return np.asarray(state >> np.uint64(64 - BITS))


def _mix(state: Hashes, value: Hashes) -> Hashes:
    """Mix ``value`` into the hash ``state`` with the finaliser of the SplitMix64 generator."""
    x = (state ^ value) + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(x ^ (x >> np.uint64(31)))


# ------------------------------------------------------------------------------------------------------------------
# Torque errors of a model, each with the data, the filter and the share of rows it refers to
# ------------------------------------------------------------------------------------------------------------------

TorqueModels = Callable[..., Array]
"""Motion (q, dq, ddq), (N, n) each, to the joint torques (N, n, k) of k models."""

Selection = Literal["moving", "all"]

MAIN_LOBE = 2
"""Half width, in decimated samples, of the main lobe of the decimation filter: neighbours that it mixes strongly."""


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
                parts = (split.is_fitted(rows.t, start, duration), split.is_scored(rows.t, start, duration))
                for label, mask in zip(labels, parts, strict=True):
                    if maker is filtered and tuning.processing.low_speed:
                        sums.setdefault((label, torque, "moving"), _Sums()).add(rows, mask, rows.use)
                    sums.setdefault((label, torque, "all"), _Sums()).add(rows, mask, rows.sound)
    ordered = sorted(sums.items(), key=lambda item: labels.index(item[0][0]))
    return tuple(
        row_sums.score(name, i, *key) for key, row_sums in ordered if row_sums.total > 0 for i, name in enumerate(names)
    )


class _Sums:
    """Sums of squared torques and torque errors of every joint and model, accumulated block by block."""

    def __init__(self) -> None:
        self.total = 0
        self.counts: NDArray[np.int64] = np.zeros(0, np.int64)
        self.torque = np.zeros(0)
        self.error = np.zeros((0, 0))

    def add(self, rows: Rows, mask: NDArray[np.bool_], use: NDArray[np.bool_]) -> None:
        """Add the torques in ``use`` (N, n) of the times in ``mask`` (N,)."""
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
            torque_squares = np.maximum(self.torque, np.finfo(float).tiny)
            known["joint_relative"] = tuple(float(v) for v in np.sqrt(squares / torque_squares))
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
    for where, row_scores in by_rows.items():
        errors = (row_scores[name].relative_error for name in names)
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


# ------------------------------------------------------------------------------------------------------------------
# Warnings where torques that were not fitted are predicted badly: unexplained joints, deviations that are too small.
#
# A small total error hides a light joint: its torque hardly counts in the norm over all joints.
# ------------------------------------------------------------------------------------------------------------------

UNEXPLAINED = 0.3  # relative error of a torque above which it counts as not explained
WORSE = 2.0  # and how many times that of the fitted rows it is; otherwise the diagnosis of the fit tells of it
COVERED = 0.85  # share of rows in a 95 % band below which the band is too narrow; residuals are correlated


def not_explained(what: str, errors: Iterable[float]) -> str:
    """Sentence on torques whose relative ``errors`` are large, with the questions that follow from it.

    ``what`` says whose torques they are or what does not explain them.
    """
    left = ", ".join(f"{100.0 * error:.3g}" for error in errors)
    return (
        f"{what}: {left} % of them are left. Are positions and torques in the right units, at the joints, with the "
        "right signs and in the right columns, and do the rows of the robot file belong to this arm? `rrrgen identify` "
        "compares such causes"
    )


def held_out_notes(
    scores: Sequence[Score], covered: Coverage | None, joints: Sequence[str], left: Sequence[Remainder] = ()
) -> tuple[str, ...]:
    """Sentences on the ``joints`` whose torque on held-out rows is not explained, or lies outside its band.

    ``scores`` are those of all estimates, of which the last is the written model; ``covered`` is the coverage of the
    held-out rows by its 95 % band, ``left`` what noise does not explain there. Empty if nothing was held out.
    """
    first: dict[str, Score] = {}
    for score in scores:
        if scores and score.estimate == scores[-1].estimate and score.joint_relative is not None:
            first.setdefault(score.data, score)
    fitted, held_out = (getattr(first.get(data), "joint_relative", None) for data in ("in sample", "held out"))
    if not fitted or not held_out or covered is None:
        return ()
    notes, narrow, unexplained = [], [], []
    for joint, inside, before, after in zip(joints, covered.joints, fitted, held_out, strict=True):
        if after > max(UNEXPLAINED, WORSE * before):
            unexplained.append(joint)
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
    return (*notes, *remainder_notes([remainder for remainder in left if remainder.name not in unexplained]))


def left_in_rows(
    theta: Array, fitted: Iterable[Rows], held_out: Iterable[Rows], joints: Sequence[str], tuning: Tuning
) -> tuple[Remainder, ...]:
    """What the torques of the ``joints`` leave unexplained in ``held_out`` rows by the parameters ``theta`` (p,)."""
    fit, out = (row_errors(theta, blocks, tuning) for blocks in (fitted, held_out))
    return remainders(out, fit, joints)


def row_errors(theta: Array, blocks: Iterable[Rows], tuning: Tuning) -> Errors | None:
    """Sums over the torque errors of rows filtered by ``tuning``, for the parameters ``theta`` (p,) of all columns."""
    return Errors.of(row_pieces(blocks, theta), filter_reach(tuning))


def filter_reach(tuning: Tuning) -> int:
    """Number of rows over which the decimation filter mixes their noise strongly."""
    return 0 if (tuning.processing.decimate or 1) == 1 else MAIN_LOBE
