"""Windows of a recording, and the noise of the positions simulated over them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.friction_estimation.shooting.simulation import Torque


@dataclass(frozen=True, eq=False)
class Windows:
    """The recording cut into S windows of ``length`` sampling periods, compared every ``stride`` of them.

    ``torque`` holds all samples; ``measured`` (m, S) are the positions, ``q0``, ``v0`` (S,) the start states of a
    filter, ``q0_std``, ``v0_std`` their standard deviations; ``used`` (m, S) says which positions count, from the start
    of a window on; ``block`` (S,) numbers longer stretches, for held-out errors and resampling. ``resolution`` is that
    of the encoder. With ``direction`` (S,) the joint slides that way throughout each window.
    """

    period: float
    stride: int
    torque: Torque
    measured: Array
    q0: Array
    v0: Array
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
        """Number of positions that count."""
        return int(np.count_nonzero(self.used))

    def of(self, chosen: NDArray[Any]) -> Windows:
        """The windows ``chosen`` (a mask or numbers)."""
        torque = replace(self.torque, starts=self.torque.starts[chosen])
        return replace(
            self, torque=torque, measured=self.measured[:, chosen], q0=self.q0[chosen], v0=self.v0[chosen],
            direction=None if self.direction is None else self.direction[chosen],
            used=self.used[:, chosen], block=self.block[chosen],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Noise:
    """``covariance = sigma^2 (I + ratio D)`` of a window's residual, D that of torque noise integrated twice, scaled.

    ``whitener`` (m, m), lower triangular, makes it ``sigma^2 I``, also of a window's first part alone; ``logarithms``
    (m,) are those of the inverse of its diagonal.
    """

    ratio: float
    whitener: Array
    logarithms: Array


def make_noise(points: int, step: float, ratio: float) -> Noise:
    """Noise of windows with ``points`` samples ``step`` seconds apart; ``ratio`` is relative at the window's end."""
    t = np.arange(points) * step
    early, late = np.minimum.outer(t, t), np.maximum.outer(t, t)
    D = early**2 * (3.0 * late - early) / 6.0  # white noise integrated twice
    D = D / D[-1, -1]
    C = np.eye(points) + ratio * D
    lower = np.linalg.cholesky(C)
    return Noise(ratio, np.linalg.inv(lower), np.log(np.diag(lower)))
