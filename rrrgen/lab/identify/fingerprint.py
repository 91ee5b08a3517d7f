"""Fingerprints of recorded samples, which show whether a model is scored on samples that it was fitted to.

A *window* consists of k samples of a recording, 20 ms apart (consecutive if the sampling is slower), with the positions
and torques of all joints in SI. Positions are rounded to 2^-12 of the power of two above the largest position in the
window, torques likewise, and the results are hashed. Instants and file format do not enter: the same samples give the
same hashes from CSV, NumPy, MATLAB, Parquet or a bag, in radians or degrees, whole or in part, with other filters,
splits and versions of the program. Rounding the samples to six significant digits preserves most hashes, to five enough
to recognise the data in part, to four none. Changed samples (another zero, sign, gear ratio or torque constant,
resampling, a filter) give other hashes, and so does the noise of a repeated measurement of the same motion.

A fingerprint keeps the smallest hashes, which amounts to a random selection of windows. All hashes of another recording
within the same range occur in it if the samples are the same, and none if they are not; the share of common samples is
therefore estimated from a few hundred hashes (a sketch, as in Broder's minwise hashing).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.data.log_stream import Part, joined
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Recording

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
        return "its own data" if self.share >= NEARLY_ALL else "partly its own data"


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
    top = max((each.range for each in known), default=(1 << BITS) - 1)
    seen: Hashes = np.zeros(0, np.uint64)
    for recording in recordings:
        for hashes in window_hashes(recording, split or Split(), held_out=split is not None and split.kind != "none"):
            seen = np.unique(np.concatenate([seen, hashes[hashes <= np.uint64(top)]]))
    share, looked = 0.0, len(seen)
    for each in known:
        inside = seen[seen <= np.uint64(each.range)]
        looked = min(looked, len(inside))
        if len(inside):
            share += float(np.mean(np.isin(inside, np.array(each.hashes, np.uint64))))
    return Common(min(1.0, share), looked)


def window_hashes(recording: Recording, split: Split, held_out: bool = False) -> Iterator[Hashes]:
    """Iterate over the hashes of all windows in the fitted or the held-out part of a recording, in blocks."""
    chosen = split.scored if held_out else split.fitted
    start, duration = recording.span
    step = recording.period * max(1, int(SPACING / recording.period + 0.25))
    pending: Part | None = None
    for part in recording.samples():
        rows = part if pending is None else joined([pending, part])
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
            yield _hashed(rows.q[at].reshape(len(at), -1), rows.tau[at].reshape(len(at), -1))
        pending = rows.sliced(length, len(rows))


def _hashed(q: Array, tau: Array) -> Hashes:
    """Hashes of windows with positions ``q`` and torques ``tau``, (N, values) each; all-zero windows are left out."""
    largest = np.max(np.abs(q), axis=1), np.max(np.abs(tau), axis=1)
    some = (largest[0] > 0) & (largest[1] > 0)
    state = np.full(int(np.sum(some)), q.shape[1], np.uint64)
    for values, size in zip((q, tau), largest, strict=True):
        exponent = np.frexp(size[some])[1]
        cells = np.floor(np.ldexp(values[some], (CELL_BITS - exponent)[:, None]) + SHIFT).astype(np.int64)
        for column in (exponent.astype(np.int64), *cells.T):
            state = _mixed(state, column.astype(np.uint64))
    return np.asarray(state >> np.uint64(64 - BITS))


def _mixed(state: Hashes, value: Hashes) -> Hashes:
    """Mix ``value`` into the hash ``state`` with the finaliser of the SplitMix64 generator."""
    x = (state ^ value) + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(x ^ (x >> np.uint64(31)))
