"""A probable fault with its evidence and its remedy, and the wording of the faults that the rules can find.

A fault is worded identically whichever rule finds it, so that the evidence of several rules is merged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rrrgen.base.arrays import Array
from rrrgen.base.yamltext import signal_units
from rrrgen.lab.data.mapping import Channel, LogMapping, Signal

TABLES = {
    ("position", True): signal_units.ANGLE,
    ("position", False): signal_units.LENGTH,
    ("velocity", True): signal_units.VELOCITY,
    ("velocity", False): signal_units.VELOCITY,
    ("torque", True): signal_units.TORQUE,
    ("torque", False): signal_units.FORCE,
}
NAMES = {"position": "position", "velocity": "speed", "torque": "torque"}


@dataclass(frozen=True)
class Cause:
    """A probable fault: its description, the evidence in numbers, and what to write instead in which file.

    A ``general`` cause only states that something is wrong and is dropped if another rule finds a specific one. A cause
    that fits several faults names them in ``either``; its evidence is added to the one that another rule found. One
    that is ``possible`` only has too little evidence, or rivals that explain as much.
    """

    cause: str
    remedy: str
    evidence: tuple[str, ...] = ()
    general: bool = False
    either: tuple[str, ...] = ()
    possible: bool = False

    def because(self, *evidence: str) -> Cause:
        """A copy of this cause with more ``evidence``."""
        return replace(self, evidence=(*self.evidence, *evidence))

    def lines(self) -> list[str]:
        """The cause, its evidence and its remedy as lines to print."""
        return [
            f"{'possible' if self.possible else 'diagnosis'}: {self.cause}",
            *(f"  evidence: {sentence}" for sentence in self.evidence),
            f"  {'if so, write' if self.possible else 'write instead'}: {self.remedy}",
        ]

    def to_json(self) -> dict[str, Any]:
        """The cause as plain data for JSON."""
        named = {"possible_only": True} if self.possible else {}
        return {"cause": self.cause, "evidence": list(self.evidence), "write_instead": self.remedy, **named}


def merge_causes(causes: Iterable[Cause]) -> tuple[Cause, ...]:
    """Merge equal causes and their evidence; general causes are dropped if there are specific ones."""
    merged_causes: dict[str, Cause] = {}
    for fault in causes:
        before = merged_causes.get(fault.cause)
        if before is None:
            merged_causes[fault.cause] = fault
        else:
            merged_causes[fault.cause] = before.because(*(new for new in fault.evidence if new not in before.evidence))
    for fault in [cause for cause in merged_causes.values() if cause.either]:
        known = [name for name in fault.either if name in merged_causes]
        if known:
            del merged_causes[fault.cause]
            merged_causes[known[0]] = merged_causes[known[0]].because(*fault.evidence)
    specific = [cause for cause in merged_causes.values() if not cause.general]
    return tuple(specific or merged_causes.values())


@dataclass(frozen=True)
class Wording:
    """Formulates the causes found in one recording, with the names of its joints, columns and files.

    ``joints`` are the joint names, ``revolute`` (n,) the joint types, ``mapping`` describes the recording's columns if
    it has a mapping file, ``robot`` is the name of the robot file.
    """

    joints: tuple[str, ...]
    revolute: tuple[bool, ...]
    mapping: LogMapping | None = None
    robot: str = "robot"

    def name_joints(self, joints: Sequence[int]) -> str:
        """Text that names some ``joints`` (numbers from 0): ``joint q1``, ``joints q1, q2`` or ``all joints``."""
        if len(joints) == len(self.joints) > 1:
            return "all joints"
        return f"joint{'s' if len(joints) > 1 else ''} {', '.join(self.joints[i] for i in joints)}"

    def wrong_unit(self, signal: Signal, joints: Sequence[int], factor: float) -> Cause:
        """The cause that the ``signal`` of ``joints`` was read in a wrong unit.

        The true values are ``factor`` times those read.
        """
        units = [self._unit(signal, i, factor) for i in joints]
        read, true = (" and ".join(dict.fromkeys(column)) for column in zip(*units, strict=True))
        true = true if all(unit for _, unit in units) else ""
        size = f"{factor:.4g} times too small" if factor > 1.0 else f"{1.0 / factor:.4g} times too large"
        what = f"are in {true}, but are read in {read}" if true else f"are {size}"
        cause = f"the {NAMES[signal]}s of {self.name_joints(joints)} {what}"
        if true and len(joints) == len(self.joints) and len(set(units)) == 1:
            return Cause(cause, f"units: {{{signal}: {true}}}{self._where()}")
        entries = [
            self._entry(signal, i, f"unit: {unit}")
            if unit
            else f"{self._entry(signal, i)} with its scale times {factor:.6g}"
            for i, (_, unit) in zip(joints, units, strict=True)
        ]
        return Cause(cause, "; ".join(entries) + self._where())

    def wrong_sign(self, signals: Sequence[Signal], joint: int) -> Cause:
        """The cause that one of the ``signals`` of a joint is recorded with the wrong sign."""
        what = " or the ".join(NAMES[signal] for signal in signals)
        entries = []
        for signal in signals:
            channel = self._channel(signal, joint)
            entries.append(self._entry(signal, joint, f"sign: {'1' if channel and channel.sign < 0 else '-1'}"))
        doubt = ", whichever of them does not follow the robot file's sense" if len(signals) > 1 else ""
        name = self.joints[joint]
        return Cause(
            f"the {what} of joint {name} has the wrong sign",
            " or ".join(entries) + doubt + self._where(),
            either=() if len(signals) == 1 else tuple(self.wrong_sign([signal], joint).cause for signal in signals),
        )

    def exchanged_columns(self, signal: Signal, i: int, k: int) -> Cause:
        """The cause that the columns of a ``signal`` are exchanged between the joints ``i`` and ``k``."""
        first, second = (self._column(signal, j) for j in (i, k))
        entries = [self._entry(signal, i, column=second), self._entry(signal, k, column=first)]
        cause = f"the {NAMES[signal]}s of joints {self.joints[i]} and {self.joints[k]} are exchanged"
        return Cause(cause, "; ".join(entries) + self._where())

    def clock(self, factor: float) -> Cause:
        """The cause that time was read in a wrong unit: the true times are ``factor`` times those read."""
        source = None if self.mapping is None else self.mapping.time
        size = f"{factor:.4g} times too small" if factor > 1.0 else f"{1.0 / factor:.4g} times too large"
        cause = f"the clock is wrong: the times in seconds are {size}"
        if source is not None and source.period is not None:
            period = source.period * factor
            return Cause(cause, f"time: {{rate: {1.0 / period:.6g} Hz}}{self._where()}")
        current = 1.0 if source is None else source.factor
        unit = signal_units.unit_of_factor(signal_units.TIME, current * factor)
        column = "t" if source is None else source.column
        entry = f"unit: {unit}" if unit else f"a unit of {current * factor:.3g} s"
        if unit:
            read = signal_units.unit_of_factor(signal_units.TIME, current) or f"{current:g} s"
            cause = f"the clock is in {unit}, but is read in {read}"
        return Cause(cause, f"time: {{column: {column}, {entry}}}{self._where()}")

    def missing(self, joint: int, section: str, keys: Sequence[str], what: str) -> Cause:
        """The cause that the terms ``keys`` of the ``section`` of a joint are missing in the robot file."""
        inside = ", ".join(f"{key}: 0" for key in keys)
        return Cause(
            f"{what} of joint {self.joints[joint]} is not in the model",
            f"{section}: {{{inside}}} at joint {self.joints[joint]} in {self.robot} (a key that is given is estimated)",
        )

    def zero(self, joint: int, error: float) -> Cause:
        """The cause that the positions of a joint are ``error`` (rad, m) too small, because of its encoder's zero."""
        stated = 0.0 if self.mapping is None else self.mapping.joints[joint].zero
        name, true = self.joints[joint], stated + error
        zero = f"zero: {math.degrees(true):.4g} deg" if self.revolute[joint] else f"zero: {1e3 * true:.4g} mm"
        return Cause(f"the encoder zero of joint {name} is off", f"joint {name}: {zero}{self._where()}")

    def gain(self, joint: int, factor: float) -> Cause:
        """The cause that the torques of a joint are recorded ``factor`` times too large against the other joints."""
        channel = self._channel("torque", joint)
        gain = (1.0 if channel is None else channel.gain) / factor
        return Cause(
            f"the torque constant of joint {self.joints[joint]} is wrong",
            self._entry("torque", joint, f"gain: {gain:.4g}") + self._where(),
        )

    def gear_sides(self, ratios: Sequence[float] | Array, std: Sequence[float | None], at_motors: bool) -> Cause:
        """The cause that motion and torque are those of the other side of the gears.

        ``ratios`` (n,) are motor turns per joint turn; those whose deviation ``std`` (n,) is None are undetermined.
        """
        if not at_motors and all(abs(r - 1.0) < 0.2 for r, s in zip(ratios, std, strict=True) if s is not None):
            return Cause(
                "positions and torques are recorded at the joints, not at the motors", f"side: joint{self._where()}"
            )
        pairs = zip(self.joints, ratios, std, strict=True)
        gears = "; ".join(
            f"joint {name}: gear_ratio: " + ("that of its gear" if s is None else f"{r:.4g}") for name, r, s in pairs
        )
        where = "at the motors" if at_motors else "behind smaller gears"
        return Cause(f"positions and torques are recorded {where}", f"side: motor; {gears}{self._where()}")

    def delay(self, joint: int | None, late: float) -> Cause:
        """The cause that the torques of a joint, or of all joints (None), are recorded ``late`` (s) too late."""
        when = "late" if late > 0.0 else "early"
        if joint is None:
            stated = 0.0 if self.mapping is None else self.mapping.torque_delay
            line = f"torque_delay: {1e3 * (stated - late):.3g} ms"
            return Cause(f"the torques are recorded too {when}", line + self._where())
        channel = self._channel("torque", joint)
        total = (0.0 if channel is None else channel.delay) + late
        line = self._entry("torque", joint, f"delay: {1e3 * total:.3g} ms")
        return Cause(f"the torques of joint {self.joints[joint]} are recorded too {when}", line + self._where())

    def tilt(self, gravity: Sequence[float]) -> Cause:
        """The cause that the base is tilted: ``gravity`` (3,), m/s^2, is that in the frame of the base."""
        values = ", ".join(f"{value:.4g}" for value in gravity)
        return Cause("the base is tilted", f"gravity: [{values}] in {self.robot}, or level the base")

    def drift(self, joint: int | None) -> Cause:
        """The cause that the friction of a joint, or of all joints (None), changes during the recording."""
        whose = "the joints" if joint is None else f"joint {self.joints[joint]}"
        return Cause(
            f"the friction of {whose} drifts",
            "record after the arm has warmed up: the friction in the robot file is that of the middle of the recording",
        )

    def _channel(self, signal: Signal, joint: int) -> Channel | None:
        return None if self.mapping is None else self.mapping.joints[joint].channel(signal)

    def _column(self, signal: Signal, joint: int) -> str:
        channel = self._channel(signal, joint)
        return f"the column of joint {self.joints[joint]}" if channel is None else str(channel.column)

    def _entry(self, signal: Signal, joint: int, key: str = "", column: str = "") -> str:
        """Text of a mapping file entry to write, such as ``joint q1: position: {column: q_q1, sign: -1}``.

        ``key`` is an additional key with its value, ``column`` replaces the recorded column.
        """
        channel = self._channel(signal, joint)
        parts = [] if channel is None or self.mapping is None or len(self.mapping.files) < 2 else [channel.file]
        inside = [*(f"file: {part}" for part in parts), f"column: {column or self._column(signal, joint)}"]
        return f"joint {self.joints[joint]}: {signal}: {{{', '.join([*inside, key] if key else inside)}}}"

    def _unit(self, signal: Signal, joint: int, factor: float) -> tuple[str, str]:
        """Names of the unit in which a signal is read, and of the unit ``factor`` times as large ("" for none)."""
        table = TABLES[signal, self.revolute[joint]]
        channel = self._channel(signal, joint)
        read = channel.unit if channel is not None and channel.unit else signal_units.unit_of_factor(table, 1.0)
        return read, signal_units.unit_of_factor(table, table[read] * factor) if read in table else ""

    def _where(self) -> str:
        if self.mapping is None:
            return ""
        if self.mapping.source:
            return f", in {self.mapping.source}"
        return ", in a mapping file of this recording (docs/identification.md, section 3)"
