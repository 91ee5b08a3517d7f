"""Checks a simulated experiment: does the arm follow the motion, and does its control loop oscillate?

A joint follows where its largest deviation is small against its motion, or no larger than what its load bends the loop
by; PD control without a model deviates by the load over its gain. A loop oscillates where the torques swing at one
frequency that neither the motion nor the load has. The swing is looked for in windows: in each, the spectrum of the
torque less that of the motion, above the band of motion and loop, must have most of its power in one peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.plant.experiment import SimulatedRecording

SHARE = 0.2
"""Largest deviation of a joint that follows, over the range of its motion."""

BEND = 2.0
"""Largest deviation over that of the largest load at rest: a step of the load overshoots by less than this."""

STEPS = 10.0
"""A deviation of so many steps of the encoder is no failure, however small the motion."""

SWING = 0.1
"""Least amplitude of an oscillation over the largest torque that the motion takes."""

PEAK = 0.6
"""Least share of the power above the band that the peak of an oscillation holds; noise spreads it over all lines."""

CHATTER = 0.5
"""Steps of the encoder by which an oscillation moves its joint at least: a stable loop that stands still may jump
between two steps, and its torques then swing by what the gains make of one."""

BAND = 3.0
"""An oscillation is looked for above this many times the bandwidth of the loop: friction shakes the arm up to there."""

WINDOW = 0.5
"""Length of a window, s: long enough to tell lines 2 Hz apart."""

LASTING = 3
"""Number of successive windows, overlapping by half, that an oscillation lasts: what decays sooner is a transient."""

QUIET = 1e-3
"""Share of the power of the torques of the motion that may lie above what counts as its band."""


@dataclass(frozen=True)
class Oscillation:
    """An oscillation of ``joint`` (from 0) at ``frequency`` (Hz) from ``start`` to ``stop`` (s).

    ``amplitude`` is the largest of its torque, N m (N).
    """

    joint: int
    frequency: float
    amplitude: float
    start: float
    stop: float


@dataclass(frozen=True)
class Tracking:
    """How the arm followed the motion: ``deviation`` (n,) is the largest of every joint, ``span`` (n,) its motion.

    In rad (m). ``lost`` are the joints (from 0) that do not follow, ``oscillations`` one per joint that oscillates.
    """

    deviation: tuple[float, ...]
    span: tuple[float, ...]
    lost: tuple[int, ...]
    oscillations: tuple[Oscillation, ...]

    @property
    def ok(self) -> bool:
        """Whether every joint follows and none oscillates."""
        return not self.lost and not self.oscillations


def check_tracking(
    recording: SimulatedRecording,
    torques: Array,
    load: Array,
    stiffness: Array,
    bandwidth: float,
    resolution: Array,
    prismatic: Array,
) -> Tracking:
    """Check the ``recording`` of m samples of a motion that takes the torques ``torques`` (m, n) without friction.

    ``load`` (n,) is the largest torque with friction and ``stiffness`` (n,) the gain of the loop, N m/rad (N/m);
    ``bandwidth`` (Hz) that of the fastest loop, ``resolution`` (n,) the steps of the encoders. ``prismatic`` (n,) says
    which joints move along a line: those of one kind are compared with each other.
    """
    deviation = np.abs(recording.true_q - recording.reference).max(axis=0)
    span = np.ptp(recording.reference, axis=0)
    largest = np.array([span[prismatic == kind].max() for kind in prismatic])
    bent = np.minimum(BEND * load / stiffness, SHARE * largest)
    allowed = np.maximum(np.maximum(SHARE * span, bent), STEPS * resolution)
    lost = tuple(int(joint) for joint in np.flatnonzero(deviation > allowed))
    oscillations = [
        oscillation(recording.held[:, i], torques[:, i], load[i], i, recording.period, bandwidth)
        for i in range(len(span))
    ]
    error = recording.true_q - recording.reference
    swinging = tuple(
        swing
        for swing in oscillations
        if swing is not None
        and _amplitude(error[:, swing.joint], swing, recording.period) >= CHATTER * resolution[swing.joint]
    )
    return Tracking(tuple(deviation.tolist()), tuple(span.tolist()), lost, swinging)


def _amplitude(error: Array, swing: Oscillation, period: float) -> float:
    """Amplitude, rad (m), with which the position ``error`` (m,) swings at the frequency of an oscillation."""
    part = error[round(swing.start / period) : round(swing.stop / period)]
    window = np.hanning(len(part))
    turning = np.exp(-2j * np.pi * swing.frequency * period * np.arange(len(part)))
    return float(2.0 * abs(((part - part.mean()) * window) @ turning) / window.sum())


def oscillation(
    torque: Array, expected: Array, load: float, joint: int, period: float, bandwidth: float
) -> Oscillation | None:
    """The longest oscillation of a joint whose ``torque`` (m,) should be ``expected`` (m,); None if there is none.

    Both in N m (N), sampled with ``period`` (s); ``load`` is the largest torque that the motion takes with friction.
    """
    length = min(len(torque), round(WINDOW / period))
    if length < 16 or load <= 0.0:
        return None
    line = 1.0 / (length * period)
    lowest = max(BAND * bandwidth, 1.5 * band_of(expected, period)) / line
    first = int(np.ceil(max(lowest, 4.0)))
    if first + 4 > length // 2:
        return None
    shape = np.hanning(length)
    runs: list[list[tuple[int, int, float]]] = [[]]
    for start in range(0, len(torque) - length + 1, length // 2):
        part = (torque - expected)[start : start + length]
        power = np.abs(np.fft.rfft((part - part.mean()) * shape)) ** 2
        peak = first + int(power[first:].argmax())
        near = power[max(first, peak - 2) : peak + 3].sum()
        amplitude = float(np.sqrt(power[peak])) / (0.5 * length * 0.5)  # a Hann window halves a sine
        clear = near >= PEAK * power[first:].sum() and amplitude >= SWING * load
        if clear and runs[-1] and abs(peak - runs[-1][-1][1]) <= 2:
            runs[-1].append((start, peak, amplitude))
        else:
            runs.append([(start, peak, amplitude)] if clear else [])
    windows = 1 + (len(torque) - length) // (length // 2)
    longest: list[Any] = max(runs, key=len)
    if len(longest) < min(LASTING, windows):
        return None
    strongest = max(longest, key=lambda window: window[2])
    stop = (longest[-1][0] + length) * period
    return Oscillation(joint, strongest[1] * line, strongest[2], longest[0][0] * period, stop)


def band_of(torque: Array, period: float) -> float:
    """The frequency (Hz) below which all but :data:`QUIET` of the power of ``torque`` lies; 0 for a constant one."""
    power = np.abs(np.fft.rfft((torque - torque.mean()) * np.hanning(len(torque)))) ** 2
    total = np.cumsum(power)
    if total[-1] <= 0.0:
        return 0.0
    return float(np.searchsorted(total, (1.0 - QUIET) * total[-1])) / (len(torque) * period)
