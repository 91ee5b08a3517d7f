"""A clock that is read in a wrong unit: sampling and motion that no arm has, by powers of 1000."""

from __future__ import annotations

SLOW_PERIOD, SLOW_MOTION = 0.05, 0.1
"""A period above 50 ms (s) with a motion below 0.1 Hz: arms are sampled faster, and move faster."""
FAST_PERIOD, FAST_MOTION = 5e-5, 200.0
"""A period below 50 us (s) with a motion above 200 Hz: no arm moves so fast."""
CREEPING = 0.1
"""Share of SLOW_MOTION that a motion may fall below before the next unit is tried: friction is recorded so slowly."""
THOUSANDS = (1e3, 1e6, 1e9)


def clock_factor(period: float, frequency: float) -> float:
    """Correction factor of time, a power of 1000: the nearest one with which both are plausible, 1 if they are.

    ``period`` (s) is that of the sampling, ``frequency`` (Hz) that of the motion, NaN without any.
    """
    if period >= SLOW_PERIOD and frequency < SLOW_MOTION:
        factors = [1.0 / large for large in THOUSANDS]
        right = (f for f in factors if f * period < SLOW_PERIOD and frequency / f >= CREEPING * SLOW_MOTION)
        return next(right, factors[0])
    if period <= FAST_PERIOD and frequency > FAST_MOTION:
        right = (f for f in THOUSANDS if f * period > FAST_PERIOD and frequency / f <= FAST_MOTION)
        return next(right, THOUSANDS[0])
    return 1.0
