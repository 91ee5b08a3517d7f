"""A path with its timing: duration, speed along it, and the motion at any instant."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.base.arrays import Array
from rrrgen.runtime.path import Path
from rrrgen.runtime.results import Motion

Sampler = Callable[[Path, Array, Array, Array], tuple[Array, Array, Array]]


class TimedPath:
    """The fastest motion along ``path``: ``ds_dt`` (N,) and the instants ``t`` (N,), s, at its points.

    ``speed_share`` and ``acceleration_share`` are the largest speed and acceleration over their limits at any time,
    at most 1. ``torque_share`` is the largest torque over its limit, at the points and at eighths between them. 0
    stands for no limit. The motion is slower by the factor ``stretch`` than the limits at the points alone allow.
    """

    def __init__(
        self,
        path: Path,
        ds_dt: Array,
        t: Array,
        sampler: Sampler,
        stretch: float,
        shares: tuple[float, float, float],
    ) -> None:
        self.path, self.ds_dt, self.t, self._sampler = path, ds_dt, t, sampler
        self.stretch = stretch
        self.torque_share, self.speed_share, self.acceleration_share = shares

    def __repr__(self) -> str:
        points, n = self.path.q.shape
        return f"<rrrgen.TimedPath: {n} joints, {points} points, {self.duration:.6g} s>"

    @property
    def duration(self) -> float:
        """The time from the first point to the last, s."""
        return float(self.t[-1])

    @property
    def d2s_dt2(self) -> Array:
        """Second time derivative of the path parameter s, constant between neighbouring points, (N - 1,)."""
        return np.asarray(np.diff(np.square(self.ds_dt)) / (2.0 * np.diff(self.path.s)))

    def sample(self, t: ArrayLike) -> Motion:
        """The desired motion at any instants, for instance at the constant rate of a controller.

        Between the points q is the quintic polynomial in s that agrees with q, q_s and q_ss at both ends, as in the
        emitted function ``<name>_timed_path``. Before 0 and after the duration the motion is that of the nearer end.

        Args:
            t: instants, (...), s.

        Returns:
            The named tuple (q_d, dq_d, ddq_d), (..., n) each, rad or m, per s and per s^2.
        """
        times = np.asarray(t, dtype=float)
        parts = self._sampler(self.path, self.ds_dt, self.t, times.reshape(-1))
        return Motion(*(part.reshape(*times.shape, -1) for part in parts))
