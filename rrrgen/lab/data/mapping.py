"""The mapping of a recording: how its columns become joint positions and torques in SI.

A channel turns the numbers of one column into SI by ``value = sign * (column - zero) * factor``. Signals of the motor
side pass the transmission: with ``q_m = N (q - q_0)`` the joint has ``q = N^-1 q_m + q_0`` and ``tau = N' tau_m``,
where N (n, n) is the coupling matrix, or the diagonal of the gear ratios, and ``q_0`` the position of every joint at
which its encoder reads zero.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext import signal_units as log_units
from rrrgen.base.yamltext.document import FaultList, Node, ScalarNode, SequenceNode, describe, file_text, read_document
from rrrgen.base.yamltext.fields import UNITLESS, Entry, Reader, read_entries, words
from rrrgen.lab.data.preprocessing import read_processing

Side = Literal["joint", "motor"]
Signal = Literal["position", "velocity", "acceleration", "torque", "reference", "reference_velocity", "feedforward"]
SIGNALS: tuple[Signal, ...] = (
    *("position", "velocity", "acceleration", "torque", "reference", "reference_velocity", "feedforward"),
)

ON_BASE = ("base fx", "base fy", "base fz", "base mx", "base my", "base mz")
"""Names of the six channels of a floating base, which stand before those of the joints.

Their torques are the wrench on the base, their velocities and accelerations its twist and the rates of that. Their
positions are 0, 0 and the orientation x, y, z, w: only this enters the dynamics.
"""
BASE_COLUMNS: dict[str, tuple[str, ...]] = {
    "orientation": ("x", "y", "z", "w"),
    "twist": ("vx", "vy", "vz", "wx", "wy", "wz"),
    "twist_rate": ("vx", "vy", "vz", "wx", "wy", "wz"),
    "wrench": ("fx", "fy", "fz", "mx", "my", "mz"),
}
"""What is recorded of a floating base, and the names of its parts: plain recordings have columns ``twist_vx``, ..."""


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
    delay: float = 0.0  # s; how much later than it acted a torque was recorded
    gain: float = 1.0  # the part of ``factor`` that corrects a constant
    value: float | None = None  # SI; stands in place of a column: NaN where nothing was recorded


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
        channel: Channel | None = getattr(self, signal)
        return channel


ABSENT = Channel("", "", value=math.nan)
"""The channel of a signal that was not recorded, beside others that were."""


@dataclass(frozen=True)
class TimeSource:
    """Source of the sampling times: a constant ``period`` (s), or a ``column`` of a file, times ``factor`` in s."""

    period: float | None = None
    file: str = ""
    column: str | int = ""
    factor: float = 1.0


@dataclass(frozen=True)
class LogMapping:
    """The content of a mapping file: data files, time source and channels of every joint.

    ``transmission`` is the matrix N (n, n) with motor angles = N * joint angles, or None; ``processing`` holds the
    default preprocessing settings of the file. On a ``floating`` base, the first six joints are those of
    :data:`ON_BASE`.
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
    floating: bool = False

    @property
    def torque_lateness(self) -> float | Array:
        """How much later than their rows the recorded torques act, s: of all joints, or (n,) if delays are stated."""
        delays = np.array([0.0 if joint.torque is None else joint.torque.delay for joint in self.joints])
        return self.torque_delay - delays if delays.any() else self.torque_delay

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
        channels = [joint.channel(signal) for joint in self.joints]
        return [channel for channel in channels if channel is not None] if self.has(signal) else []

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
        if self.floating:  # its part of the transmission is the identity
            on_motor[: len(ON_BASE)] = on_motor[len(ON_BASE) :].any()
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


