"""Choice of the filters from the bandwidth of the motion, for all settings that the user leaves open.

The *bandwidth* B of the motion is the frequency below which 99.9 % of the power of every joint's speed lies, after the
measuring noise is subtracted. The row rate is 10 B: the decimation filter then passes torque and regressor up to 4 B.
The torques of the motion lie below that (squares of speeds reach 2 B; with the sines of gravity and inertia, about
3 B), most of their noise above. A Butterworth filter of the positions has its cut-off at 5 B, above the decimation
filter, so that it hardly affects the rows. The variances of a Kalman filter maximise the likelihood of its innovations.

Only positions of the fitted part of the data are used, never torques or held-out data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import CUTOFF_RATIO, DEFAULT_ORDER, KALMAN, Decimator, Processing
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
WINDOW_WIDTH = 1.5  # cycles per window below which 99.9 % of the power of a Hann window lies
END_SAMPLES = 7  # samples from which the speed at the end of a stretch is taken
ENERGY_SHARE = 0.99  # share of the energy of an impulse response that defines its width


@dataclass(frozen=True)
class Tuning:
    """Complete preprocessing settings ``processing``, and how they were chosen.

    ``by_rule`` names the settings chosen by the rule (``decimate``, ``cutoff``, ``variances``); ``motion`` is the
    bandwidth B (Hz), None if it was not needed; ``period`` (s) is the sampling period, ``on`` (s) the duration of the
    data that the choice is based on.
    """

    processing: Processing
    period: float
    by_rule: tuple[str, ...] = ()
    motion: float | None = None
    on: float = 0.0

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
        """Two sentences that describe the filters and how they were chosen."""
        return (self._motion_sentence(), self._torque_sentence())

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
    from rrrgen.lab.data.kalman import tune_stretches

    period = max(recording.period for recording in recordings)
    kalman = processing.method in KALMAN and not (processing.var_eta and processing.var_xi)
    cutoff = processing.method == "butterworth" and processing.cutoff is None
    open_ = [("decimate", processing.decimate is None), ("cutoff", cutoff), ("variances", kalman)]
    by_rule = tuple(name for name, left in open_ if left)
    if not by_rule:
        return Tuning(processing, period)
    each = TUNING_SAMPLES // len(recordings)
    found = [(recording.period, fitted_stretches(recording, split or Split(), each)) for recording in recordings]
    on = sum(step * len(stretch.q) for step, stretches in found for stretch in stretches)
    motion = None
    if processing.decimate is None or cutoff:
        motion = max(bandwidth_of(stretches, step) for step, stretches in found)
    if processing.decimate is None and motion is not None:
        processing = replace(processing, decimate=max(1, int(1.0 / (period * RATE_OVER_BANDWIDTH * motion))))
    if cutoff and motion is not None:
        processing = replace(processing, cutoff=min(CUTOFF_OVER_BANDWIDTH * motion, HIGHEST_CUTOFF / period))
    if kalman:
        smoother = tune_stretches([stretch.q for stretch in found[0][1]], found[0][0])
        eta, xi = (tuple(float(x) for x in np.atleast_1d(v)) for v in (smoother.var_eta, smoother.var_xi))
        processing = replace(processing, var_eta=processing.var_eta or eta, var_xi=processing.var_xi or xi)
    return Tuning(processing, period, by_rule, motion, on)


@dataclass(frozen=True)
class Stretch:
    """Uninterrupted positions ``q`` (N, n) that begin at sample ``first`` of the stretch ``segment`` of a recording."""

    q: Array
    segment: int
    first: int

    @property
    def end(self) -> int:
        """Index, within the stretch of the recording, of the sample after the last one."""
        return self.first + len(self.q)


def fitted_stretches(recording: Recording, split: Split, limit: int = TUNING_SAMPLES) -> list[Stretch]:
    """Uninterrupted stretches of fitted positions from the beginning of a recording, up to ``limit`` samples in all.

    Raises :class:`InputError` if no stretch is long enough to tune filters on it.
    """
    start, duration = recording.span
    found: list[Stretch] = []
    count = 0
    for part in recording.parts():
        fitted = split.fitted(part.t, start, duration)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], fitted.astype(np.int8), [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            taken = Stretch(part.q[begin : min(end, begin + limit - count)], part.segment, part.first + int(begin))
            if found and (found[-1].segment, found[-1].end) == (taken.segment, taken.first):
                taken = Stretch(np.concatenate([found[-1].q, taken.q]), taken.segment, found.pop().first)
            found.append(taken)
            count = sum(len(stretch.q) for stretch in found)
            if count >= limit:
                break
        if count >= limit:
            break
    long = [stretch for stretch in found if len(stretch.q) >= SHORTEST]
    if not long:
        raise InputError(
            f"no fitted stretch has the {SHORTEST} samples that filters are tuned on: split the data otherwise, or "
            "name method, cutoff and decimate"
        )
    return long


def bandwidth_of(stretches: Sequence[Stretch], period: float) -> float:
    """The bandwidth of the motion (Hz) from its fitted stretches.

    It is estimated twice: from the stretches alone, which resolve slow motion poorly, and with the gaps between them
    interpolated, which adds kinks. Both errors enlarge the bandwidth, so the smaller estimate is returned.
    """
    apart = motion_bandwidth([stretch.q for stretch in stretches], period)
    return min(apart, motion_bandwidth(bridged(stretches), period)) if len(stretches) > 1 else apart


def bridged(stretches: Sequence[Stretch]) -> list[Array]:
    """Positions of whole stretches of the recording, with held-out gaps interpolated by cubics.

    The cubics match position and speed at both ends of a gap; long stretches resolve slow motion.
    """
    whole: list[list[Array]] = []
    before: Stretch | None = None
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
    instants = np.arange(float(END_SAMPLES))[:, None] ** np.arange(3)
    slope = np.linalg.pinv(instants)[1]  # slope of the parabola at the first of its samples
    start, end = -slope @ before[: -END_SAMPLES - 1 : -1], slope @ after[:END_SAMPLES]
    length = gap + 1
    s = np.arange(1, length)[:, None] / length
    inside = (2 * s + 1) * (1 - s) ** 2 * before[-1] + s**2 * (3 - 2 * s) * after[0]
    return np.asarray(inside + length * (s * (1 - s) ** 2 * start - s**2 * (1 - s) * end))


def motion_bandwidth(q: Array | Sequence[Array], period: float) -> float:
    """The frequency (Hz) below which 99.9 % of the power of every joint's speed lies, without the measuring noise.

    ``q`` (N, n), or several stretches: the power is then averaged over those at least half as long as the longest.
    Position noise that is white has a power proportional to ``4 sin^2(pi f Ts)`` in the differences; its level is
    estimated from the upper half of the spectrum and subtracted, as is the width 1.5/T of a window of length T.
    ``period`` is Ts in s. Raises :class:`InputError` if no joint moves.
    """
    stretches = [q] if isinstance(q, np.ndarray) else list(q)
    longest = max(map(len, stretches))
    alike = [stretch for stretch in stretches if 2 * len(stretch) >= longest]
    length = min(map(len, alike)) - 1
    window, padded = np.hanning(length)[:, None], ZERO_PADDING * length
    speeds = (np.diff(x[: length + 1], axis=0) * window for x in alike)
    power = np.sum([np.abs(np.fft.rfft(speed, padded, axis=0)) ** 2 for speed in speeds], axis=0)
    power = power[:, np.sum(power, axis=0) > 0]
    if power.shape[1] == 0:
        raise InputError("no joint moves in the recording")
    shape = 4.0 * np.sin(np.pi * np.arange(len(power)) / padded)[:, None] ** 2
    upper = slice(len(power) // 2, None)
    # the median of a squared modulus is ln 2 of its mean
    noise = np.median(power[upper] / shape[upper], axis=0) / np.log(2.0)
    total = np.cumsum(power - noise * shape, axis=0)
    last = np.max(np.argmax(total >= MOTION_POWER * np.max(total, axis=0), axis=0))
    resolution = 1.0 / (period * length)
    return float(max((last + 1) / ZERO_PADDING - WINDOW_WIDTH, 1.0) * resolution)


def reach(tuning: Tuning) -> float:
    """Default width (s) of a guard band: half the width of the impulse response from samples to rows.

    It is the radius that holds 99 % of the energy of the response of the reconstructed acceleration, plus that of the
    decimation filter.
    """
    processing, decimate = tuning.processing, Decimator(tuning.processing.decimate or 1)
    samples = 0 if decimate.factor == 1 else _energy_radius(decimate.taps()[:, None])
    if processing.method != "logged":
        method = processing.reconstructor()
        half = method.memory(tuning.period)
        joints = len(processing.var_eta or (0.0,))
        impulse = np.zeros((2 * half + 1, joints))
        impulse[half] = 1.0
        samples += _energy_radius(method(np.arange(len(impulse)) * tuning.period, impulse).ddq)
    return samples * tuning.period


def _energy_radius(response: Array) -> int:
    """Samples on either side of the middle of ``response`` (2 h + 1, k) that hold 99 % of the energy of each column."""
    half = len(response) // 2
    energy = np.square(response)
    both = np.concatenate([energy[half : half + 1], energy[half + 1 :] + energy[:half][::-1]])
    total = np.cumsum(both, axis=0)
    return int(np.max(np.argmax(total >= ENERGY_SHARE * total[-1], axis=0)))
