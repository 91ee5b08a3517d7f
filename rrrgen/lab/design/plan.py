"""The plan of a frequency response experiment, and its design: the runs in which it is recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

SCHEMA = "rrrgen-response-excitation/1"


@dataclass(frozen=True)
class ResponsePlan:
    """Plan of an experiment that measures the frequency response of one joint, (14.36), while the others stand still.

    - ``joint``: name of the joint, or its number from 1.
    - ``signal``: kind of excitation, one of ``SIGNALS``.
    - ``band``: lowest and highest excited frequency, Hz.
    - ``period``: period of the signal, s; the excited frequencies are multiples of 1/period.
    - ``periods``, ``settle``: number of recorded periods, after ``settle`` periods in which transients decay.
    - ``rms``: RMS of the excitation, rad/s^2 (m/s^2); None for the largest that the limits allow.
    - ``speed``: mean speed of the joint, rad/s (m/s); None for one that is chosen.
    - ``realisations``: number of experiments with different random phases.
    - ``postures``: joint positions (n,) of each experiment; None for zero, or the middle of a range without zero.
    - ``bandwidth``: bandwidths in Hz of the position loops of this joint, and of the others.
    - ``damping``: damping ratio of all loops.
    """

    joint: str
    signal: str = "multisine"
    band: tuple[float, float] = (0.5, 200.0)
    period: float = 2.0
    periods: int = 10
    settle: int = 2
    rms: float | None = None
    speed: float | None = None
    realisations: int = 1
    postures: tuple[tuple[float, ...], ...] | None = None
    bandwidth: tuple[float, float] = (1.0, 6.0)
    damping: float = 1.0

    def joint_index(self, names: tuple[str, ...]) -> int:
        """Index from 0 of the joint of this plan among the joint ``names``; raises InputError if it is not there."""
        if self.joint in names:
            return names.index(self.joint)
        if self.joint.isdigit() and 1 <= int(self.joint) <= len(names):
            return int(self.joint) - 1
        raise InputError(f"the robot has no joint '{self.joint}': it has {', '.join(names)}")


@dataclass(frozen=True, eq=False)
class ResponseRun:
    """One run to be recorded: a joint moves at a constant mean ``speed``, rad/s (m/s), and is excited by ``n``.

    ``n`` (samples,) is the excitation, rad/s^2 (m/s^2), ``start`` (joints,) are the initial joint positions. The first
    ``settle`` samples are not used for the response. ``posture`` and ``realisation`` are their numbers, from 1.
    """

    name: str
    posture: int
    realisation: int
    start: tuple[float, ...]
    speed: float
    settle: int
    n: Array


@dataclass(frozen=True, eq=False)
class ResponseDesign:
    """Designed frequency response experiment of one joint: its loop gains and the runs to be recorded.

    ``robot`` is the name of the robot, ``joint_name`` that of the joint number ``joint`` (from 0). ``period`` is the
    sampling period (s); ``signal`` is the kind of excitation and ``signal_period`` its period in samples, None for
    noise. ``kp`` (n,) in 1/s^2 and ``kd`` (n,) in 1/s are the gains of the position loops, (14.36).
    """

    robot: str
    joint: int
    joint_name: str
    signal: str
    period: float
    signal_period: int | None
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    runs: tuple[ResponseRun, ...]

    def reference(self, run: ResponseRun, t: Array) -> tuple[Array, Array, Array]:
        """Reference position, velocity, acceleration of all joints in ``run`` at times ``t`` (m,), s; (m, n) each."""
        direction = np.zeros(len(run.start))
        direction[self.joint] = run.speed
        t = np.asarray(t, dtype=float)
        q = np.asarray(run.start) + t[:, None] * direction
        return q, np.broadcast_to(direction, q.shape), np.zeros_like(q)

    def to_json(self) -> dict[str, Any]:
        """The design as plain data for JSON; a periodic excitation is stored as one period."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joint": self.joint_name,
            "joint_number": self.joint + 1,
            "signal": self.signal,
            "sampling_period_s": self.period,
            "signal_period_samples": self.signal_period,
            "kp": list(self.kp),
            "kd": list(self.kd),
            "runs": [
                {
                    "name": run.name,
                    "posture": run.posture,
                    "realisation": run.realisation,
                    "start": list(run.start),
                    "speed": run.speed,
                    "settle_samples": run.settle,
                    "samples": len(run.n),
                    "excitation": run.n[: self.signal_period].tolist(),
                }
                for run in self.runs
            ],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ResponseDesign:
        """Restore a design from the data of :meth:`to_json`; raises :class:`InputError` for other data."""
        if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
            raise InputError(
                f"this is no response excitation of `rrrgen experiment excite --response` (schema {SCHEMA})"
            )
        try:
            runs = tuple(
                ResponseRun(
                    name=str(row["name"]),
                    posture=int(row["posture"]),
                    realisation=int(row["realisation"]),
                    start=tuple(float(v) for v in row["start"]),
                    speed=float(row["speed"]),
                    settle=int(row["settle_samples"]),
                    n=np.resize(np.array(row["excitation"], dtype=float), int(row["samples"])),
                )
                for row in data["runs"]
            )
            design = cls(
                robot=str(data["robot"]),
                joint=int(data["joint_number"]) - 1,
                joint_name=str(data["joint"]),
                signal=str(data["signal"]),
                period=float(data["sampling_period_s"]),
                signal_period=None if data["signal_period_samples"] is None else int(data["signal_period_samples"]),
                kp=tuple(float(v) for v in data["kp"]),
                kd=tuple(float(v) for v in data["kd"]),
                runs=runs,
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the response excitation is damaged: {error!r}") from None
        if not runs or any(not np.all(np.isfinite(run.n)) or len(run.start) != len(design.kp) for run in runs):
            raise InputError("the response excitation is damaged: a run has no excitation or another number of joints")
        return design
