"""Discrete-time description of the joint controllers that were active during a recording.

Each joint has a list of signals, computed in order at every controller sample. A signal is a weighted sum, filter,
limit, sign or integral of earlier signals. The inputs are the measured position, the reference position and velocity,
the feed-forward torque and the constant 1.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.yamltext import signal_units as units
from rrrgen.base.yamltext.document import FaultList, Node, ScalarNode, SequenceNode, describe, file_text, read_document
from rrrgen.base.yamltext.fields import Entry, Reader, hint_for, read_entries, words

INPUTS = ("position", "reference", "reference_velocity", "feedforward", "constant")
"""Input signals of every joint controller."""
Kind = Literal["sum", "filter", "limit", "sign", "integral"]
KINDS: tuple[Kind, ...] = ("sum", "filter", "limit", "sign", "integral")
Record = Literal["applied", "command", "centred"]
RECORDS: tuple[Record, ...] = ("applied", "command", "centred")
SETTLED = 1e-4
"""Fraction of its initial transient below which a filter counts as settled."""


@dataclass(frozen=True)
class Operation:
    """Operation that computes one controller signal: its ``kind``, source signals ``of`` and coefficients ``values``.

    The meaning of ``values`` depends on the kind:

    - sum: one weight for each source signal.
    - filter: numerator, then denominator coefficients in ascending powers of 1/z; both have the same length and the
      first denominator coefficient is 1.
    - limit: lower and upper limit.
    - sign: half-width of the dead zone around zero in which the result is 0.
    - integral: gain times sampling period, then lower and upper limit of the integral.
    """

    kind: Kind
    of: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class JointController:
    """Controller of one joint: maps signal names to operations, in the order in which they are computed.

    ``torque`` names the signal that is recorded as torque, ``acts`` the signal that drives the joint.
    """

    name: str
    signals: Mapping[str, Operation]
    torque: str
    acts: str


@dataclass(frozen=True)
class LoopController:
    """Controllers of all joints, with their common sampling ``period`` (s).

    ``delay`` is the time from reading the encoders until the torque acts, in sampling periods; it adds to delays
    inside the signals. ``records`` says which torque is stored with each sample: "applied" is the torque applied from
    that time on, "command" the command computed at that time, "centred" the mean over one period centred there.
    ``source`` is the file it was read from.
    """

    joints: tuple[JointController, ...]
    period: float
    delay: float = 0.0
    records: Record = "applied"
    source: str = field(default="", compare=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in order."""
        return tuple(joint.name for joint in self.joints)

    def uses(self, signal: str) -> bool:
        """Whether the controller of any joint reads the input ``signal``, one of :data:`INPUTS`."""
        return any(signal in operation.of for joint in self.joints for operation in joint.signals.values()) or any(
            signal in (joint.torque, joint.acts) for joint in self.joints
        )

    @property
    def records_what_acts(self) -> bool:
        """Whether, for every joint, the signal that is recorded as torque is also the one that drives the joint."""
        return all(joint.acts == joint.torque for joint in self.joints)

    @property
    def settling(self) -> int:
        """Number of samples until the transients of all filters have settled; poles on the unit circle are ignored."""
        longest = 1
        for joint in self.joints:
            total = 0
            for operation in joint.signals.values():
                if operation.kind == "filter":
                    total += _settling(operation.values)
            longest = max(longest, total)
        return longest + int(np.ceil(self.delay)) + 1

    def tables(self) -> Tables:
        """Encode the operations of all joints as the arrays that the compiled simulation reads."""
        return Tables.of(self)


@dataclass(frozen=True, eq=False)
class Tables:
    """Controller operations of n joints, encoded as flat arrays for the compiled simulation.

    ``operations`` holds kind, signal index and source indices of each operation in turn, ``coefficients`` all their
    values. ``outputs`` (2n,) are the indices of the recorded and the acting torque signal of each joint. ``signals``
    and ``memory`` are the numbers of signals and of stored filter and integrator states.
    """

    operations: NDArray[np.int32]
    coefficients: Array
    outputs: NDArray[np.int32]
    signals: int
    memory: int

    @classmethod
    def of(cls, controller: LoopController) -> Tables:
        """Encode ``controller``; every signal must refer to earlier signals only, as the reader has checked."""
        operations: list[int] = []
        coefficients: list[float] = []
        outputs: list[int] = []
        signals, memory = len(INPUTS) * len(controller.joints), 0
        for j, joint in enumerate(controller.joints):
            place = {name: len(INPUTS) * j + k for k, name in enumerate(INPUTS)}
            for name, operation in joint.signals.items():
                of = [place[source] for source in operation.of]
                kind = KINDS.index(operation.kind)
                match operation.kind:
                    case "sum":
                        operations += [kind, signals, len(of), *of]
                    case "filter":
                        order = len(operation.values) // 2 - 1
                        operations += [kind, signals, of[0], order, memory]
                        memory += order
                    case "integral":
                        operations += [kind, signals, of[0], memory]
                        memory += 1
                    case _:
                        operations += [kind, signals, of[0]]
                coefficients += operation.values
                place[name] = signals
                signals += 1
            outputs += [place[joint.torque], place[joint.acts]]
        return cls(
            np.array(operations, np.int32),
            np.array([*coefficients, 0.0]),
            np.array(outputs, np.int32),
            signals,
            memory,
        )


