"""A sample of a few hundred instants of a recording, filtered as for the estimation, to which the rules are applied."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.data.decimation import Decimator
from rrrgen.lab.data.processing import Processing
from rrrgen.lab.identify.observations import Recording, RowMaker, reconstruct, windows

MOST_ROWS = 3000
"""Rows (instants times joints) of a sample: twenty to fifty per parameter, in a few hundredths of a second."""
MOST_READ = 200_000  # samples that are read of a long recording
WHOLE = 0.999  # gain of the filter below which a sample lies at a border or next to an invalid one


@dataclass(frozen=True)
class Sample:
    """Motion and torque (N, n) at N instants, passed through the same filter.

    ``use`` (N, n) is False where the equation of a joint is left out.
    """

    q: Array
    dq: Array
    ddq: Array
    tau: Array
    use: NDArray[np.bool_]

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def moved(self, change: Array, zero: Array) -> Sample:
        """A copy with the positions ``zero + change (q - zero)`` and the speeds and accelerations that follow.

        ``change`` is (n, n), ``zero`` (n,) in rad (m).
        """
        q = zero + (self.q - zero) @ change.T
        return replace(self, q=q, dq=self.dq @ change.T, ddq=self.ddq @ change.T)

    def slowed(self, factor: float) -> Sample:
        """A copy with time stretched by ``factor``: speeds are divided by it, accelerations by its square."""
        return replace(self, dq=self.dq / factor, ddq=self.ddq / factor**2)


def sample_of(recording: Recording, processing: Processing) -> Sample | None:
    """Sample instants spread evenly over a recording; None if it has no torques or no usable instant."""
    decimate = Decimator(processing.decimate or 1)
    memory = RowMaker(lambda q, dq, ddq: q, processing, 1).memory(recording.period)
    found: list[tuple[Any, ...]] = []
    read = 0
    for window in windows(recording, memory):
        part = window.part.aligned()
        if part.tau is None:
            return None
        motion = reconstruct(part, processing)
        usable = decimate(part.valid.astype(float), part.first) > WHOLE
        parts = [decimate(x, part.first) for x in (motion.q, motion.dq, motion.ddq, part.tau)]
        use = usable & (np.abs(parts[1]) >= (np.asarray(processing.low_speed) if processing.low_speed else 0.0))
        found.append((*parts, use))
        read += window.stop - window.start
        if read >= MOST_READ:
            break
    if not found:
        return None
    q, dq, ddq, tau, use = (np.concatenate(columns) for columns in zip(*found, strict=True))
    there = np.flatnonzero(use.any(axis=1))
    if len(there) == 0:
        return None
    count = min(len(there), max(1, MOST_ROWS // q.shape[1]))
    kept = there[np.linspace(0, len(there) - 1, count).astype(int)]
    return Sample(q[kept], dq[kept], ddq[kept], tau[kept], use[kept].astype(bool))
