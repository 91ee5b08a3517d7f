"""Detection of the period of an excitation: whether it repeats, and after how many samples."""

from __future__ import annotations

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.response_file import ResponseRecording

SAME = 1e-3  # largest relative difference of two equal periods: rounding of the numbers in the file
ALIKE = 0.05  # the same where the user states the period
SHORTEST = 16  # shortest period, samples
LEAST_OVERLAP = 0.05  # least share of the recording by which two periods must overlap to be compared
FLAT = 5e-4  # bound on the second differences of the logarithms of a multisine's lines; a sweep has 3e-3, noise 1
LEAST_LINES = 8
STRONG = 0.03  # lines below this share of the largest may be leakage, which is smooth for every excitation


def samples_of(record: ResponseRecording, period: float | None) -> int | None:
    """Number of samples of a period: of the stated ``period`` (s), or found in the excitation; None if none repeats."""
    if period is None:
        return find_period(record.n)
    samples = round(period / record.period)
    if samples < 2 or abs(samples * record.period - period) > 1e-3 * record.period * max(1.0, 1e-3 * samples):
        raise DerivationError(
            f"{record.name}: the period of {period:.9g} s is not a whole number of samples of {record.period:.9g} s"
        )
    last, before = record.n[-samples:], record.n[-2 * samples : -samples]
    if len(before) == samples and np.std(last - before) > ALIKE * np.std(last):
        raise DerivationError(
            f"{record.name}: the excitation does not repeat after {period:.9g} s; leave the key 'period' out and it is "
            "found, where there is one"
        )
    return samples


def find_period(n: Array) -> int | None:
    """Find the period of ``n`` (samples): the shortest shift that maps it to itself; None if there is none.

    The result is longer than half of ``n`` where less than two periods are recorded. It is the length of ``n`` for a
    single period of a multisine, which is recognized by spectral lines whose magnitudes follow a smooth curve.
    """
    found = _shift(n[len(n) // 4 :], len(n) // 2)  # the first quarter apart, since an excitation may fade in
    if found is None:
        found = _shift(n, int((1.0 - LEAST_OVERLAP) * len(n)))
    return len(n) if found is None and _is_one_period(n) else found


def _shift(n: Array, longest: int) -> int | None:
    """The shortest lag up to ``longest`` at which ``n`` repeats."""
    x = n - np.mean(n)
    power = float(x @ x)
    if not power > 0.0:
        return None
    size = 2 * len(x)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(x)]
    # the correlation of the overlapping parts is divided by the power of each
    cumulated = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(len(x))
    both = np.sqrt(cumulated[len(x) - lags] * (cumulated[-1] - cumulated[lags]))
    normal = correlation / np.maximum(both, 1e-12 * power)
    top = (normal[1:-1] >= normal[:-2]) & (normal[1:-1] >= normal[2:]) & (normal[1:-1] > 0.9)
    peaks = np.flatnonzero(top) + 1
    for lag in peaks[(peaks >= SHORTEST) & (peaks <= longest)]:
        part = x[lag:] - x[:-lag]
        if len(part) >= max(LEAST_OVERLAP * len(x), SHORTEST) and np.sqrt(np.mean(part**2)) < SAME * np.std(x):
            return int(lag)
    return None


def _is_one_period(n: Array) -> bool:
    magnitude = np.abs(np.fft.rfft(n - np.mean(n)))
    lines = magnitude[magnitude > STRONG * magnitude.max()] if magnitude.max() > 0.0 else magnitude[:0]
    return len(lines) >= LEAST_LINES and float(np.median(np.abs(np.diff(np.log(lines), 2)))) < FLAT
