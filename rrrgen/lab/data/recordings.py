"""Recordings of an experiment in memory, and the check that a recording fits a robot."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext.signal_units import ANGLE, FORCE, LENGTH, TORQUE
from rrrgen.lab.data.mapping import BASE_COLUMNS, ON_BASE, LogMapping, plain_mapping
from rrrgen.lab.data.reconstruction import sampling_period
from rrrgen.lab.data.repair import RepairedFault, Repairs
from rrrgen.lab.data.uniform_stream import CHUNK, LogStream, Part, join_parts

MAPPING_SUFFIXES = (".yaml", ".yml")
SAME_DIRECTION = 1e-6  # largest 1 - cosine between the rows of mapping and robot file, which may hold rounded ratios


@dataclass(frozen=True)
class Log:
    """A recording in memory, uniformly sampled within each uninterrupted stretch, in SI at the joints.

    - ``joints``: names of the n joints.
    - ``t`` (N,) s; ``q`` (N, n) rad (m); ``dq``, ``ddq`` (N, n) per s and s^2, None if not recorded; ``tau`` (N, n) N m
      (N), None if not recorded.
    - ``period``: sampling period, s; 0 takes it from ``t``.
    - ``valid`` (N, n): False where the torque of a joint cannot be used; None for all valid.
    - ``segment`` (N,): number of the uninterrupted stretch of each sample; None for a single one.
    - ``reference``, ``reference_velocity``, ``feedforward`` (N, n): inputs of the controller, None if not recorded.
    - ``torque_delay``: how much later than its row a torque acts, in the mean, s; the mapping's where there is one.
    - ``repairs``: the faults found and how they were repaired; ``mapping``: where the recording was read from.
    - ``floating``: whether the first six joints are those of a floating base,
      :data:`~rrrgen.lab.data.mapping.ON_BASE`.
    """

    joints: tuple[str, ...]
    t: Array
    q: Array
    tau: Array | None = None
    dq: Array | None = None
    ddq: Array | None = None
    period: float = 0.0
    valid: NDArray[np.bool_] | None = None
    segment: NDArray[np.int64] | None = None
    repairs: Repairs = field(default_factory=Repairs)
    mapping: LogMapping | None = field(default=None, compare=False)
    reference: Array | None = None
    reference_velocity: Array | None = None
    feedforward: Array | None = None
    torque_delay: float = 0.0
    floating: bool = False

    def __post_init__(self) -> None:
        if not self.period > 0.0:
            object.__setattr__(self, "period", sampling_period(self.t))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def findings(self) -> tuple[RepairedFault, ...]:
        """The faults found in the recording, one entry per kind."""
        return self.repairs.findings

    @property
    def span(self) -> tuple[float, float]:
        """Start and duration, s."""
        return float(self.t[0]), float(self.t[-1] - self.t[0])

    def __len__(self) -> int:
        return len(self.t)

    def parts(self) -> Iterator[Part]:
        """Iterate over the uninterrupted stretches."""
        valid = np.ones(self.q.shape, bool) if self.valid is None else self.valid
        segment = np.zeros(len(self.t), np.int64) if self.segment is None else self.segment
        given = self.reference, self.reference_velocity, self.feedforward
        late = (self.torque_delay if self.mapping is None else self.mapping.torque_lateness) / self.period
        signals = self.q, self.dq, self.ddq, self.tau
        whole = Part(self.t, *signals, valid, 0, 0, *given, late=late, floating=self.floating)
        edges = [0, *(np.flatnonzero(np.diff(segment)) + 1), len(self.t)]
        for number, (start, stop) in enumerate(pairwise(edges)):
            part = whole.slice_samples(int(start), int(stop))
            yield replace(part, segment=number, first=0)

    def samples(self) -> Iterator[Part]:
        """All samples as one part, across the holes between stretches."""
        valid = np.ones(self.q.shape, bool) if self.valid is None else self.valid
        yield Part(self.t, self.q, self.dq, self.ddq, self.tau, valid, 0, 0)


def open_log(
    path: str | os.PathLike[str],
    mapping: LogMapping | str | os.PathLike[str] | None = None,
    skip_truncated: bool = False,
) -> LogMapping:
    """Find the mapping with which the recording ``path`` is read.

    ``path`` is a mapping file, or a recording, whose ``mapping`` is then given (as object or file) or must be rrrgen's
    own: columns ``t, q_<joint>, [dq_<joint>,] tau_<joint>`` in SI. With ``skip_truncated``, an incomplete last line of
    a text file is left out. Raises :class:`InputError` for a mapping file with faults or a recording without a mapping.
    """
    log_mapping = _mapping_of(path, mapping)
    return log_mapping.without_truncated_lines() if skip_truncated else log_mapping


def _mapping_of(path: str | os.PathLike[str], mapping: LogMapping | str | os.PathLike[str] | None) -> LogMapping:
    from rrrgen.lab.data.mapping import load_mapping

    place = Path(path)
    if place.suffix.lower() in MAPPING_SUFFIXES and mapping is None:
        return load_mapping(place)
    if isinstance(mapping, LogMapping):
        return mapping.with_file(place)
    if mapping is not None:
        return load_mapping(mapping).with_file(place)
    return _own_mapping(place)


def _own_mapping(path: Path) -> LogMapping:
    from rrrgen.lab.data.mapping import FileSource
    from rrrgen.lab.data.tables import table_fault
    from rrrgen.lab.data.tables.formats import open_table

    columns = open_table(FileSource("log", path)).columns
    joints = tuple(name[2:] for name in columns if name.startswith("q_"))
    if "t" not in columns or not joints:
        raise table_fault(
            path,
            "without a mapping file a recording needs the columns t, q_<joint>, tau_<joint>",
            f"there are: {', '.join(columns[:20])}",
        )
    velocity, torque = (all(f"{key}_{joint}" in columns for joint in joints) for key in ("dq", "tau"))
    base = [key for key, parts in BASE_COLUMNS.items() if any(f"{key}_{part}" in columns for part in parts)]
    wanted = [f"{key}_{part}" for key in dict.fromkeys((*base, "orientation", "twist")) for part in BASE_COLUMNS[key]]
    missing = [name for name in wanted if name not in columns]
    if base and missing:
        hint = "a floating base has at least orientation_x, .., orientation_w and twist_vx, .., twist_wz"
        raise table_fault(path, f"of the floating base there is no {', '.join(missing)}", hint)
    return plain_mapping(path, joints, velocity, torque, base)


def read_log(
    path: str | os.PathLike[str],
    mapping: LogMapping | str | os.PathLike[str] | None = None,
    joints: Sequence[str] | None = None,
    chunk: int = CHUNK,
) -> Log:
    """Read a whole recording into memory.

    ``path`` is a mapping file, or a recording with its ``mapping`` (object or file); without a mapping, the recording
    must have the columns ``t, q_<joint>, [dq_<joint>,] tau_<joint>`` in SI. ``joints`` are the joint names of the robot
    in order, which must be those of the recording. ``chunk`` is the number of rows read at a time. Raises
    :class:`InputError` for a recording that cannot be read or repaired.
    """
    return load_stream(LogStream(open_log(path, mapping), chunk), joints)


def load_stream(stream: LogStream, joints: Sequence[str] | None = None) -> Log:
    """Load a stream into memory; raises InputError if ``joints`` are given and are not its joint names."""
    if joints is not None:
        check_joints(stream.joints, joints)
    parts = list(stream.parts())
    whole = join_parts(parts)
    return Log(
        joints=stream.joints,
        t=whole.t,
        q=whole.q,
        tau=whole.tau,
        dq=whole.dq,
        ddq=whole.ddq,
        period=stream.period,
        valid=whole.valid,
        segment=np.concatenate([np.full(len(part), part.segment, np.int64) for part in parts]),
        repairs=stream.repairs,
        mapping=stream.mapping,
        reference=whole.reference,
        reference_velocity=whole.reference_velocity,
        feedforward=whole.feedforward,
        floating=whole.floating,
    )


def check_robot(mapping: LogMapping, spec: Any) -> None:
    """Check that a recording fits a robot: joint names, units for revolute or prismatic joints, coupled drives.

    ``mapping`` describes the recording, ``spec`` is the robot file. Raises :class:`InputError` listing every mismatch.
    """
    check_joints(mapping.names, recorded_joints(spec, mapping.floating))
    faults = []
    for joint, channels in zip(spec.joints, mapping.joints[-spec.n :], strict=True):
        wrong = (LENGTH, FORCE) if joint.is_revolute else (ANGLE, TORQUE)
        for signal, table in zip(("position", "torque"), wrong, strict=True):
            channel = channels.position if signal == "position" else channels.torque
            if channel is not None and channel.unit in table:
                message = f"joint {joint.name} is {joint.type}, but its {signal} is in {channel.unit}"
                faults.append(Fault(mapping.source or "recording", 0, 0, message))
    place = mapping.source or "recording"
    faults += [Fault(place, 0, 0, message, hint=hint) for message, hint in _coupling_faults(mapping, spec)]
    if faults:
        raise InputError(faults)


def _coupling_faults(mapping: LogMapping, spec: Any) -> Iterator[tuple[str, str]]:
    """Message and hint for every motor whose row of the transmission is not a multiple of that in the robot file."""
    if spec.drives is None or mapping.transmission is None:
        return
    stated = np.array(spec.drives.motor_from_joint, dtype=float)
    names, transmission = mapping.names[-spec.n :], mapping.transmission[-spec.n :, -spec.n :]
    for motor, stated_row, row in zip(spec.drives.motors, stated, transmission, strict=True):
        cosine = abs(stated_row @ row) / (np.linalg.norm(stated_row) * np.linalg.norm(row))
        if cosine < 1.0 - SAME_DIRECTION:
            moved = [" and ".join(names[i] for i in np.flatnonzero(weights)) for weights in (row, stated_row)]
            message = f"motor {motor.name} turns with {moved[0]} by the transmission, with {moved[1]} by the robot file"
            rows = "; ".join(f"[{', '.join(f'{w:g}' for w in weights)}]" for weights in stated)
            yield message, f"rows of the robot's drives, each up to a factor: {rows}"


def recorded_joints(spec: Any, floating: bool) -> list[str]:
    """Names of the joints of a recording of the robot ``spec``, behind those of a ``floating`` base.

    Raises :class:`InputError` if the robot has no such base.
    """
    if floating and not spec.floating_base:
        raise InputError("the recording has the motion of a floating base, but the robot file states no floating_base")
    return [*(ON_BASE if floating else ()), *(joint.name for joint in spec.joints)]


def check_joints(recorded: Sequence[str], robot: Sequence[str]) -> None:
    """Check that the recorded joint names are those of the robot, in the same order; raises :class:`InputError`."""
    if len(recorded) != len(robot):
        raise InputError(f"the recording has {len(recorded)} joints, the robot {len(robot)}")
    if tuple(recorded) != tuple(robot):
        raise InputError(
            f"the joints of the recording ({', '.join(recorded)}) are not those of the robot ({', '.join(robot)}); "
            "name them alike, in the same order"
        )