def filter_operation(of: str, numerator: tuple[float, ...], denominator: tuple[float, ...] = (1.0,)) -> Operation:
    """Filter of the signal ``of`` with coefficients in ascending powers of 1/z, normalized to a leading 1.

    Raises InputError for an empty numerator or denominator, or a first denominator coefficient of 0.
    """
    if not numerator or not denominator or denominator[0] == 0.0:
        raise InputError("a filter needs a numerator, and a denominator whose first coefficient is not 0")
    size = max(len(numerator), len(denominator))
    rows = [tuple(c / denominator[0] for c in part) + (0.0,) * (size - len(part)) for part in (numerator, denominator)]
    return Operation("filter", (of,), rows[0] + rows[1])


def _settling(values: tuple[float, ...]) -> int:
    """Number of samples until the transient of a filter with coefficients ``values`` has decayed to SETTLED."""
    size = len(values) // 2
    radii = np.abs(np.roots(values[size:]))
    slow = radii[radii < 1.0 - 1e-9]
    slowest = float(slow.max()) if len(slow) else 0.0
    return size - 1 + (int(np.ceil(np.log(SETTLED) / np.log(slowest))) if slowest > 1e-6 else 0)


# ------------------------------------------------------------------------------------------------------------------
# Reads the controller file (YAML); all its faults are reported together with their places.
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-controller/1"
HOLDS = ("zero-order",)
JOINT_KEYS = {
    "name": Entry("of the joint", required=True),
    "signals": Entry("name: operation, in the order of computation"),
    "torque": Entry("the signal that is recorded as torque"),
    "acts": Entry("the signal that moves the joint; `torque` if missing"),
}
KEYS = {
    "schema": Entry(words([SCHEMA]), required=True),
    "name": Entry("of the controller"),
    "description": Entry("what it is"),
    "rate": Entry("of the controller, or its `period`", "Hz"),
    "period": Entry("of the controller, or its `rate`", "s"),
    "delay": Entry("from reading the positions to the torque", "periods"),
    "hold": Entry(f"{words(HOLDS)}: the torque is held between samples"),
    "records": Entry(f"which torque is recorded: {words(RECORDS)}; `{RECORDS[0]}` if missing"),
    "signals": Entry("those of all joints: name: operation, in the order of computation"),
    "torque": Entry("of all joints: the signal that is recorded as torque"),
    "acts": Entry("of all joints: the signal that moves the joint; `torque` if missing"),
    "joints": Entry("list of names, or of mappings where joints differ", required=True),
}
_SPAN = Entry("1 if missing", "samples")
_POWERS = "list of coefficients in rising powers of 1/z"
OPERATIONS = {
    "sum": {"sum": Entry("mapping of signals to their weights")},
    "filter": {
        "filter": Entry("a signal, filtered"),
        "numerator": Entry(_POWERS, required=True),
        "denominator": Entry(f"{_POWERS}; [1] if missing"),
    },
    "difference": {"difference": Entry("a signal: its change over some samples, per second"), "over": _SPAN},
    "average": {"average": Entry("a signal: mean of its last samples"), "over": Entry("2 if missing", "samples")},
    "delayed": {"delayed": Entry("a signal, some samples ago"), "by": _SPAN},
    "integral": {
        "integral": Entry("a signal: its integral over time"),
        "gain": Entry("factor; 1 if missing"),
        "limit": Entry("a bound in both directions, or [lowest, highest]"),
    },
    "limit": {
        "limit": Entry("a signal, held within bounds"),
        "to": Entry("a bound in both directions, or [lowest, highest]", required=True),
    },
    "sign": {"sign": Entry("a signal: 1, -1 or 0"), "dead_zone": Entry("0 up to this size; 0 if missing")},
}
"""The keys of each operation, the first of which names it."""