def plain_mapping(
    path: Path, joints: tuple[str, ...], velocity: bool = False, torque: bool = True, base: Sequence[str] = ()
) -> LogMapping:
    """The mapping of rrrgen's own recordings: columns ``t``, ``q_<joint>``, ``dq_<joint>``, ``tau_<joint>`` in SI.

    ``velocity`` and ``torque`` state whether the columns ``dq_<joint>`` and ``tau_<joint>`` are present, ``base`` what
    is recorded of a floating base, of :data:`BASE_COLUMNS`.
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
    mapping = LogMapping((FileSource(file, path),), TimeSource(file=file, column="t"), tuple(channels))
    columns = {key: [Channel(file, f"{key}_{part}") for part in BASE_COLUMNS[key]] for key in base}
    return on_floating_base(mapping, columns) if base else mapping


def on_floating_base(mapping: LogMapping, base: Mapping[str, Sequence[Channel]]) -> LogMapping:
    """Put the channels of a floating base before those of the joints.

    ``base`` holds the channels of ``orientation`` (4), ``twist`` (6), ``twist_rate`` (6) and ``wrench`` (6), of which
    the first two must be there. Signals of joints that were not recorded become :data:`ABSENT`.
    """
    still = Channel("", "", value=0.0)
    place = [still, still, *base["orientation"]]
    rates, wrench = base.get("twist_rate", [ABSENT] * 6), base.get("wrench", [ABSENT] * 6)
    base_joints = [
        JointChannels(name, position=place[k], velocity=base["twist"][k], acceleration=rates[k], torque=wrench[k])
        for k, name in enumerate(ON_BASE)
    ]
    joints = [
        replace(
            joint,
            velocity=joint.velocity or ABSENT,
            acceleration=joint.acceleration or ABSENT,
            torque=joint.torque or ABSENT,
        )
        for joint in mapping.joints
    ]
    N = mapping.transmission
    if N is not None:
        padded = np.eye(len(base_joints) + len(N))
        padded[len(base_joints) :, len(base_joints) :] = N
        N = padded
    processing = dict(mapping.processing)
    if "low_speed" in processing:
        processing["low_speed"] = (0.0,) * len(base_joints) + tuple(processing["low_speed"])
    return replace(mapping, joints=(*base_joints, *joints), transmission=N, processing=processing, floating=True)


# ------------------------------------------------------------------------------------------------------------------
# Reads the keys that mapping files and response files share: recorded files, time, columns by name or number.
# ------------------------------------------------------------------------------------------------------------------

FORMATS = ("csv", "npy", "npz", "mat", "hdf5", "parquet", "rosbag")
DECIMALS = (".", ",")
FILE_KEYS = {
    "path": Entry("the file, from the folder of this file on", required=True),
    "format": Entry(f"{words(FORMATS)}; by the suffix if missing"),
    "separator": Entry("of a text file: a character, or `tab`, `space`, `comma`, `semicolon`; found out if missing"),
    "decimal": Entry(f"of a text file: {words(DECIMALS)}; found out if missing"),
    "header": Entry("of a text file: number of header lines, after the skipped ones; found out if missing"),
    "skip": Entry("of a text file: number of lines to leave out before the header"),
    "comment": Entry("of a text file: what a comment begins with; `#` if missing"),
    "encoding": Entry("of a text file; UTF-8 if missing"),
    "topic": Entry("of a ROS bag with several"),
}
TIME_KEYS = {
    "rate": Entry("constant sampling rate", "Hz"),
    "period": Entry("constant sampling period, in place of a rate", "s"),
    "file": Entry("of recorded times; may be missing if there is only one"),
    "column": Entry("of recorded times, in place of a rate: its name, or its number from 1"),
    "unit": Entry(f"of recorded times: {words(log_units.TIME)}"),
}


class SourceReader(Reader):
    """Reads the keys of a YAML file that describe recorded files, their time and their columns.

    ``files`` are the recorded files by name, with paths relative to ``folder``; faults are added to ``faults``.
    """

    def __init__(self, faults: FaultList, folder: Path, elsewhere: Mapping[str, str] | None = None) -> None:
        super().__init__(faults, elsewhere)
        self.folder = folder
        self.files: dict[str, FileSource] = {}

    def read_files(self, node: Node | None) -> None:
        """Fill ``files`` from one path or description, or from a mapping of names to paths or descriptions."""
        if node is None:
            return
        if isinstance(node, ScalarNode):
            self.files["log"] = FileSource("log", self.folder / node.text)
            return
        entries = read_entries(node, "files", self.faults) or {}
        if "path" in entries and entries.keys() <= FILE_KEYS.keys():
            self.files["log"] = self.read_file("log", node, "files")
            return
        for alias, (_, value) in entries.items():
            if isinstance(value, ScalarNode):
                self.files[alias] = FileSource(alias, self.folder / self.text(value, f"files.{alias}"))
                continue
            self.files[alias] = self.read_file(alias, value, f"files.{alias}")
        if not self.files:
            self.faults.error(node, "files names no file")

    def read_file(self, alias: str, node: Node, what: str) -> FileSource:
        """Read the description of one file, a mapping that the messages call ``what``."""
        part = self.values(node, what, FILE_KEYS) or {}
        return FileSource(
            name=alias,
            path=self.folder / self.text(part["path"], "path") if "path" in part else self.folder,
            format=self.choice(part["format"], "format", FORMATS) if "format" in part else None,
            separator=self.separator(part.get("separator")),
            decimal=self.choice(part["decimal"], "decimal", DECIMALS) if "decimal" in part else None,
            header=self.whole(part.get("header"), "header", None),
            skip=self.whole(part.get("skip"), "skip", 0) or 0,
            comment=self.text(part["comment"], "comment") if "comment" in part else "#",
            encoding=self.text(part["encoding"], "encoding") if "encoding" in part else "utf-8-sig",
            topic=self.text(part["topic"], "topic") if "topic" in part else None,
        )

    def read_time(self, node: Node | None) -> TimeSource:
        """Read where the sampling times come from: a rate (Hz), a period (s), or a column of a file."""
        part = (self.values(node, "time", TIME_KEYS) or {}) if node is not None else {}
        given = [key for key in ("rate", "period", "column") if key in part]
        if node is not None and len(given) != 1:
            self.faults.error(node, "time needs exactly one of rate, period and column", "e.g. {rate: 1 kHz}")
        if "rate" in part:
            rate = self.quantity(part["rate"], "time.rate", log_units.RATE, "Hz", positive=True)
            return TimeSource(period=1.0 / rate if rate else None)
        if "period" in part:
            return TimeSource(period=self.quantity(part["period"], "time.period", log_units.TIME, "s", positive=True))
        if "column" not in part:
            return TimeSource(period=1.0)
        unit: str | None = None
        if "unit" in part:
            unit = log_units.read_unit(part["unit"], "time", log_units.TIME, self.faults)
        elif node is not None:
            self.faults.error(node, "time.column needs a unit", f"allowed are {', '.join(log_units.TIME)}")
        return TimeSource(
            file=self.file_of(part.get("file"), "time", node),
            column=self.column(part["column"], "time.column"),
            factor=log_units.TIME[unit or "s"],
        )

    def file_of(self, node: Node | None, what: str, where: Node | None) -> str:
        """Read the name of a recorded file; None stands for the only one. A fault is located at ``where``."""
        if node is None:
            if len(self.files) > 1:
                self.faults.error(where, f"{what} needs the key 'file'", f"one of {', '.join(self.files)}")
            return next(iter(self.files), "")
        return self.choice(node, f"{what}.file", tuple(self.files))

    def column(self, node: Node, what: str) -> str | int:
        """Read a column, given by its name or by its number counted from 1; ``what`` describes it in messages."""
        text = self.text(node, what)
        quoted = isinstance(node, ScalarNode) and node.quoted
        return int(text) if text.isdecimal() and not quoted else text

    def separator(self, node: Node | None) -> str | None:
        """Read the separator of columns: the character itself or its name, such as "tab"; None if ``node`` is None."""
        if node is None:
            return None
        words = {"tab": "\t", "space": " ", "comma": ",", "semicolon": ";", "\\t": "\t"}
        value = node.text if isinstance(node, ScalarNode) else self.text(node, "separator")
        return words.get(value, value) or None


# ------------------------------------------------------------------------------------------------------------------
# Reads a mapping file (YAML) into a :class:`LogMapping`; all its faults are reported together with their places.
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-log/1"

SIDES = ("joint", "motor")
KEYS = {
    "mapping": {
        "schema": Entry(words([SCHEMA]), required=True),
        "name": Entry("of the recording"),
        "description": Entry("what was recorded"),
        "files": Entry(
            "path or description of the recording; or several as name: path, or name: description", required=True
        ),
        "time": Entry("when the samples were taken", required=True),
        "units": Entry("signal: unit of its columns, for all joints"),
        "side": Entry("where signals are measured: `joint` (if missing) or `motor`"),
        "joints": Entry("list with a row per joint", required=True),
        "base": Entry("what was recorded of a floating base"),
        "transmission": Entry("`matrix` of coupled motors, a row per motor: motor angles = matrix * joint angles"),
        "torque_delay": Entry(
            "how much later than its row a recorded torque acts, in the mean; half a sampling period for commands that "
            "are held until the next; 0 if missing",
            "s",
        ),
        "max_gap": Entry("longer holes split the recording", "s"),
        "processing": Entry("how the motion is reconstructed"),
    },
    "joint": {
        "name": Entry("the joint of the robot file", required=True),
        "position": Entry("measured: a column, or a channel", required=True),
        "velocity": Entry("measured, alike"),
        "acceleration": Entry("measured, alike"),
        "torque": Entry("measured or commanded torque, force or current, alike"),
        "reference": Entry("position that the controller was given, for `--controller`"),
        "reference_velocity": Entry("speed that the controller was given"),
        "feedforward": Entry("torque that was added to that of the controller"),
        "zero": Entry("position of the joint at which its encoder reads zero", "rad, m"),
        "gear_ratio": Entry("motor turns per joint turn"),
        "side": Entry("as above, of this joint"),
    },
    "base": {
        "file": Entry("name of the file; may be missing if there is only one"),
        "orientation": Entry(
            "list of four columns: unit quaternion x, y, z, w of the base in the world", required=True
        ),
        "twist": Entry(
            "list of six columns: velocity of the base origin, m/s, and angular velocity, rad/s, in base axes",
            required=True,
        ),
        "twist_rate": Entry(
            "list of six columns: rates of these components; by the filter of the joints if missing", "m/s^2, rad/s^2"
        ),
        "wrench": Entry(
            "list of six columns: force, N, and moment about the base origin, N m, on the base in its axes; `none` in "
            "flight, where it is zero; missing where it was not measured"
        ),
    },
    "channel": {
        "file": Entry("name of the file; may be missing if there is only one"),
        "column": Entry("its name, or its number from 1", required=True),
        "unit": Entry("of the column, in place of `units`"),
        "sign": Entry("1 or -1"),
        "zero": Entry("what the column reads at zero", "that of the column"),
        "side": Entry("as above, of this channel"),
        "wraps_at": Entry("what an encoder counts up to before it starts over", "that of the column"),
        "resolution": Entry("of a column in `counts`: angle or length of one count", "rad, m"),
        "counts_per_turn": Entry("of a column in `counts`, in place of its resolution"),
        "constant": Entry("of a torque measured as current or voltage: torque per ampere or volt", "N*m/A"),
        "rated": Entry("of a torque measured in per cent: that at 100 %", "N*m, N"),
        "limit": Entry("torque or force at which the drive saturates", "N*m, N"),
        "gain": Entry("factor on the column, such as the correction of a torque constant; 1 if missing"),
        "delay": Entry("of a torque: how much later than it acted it was recorded; 0 if missing", "s"),
    },
}
KEYS_OF_OTHER_FILES = {
    "coupled_drives": "friction and inertia of motors that turn with several joints are part of the robot file: "
    "drives: {drive_from_joint: [[1, 0], [1, 1]], motors: [{name: m1}, {name: m2, inertia: 0, friction: {viscous: 0}}]}"
}
"""Keys that belong to another file, with a hint where."""
UNITS_OF: dict[Signal, Signal] = {"reference": "position", "reference_velocity": "velocity", "feedforward": "torque"}
"""Signals whose unit is that of another signal where `units` does not state it."""

UNREAD = "?"
"""In place of a unit that is a fault already, so that no other fault follows from it."""
UNITS_WITH: dict[str, tuple[str, ...]] = {
    "counts_per_turn": (log_units.COUNTS, log_units.COUNTS + "/s"),
    "resolution": (log_units.COUNTS, log_units.COUNTS + "/s"),
    "constant": tuple(unit for unit in log_units.DRIVE_SIGNALS if unit != "%"),
    "rated": ("%",),
}
"""Keys of a channel that have an effect on columns in certain units only."""
SIGNAL_WITH: dict[str, tuple[Signal, str]] = {
    "limit": ("torque", "torques at which the drive saturates are left out"),
    "delay": ("torque", "torques may lag behind positions"),
    "wraps_at": ("position", "an encoder may start over"),
}
"""Keys of a channel that have an effect on one signal only, with the reason."""

UNITS: dict[Signal, dict[str, float]] = {
    "position": log_units.POSITION | {log_units.COUNTS: 1.0},
    "velocity": log_units.VELOCITY | {log_units.COUNTS + "/s": 1.0},
    "acceleration": log_units.ACCELERATION,
    "torque": log_units.TORQUE | log_units.FORCE | log_units.DRIVE_SIGNALS,
    "reference": log_units.POSITION | {log_units.COUNTS: 1.0},
    "reference_velocity": log_units.VELOCITY | {log_units.COUNTS + "/s": 1.0},
    "feedforward": log_units.TORQUE | log_units.FORCE | log_units.DRIVE_SIGNALS,
}


def load_mapping(path: str | os.PathLike[str]) -> LogMapping:
    """Read the mapping file ``path``; relative paths in it start from its folder.

    Raises :class:`InputError` with every fault and its line and column.
    """
    return loads_mapping(file_text(path, "mapping file"), str(path))


def loads_mapping(text: str, file: str = "log.yaml") -> LogMapping:
    """Read a mapping from YAML ``text``; ``file`` names it in messages, and its folder is where relative paths start.

    Raises :class:`InputError` with every fault and its line and column.
    """

    def read(root: Node, faults: FaultList) -> LogMapping | None:
        return _MappingReader(faults, Path(file).parent).mapping(root)

    return read_document(text, file, "mapping file", read)


class _MappingReader(SourceReader):
    """Reads one mapping file; ``faults`` collects what is wrong with it, paths in it are relative to ``folder``."""

    def __init__(self, faults: FaultList, folder: Path) -> None:
        super().__init__(faults, folder, KEYS_OF_OTHER_FILES)
        self.units: dict[str, str] = {}
        self.side: Side = "joint"
        self.gears: dict[int, float] = {}

    def mapping(self, root: Node) -> LogMapping | None:
        top = self.section(root, "mapping", "the mapping file")
        if top is None:
            return None
        if "schema" in top:
            self.choice(top["schema"], "schema", (SCHEMA,))
        self.read_files(top.get("files"))
        self.read_units(top.get("units"))
        if "side" in top:
            self.side = self.read_side(top["side"], "side")
        joints = self.read_joints(top.get("joints"))
        base = self.read_base(top.get("base"))
        late = self.quantity(top.get("torque_delay"), "torque_delay", log_units.TIME, "s")
        mapping = LogMapping(
            files=tuple(self.files.values()),
            time=self.read_time(top.get("time")),
            joints=tuple(joints),
            transmission=self.read_transmission(top.get("transmission"), joints),
            max_gap=self.max_gap(top.get("max_gap")),
            torque_delay=late or 0.0,
            processing=read_processing(top.get("processing"), len(joints), self.faults),
            name=self.text(top["name"], "name") if "name" in top else "",
            source=self.faults.file,
        )
        if not base:
            return mapping
        for key in ("var_eta", "var_xi"):
            if key in mapping.processing:
                hint = "it is chosen for joints and base together: leave it away, or name another method"
                self.faults.error(top.get("processing"), f"processing states {key} of the joints alone", hint)
        return on_floating_base(mapping, base)

    # -- sections ------------------------------------------------------------------------------------------------

    def section(self, node: Node, kind: str, what: str) -> dict[str, Node] | None:
        return self.values(node, what, KEYS[kind])

    def read_units(self, node: Node | None) -> None:
        if node is None:
            return
        for name, (key, value) in (read_entries(node, "units", self.faults) or {}).items():
            signal = next((s for s in SIGNALS if s == name), None)
            if signal is None:
                self.faults.error(key, f"unknown signal '{name}' in units", f"allowed are {', '.join(SIGNALS)}")
            elif unit := log_units.read_unit(value, f"units.{name}", UNITS[signal], self.faults):
                self.units[signal] = unit

    def read_joints(self, node: Node | None) -> list[JointChannels]:
        if node is None:
            return []
        if not isinstance(node, SequenceNode) or not node.items:
            self.faults.error(node, f"joints is {describe(node)}, not a list", "one entry per joint, in order")
            return []
        joints, seen = [], {}
        for index, item in enumerate(node.items):
            what = f"joints[{index}]"
            part = self.section(item, "joint", what)
            if part is None:
                continue
            side = self.read_side(part["side"], what) if "side" in part else self.side
            if "gear_ratio" in part:
                ratio = self.number(part["gear_ratio"], f"{what}.gear_ratio")
                if ratio == 0.0:
                    self.faults.error(part["gear_ratio"], "a gear ratio of zero")
                self.gears[index] = ratio or 1.0
            name = self.text(part["name"], f"{what}.name") if "name" in part else f"joint {index + 1}"
            if name in seen:
                self.faults.error(part.get("name", item), f"a second joint '{name}'")
            seen[name] = index
            channels = {s: self.read_channel(part[s], s, f"{what}.{s}", side) for s in SIGNALS if s in part}
            if "gear_ratio" in part and all(channel.side == "joint" for channel in channels.values()):
                message = f"{what}.gear_ratio has no effect, because no signal of the joint is measured at the motor"
                self.faults.error(part["gear_ratio"], message, "side: motor")
            joints.append(
                JointChannels(
                    name=name,
                    position=channels.get("position") or Channel("", ""),
                    velocity=channels.get("velocity"),
                    acceleration=channels.get("acceleration"),
                    torque=channels.get("torque"),
                    reference=channels.get("reference"),
                    reference_velocity=channels.get("reference_velocity"),
                    feedforward=channels.get("feedforward"),
                    zero=self.joint_zero(part.get("zero"), f"{what}.zero", channels.get("position")),
                )
            )
        for signal in SIGNALS[1:]:
            missing = [j.name for j in joints if j.channel(signal) is None]
            if missing and len(missing) < len(joints):
                self.faults.error(
                    node, f"some joints have a {signal}, but not {', '.join(missing)}", "give all or none"
                )
        return joints

    def joint_zero(self, node: Node | None, what: str, position: Channel | None) -> float:
        """Position (rad, m) at which the encoder of a joint reads zero: an angle where ``position`` is one."""
        unit = "" if position is None else position.unit
        table = next((kind for kind in (log_units.ANGLE, log_units.LENGTH) if unit in kind), log_units.POSITION)
        return self.quantity(node, what, table, next(iter(table))) or 0.0

    def read_base(self, node: Node | None) -> dict[str, list[Channel]]:
        """Read the channels of a floating base (:func:`on_floating_base`); empty without any."""
        if node is None:
            return {}
        part = self.section(node, "base", "base") or {}
        channels: dict[str, list[Channel]] = {}
        for key, parts in BASE_COLUMNS.items():
            if key not in part:
                continue
            value, what = part[key], f"base.{key}"
            if key == "wrench" and isinstance(value, ScalarNode) and value.text == "none":
                channels[key] = [Channel("", "", value=0.0)] * len(parts)
            elif not isinstance(value, SequenceNode) or len(value.items) != len(parts):
                self.faults.error(value, f"{what} is no list of {len(parts)} columns", f"those of {', '.join(parts)}")
            else:
                file = self.file_of(part.get("file"), "base", node)
                channels[key] = [Channel(file, self.column(item, f"{what}[{k}]")) for k, item in enumerate(value.items)]
        return channels if {"orientation", "twist"} <= channels.keys() else {}

    def read_channel(self, node: Node, signal: Signal, what: str, side: Side) -> Channel:
        if isinstance(node, ScalarNode):
            part: dict[str, Node] = {"column": node}
        else:
            part = self.section(node, "channel", what) or {}
        unit = self.units.get(signal) or self.units.get(UNITS_OF.get(signal, signal), "")
        if "unit" in part:
            unit = log_units.read_unit(part["unit"], what, UNITS[signal], self.faults) or UNREAD
        elif not unit:
            hint = f"give it here or once in units.{signal}; allowed are {', '.join(UNITS[signal])}"
            self.faults.error(node, f"{what} has no unit", hint)
        sign = self.number(part["sign"], f"{what}.sign") if "sign" in part else 1.0
        if sign not in (1.0, -1.0):
            self.faults.error(part.get("sign"), f"{what}.sign is not +1 or -1", "scale with constant or resolution")
        side = self.read_side(part["side"], what) if "side" in part else side
        gain = self.gain(part.get("gain"), what)
        self.refuse_idle_keys(part, signal, unit, what)
        return Channel(
            file=self.file_of(part.get("file"), what, node),
            column=self.column(part["column"], f"{what}.column") if "column" in part else "",
            factor=self.factor(part, signal, unit, what, node) * gain,
            gain=gain,
            delay=self.quantity(part.get("delay"), f"{what}.delay", log_units.TIME, "s") or 0.0,
            sign=sign or 1.0,
            zero=(self.number(part["zero"], f"{what}.zero") or 0.0) if "zero" in part else 0.0,
            side=side,
            wraps=self.quantity(part.get("wraps_at"), f"{what}.wraps_at", UNITLESS, "one", positive=True),
            unit=unit,
            limit=self.limit(part.get("limit"), what),
        )

    def gain(self, node: Node | None, what: str) -> float:
        """Factor on a column; a fault unless it is positive (`sign` reverses a column)."""
        value = 1.0 if node is None else self.number(node, f"{what}.gain")
        if value is not None and value <= 0.0:
            self.faults.error(node, f"{what}.gain is {value:g}, not positive", "sign: -1 reverses a column")
        return value if value is not None and value > 0.0 else 1.0

    def refuse_idle_keys(self, part: dict[str, Node], signal: Signal, unit: str, what: str) -> None:
        """Record a fault for every key of a channel that would have no effect on a ``signal`` in this ``unit``."""
        for key, (only, reason) in SIGNAL_WITH.items():
            if key in part and signal != only:
                self.faults.error(part[key], f"{what} has a {key}, which only a {only} has", reason)
        for key, units in UNITS_WITH.items():
            if key in part and unit not in ("", UNREAD, *units):
                possible = [name for name in units if name in UNITS[signal]]
                hint = f"it belongs to a column in {' or '.join(possible or units)}"
                hint += f": state the unit of the column, or leave {key} away" if possible else ""
                self.faults.error(part[key], f"{what}.{key} has no effect on a column in {unit}", hint)
        if "counts_per_turn" in part and "resolution" in part:
            self.faults.error(part["resolution"], f"{what} has both counts_per_turn and resolution", "give one of them")

    def nonzero(self, value: float | None, node: Node | None, what: str) -> float:
        """The ``value`` of a factor; a fault and 1 if it is zero, 1 if it is None."""
        if value == 0.0:
            self.faults.error(node, f"{what} is zero", "every row of the column would read the same")
        return value or 1.0

    def factor(self, part: dict[str, Node], signal: Signal, unit: str, what: str, node: Node) -> float:
        """Factor that converts a column of a ``signal`` to SI, from the keys ``part`` that describe its channel.

        It comes from an encoder resolution, a torque constant, a rated torque, or the name of the ``unit``.
        """
        if unit.startswith(log_units.COUNTS):
            if "counts_per_turn" in part:
                counts = self.number(part["counts_per_turn"], f"{what}.counts_per_turn")
                return 2.0 * math.pi / self.nonzero(counts, part["counts_per_turn"], f"{what}.counts_per_turn")
            if "resolution" not in part:
                self.faults.error(node, f"{what} in counts needs counts_per_turn or resolution", "e.g. 0.001 deg")
            step = self.quantity(part.get("resolution"), f"{what}.resolution", log_units.POSITION, "rad")
            return self.nonzero(step, part.get("resolution"), f"{what}.resolution")
        if signal not in ("torque", "feedforward") or unit not in log_units.DRIVE_SIGNALS:
            return UNITS[signal].get(unit, 1.0)
        key, table = ("rated", log_units.TORQUE | log_units.FORCE) if unit == "%" else ("constant", log_units.CONSTANT)
        if key not in part:
            hint = "the torque at 100 %" if unit == "%" else f"the torque or force per {unit}, e.g. 0.12 N*m/A"
            self.faults.error(node, f"{what} in {unit} needs the key '{key}'", hint)
        value = self.quantity(part.get(key), f"{what}.{key}", table, next(iter(table)))
        return log_units.DRIVE_SIGNALS[unit] * self.nonzero(value, part.get(key), f"{what}.{key}")

    def read_transmission(self, node: Node | None, joints: list[JointChannels]) -> Array | None:
        if node is None:
            if not self.gears:
                return None
            return np.diag([self.gears.get(i, 1.0) for i in range(len(joints))])
        entries = read_entries(node, "transmission", self.faults) or {}
        if set(entries) != {"matrix"}:
            self.faults.error(
                node, "transmission needs the key 'matrix' and no other", "rows: motor angles in the joints"
            )
            return None
        if self.gears:
            self.faults.error(node, "both a transmission matrix and gear ratios", "the matrix holds the gear ratios")
        rows_node = entries["matrix"][1]
        if not isinstance(rows_node, SequenceNode) or len(rows_node.items) != len(joints):
            self.faults.error(rows_node, f"transmission.matrix needs {len(joints)} rows, one per joint")
            return None
        rows = [self.numbers(row, f"matrix[{i}]", len(joints)) for i, row in enumerate(rows_node.items)]
        if not all(rows):
            return None
        N = np.array(rows, float)
        if not abs(np.linalg.det(N)) > 1e-12 * np.prod(np.linalg.norm(N, axis=1)):  # a row of zeros included
            self.faults.error(rows_node, "the transmission matrix is singular", "joint angles would not be determined")
            return None
        return N

    # -- values --------------------------------------------------------------------------------------------------

    def read_side(self, node: Node, what: str) -> Side:
        return "motor" if self.choice(node, f"{what} (side)", SIDES) == "motor" else "joint"

    def max_gap(self, node: Node | None) -> float | None:
        gap = self.quantity(node, "max_gap", log_units.TIME, "s")
        if gap is not None and gap < 0.0:
            self.faults.error(node, "max_gap is negative", "0 lets every hole split the recording")
        return gap

    def limit(self, node: Node | None, what: str) -> float | None:
        if node is None:
            return None
        return self.quantity(node, f"{what}.limit", log_units.TORQUE | log_units.FORCE, "N*m", positive=True)
