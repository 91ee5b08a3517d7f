"""The true frequencies that a resonance of a sampled recording may stand for, and how a second rate tells them apart.

Sampling at the rate fs folds the pole of a mode: with its frequency f and damping zeta, ``zeta f`` and ``f sqrt(1 -
zeta^2)`` up to multiples of fs and sign are all that the samples hold. Every ``|k fs +- f_d|`` below the bandwidth of
what is measured is a candidate, each with the decay of the measured mode. Behind a sampled hold all have the same
poles, so that nothing in one recording decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rrrgen.lab.response.response_model import Resonance

ANALOGUE_BANDWIDTH = 5.0  # of drives and sensors, over the sampling rate, where nothing else is known


def aliases(mode: Resonance, rate: float, bandwidth: float | None = None) -> list[Resonance]:
    """All modes below the analogue ``bandwidth`` (Hz) with the samples of ``mode`` at ``rate`` (Hz); ``mode`` leads.

    The default bandwidth is five times the rate. The standard deviations of the frequencies are that of the mode;
    those of the dampings keep their share of the value.
    """
    highest = ANALOGUE_BANDWIDTH * rate if bandwidth is None else bandwidth
    decay = mode.damping * mode.frequency
    damped = mode.frequency * math.sqrt(max(0.0, 1.0 - mode.damping**2))
    found = [mode]
    for k in range(1, int(highest / rate) + 2):
        for image in (k * rate - damped, k * rate + damped):
            frequency = math.hypot(image, decay)
            if frequency <= highest:
                damping = decay / frequency
                share = None if mode.damping_std is None or not mode.damping else mode.damping_std / mode.damping
                std = None if share is None else abs(share * damping)
                found.append(replace(mode, frequency=frequency, damping=damping, damping_std=std))
    return found


def rates_decide(rate: float, other: float, bandwidth: float) -> bool:
    """Whether no two frequencies below ``bandwidth`` (Hz) have the same images at both rates (Hz)."""
    low, high = sorted((rate, other))
    multiples = (k * high for k in range(1, int(2.0 * bandwidth / high) + 1))
    return not any(abs(multiple / low - round(multiple / low)) < 1e-6 for multiple in multiples)


def second_rate(rate: float) -> float:
    """A second sampling rate (Hz) that tells the candidates apart: a tenth faster, no simple ratio of the first."""
    return 1.1 * rate if rates_decide(rate, 1.1 * rate, ANALOGUE_BANDWIDTH * rate) else 1.13 * rate


def alias_lines(modes: Sequence[Resonance], rate: float) -> list[str]:
    """A sentence for each of ``modes`` on the true frequencies that it may stand for, sampled at ``rate`` (Hz)."""
    lines = []
    for mode in modes:
        others = aliases(mode, rate)[1:]
        shown = ", ".join(f"{each.frequency:.4g} Hz (damping {each.damping:.3g})" for each in others[:3])
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        lines.append(f"{mode.frequency:.4g} Hz may stand for {shown}{more}")
    if lines:
        lines.append(
            f"no recording at {rate:g} Hz tells these frequencies apart: low-pass filters before the sampling exclude "
            f"those above {0.5 * rate:g} Hz, or record again at {second_rate(rate):g} Hz and compare"
        )
    return lines
