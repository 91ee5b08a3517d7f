"""The motion of one joint from which its friction is estimated: a fast multisine, then slow reversals.

Fast motion determines inertia and viscous friction, slow motion with reversals determines stiction and Stribeck speed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.robot.model.mechanism import limits_at

SCHEMA = "rrrgen-friction-motion/1"
FAST_BAND, SLOW_BAND = (0.1, 5.0), (0.05, 0.2)  # Hz
FAST_SPACING, SLOW_SPACING = 0.1, 0.05  # Hz
FAST_SPEED, SLOW_SPEED = 1.2, 0.25  # rad/s, rms speed of a revolute joint
PRISMATIC = 0.3  # m, speeds of a prismatic joint (m/s) divided by those of a revolute one (rad/s)
FADE = 1.0  # s over which a motion fades in and out
DRAWS = 40  # draws of random phases, of which the one with the smallest peak is kept
RESERVE = 0.9  # fraction of a limit on the motion that is used
TORQUE_RESERVE = 0.6  # fraction of the torque limit for the links; the rest is left to friction
GRID = 1e-3  # s between the times at which limits are checked


@dataclass(frozen=True)
class Multisine:
    """Sum of cosines as a position, ``sum_k amplitude_k cos(2 pi frequency_k t + phase_k)``, that fades in and out.

    It lasts ``duration`` (s) from the time ``start`` (s). ``frequency`` is in Hz, ``amplitude`` in rad (m),
    ``phase`` in rad, one entry for each cosine.
    """

    start: float
    duration: float
    frequency: tuple[float, ...]
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration at the times ``t`` (N,) in s, each (N,); zero outside the duration."""
        local = np.clip(t - self.start, 0.0, self.duration)
        omega = 2.0 * math.pi * np.array(self.frequency)
        angle = np.multiply.outer(local, omega) + np.array(self.phase)
        a = np.array(self.amplitude)
        wave = [np.cos(angle) @ a, -np.sin(angle) @ (a * omega), -np.cos(angle) @ (a * omega**2)]
        near = np.minimum(local, self.duration - local) / FADE
        sign = np.where(local <= 0.5 * self.duration, 1.0, -1.0) / FADE
        s = np.clip(near, 0.0, 1.0)
        fade = [
            s**3 * (10 - 15 * s + 6 * s**2),
            30 * s**2 * (1 - s) ** 2 * sign,
            (60 * s - 180 * s**2 + 120 * s**3) / FADE**2,
        ]
        return (
            fade[0] * wave[0],
            fade[0] * wave[1] + fade[1] * wave[0],
            fade[0] * wave[2] + 2.0 * fade[1] * wave[1] + fade[2] * wave[0],
        )