def load_controller(path: str | os.PathLike[str]) -> LoopController:
    """Read the controller file ``path``; raises :class:`InputError` with every fault and its line and column."""
    return loads_controller(file_text(path, "controller file"), str(path))


def loads_controller(text: str, file: str = "controller.yaml") -> LoopController:
    """Read a controller from YAML ``text``; ``file`` names it in messages.

    Raises :class:`InputError` with every fault and its line and column.
    """

    def read(root: Node, faults: FaultList) -> LoopController | None:
        return _ControllerReader(faults).controller(root)

    return read_document(text, file, "controller file", read)


class _ControllerReader(Reader):
    """Reads one controller file; faults are collected and reported together."""

    period = 0.0

    def controller(self, root: Node) -> LoopController | None:
        top = self.values(root, "the controller file", KEYS)
        if top is None:
            return None
        if "schema" in top:
            self.choice(top["schema"], "schema", (SCHEMA,))
        self.period = self.sampling(root, top)
        if "hold" in top:
            self.choice(top["hold"], "hold", HOLDS)
        delay = self.number(top.get("delay"), "delay") or 0.0
        if delay < 0.0:
            self.faults.error(
                top.get("delay"), "delay is negative", "in periods, 0 or more; parts of a period are allowed"
            )
        records: Record = "applied"
        if "records" in top:
            word = self.choice(top["records"], "records", RECORDS)
            records = next((record for record in RECORDS if record == word), records)
        return LoopController(tuple(self.read_joints(top)), self.period, delay, records, self.faults.file)

    def sampling(self, root: Node, top: dict[str, Node]) -> float:
        given = [key for key in ("rate", "period") if key in top]
        if len(given) != 1:
            self.faults.error(root, "the controller file needs either 'rate' or 'period'", "e.g. rate: 1 kHz")
            return 1.0
        if given == ["rate"]:
            rate = self.quantity(top["rate"], "rate", units.RATE, "Hz", positive=True)
            return 1.0 / rate if rate else 1.0
        return self.quantity(top["period"], "period", units.TIME, "s", positive=True) or 1.0

    def read_joints(self, top: dict[str, Node]) -> list[JointController]:
        """Read the joints; ``signals``, ``torque`` and ``acts`` at the top level are defaults for all joints."""
        node = top.get("joints")
        if node is None:
            return []
        if not isinstance(node, SequenceNode) or not node.items:
            self.faults.error(node, f"joints is {describe(node)}, not a list", "one entry per joint, in order")
            return []
        joints: list[JointController] = []
        for k, item in enumerate(node.items):
            entries = {"name": item} if isinstance(item, ScalarNode) else self.values(item, f"joints[{k}]", JOINT_KEYS)
            if entries is None:
                continue
            part = {key: top[key] for key in ("signals", "torque", "acts") if key in top} | entries
            name = self.text(part["name"], f"joints[{k}].name") if "name" in part else f"joint {k + 1}"
            if any(joint.name == name for joint in joints):
                self.faults.error(item, f"a second joint '{name}'")
            for key in ("signals", "torque"):
                if key not in part:
                    self.faults.error(item, f"joint '{name}' has no '{key}'", "state it there, or once for all joints")
            signals = self.read_signals(part["signals"], name) if "signals" in part else {}
            known = (*INPUTS, *signals)
            torque = self.choice(part["torque"], f"torque of '{name}'", known) if "torque" in part else "feedforward"
            acts = self.choice(part["acts"], f"acts of '{name}'", known) if "acts" in part else torque
            joints.append(JointController(name, signals, torque, acts))
        return joints

    def read_signals(self, node: Node, joint: str) -> dict[str, Operation]:
        signals: dict[str, Operation] = {}
        for name, (key, value) in (read_entries(node, f"signals of '{joint}'", self.faults) or {}).items():
            if name in INPUTS:
                self.faults.error(key, f"a signal must not be called '{name}'", f"{', '.join(INPUTS)} are given")
                continue
            operation = self.operation(value, name, (*INPUTS, *signals))
            signals[name] = operation or Operation("sum", (), ())
        return signals

    def operation(self, node: Node, name: str, known: tuple[str, ...]) -> Operation | None:
        entries = read_entries(node, f"signal '{name}'", self.faults) or {}
        beside = {key for kind in OPERATIONS if kind in entries for key in OPERATIONS[kind] if key != kind}
        kinds = [kind for kind in OPERATIONS if kind in entries and kind not in beside]
        if len(kinds) != 1:
            self.faults.error(node, f"signal '{name}' needs one operation", f"one of {', '.join(OPERATIONS)}")
            return None
        kind = kinds[0]
        part = self.values(node, f"signal '{name}'", OPERATIONS[kind]) or {}
        if kind not in part:
            return None
        if kind == "sum":
            return self.weighted_sum(part["sum"], name, known)
        of = self.choice(part[kind], f"{kind} of signal '{name}'", known)
        readers: dict[str, Callable[[str, dict[str, Node], str, Node], Operation | None]] = {
            "filter": self.filter,
            "difference": self.window,
            "average": self.window,
            "delayed": self.window,
            "integral": self.integral,
            "limit": self.limit,
            "sign": self.sign,
        }
        return readers[kind](of, part, name, node)

    def weighted_sum(self, node: Node, name: str, known: tuple[str, ...]) -> Operation:
        of, weights = [], []
        for source, (key, value) in (read_entries(node, f"sum of signal '{name}'", self.faults) or {}).items():
            if source not in known:
                self.faults.error(key, f"signal '{name}' uses '{source}'", hint_for(source, known))
            weight = self.number(value, f"weight of '{source}'")
            of.append(source)
            weights.append(0.0 if weight is None else weight)
        return Operation("sum", tuple(of), tuple(weights))

    def filter(self, of: str, part: dict[str, Node], name: str, node: Node) -> Operation | None:
        coefficients: dict[str, tuple[float, ...]] = {"denominator": (1.0,)}
        for key in ("numerator", "denominator"):
            if key in part:
                item = part[key]
                length = len(item.items) if isinstance(item, SequenceNode) else 0
                if not length:
                    self.faults.error(item, f"{key} of '{name}' is not a list", "in powers of 1/z, e.g. [0.5, 0.5]")
                coefficients[key] = tuple(self.numbers(item, f"{key} of '{name}'", length)) if length else ()
        if "numerator" not in coefficients:
            return None
        if not coefficients["denominator"] or coefficients["denominator"][0] == 0.0:
            self.faults.error(part.get("denominator", node), f"denominator of '{name}' starts with 0", "e.g. [1, -0.9]")
            return None
        return filter_operation(of, coefficients["numerator"] or (0.0,), coefficients["denominator"])

    def window(self, of: str, part: dict[str, Node], name: str, node: Node) -> Operation:
        """Read a difference quotient, moving average or delay over a number of samples, as a filter."""
        kind = next(key for key in ("difference", "average", "delayed") if key in part)
        node = part.get("by" if kind == "delayed" else "over", node)
        count = self.whole(
            part.get("by" if kind == "delayed" else "over"), f"samples of '{name}'", 2 if kind == "average" else 1
        )
        if count < 1:
            self.faults.error(node, f"'{name}' spans no sample", "1 or more")
            count = 1
        if kind == "average":
            return filter_operation(of, (1.0 / count,) * count)
        zeros = (0.0,) * (count - 1)
        if kind == "delayed":
            return filter_operation(of, (0.0, *zeros, 1.0))
        slope = 1.0 / (count * self.period)
        return filter_operation(of, (slope, *zeros, -slope))

    def integral(self, of: str, part: dict[str, Node], name: str, node: Node) -> Operation:
        gain = self.number(part.get("gain"), f"gain of '{name}'") if "gain" in part else 1.0
        low, high = self.range(part["limit"], f"limit of '{name}'") if "limit" in part else (-math.inf, math.inf)
        return Operation("integral", (of,), ((gain or 0.0) * self.period, low, high))

    def limit(self, of: str, part: dict[str, Node], name: str, node: Node) -> Operation:
        if "to" not in part:
            return Operation("limit", (of,), (0.0, 0.0))
        return Operation("limit", (of,), self.range(part["to"], f"limit '{name}'"))

    def range(self, node: Node, what: str) -> tuple[float, float]:
        if isinstance(node, SequenceNode):
            values = self.numbers(node, what, 2)
            low, high = (values[0], values[1]) if len(values) == 2 else (-1.0, 1.0)
        else:
            bound = self.number(node, what)
            low, high = (-1.0, 1.0) if bound is None else (-bound, bound)
        if not low < high:
            self.faults.error(node, f"{what}: the lowest value is not below the highest")
        return low, high

    def sign(self, of: str, part: dict[str, Node], name: str, node: Node) -> Operation:
        zone = self.number(part.get("dead_zone"), f"dead zone of '{name}'") or 0.0
        return Operation("sign", (of,), (zone,))
