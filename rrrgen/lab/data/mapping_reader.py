"""Reads a mapping file (YAML) into a :class:`LogMapping`; all its faults are reported together with their places."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext import signal_units as log_units
from rrrgen.base.yamltext.document import FaultList, Node, Scalar, Sequence, decode, parse_document
from rrrgen.base.yamltext.keys import Entry, words
from rrrgen.base.yamltext.sections import describe, read_entries
from rrrgen.lab.data.mapping import SIGNALS, Channel, JointChannels, LogMapping, Side, Signal
from rrrgen.lab.data.processing import read_processing
from rrrgen.lab.data.source_reader import SourceReader

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
    },
}
KEYS_OF_OTHER_FILES = {
    "coupled_drives": "friction and inertia of motors that turn with several joints are part of the robot file: "
    "drives: {drive_from_joint: [[1, 0], [1, 1]], motors: [{name: m1}, {name: m2, inertia: 0, friction: {viscous: 0}}]}"
}
"""Keys that belong to another file, with a hint where."""
UNITS_OF: dict[Signal, Signal] = {"reference": "position", "reference_velocity": "velocity", "feedforward": "torque"}
"""Signals whose unit is that of another signal where `units` does not state it."""

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
    place = Path(path)
    try:
        data = place.read_bytes()
    except OSError as error:
        raise InputError([Fault(str(path), 0, 0, f"cannot read the mapping file: {error.strerror or error}")]) from None
    return loads_mapping(decode(data, str(path)), str(path))


def loads_mapping(text: str, file: str = "log.yaml") -> LogMapping:
    """Read a mapping from YAML ``text``; ``file`` names it in messages, and its folder is where relative paths start.

    Raises :class:`InputError` with every fault and its line and column.
    """
    faults = FaultList(file, text)
    mapping = _Reader(faults, Path(file).parent).mapping(parse_document(text, faults))
    faults.raise_errors()
    if mapping is None:
        raise InputError([Fault(file, 0, 0, "the mapping file says nothing")])
    return mapping


class _Reader(SourceReader):
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
        gap = top.get("max_gap")
        late = self.quantity(top.get("torque_delay"), "torque_delay", log_units.TIME, "s")
        return LogMapping(
            files=tuple(self.files.values()),
            time=self.read_time(top.get("time")),
            joints=tuple(joints),
            transmission=self.read_transmission(top.get("transmission"), joints),
            max_gap=None if gap is None else self.quantity(gap, "max_gap", log_units.TIME, "s"),
            torque_delay=late or 0.0,
            processing=read_processing(top.get("processing"), len(joints), self.faults),
            name=self.text(top["name"], "name") if "name" in top else "",
            source=self.faults.file,
        )

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
        if not isinstance(node, Sequence) or not node.items:
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
                    zero=self.quantity(part.get("zero"), f"{what}.zero", log_units.POSITION, "rad") or 0.0,
                )
            )
        for signal in SIGNALS[1:]:
            missing = [j.name for j in joints if j.channel(signal) is None]
            if missing and len(missing) < len(joints):
                self.faults.error(
                    node, f"some joints have a {signal}, but not {', '.join(missing)}", "give all or none"
                )
        return joints

    def read_channel(self, node: Node, signal: Signal, what: str, side: Side) -> Channel:
        if isinstance(node, Scalar):
            part: dict[str, Node] = {"column": node}
        else:
            part = self.section(node, "channel", what) or {}
        unit = self.units.get(signal) or self.units.get(UNITS_OF.get(signal, signal), "")
        if "unit" in part:
            unit = log_units.read_unit(part["unit"], what, UNITS[signal], self.faults) or "one"
        elif not unit:
            hint = f"give it here or once in units.{signal}; allowed are {', '.join(UNITS[signal])}"
            self.faults.error(node, f"{what} has no unit", hint)
        sign = self.number(part["sign"], f"{what}.sign") if "sign" in part else 1.0
        if sign not in (1.0, -1.0):
            self.faults.error(part.get("sign"), f"{what}.sign is not +1 or -1", "scale with constant or resolution")
        side = self.read_side(part["side"], what) if "side" in part else side
        return Channel(
            file=self.file_of(part.get("file"), what, node),
            column=self.column(part["column"], f"{what}.column") if "column" in part else "",
            factor=self.factor(part, signal, unit, what, node),
            sign=sign or 1.0,
            zero=(self.number(part["zero"], f"{what}.zero") or 0.0) if "zero" in part else 0.0,
            side=side,
            wraps=self.number(part["wraps_at"], f"{what}.wraps_at") if "wraps_at" in part else None,
            unit=unit,
            limit=self.limit(part.get("limit"), what),
        )

    def factor(self, part: dict[str, Node], signal: Signal, unit: str, what: str, node: Node) -> float:
        """Factor that converts a column of a ``signal`` to SI, from the keys ``part`` that describe its channel.

        It comes from an encoder resolution, a torque constant, a rated torque, or the name of the ``unit``.
        """
        if unit.startswith(log_units.COUNTS):
            if "counts_per_turn" in part:
                counts = self.number(part["counts_per_turn"], f"{what}.counts_per_turn")
                return 2.0 * math.pi / counts if counts else 1.0
            if "resolution" not in part:
                self.faults.error(node, f"{what} in counts needs counts_per_turn or resolution", "e.g. 0.001 deg")
            return self.quantity(part.get("resolution"), f"{what}.resolution", log_units.POSITION, "rad") or 1.0
        if signal not in ("torque", "feedforward") or unit not in log_units.DRIVE_SIGNALS:
            return UNITS[signal].get(unit, 1.0)
        key, table = ("rated", log_units.TORQUE | log_units.FORCE) if unit == "%" else ("constant", log_units.CONSTANT)
        if key not in part:
            hint = "the torque at 100 %" if unit == "%" else f"the torque or force per {unit}, e.g. 0.12 N*m/A"
            self.faults.error(node, f"{what} in {unit} needs the key '{key}'", hint)
        value = self.quantity(part.get(key), f"{what}.{key}", table, next(iter(table)))
        return log_units.DRIVE_SIGNALS[unit] * (1.0 if value is None else value)

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
        if not isinstance(rows_node, Sequence) or len(rows_node.items) != len(joints):
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

    def limit(self, node: Node | None, what: str) -> float | None:
        if node is None:
            return None
        return self.quantity(node, f"{what}.limit", log_units.TORQUE | log_units.FORCE, "N*m", positive=True)
