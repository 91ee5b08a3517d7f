"""Reconstruction of joint positions, speeds and accelerations from positions sampled at a constant period.

This module holds the interface :class:`Reconstructor`, the zero-phase Butterworth filter and plain central
differences; the steady-state Kalman filter and smoother are in :mod:`rrrgen.lab.data.kalman`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

DECAY_TOLERANCE = 1e-14
"""Relative size below which the response of a filter to a past sample is lost in the round-off of a double."""


@dataclass(frozen=True)
class Reconstruction:
    """Reconstructed joint motion: ``q``, ``dq``, ``ddq``, each (N, n), in rad (m), rad/s and rad/s^2, at ``t`` (N,), s.

    ``method`` names the filter, ``facts`` holds its settings.
    """

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
        """The motion of the samples ``start`` to ``stop`` (exclusive)."""
        part = slice(start, stop)
        return Reconstruction(self.t[part], self.q[part], self.dq[part], self.ddq[part], self.method, self.facts)


class Reconstructor(Protocol):
    """Interface of a reconstruction filter: linear, and with finite memory up to round-off."""

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Reconstruct the motion from positions ``q`` (N, n) in rad (m) at the uniform times ``t`` (N,) in s.

        With a ``reference`` motion at the same points in time, only the deviation from it is filtered.
        """
        ...

    def memory(self, period: float) -> int:
        """Number of samples on either side that influence a reconstructed sample, for a sampling ``period`` in s."""
        ...


def sampling_period(t: Array) -> float:
    """The sampling period (s) of the times ``t`` (N,).

    Raises :class:`InputError` if there are fewer than two, or if a step differs from the mean by over 1e-3 of it.
    """
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
    """First and second derivative of ``q`` (N, n) by central differences, one-sided at the two ends.

    ``dq_k = (q_{k+1} - q_{k-1}) / (2 Ts)``, and ``ddq`` likewise from ``dq``; returns ``dq`` and ``ddq``, (N, n) each.
    Raises :class:`InputError` for fewer than two samples and for times ``t`` (N,) that are not uniform.
    """
    if len(q) < 2:
        raise InputError("central differences need at least two samples")
    period = sampling_period(t)
    dq = np.gradient(q, period, axis=0)
    return dq, np.gradient(dq, period, axis=0)


@dataclass(frozen=True)
class CentralDifferences:
    """Reconstruction by central differences of the unfiltered positions, for noise-free data."""

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Differentiate ``q`` (N, n) at the times ``t`` (N,); ``reference`` is ignored."""
        q = np.asarray(q, float)
        dq, ddq = central_differences(t, q)
        return Reconstruction(np.asarray(t, float), q, dq, ddq, "central differences")

    def memory(self, period: float) -> int:
        """Number of samples on either side that influence a result: 2, since two central differences span five."""
        return 2


@dataclass(frozen=True)
class Butterworth:
    """Zero-phase Butterworth low-pass filter on the positions, followed by central differences.

    The filter of ``order`` poles and ``cutoff`` (Hz) runs forward and backward: its phase cancels and its magnitude is
    squared (-6 dB at the cut-off). The recording is extended at both ends by point reflection at its end samples.
    Raises :class:`InputError` for a cut-off outside 0 to half the sampling rate.
    """

    cutoff: float
    order: int = 4

    def __call__(self, t: Array, q: Array, reference: Reconstruction | None = None) -> Reconstruction:
        """Filter and differentiate ``q`` (N, n) at the times ``t`` (N,).

        With a ``reference`` motion, only the deviation from it is filtered and differentiated.
        """
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
        """Number of samples in which the slowest pole decays to round-off, for a sampling ``period`` in s."""
        from scipy import signal

        _, poles, _ = signal.sos2zpk(self._sections(period))
        return 2 + math.ceil(math.log(DECAY_TOLERANCE) / math.log(float(np.max(np.abs(poles)))))

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
