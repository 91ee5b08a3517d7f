"""Note on recordings whose control loop oscillates: torques swing at a frequency that the motion does not have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.plant.tracking import band_of, oscillation

FASTEST_MOTION = 20.0
"""Frequency (Hz) above which no motion for identification goes, where the recording holds no reference to tell."""


def swinging_notes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Sentences on the joints whose torques oscillate, one per recording, with frequency and amplitude."""
    return tuple(note for recording in recordings for note in _notes(recording))


def _notes(recording: Recording) -> Iterator[str]:
    part, period = next(iter(recording.parts())), recording.period
    if part.tau is None:
        return
    swings = []
    for i, torque in enumerate(part.tau.T):
        lowest = FASTEST_MOTION
        if part.reference is not None:
            lowest = 3.0 * band_of(np.diff(part.reference[:, i], n=2), period)
        found = oscillation(torque, np.zeros_like(torque), float(np.abs(torque).max()), i, period, lowest / 3.0)
        if found is not None:
            swings.append(found)
    if swings:
        worst = max(swings, key=lambda swing: swing.stop - swing.start)
        names = ", ".join(recording.joints[swing.joint] for swing in swings)
        yield (
            f"the control loop oscillates: the torque of {names} swings, of {recording.joints[worst.joint]} at "
            f"{worst.frequency:.3g} Hz with {worst.amplitude:.3g} from t = {part.t[0] + worst.start:.3g} s to "
            f"{part.t[0] + worst.stop:.3g} s, which the motion does not ask for; do not trust estimates, deviations "
            "and diagnoses, but record anew with lower gains or a higher rate"
        )