@dataclass(frozen=True)
class FrictionMotion:
    """Motion of joint number ``joint`` (from 0) about the posture ``centre`` (n,), while the other joints are at rest.

    ``name`` is that of the joint; its deviation from the posture is the sum of the multisines ``parts``.
    """

    joint: int
    name: str
    centre: tuple[float, ...]
    parts: tuple[Multisine, ...]

    @property
    def period(self) -> float:
        """Duration of the motion, s."""
        return self.parts[-1].start + self.parts[-1].duration

    def evaluate(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, speeds and accelerations (N, n) of all joints at the times ``t`` (N,)."""
        times = np.asarray(t, dtype=float)
        totals = [np.zeros((len(times), len(self.centre))) for _ in range(3)]
        totals[0] += np.array(self.centre)
        for part in self.parts:
            for total, contribution in zip(totals, part.evaluate(times), strict=True):
                total[:, self.joint] += contribution
        return totals[0], totals[1], totals[2]

    def to_json(self) -> dict[str, Any]:
        """The motion as plain data for JSON, which :meth:`from_json` reads back."""
        return {"schema": SCHEMA, **asdict(self)}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> FrictionMotion:
        """Restore a motion from the data of :meth:`to_json`; raises InputError for other data."""
        try:
            series = ("frequency", "amplitude", "phase")
            parts = tuple(
                Multisine(float(p["start"]), float(p["duration"]), *(tuple(float(v) for v in p[key]) for key in series))
                for p in data["parts"]
            )
            return cls(int(data["joint"]), str(data["name"]), tuple(float(v) for v in data["centre"]), parts)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"this is no motion of `rrrgen experiment excite --friction`: {error!r}") from None


def read_friction_motion(path: Path) -> FrictionMotion | None:
    """Read a friction motion from the JSON file ``path``; None if the file holds something else."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    is_motion = isinstance(data, dict) and data.get("schema") == SCHEMA
    return FrictionMotion.from_json(data) if is_motion else None


def design_friction_motion(
    spec: Any,
    joint: str,
    duration: float,
    seed: int,
    torque: Callable[[Array, Array, Array], Array] | None = None,
) -> FrictionMotion:
    """Design a fast multisine and slow reversals of the joint named ``joint`` within its limits in the robot file.

    ``spec`` is the robot file. Each of the two motions takes half of ``duration`` (s); ``seed`` is that of the random
    phases. ``torque(q, dq, ddq)`` returns the joint torques of the links without friction and is used for the torque
    limit. Raises InputError for an unknown joint or a duration below 20 s, DerivationError if the position limits leave
    no room for motion.
    """
    names = [joint_spec.name for joint_spec in spec.joints]
    if joint not in names:
        raise InputError(f"robot '{spec.name}' has no joint '{joint}'; its joints are {', '.join(names)}")
    if not duration >= 20.0:
        raise InputError(f"a friction experiment of {duration:g} s is too short: 20 s at least, better 40 s")
    i = names.index(joint)
    row = spec.joints[i]
    unit = 1.0 if row.is_revolute else PRISMATIC
    half = 0.5 * duration
    rng = np.random.default_rng(seed)
    parts = (
        _multisine(rng, 0.0, half, FAST_BAND, FAST_SPACING, FAST_SPEED * unit),
        _multisine(rng, half, half, SLOW_BAND, SLOW_SPACING, SLOW_SPEED * unit),
    )
    centre = [_middle(joint_spec.limits) for joint_spec in spec.joints]
    row = replace(row, limits=limits_at(spec, i, centre))
    centre[i] = _centre(row.limits, parts)
    scaled_parts = [_scale_amplitude(part, _share(part, row.limits, centre[i], joint)) for part in parts]
    motion = FrictionMotion(i, joint, tuple(centre), tuple(scaled_parts))
    if torque is None or row.limits.torque is None:
        return motion
    for _ in range(30):  # inertia torque falls with the amplitude, gravity does not
        t = np.arange(0.0, motion.period, 5.0 * GRID)
        largest = float(np.max(np.abs(torque(*motion.evaluate(t))[:, i])))
        if largest <= TORQUE_RESERVE * float(row.limits.torque):
            return motion
        motion = FrictionMotion(i, joint, motion.centre, tuple(_scale_amplitude(part, 0.8) for part in motion.parts))
    raise DerivationError(f"gravity alone takes more than {100 * TORQUE_RESERVE:g} % of the torque limit of '{joint}'")


def _multisine(
    rng: np.random.Generator, start: float, duration: float, band: tuple[float, float], spacing: float, speed: float
) -> Multisine:
    """Multisine with equal speed amplitudes at all frequencies of ``band`` (Hz), ``spacing`` (Hz) apart.

    ``speed`` is its RMS speed, rad/s (m/s). Of DRAWS random sets of phases the one with the smallest peak is kept.
    """
    f = np.arange(band[0], band[1] + 1e-9, spacing)
    amplitude = speed * math.sqrt(2.0 / len(f)) / (2.0 * math.pi * f)
    t = start + np.arange(0.0, duration, 5.0 * GRID)
    drawn = [
        Multisine(start, duration, tuple(f.tolist()), tuple(amplitude.tolist()), tuple(phase.tolist()))
        for phase in rng.uniform(0.0, 2.0 * math.pi, (DRAWS, len(f)))
    ]
    return min(
        drawn, key=lambda multisine: float(np.max(np.abs(multisine.evaluate(t)[1])) * np.ptp(multisine.evaluate(t)[0]))
    )


def _middle(limits: Any) -> float:
    """Middle of the position range of a joint, rad (m); 0 if it is unlimited."""
    if limits.lower is not None and limits.upper is not None:
        return 0.5 * (float(limits.lower) + float(limits.upper))
    low = -math.inf if limits.lower is None else float(limits.lower)
    high = math.inf if limits.upper is None else float(limits.upper)
    return min(max(0.0, low), high)


def _centre(limits: Any, parts: Sequence[Multisine]) -> float:
    """Position, rad (m), about which the joint moves: the middle of its range, or 0 unless its only limit is too near.

    Then it is so far from this limit that the unscaled motion ``parts`` takes RESERVE of the way to it.
    """
    if (limits.lower is None) == (limits.upper is None):
        return _middle(limits)
    waves = [part.evaluate(part.start + np.arange(0.0, part.duration, GRID))[0] for part in parts]
    if limits.upper is None:
        return max(0.0, float(limits.lower) - min(float(np.min(wave)) for wave in waves) / RESERVE)
    return min(0.0, float(limits.upper) - max(float(np.max(wave)) for wave in waves) / RESERVE)


def _share(part: Multisine, limits: Any, centre: float, joint: str) -> float:
    """Largest factor, at most 1, by which the motion ``part`` can be scaled to stay within the limits of the joint.

    ``centre`` is the position, rad (m), about which the joint named ``joint`` moves.
    """
    q, dq, ddq = part.evaluate(part.start + np.arange(0.0, part.duration, GRID))
    share = 1.0
    for values, limit in ((dq, limits.velocity), (ddq, limits.acceleration)):
        if limit is not None:
            share = min(share, RESERVE * float(limit) / float(np.max(np.abs(values))))
    for limit, reach in ((limits.upper, float(np.max(q))), (limits.lower, -float(np.min(q)))):
        if limit is not None and reach > 0.0:
            share = min(share, RESERVE * abs(float(limit) - centre) / reach)
    if not share > 0.02:
        raise DerivationError(f"the position limits of joint '{joint}' leave no room for a friction experiment")
    return share


def _scale_amplitude(part: Multisine, factor: float) -> Multisine:
    amplitude = tuple(factor * a for a in part.amplitude)
    return Multisine(part.start, part.duration, part.frequency, amplitude, part.phase)
