"""Windows of a recording, and the noise of the positions simulated over them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.simulation import Torque


@dataclass(frozen=True, eq=False)
class Windows:
    """A recording cut into S short windows over which the joint is simulated.

    ``period`` is the sampling period (s), ``torque`` the recorded torque of the windows. Positions are compared every
    ``stride`` periods: ``measured`` (m, S) are the recorded ones, rad (m), and ``used`` (m, S) marks those that belong
    to a window, which may be shorter than the longest. ``q0``, ``v0`` (S,) are estimated positions and speeds at the
    start, with the standard deviations ``q0_std``, ``v0_std``. ``block`` (S,) is the number of the longer stretch that
    a window belongs to; blocks are held out or resampled as a whole. ``resolution`` is that of the encoder, rad (m).
    ``direction`` (S,), +1 or -1, is the direction of sliding if it is constant in each window, otherwise None.
    ``a0`` (S,) is the acceleration at the start, ``smoothed`` the torque after the low-pass filter that gave it.
    """

    period: float
    stride: int
    torque: Torque
    smoothed: Torque
    measured: Array
    q0: Array
    v0: Array
    a0: Array
    q0_std: float
    v0_std: float
    used: NDArray[np.bool_]
    block: NDArray[np.int64]
    resolution: float
    direction: Array | None = None

    def __len__(self) -> int:
        return len(self.q0)

    @property
    def points(self) -> int:
        """Number of positions that are compared, over all windows."""
        return int(np.count_nonzero(self.used))

    def by_length(self) -> list[tuple[NDArray[np.int64], Windows]]:
        """Short and long windows apart: their numbers and the windows, cut to the longest of them.

        Windows are short that take at most half as long as the longest: to simulate them further is lost time.
        """
        points = np.asarray(np.count_nonzero(self.used, axis=0))
        long = points > (len(self.measured) + 1) // 2
        found = []
        for numbers in (np.flatnonzero(~long), np.flatnonzero(long)):
            if len(numbers):
                part, most = self.of(numbers), int(np.max(points[numbers]))
                torque = replace(part.torque, length=(most - 1) * self.stride)
                found.append(
                    (numbers, replace(part, torque=torque, measured=part.measured[:most], used=part.used[:most]))
                )
        return found

    def of(self, chosen: NDArray[Any]) -> Windows:
        """The ``chosen`` windows, given by a mask (S,) or by their numbers."""
        torque, smoothed = (replace(each, starts=each.starts[chosen]) for each in (self.torque, self.smoothed))
        return replace(
            self, torque=torque, smoothed=smoothed, measured=self.measured[:, chosen],
            q0=self.q0[chosen], v0=self.v0[chosen], a0=self.a0[chosen],
            direction=None if self.direction is None else self.direction[chosen],
            used=self.used[:, chosen], block=self.block[chosen],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise model of the m position errors of a window: ``covariance = sigma^2 (I + ratio D)``.

    I is encoder noise; D is the covariance of white torque noise integrated twice, 1 at the last position. ``ratio`` is
    thus torque noise over encoder noise. ``whitener`` (m, m), lower triangular, maps the errors to ones with covariance
    ``sigma^2 I``; its leading block does so for a shorter window. ``logarithms`` (m,) are ``-ln`` of its diagonal.
    """

    ratio: float
    whitener: Array
    logarithms: Array


def make_noise(points: int, step: float, ratio: float) -> Noise:
    """Noise model of windows with ``points`` positions at a distance of ``step`` seconds.

    ``ratio`` is the variance due to torque noise at the end of a window divided by that of the encoder.
    """
    t = np.arange(points) * step
    early, late = np.minimum.outer(t, t), np.maximum.outer(t, t)
    D = early**2 * (3.0 * late - early) / 6.0  # white noise integrated twice
    D = D / D[-1, -1]
    C = np.eye(points) + ratio * D
    lower = np.linalg.cholesky(C)
    return Noise(ratio, np.linalg.inv(lower), np.log(np.diag(lower)))
