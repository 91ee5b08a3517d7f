"""Diagnosis rule: a clock wrong by a factor of 1000; and the motion data used by all rules that need no model."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.log_stream import Part
from rrrgen.lab.identify.bandwidth import TUNING_SAMPLES, motion_bandwidth
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.observations import Recording

SLOW_PERIOD, SLOW_MOTION = 0.05, 0.1
"""A period above 50 ms (s) with a motion below 0.1 Hz: arms are sampled faster, and move faster."""
FAST_PERIOD, FAST_MOTION = 5e-5, 200.0
"""A period below 50 us (s) with a motion above 200 Hz: no arm moves so fast."""
LAG = 10  # samples over which positions are differenced: a tenth of the encoder noise of single differences


@dataclass(frozen=True)
class Motion:
    """The first uninterrupted stretch of a recording (``part``), as the rules that need no model use it.

    ``spec`` is the robot file, ``words`` formulates the faults found, ``period`` is that of the sampling, s.
    """

    spec: Any
    words: Wording
    part: Part
    period: float

    @classmethod
    def of(cls, spec: Any, words: Wording, recording: Recording) -> Motion:
        """The first stretch of ``recording``, cut to at most TUNING_SAMPLES samples."""
        part = next(iter(recording.parts()))
        return cls(spec, words, part.sliced(0, min(len(part), TUNING_SAMPLES)), recording.period)

    @cached_property
    def bandwidth(self) -> float:
        """Bandwidth of the motion, Hz; NaN if no joint moves."""
        try:
            return motion_bandwidth(self.part.q, self.period)
        except InputError:
            return math.nan

    def speeds(self) -> Array:
        """Mean speeds over LAG samples, (N - LAG, n)."""
        return np.asarray((self.part.q[LAG:] - self.part.q[:-LAG]) / (LAG * self.period))


def clock_factor(motion: Motion) -> float:
    """Correction factor of time: 1000 or 1/1000 if sampling rate and motion are implausible by that factor, else 1."""
    slow = motion.period >= SLOW_PERIOD and motion.bandwidth < SLOW_MOTION
    fast = motion.period <= FAST_PERIOD and motion.bandwidth > FAST_MOTION
    return 1e-3 if slow else 1e3 if fast else 1.0


def clock(motion: Motion) -> Iterator[Cause]:
    """Report a clock that makes both sampling and motion implausible by a factor of 1000."""
    factor = clock_factor(motion)
    if factor != 1.0:
        yield motion.words.clock(factor).because(
            f"a period of {motion.period:.4g} s and a motion of {motion.bandwidth:.3g} Hz bandwidth; "
            f"with the other unit {factor * motion.period:.4g} s and {motion.bandwidth / factor:.3g} Hz"
        )
