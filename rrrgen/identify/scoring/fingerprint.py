"""Fingerprints of recorded samples: whether a model is scored on samples that it was fitted to.

A *window* is k samples of a recording, 20 ms apart (one apart where the recording is slower), of positions and torques
of all joints in SI. The values are rounded to cells, 2^-12 of the next power of two above the largest position in the
window, and of that above the largest torque, and the cells are hashed. Neither the instants themselves nor the file
enter: the same samples give the same hashes from CSV, NumPy, MATLAB, Parquet or a bag, in radians or degrees, whole or
in part, with other filters, splits and versions of the program. Of samples rounded to six significant digits most
hashes stay (those of which no value lies at the border of its cell), to five enough to be recognised in part, to four
none. What changes the samples themselves (another zero, sign, gear ratio or torque constant, other instants by
resampling, a filter) gives other hashes, and so does the noise of the same motion measured once more.

A fingerprint keeps the smallest hashes, which are a random choice of windows. Windows of another recording whose hashes
lie in the same range should all be among them if these are the same samples, and none if they are not: so the share of
common samples is estimated from some hundred hashes (the sketch of Broder's minwise hashing).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.identify.estimation.observations import Recording
from rrrgen.identify.scoring.split import Split
from rrrgen.recordings.log_stream import Part, joined

SPACING = 0.02  # s, of the samples of a window
VALUES = 12  # of one window, at least
BITS = 48
SMALLEST, LARGEST = 512, 4096  # hashes in a fingerprint
WINDOWS_PER_HASH = 64  # of a long recording, until the largest size
CELL_BITS = 12  # a cell is 2^-12 of the power of two above the largest value
SHIFT = 0.381966  # of the cells: values on a grid of their own are never at the border of one
COINCIDENCE = 0.01
"""Share of common windows below which they are a coincidence: rest in the same pose."""
NEARLY_ALL = 0.95

Hashes = NDArray[np.uint64]
Label = Literal["held-out data", "partly its own data", "its own data", "data of unknown origin"]
UNKNOWN: Label = "data of unknown origin"
"""Nothing says what the model was fitted to, or there is too little to tell."""


@dataclass(frozen=True)
class Fingerprint:
    """The smallest ``hashes`` (rising) of all ``windows`` of a recording; all of them where there are few."""

    hashes: tuple[int, ...]
    windows: int

    @property
    def range(self) -> int:
        """Hashes up to here are among :attr:`hashes` if the recording has them."""
        return self.hashes[-1] if len(self.hashes) >= SMALLEST else (1 << BITS) - 1


@dataclass(frozen=True)
class Common:
    """Which ``share`` of the windows of one recording is known from others, told from ``looked`` of them."""

    share: float
    looked: int

    @property
    def label(self) -> Label:
        """In words."""
        if self.looked == 0:
            return UNKNOWN
        if self.share < COINCIDENCE:
            return "held-out data"
        return "its own data" if self.share >= NEARLY_ALL else "partly its own data"


def fingerprint(recordings: Sequence[Recording], split: Split | None = None) -> Fingerprint:
    """The fingerprint of the fitted part of ``recordings``, guard bands included: filters reach into them."""
    whole = Split() if split is None else Split(split.kind, split.value)
    kept: Hashes = np.zeros(0, np.uint64)
    windows = 0
    for recording in recordings:
        for hashes in window_hashes(recording, whole):
            windows += len(hashes)
            kept = np.unique(np.concatenate([kept, hashes]))[:LARGEST]
    size = max(SMALLEST, windows // WINDOWS_PER_HASH)
    return Fingerprint(tuple(int(value) for value in kept[:size]), windows)


def common_share(known: Sequence[Fingerprint], recordings: Sequence[Recording]) -> Common:
    """Which share of ``recordings`` is among the samples of the ``known`` fingerprints."""
    top = max((each.range for each in known), default=(1 << BITS) - 1)
    seen: Hashes = np.zeros(0, np.uint64)
    for recording in recordings:
        for hashes in window_hashes(recording, Split()):
            seen = np.unique(np.concatenate([seen, hashes[hashes <= np.uint64(top)]]))
    share, looked = 0.0, len(seen)
    for each in known:
        inside = seen[seen <= np.uint64(each.range)]
        looked = min(looked, len(inside))
        if len(inside):
            share += float(np.mean(np.isin(inside, np.array(each.hashes, np.uint64))))
    return Common(min(1.0, share), looked)


def window_hashes(recording: Recording, split: Split) -> Iterator[Hashes]:
    """The hashes of all windows that lie in the fitted part of a recording, block by block."""
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
        usable = split.fitted(rows.t, start, duration) & np.all(np.isfinite(rows.tau), axis=1)
        at = at[there & usable[at].all(axis=1)]
        if len(at):  # a block may hold no window of the fitted part
            yield _hashed(rows.q[at].reshape(len(at), -1), rows.tau[at].reshape(len(at), -1))
        pending = rows.sliced(length, len(rows))


def _hashed(q: Array, tau: Array) -> Hashes:
    """Hashes of windows, (N, values) each; windows without any torque or position are left out."""
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
    """One step of the hash, that of the generator SplitMix64."""
    x = (state ^ value) + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(x ^ (x >> np.uint64(31)))
