"""A recorded motion as the reference of a simulation: positions, smooth speeds and accelerations at any instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.log_stream import joined
from rrrgen.lab.data.processing import Processing
from rrrgen.lab.identify.bandwidth import tune
from rrrgen.lab.identify.observations import Recording, reconstruct


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """The reconstructed motion of one uninterrupted recording, from its first sample at t = 0 to ``duration`` (s).

    Between samples the position is the cubic that matches position and speed at both ends, the acceleration is linear.
    ``position`` and ``speed`` are these cubics and their derivative, ``ddq`` (N, n) the accelerations at the samples
    ``t`` (N,).
    """

    duration: float
    t: Array
    ddq: Array
    position: Any
    speed: Any

    @classmethod
    def of(cls, recording: Recording, processing: Processing) -> RecordedMotion:
        """Reconstruct ``recording`` by the method of ``processing``; settings left None are chosen from its bandwidth.

        Raises :class:`InputError` if the recording is interrupted.
        """
        from scipy.interpolate import CubicHermiteSpline

        parts = list(recording.parts())
        if len({part.segment for part in parts}) != 1:
            pieces = len({part.segment for part in parts})
            raise InputError(f"the reference has {pieces} stretches with gaps between them: it must be uninterrupted")
        motion = reconstruct(joined(parts), tune(processing, [recording]).processing)
        t = np.asarray(motion.t) - motion.t[0]
        position = CubicHermiteSpline(t, motion.q, motion.dq)
        return cls(float(t[-1]), t, motion.ddq, position, position.derivative())

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration (N, n) at the instants ``t`` (N,) in s; at rest beyond either end."""
        at = np.clip(t, 0.0, self.duration)
        inside = ((np.asarray(t) >= 0.0) & (np.asarray(t) <= self.duration))[:, None]
        ddq = np.column_stack([np.interp(at, self.t, column) for column in self.ddq.T])
        return np.asarray(self.position(at)), np.asarray(self.speed(at)) * inside, ddq * inside
