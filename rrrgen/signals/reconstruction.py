"""Joint motion from sampled joint positions: one interface, two methods.

A :class:`Reconstructor` turns positions sampled at a constant period into positions, speeds and accelerations. The
steady-state Kalman filter and smoother of (14.26)-(14.31) live in :mod:`rrrgen.signals.kalman`; the zero-phase
Butterworth filter with central differences is here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import InputError

FORGOTTEN = 1e-14
"""A filter has forgotten a sample when what is left of it is below the round-off of a double."""


@dataclass(frozen=True)
class Reconstruction:
    """Joint motion at the instants ``t`` (s): ``q``, ``dq``, ``ddq``, each (N, n), in rad (or m), per s and per s^2."""

    t: Array
    q: Array
    dq: Array
    ddq: Array
    method: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def window(self, start: int, stop: int) -> Reconstruction:
        """The samples ``start`` to ``stop`` (exclusive)."""
        part = slice(start, stop)
        return Reconstruction(self.t[part], self.q[part], self.dq[part], self.ddq[part], self.method, self.facts)


class Reconstructor(Protocol):
    """A method of reconstruction: a linear filter with finite memory."""

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Reconstruct the motion from positions ``q`` (N, n) at the uniform instants ``t`` (N,)."""
        ...

    def memory(self, period: float) -> int:
        """Samples on either side that still influence a reconstructed sample, at the period ``period`` (s)."""
        ...


def sampling_period(t: Array) -> float:
    """The period of uniform instants (s); raises :class:`InputError` where they are not uniform to 1e-3 of a period."""
    t = np.asarray(t, float)
    if t.ndim != 1 or len(t) < 2:
        raise InputError("a reconstruction needs at least two samples")
    period = float(t[-1] - t[0]) / (len(t) - 1)
    worst = float(np.max(np.abs(np.diff(t) - period))) if period > 0 else math.inf
    if not worst <= 1e-3 * period:
        raise InputError(
            f"the samples are not at a constant period (mean {period:.6g} s, worst step off by {worst:.3g} s); "
            "read the log with read_log, which resamples jittered recordings"
        )
    return period


def central_differences(t: Array, q: Array) -> tuple[Array, Array]:
    """First and second derivative by central differences applied twice, one-sided at the two ends.

    ``dq_k = (q_{k+1} - q_{k-1}) / (2 Ts)``, ``ddq`` the same of ``dq``; shapes (N, n).
    """
    if len(q) < 2:
        raise InputError("central differences need at least two samples")
    period = sampling_period(t)
    dq = np.gradient(q, period, axis=0)
    return dq, np.gradient(dq, period, axis=0)


@dataclass(frozen=True)
class CentralDifferences:
    """Central differences of the positions as they are, for noise-free data."""

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Differentiate; ``reference`` is not needed and not used."""
        q = np.asarray(q, float)
        dq, ddq = central_differences(t, q)
        return Reconstruction(np.asarray(t, float), q, dq, ddq, "central differences")

    def memory(self, period: float) -> int:
        """Two samples: the second difference spans five."""
        return 2


@dataclass(frozen=True)
class Butterworth:
    """Zero-phase Butterworth low-pass on the position, then central differences.

    The filter of ``order`` poles and ``cutoff`` (Hz) runs forward and backward: no phase, squared magnitude (-6 dB at
    the cutoff). The recording is continued at both ends by reflection through its end points.
    """

    cutoff: float
    order: int = 4

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Filter and differentiate; with a ``reference`` motion only the deviation from it is filtered."""
        from scipy import signal

        t, q = np.asarray(t, float), np.asarray(q, float)
        period = sampling_period(t)
        sections = self._sections(period)
        pad = min(self.memory(period), len(t) - 1)
        deviation = q if reference is None else q - reference.q
        smooth = signal.sosfiltfilt(sections, deviation, axis=0, padtype="odd", padlen=pad)
        dq, ddq = central_differences(t, smooth)
        if reference is not None:
            smooth, dq, ddq = smooth + reference.q, dq + reference.dq, ddq + reference.ddq
        facts = {"cutoff_hz": self.cutoff, "order": self.order}
        return Reconstruction(t, smooth, dq, ddq, "zero-phase Butterworth and central differences", facts)

    def memory(self, period: float) -> int:
        """Samples until the slowest pole has decayed to round-off."""
        from scipy import signal

        _, poles, _ = signal.sos2zpk(self._sections(period))
        return 2 + math.ceil(math.log(FORGOTTEN) / math.log(float(np.max(np.abs(poles)))))

    def _sections(self, period: float) -> Array:
        from scipy import signal

        nyquist = 0.5 / period
        if not 0.0 < self.cutoff < nyquist:
            raise InputError(
                f"the cutoff {self.cutoff:g} Hz of the Butterworth filter must lie between 0 and {nyquist:g} Hz, "
                "half the sampling rate"
            )
        if self.order < 1:
            raise InputError(f"the order of the Butterworth filter is {self.order}; it must be 1 or more")
        sections: Array = signal.butter(self.order, self.cutoff, fs=1.0 / period, output="sos")
        return sections
