"""The mapping of a recording: how its columns become joint positions and torques in SI.

A channel turns the numbers of one column into SI by ``value = sign * (column - zero) * factor``. Signals of the motor
side pass the transmission: with ``q_m = N (q - q_0)`` the joint has ``q = N^-1 q_m + q_0`` and ``tau = N' tau_m``,
where N (n, n) is the coupling matrix, or the diagonal of the gear ratios, and ``q_0`` the position of every joint at
which its encoder reads zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError

Side = Literal["joint", "motor"]
Signal = Literal["position", "velocity", "acceleration", "torque", "reference", "reference_velocity", "feedforward"]
SIGNALS: tuple[Signal, ...] = (
    *("position", "velocity", "acceleration", "torque", "reference", "reference_velocity", "feedforward"),
)


@dataclass(frozen=True)
class FileSource:
    """One file ``path`` of a recording and its format; whatever is None is detected by the reader.

    ``name`` is that in the mapping file; ``skip`` lines are left out before the header; ``comment`` begins a comment;
    ``topic`` is that of a ROS recording. With ``arrays``, the columns (N,) by name, no file is read and ``path`` is a
    name for messages only.
    """

    name: str
    path: Path
    format: str | None = None
    separator: str | None = None
    decimal: str | None = None
    header: int | None = None  # number of header lines after the skipped ones; None: detected
    skip: int = 0
    comment: str = "#"
    encoding: str = "utf-8-sig"
    topic: str | None = None
    skip_truncated: bool = False  # leave out an incomplete last line, which is a fault otherwise
    arrays: Mapping[str, Array] | None = field(default=None, compare=False, repr=False)  # columns that are in memory


@dataclass(frozen=True)
class Channel:
    """One column of a file and its conversion to SI: ``value = sign * (column - zero) * factor``.

    ``side`` says whether joint or motor is measured; ``wraps`` is the period, in column units, after which an encoder
    starts over; ``limit`` is the declared torque limit, if any; ``unit`` is kept for messages.
    """

    file: str
    column: str | int
    factor: float = 1.0
    sign: float = 1.0
    zero: float = 0.0
    side: Side = "joint"
    wraps: float | None = None
    unit: str = ""
    limit: float | None = None  # torque at which the drive saturates, SI, on the side of the channel


@dataclass(frozen=True)
class JointChannels:
    """The channels of one joint; ``zero`` is the joint position (rad, m) at which its encoder reads zero.

    ``reference`` and ``reference_velocity`` are what the controller follows, ``feedforward`` a torque that it is given.
    """

    name: str
    position: Channel
    velocity: Channel | None = None
    acceleration: Channel | None = None
    torque: Channel | None = None
    reference: Channel | None = None
    reference_velocity: Channel | None = None
    feedforward: Channel | None = None
    zero: float = 0.0

    def channel(self, signal: Signal) -> Channel | None:
        """The channel of one signal, None if it is not recorded."""
        found: Channel | None = getattr(self, signal)
        return found


@dataclass(frozen=True)
class TimeSource:
    """Source of the sampling instants: a constant ``period`` (s), or a ``column`` of a file, times ``factor`` in s."""

    period: float | None = None
    file: str = ""
    column: str | int = ""
    factor: float = 1.0


@dataclass(frozen=True)
class LogMapping:
    """The content of a mapping file: data files, time source and channels of every joint.

    ``transmission`` is the matrix N (n, n) with motor angles = N * joint angles, or None; ``processing`` holds the
    default preprocessing settings of the file.
    """

    files: tuple[FileSource, ...]
    time: TimeSource
    joints: tuple[JointChannels, ...]
    transmission: Array | None = None
    max_gap: float | None = None  # s; a longer hole splits the recording
    torque_delay: float = 0.0  # s; how much later than its row a recorded torque acts, in the mean
    processing: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    source: str = ""  # the mapping file, for messages

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in order."""
        return tuple(joint.name for joint in self.joints)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def has(self, signal: Signal) -> bool:
        """Whether every joint has this signal."""
        return all(joint.channel(signal) is not None for joint in self.joints)

    def channels(self, signal: Signal) -> list[Channel]:
        """The channels of one signal, joint by joint; empty unless every joint has one."""
        found = [joint.channel(signal) for joint in self.joints]
        return [channel for channel in found if channel is not None] if self.has(signal) else []

    def _fault(self, message: str) -> InputError:
        return InputError([Fault(self.source or "mapping", 0, 0, message)])

    def without_truncated_lines(self) -> LogMapping:
        """A copy that leaves out an incomplete last line of every text file."""
        return replace(self, files=tuple(replace(source, skip_truncated=True) for source in self.files))

    def with_file(self, path: Path) -> LogMapping:
        """A copy for another recording: its only file is replaced by ``path``; InputError if it reads several files."""
        if len(self.files) != 1:
            names = ", ".join(source.name for source in self.files)
            raise self._fault(
                f"this mapping reads {len(self.files)} files ({names}); a single path cannot stand for them"
            )
        return replace(self, files=(replace(self.files[0], path=path),))

    def joint_side(self, signal: Signal, values: Array) -> Array:
        """Transform channel values in SI (N, n) to the joints, through the transmission if they are of the motor side.

        The zero position of the joints is added to positions and references only. Raises :class:`InputError` if the
        transmission is missing, or couples joints of which only some are recorded at the motor.
        """
        channels = self.channels(signal)
        on_motor = np.array([channel.side == "motor" for channel in channels])
        is_position, is_torque = signal in ("position", "reference"), signal in ("torque", "feedforward")
        if not on_motor.any():
            return values + self._zero if is_position else values
        if self.transmission is None:
            raise self._fault("signals of the motor side need gear ratios or a transmission matrix")
        N = self.transmission if on_motor.all() else self._diagonal(on_motor)
        moved = values @ N if is_torque else np.linalg.solve(N, values.T).T
        return np.asarray(moved + self._zero if is_position else moved)

    @property
    def _zero(self) -> Array:
        return np.array([joint.zero for joint in self.joints])

    def _diagonal(self, on_motor: Any) -> Array:
        """Diagonal matrix (n, n) of the gear ratios, with 1 for joints that are recorded on the joint side.

        ``on_motor`` (n,) flags the joints recorded on the motor side. Raises :class:`InputError` if the transmission
        couples any joints.
        """
        assert self.transmission is not None
        coupled = self.transmission - np.diag(np.diag(self.transmission))
        if np.any(coupled):
            raise self._fault("with a coupling matrix, one signal must be on the motor side of all joints or of none")
        return np.diag(np.where(on_motor, np.diag(self.transmission), 1.0))


def plain_mapping(path: Path, joints: tuple[str, ...], velocity: bool = False, torque: bool = True) -> LogMapping:
    """The mapping of rrrgen's own recordings: columns ``t``, ``q_<joint>``, ``dq_<joint>``, ``tau_<joint>`` in SI.

    ``velocity`` and ``torque`` state whether the columns ``dq_<joint>`` and ``tau_<joint>`` are present.
    """
    file = "log"
    channels = [
        JointChannels(
            name,
            position=Channel(file, f"q_{name}"),
            velocity=Channel(file, f"dq_{name}") if velocity else None,
            torque=Channel(file, f"tau_{name}") if torque else None,
        )
        for name in joints
    ]
    return LogMapping((FileSource(file, path),), TimeSource(file=file, column="t"), tuple(channels))
