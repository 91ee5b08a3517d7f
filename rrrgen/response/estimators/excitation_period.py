"""Whether an excitation repeats, and after how many samples."""

from __future__ import annotations

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import DerivationError
from rrrgen.response.response_file import ResponseRecording

SAME = 1e-3  # difference of two periods relative to the excitation: rounding in the file
ALIKE = 0.05  # the same where a period is stated
SHORTEST = 16  # samples


def samples_of(record: ResponseRecording, period: float | None) -> int | None:
    """Samples of a period: as stated (s), or as found in the excitation; None where nothing repeats."""
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
    """The shortest shift that leaves the second half of ``n`` as it is, at most half of its length; None if none does.

    The second half, since an excitation may fade in.
    """
    x = n[len(n) // 4 :] - np.mean(n[len(n) // 4 :])
    power = float(x @ x)
    if not power > 0.0:
        return None
    size = 2 * len(x)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(x)]
    lags = np.arange(len(x))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = correlation / (1.0 - lags / len(x)) / power
    top = (normal[1:-1] >= normal[:-2]) & (normal[1:-1] >= normal[2:]) & (normal[1:-1] > 0.9)
    peaks = np.flatnonzero(top) + 1
    for lag in peaks[peaks >= SHORTEST]:
        part = x[lag:] - x[:-lag]
        if lag <= len(n) // 2 and len(part) >= lag // 2 and np.sqrt(np.mean(part**2)) < SAME * np.sqrt(power / len(x)):
            return int(lag)
    return None
