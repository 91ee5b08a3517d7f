"""Test whether the friction of a joint drifts during a recording, as it does while a gear warms up.

The torques in sliding are fitted with inertia, gravity, Coulomb and viscous friction and a Stribeck term, once alone
and once with viscous and Coulomb friction that change linearly with s, from -1/2 to 1/2: the time, or the energy that
friction has dissipated so far, which heats the gear. Friction drifts if the change explains torques in blocks of time
that were left out, clearly and by more than a model error would. It is then taken off the recorded torques before
friction laws are fitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.joint_recording import JointData
from rrrgen.lab.friction.sliding_model import SlidingModel

GAIN, AHEAD, UNLIKELY = 0.05, 2.0, 0.01
"""A drift is reported if it explains 5 % of the held-out squares, the mean gain of a block is two standard errors and
the test over blocks has p < 0.01. The last alone reports drift where there is none, in 10 to 20 % of recordings."""


@dataclass(frozen=True)
class Drift:
    """Linear change of the friction over a recording, from its beginning to its end, in the time or dissipated energy.

    ``viscous`` and ``coulomb`` are the changes with standard deviations ``viscous_std`` and ``coulomb_std`` over
    blocks, ``mean_viscous`` and ``mean_coulomb`` the values in the middle of ``over``, all in SI. ``gain`` is the
    explained share of the held-out squares, ``t`` the mean gain of a block over its standard error, ``p`` the
    probability of at least this change without drift.
    """

    viscous: float
    viscous_std: float
    coulomb: float
    coulomb_std: float
    mean_viscous: float
    mean_coulomb: float
    gain: float
    t: float
    p: float
    over: Literal["time", "energy"] = "time"

    @property
    def is_certain(self) -> bool:
        """Whether the friction drifts."""
        return self.gain >= GAIN and self.t >= AHEAD and self.p < UNLIKELY

    @property
    def sentence(self) -> str:
        """The drift in words."""
        share = f" ({100 * self.viscous / self.mean_viscous:+.0f} %)" if self.mean_viscous > 0.0 else ""
        return (
            f"friction drifts{self._cause}: from beginning to end viscous friction changes by {self.viscous:+.3g} +- "
            f"{self.viscous_std:.1g}{share} and Coulomb friction by {self.coulomb:+.3g} +- {self.coulomb_std:.1g}, "
            f"which explains {100 * self.gain:.0f} % of the squared torque errors that are left; it is part of the "
            "fit, and the estimates are those in the middle of the recording: warm the joint up, and record again"
        )

    @property
    def _cause(self) -> str:
        return " with the energy that it has dissipated" if self.over == "energy" else ""

    def remove_from(self, data: JointData) -> JointData:
        """The recording ``data`` as it would be with the friction of its middle."""
        dq = data.motion[1]
        s = centred_time(data) if self.over == "time" else dissipated_energy(data, self.mean_viscous, self.mean_coulomb)
        sliding = np.clip(dq / data.slow, -1.0, 1.0)  # the direction of sliding, uncertain in slow motion
        return replace(data, u=data.u - s * (self.viscous * dq + self.coulomb * sliding))

    def widen_std(self, std: Mapping[str, float]) -> dict[str, float]:
        """Deviations ``std`` of the parameters of a law, name -> value, with those of the drift at either end."""
        drift_std = {"viscous": self.viscous_std, "coulomb": self.coulomb_std}
        return {name: float(np.hypot(value, 0.5 * drift_std.get(name[:7], 0.0))) for name, value in std.items()}

    def to_json(self) -> dict[str, float]:
        """Changes from beginning to end with their deviations, and what they explain, as plain data."""
        return asdict(self)


def centred_time(data: JointData) -> Array:
    """The time (N,) of the samples of ``data``, from -1/2 to 1/2."""
    return np.asarray(np.arange(len(data.q)) / len(data.q) - 0.5)


def dissipated_energy(data: JointData, viscous: float, coulomb: float) -> Array:
    """The energy (N,) that viscous and Coulomb friction have dissipated up to every sample, from -1/2 to 1/2."""
    speed = np.abs(data.motion[1])
    energy = np.cumsum(max(viscous, 0.0) * speed**2 + max(coulomb, 0.0) * speed)
    return np.asarray(energy / energy[-1] - 0.5) if energy[-1] > 0.0 else centred_time(data)


def friction_drift(data: JointData, gravity: int, delay: float) -> Drift | None:
    """Estimate the drift of the friction in ``data``; None if there are too few samples in sliding.

    ``gravity`` is the number of gravity coefficients; the motion lags the torque by ``delay`` sampling periods. The
    drift is one over the time unless the dissipated energy predicts blocks that were left out better, by two standard
    errors of the mean over blocks.
    """
    alone = SlidingModel.of(data, gravity, delay)
    if alone is None:
        return None
    by_time = _drifting(alone, data, centred_time(data))
    viscous, coulomb = by_time.x[[0, 1]]
    by_energy = _drifting(alone, data, dissipated_energy(data, float(viscous), float(coulomb)))
    lead = by_time.held_out() - by_energy.held_out()
    ahead = float(np.mean(lead)) > AHEAD * float(np.std(lead, ddof=1)) / np.sqrt(len(lead))
    model = by_energy if ahead else by_time
    evidence, x = model.evidence(2), model.x
    std = np.sqrt(np.diag(model.covariance))[-2:]
    return Drift(
        viscous=float(x[-2]),
        viscous_std=float(std[0]),
        coulomb=float(x[-1]),
        coulomb_std=float(std[1]),
        mean_viscous=float(x[0]),
        mean_coulomb=float(x[1]),
        gain=evidence.gain,
        t=evidence.t,
        p=evidence.p,
        over="energy" if ahead else "time",
    )


def _drifting(alone: SlidingModel, data: JointData, s: Array) -> SlidingModel:
    """The model with friction that changes with ``s`` (N,) of the samples of ``data``."""
    at = np.interp(alone.time / data.period, np.arange(len(s)), s)
    return alone.beside(np.column_stack([at * alone.dq, at * np.sign(alone.dq)]))
