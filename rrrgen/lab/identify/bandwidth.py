"""Choice of the filters from the bandwidth of the motion, for all settings that the user leaves open.

The *bandwidth* B of the motion is the frequency below which 99.9 % of the power of every joint's speed lies, counting
only what stands above the floor of the measuring noise. The row rate is 10 B: the decimation filter then passes torque
and regressor up to 4 B. The torques of the motion lie below that (squares of speeds reach 2 B; with the sines of
gravity and inertia, about 3 B), most of their noise above. A Butterworth filter of the positions has its cut-off at
5 B, above the decimation filter, so that it hardly affects the rows. The variances of a Kalman filter maximise the
likelihood of its innovations.

Only positions of the fitted part of the data are used, never torques or held-out data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError, option_name
from rrrgen.lab.data.preprocessing import (
    CUTOFF_RATIO,
    DEFAULT_ORDER,
    KALMAN,
    Decimator,
    Processing,
    energy_radius,
    reconstruction_reach,
)
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Recording

TUNING_SAMPLES = 50_000
SHORTEST = 64
"""Smallest number of samples of an uninterrupted fitted stretch on which filters are tuned."""
MOTION_POWER = 0.999
RATE_OVER_BANDWIDTH = 10.0  # row rate after decimation over the bandwidth of the motion
CUTOFF_OVER_BANDWIDTH = 5.0  # cut-off of the Butterworth filter over the bandwidth of the motion
HIGHEST_CUTOFF = 0.4  # largest cut-off over the sampling rate
ZERO_PADDING = 4  # zero-padding factor of the spectrum
WINDOW_WIDTH = 2.0  # cycles per window below which 99.9 % of the power of a Blackman-Harris window lies
BINS_PER_OCTAVE = 6
NEAR_FLOOR = 2.5  # mean of a bin over the line through the bins above it, up to which it holds noise alone
LINE_OVER_FLOOR = 12.0  # noise alone exceeds it with the probability exp(-12) a line
END_SAMPLES = 7  # samples from which the speed at the end of a stretch is taken


@dataclass(frozen=True, eq=False)
class SpeedSpectrum:
    """Spectrum of the speed of one joint, its noise floor, and the bandwidth that follows from them.

    ``power`` (K,) is the power density of the speed, (rad/s)^2/Hz, at the frequencies ``f`` (K,), Hz, and ``floor``
    (K,) that of the measuring noise. ``bandwidth`` (Hz) is the frequency below which 99.9 % of the power of the lines
    above the floor lies; ``signal`` and ``noise`` are the RMS speeds of motion and noise below it, rad/s (m/s).
    """

    f: Array
    power: Array
    floor: Array
    bandwidth: float
    signal: float
    noise: float

    @property
    def decibels(self) -> float:
        """Ratio of the RMS speeds of motion and noise within the bandwidth, dB."""
        return 20.0 * float(np.log10(self.signal / max(self.noise, np.finfo(float).tiny)))


Spectra = tuple[SpeedSpectrum | None, ...]


@dataclass(frozen=True)
class Tuning:
    """Complete preprocessing settings ``processing``, and how they were chosen.

    ``by_rule`` names the settings chosen by the rule (``decimate``, ``cutoff``, ``variances``); ``motion`` is the
    bandwidth B (Hz), None if it was not needed; ``period`` (s) is the sampling period, ``on`` (s) the duration of the
    data that the choice is based on. ``spectra`` (n,) are those of the speeds that the bandwidth was taken from, of the
    recording with the fastest motion; None for a joint that does not move. ``low_speed`` (n,) are the speeds below
    which linear friction does not hold, also where the processing leaves no slow rows out for the sake of another law.
    """

    processing: Processing
    period: float
    by_rule: tuple[str, ...] = ()
    motion: float | None = None
    on: float = 0.0
    spectra: tuple[SpeedSpectrum | None, ...] = field(default=(), repr=False, compare=False)
    low_speed: tuple[float, ...] = ()

    @property
    def row_rate(self) -> float:
        """Rate of the rows after decimation, Hz."""
        return 1.0 / (self.period * (self.processing.decimate or 1))

    @property
    def torque_cutoff(self) -> float | None:
        """The -6 dB frequency (Hz) of the filter on torque and regressor; None if they are not filtered."""
        factor = self.processing.decimate or 1
        return None if factor == 1 else CUTOFF_RATIO * 0.5 * self.row_rate

    def sentences(self) -> tuple[str, ...]:
        """Sentences that describe the filters and how they were chosen."""
        return (*self._bandwidth_sentence(), self._motion_sentence(), self._torque_sentence())

    def _bandwidth_sentence(self) -> Iterator[str]:
        """Bandwidth with RMS speeds of motion and noise: of the fastest joint and of the one least above the noise."""
        moving = {joint: spectrum for joint, spectrum in enumerate(self.spectra, start=1) if spectrum is not None}
        if not moving:
            return
        fastest = max(moving, key=lambda joint: moving[joint].bandwidth)
        weakest = min(moving, key=lambda joint: moving[joint].decibels)
        text = " and ".join(
            f"{moving[joint].signal:.3g} at joint {joint} ({moving[joint].decibels:.0f} dB above the noise)"
            for joint in dict.fromkeys((fastest, weakest))
        )
        yield f"bandwidth of the motion: {self.motion:.3g} Hz, that of joint {fastest}; RMS speed {text}"

    def _motion_sentence(self) -> str:
        method, chosen = self.processing.method, self.processing
        if method == "logged":
            return "motion: speeds and accelerations as recorded"
        if method == "differences":
            return "motion: central differences, unfiltered"
        if method == "butterworth":
            times = f"{CUTOFF_OVER_BANDWIDTH:g} times the bandwidth of the motion"
            reason = times if "cutoff" in self.by_rule else "as named"
            order = chosen.order or DEFAULT_ORDER
            return f"motion: zero-phase Butterworth of order {order}, cut-off {chosen.cutoff:.3g} Hz ({reason})"
        name = "Kalman smoother" if method == "kalman" else "Kalman filter"
        reason = "tuned by its innovations" if "variances" in self.by_rule else "variances as named"
        return f"motion: {name}, {reason}"

    def _torque_sentence(self) -> str:
        factor, rate = self.processing.decimate or 1, 1.0 / self.period
        if self.torque_cutoff is None:
            what = f"torque and regressor: unfiltered, rows at {rate:.4g} Hz"
        else:
            what = (
                f"torque and regressor: filtered at {self.torque_cutoff:.3g} Hz, a row for {factor} samples of "
                f"{rate:.4g} Hz"
            )
        if "decimate" not in self.by_rule:
            return f"{what} (as named)"
        if factor == 1:
            return f"{what} (every sample stays: the bandwidth of the motion is {self.motion:.3g} Hz)"
        return f"{what} ({RATE_OVER_BANDWIDTH:g} rows for a cycle of {self.motion:.3g} Hz, the bandwidth of the motion)"

    def to_json(self) -> dict[str, object]:
        """The filters and their choice as plain data for JSON."""
        return {
            "sampling_rate": 1.0 / self.period,
            "row_rate": self.row_rate,
            "torque_cutoff": self.torque_cutoff,
            "motion_bandwidth": self.motion,
            "joint_bandwidths": [None if spectrum is None else spectrum.bandwidth for spectrum in self.spectra],
            "rms_speeds": [None if spectrum is None else spectrum.signal for spectrum in self.spectra],
            "rms_noise_of_speeds": [None if spectrum is None else spectrum.noise for spectrum in self.spectra],
            "chosen_by_rule": list(self.by_rule),
            "chosen_on_seconds": self.on,
            "in_words": list(self.sentences()),
        }


def tune(processing: Processing, recordings: Sequence[Recording], split: Split | None = None) -> Tuning:
    """Choose the preprocessing settings that ``processing`` leaves None from the bandwidth of the motion.

    The choice is based on the positions in the fitted part of ``recordings``, given by ``split`` (all if None).
    Recordings sampled at different rates share one decimation factor, that of the slowest. Raises :class:`InputError`
    if the fitted stretches are too short or no joint moves.
    """
    from rrrgen.lab.data.kalman import resting_joints, tune_stretches

    period = max(recording.period for recording in recordings)
    kalman = processing.method in KALMAN and not (processing.var_eta and processing.var_xi)
    cutoff = processing.method == "butterworth" and processing.cutoff is None
    open_ = [("decimate", processing.decimate is None), ("cutoff", cutoff), ("variances", kalman)]
    by_rule = tuple(name for name, left in open_ if left)
    if not by_rule:
        return Tuning(processing, period)
    samples = TUNING_SAMPLES // len(recordings)
    settings = (["cutoff"] if cutoff or kalman else []) + (["decimate"] if processing.decimate is None else [])
    positions = [
        (recording.period, fitted_stretches(recording, split or Split(), samples, settings)) for recording in recordings
    ]
    on = sum(step * len(stretch.q) for step, stretches in positions for stretch in stretches)
    motion: float | None = None
    spectra: Spectra = ()
    if processing.decimate is None or cutoff:
        spectra = max((stretch_spectra(stretches, step) for step, stretches in positions), key=largest_bandwidth)
        motion = largest_bandwidth(spectra)
    if processing.decimate is None and motion is not None:
        processing = replace(processing, decimate=max(1, int(1.0 / (period * RATE_OVER_BANDWIDTH * motion))))
    if cutoff and motion is not None:
        processing = replace(processing, cutoff=min(CUTOFF_OVER_BANDWIDTH * motion, HIGHEST_CUTOFF / period))
    if kalman:
        tuned_on = [stretch.q for stretch in positions[0][1]]
        if resting := [recordings[0].joints[k] for k in resting_joints(tuned_on)]:
            if len(resting) == len(recordings[0].joints):
                raise InputError("no joint moves in the recording")
            what = f"joint {resting[0]} does" if len(resting) == 1 else f"joints {' and '.join(resting)} do"
            raise InputError(
                f"{what} not move at all, so that the Kalman filter cannot separate noise from motion: "
                f"{option_name('method')} butterworth needs no noise"
            )
        smoother = tune_stretches(tuned_on, positions[0][0])
        eta, xi = (tuple(float(x) for x in np.atleast_1d(v)) for v in (smoother.var_eta, smoother.var_xi))
        processing = replace(processing, var_eta=processing.var_eta or eta, var_xi=processing.var_xi or xi)
    return Tuning(processing, period, by_rule, motion, on, spectra)


@dataclass(frozen=True)
class PositionStretch:
    """Uninterrupted positions ``q`` (N, n) that begin at sample ``first`` of the stretch ``segment`` of a recording."""

    q: Array
    segment: int
    first: int

    @property
    def end(self) -> int:
        """Index, within the stretch of the recording, of the sample after the last one."""
        return self.first + len(self.q)


def fitted_stretches(
    recording: Recording,
    split: Split,
    limit: int = TUNING_SAMPLES,
    settings: Sequence[str] = ("cutoff", "decimate"),
) -> list[PositionStretch]:
    """Uninterrupted stretches of fitted positions from the beginning of a recording, up to ``limit`` samples in all.

    Raises :class:`InputError` if no stretch is long enough to tune filters on it; ``settings`` name what has to be
    stated to do without.
    """
    start, duration = recording.span
    stretches: list[PositionStretch] = []
    count = 0
    for part in recording.parts():
        q = part.coordinates(recording.period)
        fitted = split.is_fitted(part.t, start, duration)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], fitted.astype(np.int8), [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            taken = PositionStretch(q[begin : min(end, begin + limit - count)], part.segment, part.first + int(begin))
            if stretches and (stretches[-1].segment, stretches[-1].end) == (taken.segment, taken.first):
                taken = PositionStretch(
                    np.concatenate([stretches[-1].q, taken.q]), taken.segment, stretches.pop().first
                )
            stretches.append(taken)
            count = sum(len(stretch.q) for stretch in stretches)
            if count >= limit:
                break
        if count >= limit:
            break
    long = [stretch for stretch in stretches if len(stretch.q) >= SHORTEST]
    if not long:
        whole = split.kind == "none"
        stretch, remedy = ("uninterrupted", "record longer") if whole else ("fitted", "fit longer parts of the data")
        raise InputError(
            f"no {stretch} stretch has the {SHORTEST} samples that filters are tuned on: {remedy}, or name "
            f"{' and '.join(settings)}"
        )
    return long


def stretch_spectra(stretches: Sequence[PositionStretch], period: float) -> Spectra:
    """Spectra of the speeds (n,) in the fitted stretches of a recording.

    They are estimated twice: from the stretches alone, which resolve slow motion poorly, and with the gaps between them
    interpolated, which adds kinks. Both errors enlarge the bandwidth, so those with the smaller one are returned.
    """
    apart = speed_spectra([stretch.q for stretch in stretches], period)
    if len(stretches) == 1:
        return apart
    return min(apart, speed_spectra(bridge_gaps(stretches), period), key=largest_bandwidth)


def largest_bandwidth(spectra: Spectra) -> float:
    """The bandwidth of the motion, Hz: the largest of all joints."""
    return max(spectrum.bandwidth for spectrum in spectra if spectrum is not None)


def bridge_gaps(stretches: Sequence[PositionStretch]) -> list[Array]:
    """Positions of whole stretches of the recording, with held-out gaps interpolated by cubics.

    The cubics match position and speed at both ends of a gap; long stretches resolve slow motion.
    """
    whole: list[list[Array]] = []
    before: PositionStretch | None = None
    for stretch in stretches:
        if before is not None and before.segment == stretch.segment:
            whole[-1] += [_cubic(before.q, stretch.q, stretch.first - before.end), stretch.q]
        else:
            whole.append([stretch.q])
        before = stretch
    return [np.concatenate(pieces) for pieces in whole]


def _cubic(before: Array, after: Array, gap: int) -> Array:
    """Positions in the ``gap`` samples between two stretches, interpolated by a cubic.

    At its ends the cubic has the positions and speeds of the stretches; the speeds are those of parabolas fitted to the
    samples next to the gap.
    """
    powers = np.arange(float(END_SAMPLES))[:, None] ** np.arange(3)
    slope = np.linalg.pinv(powers)[1]  # slope of the parabola at the first of its samples
    start, end = -slope @ before[: -END_SAMPLES - 1 : -1], slope @ after[:END_SAMPLES]
    length = gap + 1
    s = np.arange(1, length)[:, None] / length
    inside = (2 * s + 1) * (1 - s) ** 2 * before[-1] + s**2 * (3 - 2 * s) * after[0]
    return np.asarray(inside + length * (s * (1 - s) ** 2 * start - s**2 * (1 - s) * end))


def motion_bandwidth(q: Array | Sequence[Array], period: float) -> float:
    """The frequency (Hz) below which 99.9 % of the power of every joint's speed lies, without the measuring noise.

    ``q`` (N, n), or several stretches; ``period`` is that of the sampling, s. Raises :class:`InputError` if no joint
    moves.
    """
    return largest_bandwidth(speed_spectra(q, period))


def speed_spectra(q: Array | Sequence[Array], period: float) -> Spectra:
    """Spectra of the speeds of all joints; None for a joint that does not move more than the noise.

    ``q`` (N, n), or several stretches: the power is then averaged over those at least half as long as the longest.
    ``period`` is that of the sampling, s. Raises :class:`InputError` if no joint moves.

    Differences of the positions have the power of the speed times ``(sin(pi f Ts) / (pi f Ts))^2``, which is divided
    out. Their window is that of Blackman and Harris, whose side lobes at -92 dB keep strong slow motion out of the
    floor between 0 and half the sampling rate.
    """
    from scipy.signal.windows import blackmanharris

    stretches = [q] if isinstance(q, np.ndarray) else list(q)
    longest = max(map(len, stretches))
    alike = [stretch for stretch in stretches if 2 * len(stretch) >= longest]
    length = min(map(len, alike)) - 1
    window, padded = blackmanharris(length, sym=False)[:, None], ZERO_PADDING * length
    f = np.fft.rfftfreq(padded, period)
    scale = 2.0 / (period * np.sum(window**2) * np.sinc(f * period)[:, None] ** 2)
    speeds = (np.diff(x[: length + 1], axis=0) * window for x in alike)
    power = scale * np.mean([np.abs(np.fft.rfft(speed, padded, axis=0)) ** 2 for speed in speeds], axis=0)
    spectra = tuple(_speed_spectrum(f, column, length * period) if column.any() else None for column in power.T)
    if not any(spectra):
        raise InputError("no joint moves in the recording")
    return spectra


def _speed_spectrum(f: Array, power: Array, duration: float) -> SpeedSpectrum | None:
    """Separate the lines of the motion from the noise in one spectrum from a stretch of ``duration`` s; None without.

    The bandwidth holds 99.9 % of the power of *all* lines above the floor. The last line above it would be one of the
    noise, far up, which exceeds the floor by chance. Lines in the upper octave are those of a drive or an encoder (of
    the TX40 at 2.3 kHz) and count only if there are no others.
    """
    floor, noisy = noise_floor(f, power, duration)
    lines = np.where((power > LINE_OVER_FLOOR * floor) & ~noisy, power, 0.0)
    if np.any(lines[f < 0.5 * f[-1]]):
        lines[f >= 0.5 * f[-1]] = 0.0
    total = np.cumsum(lines)
    if total[-1] <= 0.0:
        return None
    last = int(np.argmax(total >= MOTION_POWER * total[-1]))
    bandwidth = max(float(f[last]) - WINDOW_WIDTH / duration, 1.0 / duration)
    inside = f <= f[last]
    signal, noise = (float(np.sqrt(np.sum(x[inside]) * f[1])) for x in (lines, floor))
    return SpeedSpectrum(f, power, floor, bandwidth, signal, noise)


def noise_floor(f: Array, power: Array, duration: float) -> tuple[Array, NDArray[np.bool_]]:
    """Power density (K,) of the noise in a spectrum ``power`` (K,), and a mask (K,) of where there is nothing else.

    The floor is a power law ``c f^s`` of the frequencies ``f`` (K,), Hz, with 0 <= s <= 2: a white error of the
    positions has s = 2, speeds estimated by a drive, or filtered positions, have less. It is fitted to the means of
    logarithmic bins (a mean, as rounding errors of a periodic motion are lines, between which a median would look),
    first to the upper octave, where the motion seldom reaches, then to one bin more below as long as that lies near
    the line. The slope is the median of those of all pairs of bins (Theil and Sen), which a resonance does not tilt.
    """
    octaves = np.log2(max(2.0, f[-1] * duration))
    edges = f[-1] * 2.0 ** (-np.arange(int(BINS_PER_OCTAVE * octaves)) / BINS_PER_OCTAVE)
    bounds = [len(f), *(int(k) for k in np.searchsorted(f, edges[1:]))]
    bins = [slice(low, high) for high, low in pairwise(bounds) if high - low >= ZERO_PADDING]
    x = np.log([float(np.mean(f[part])) for part in bins])
    y = np.log([max(float(np.mean(power[part])), np.finfo(float).tiny) for part in bins])
    used = min(len(x), BINS_PER_OCTAVE)
    while True:
        slope, level = _line(x[:used], y[:used])
        if used == len(x) or y[used] - slope * x[used] - level > np.log(NEAR_FLOOR):
            break
        used += 1
    noisy = np.zeros(len(f), np.bool_)
    for part, above in zip(bins, y - slope * x - level, strict=True):
        noisy[part] = above <= np.log(NEAR_FLOOR)
    return np.asarray(np.exp(level) * np.maximum(f, f[1]) ** slope), noisy


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope, between 0 and 2, and level of the line through points, from medians (Theil and Sen)."""
    i, k = np.triu_indices(len(x), 1)
    slope = float(np.clip(np.median((y[i] - y[k]) / (x[i] - x[k])), 0.0, 2.0)) if len(i) else 0.0
    return slope, float(np.median(y - slope * x))


def reach(tuning: Tuning) -> float:
    """Default width (s) of a guard band: half the width of the response from samples to rows.

    It is the reach of the reconstruction, plus the radius of 99 % of the energy of the decimation filter's response.
    """
    decimate = Decimator(tuning.processing.decimate or 1)
    samples = 0 if decimate.factor == 1 else energy_radius(decimate.taps()[:, None])
    return (samples + reconstruction_reach(tuning.processing, tuning.period)) * tuning.period
