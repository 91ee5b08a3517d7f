"""What is asked of a response experiment, and the runs in which it is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import InputError

SCHEMA = "rrrgen-response-excitation/1"


@dataclass(frozen=True)
class ResponsePlan:
    """An experiment for the frequency response of one joint, (14.36); the other joints stand.

    - ``joint``: name of the joint, or its number from 1.
    - ``signal``: one of ``SIGNALS``; ``band`` (Hz); ``period`` (s) of the signal, also the inverse of the distance of
      its lines; ``periods`` that are recorded after ``settle`` periods in which transients fade.
    - ``rms`` of the excitation, rad/s^2 (m/s^2), and ``speed`` of the joint, rad/s (m/s); None: chosen.
    - ``realisations``: experiments with other random phases; ``postures``: joint positions (n,) of each experiment;
      zero, or the middle of ranges that do not contain zero, if None.
    - ``bandwidth``: (Hz) of the loop of the joint, and of those of the others; ``damping`` of both.
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
        """The joint from 0 among ``names``; raises :class:`InputError` for a joint that the robot does not have."""
        if self.joint in names:
            return names.index(self.joint)
        if self.joint.isdigit() and 1 <= int(self.joint) <= len(names):
            return int(self.joint) - 1
        raise InputError(f"the robot has no joint '{self.joint}': it has {', '.join(names)}")


@dataclass(frozen=True, eq=False)
class ResponseRun:
    """One recording: excitation ``n`` (samples,) of a joint that moves from ``start`` (n,) at constant ``speed``.

    The first ``settle`` samples are left out of the response. ``posture`` and ``realisation`` count from 1.
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
    """A designed experiment: joint (from 0), sampling period (s), loop gains (n,), signal and runs.

    ``signal_period`` is that of the excitation in samples, None for noise. ``kp`` (1/s^2) and ``kd`` (1/s) are the
    gains of (14.36).
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
        """Position, velocity and acceleration of the reference of ``run`` at times ``t`` (m,), (m, n) each."""
        direction = np.zeros(len(run.start))
        direction[self.joint] = run.speed
        t = np.asarray(t, dtype=float)
        q = np.asarray(run.start) + t[:, None] * direction
        return q, np.broadcast_to(direction, q.shape), np.zeros_like(q)

    def to_json(self) -> dict[str, Any]:
        """The design as plain data for JSON; of a periodic excitation one period."""
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
        """The design that :meth:`to_json` describes; raises :class:`InputError` for other data."""
        if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
            raise InputError(f"this is no response excitation of `rrrgen excite --response` (schema {SCHEMA})")
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
            found = cls(
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
        if not runs or any(not np.all(np.isfinite(run.n)) or len(run.start) != len(found.kp) for run in runs):
            raise InputError("the response excitation is damaged: a run has no excitation or another number of joints")
        return found
