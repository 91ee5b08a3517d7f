"""Reads the experiment file (YAML): excitation, writing task, virtual robot and control of a simulated experiment.

Every section is optional. A list has one entry per joint; a single number applies to all joints. All faults are
reported together with their places.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext import signal_units as units
from rrrgen.base.yamltext.document import FaultList, Node, ScalarNode, SequenceNode, describe, file_text, read_document
from rrrgen.base.yamltext.fields import UNITLESS, Entries, Entry, Reader, read_entries, words
from rrrgen.lab.design.problem import OBJECTIVES, ExcitationLimits
from rrrgen.lab.design.signals import SIGNALS
from rrrgen.lab.experiment.writing_task import WritingPlane
from rrrgen.robot.friction.models import FrictionModel

# ------------------------------------------------------------------------------------------------------------------
# The keys of an experiment file, one table per section.
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-experiment/1"
FROM_ROBOT = "from_robot"
"""Word that stands in place of the values of flexible joints; they are then taken from ``drive`` in the robot file."""

CONTROL_LAWS = ("pd", "computed_torque")
OBSERVERS = ("kalman", "difference")
TORQUE_RECORDS = ("centred", "command")

KEYS: dict[str, Entries] = {
    "experiment": {
        "schema": Entry(words([SCHEMA]), required=True),
        "excitation": Entry("the exciting motion"),
        "writing": Entry("the writing task"),
        "virtual_robot": Entry("how the virtual arm differs from the model"),
        "control": Entry("control of the virtual arm"),
        "response": Entry("the experiment for a frequency response"),
        "period": Entry("sampling period; 1 ms if missing", "s"),
        "seed": Entry("of all random numbers; 0 if missing"),
    },
    "excitation": {
        "harmonics": Entry("number of harmonics of the Fourier series"),
        "base_frequency": Entry("of the Fourier series", "Hz"),
        "objective": Entry(f"what makes a motion exciting: {words(OBJECTIVES)}; `{OBJECTIVES[0]}` if missing"),
        "at_rest": Entry("`true`: the motion starts and ends at rest; `false` if missing"),
        "starts": Entry("number of random starts of the optimisation; 4 if missing"),
        "max_iterations": Entry("of one start"),
        "row_weights": Entry("1 over the standard deviation of each torque, per joint"),
        "limits": Entry(
            "of the motion; what is missing but `torque` and `box` is that of the robot file; with `--friction` and "
            "`--response` the tighter of both, without a box"
        ),
    },
    "limits": {
        "lower": Entry("lowest position, per joint", "rad, m"),
        "upper": Entry("highest position, per joint", "rad, m"),
        "speed": Entry("largest speed, per joint", "rad/s"),
        "acceleration": Entry("largest acceleration, per joint", "rad/s^2"),
        "torque": Entry("largest torque or force, per joint", "N*m"),
        "box": Entry("of the tip, in the base frame"),
    },
    "box": {axis: Entry(f"[lowest, highest] {axis}, `~` for an open side", "m") for axis in "xyz"},
    "writing": {
        "text": Entry("what is written"),
        "duration": Entry("of the whole task", "s"),
        "peak_speed": Entry("of the tip, in place of a duration", "m/s"),
        "pace": Entry("number, or list that is repeated over the strokes: faster ones have larger numbers"),
        "margin": Entry("free space around the text", "m"),
        "start": Entry("position near which the inverse kinematics begins, per joint", "rad, m"),
        "plane": Entry("the vertical window that is written in"),
    },
    "plane": {
        "x": Entry("[lowest, highest] x", "m"),
        "y": Entry("where it stands", "m"),
        "z": Entry("[lowest, highest] z", "m"),
    },
    "virtual_robot": {
        "friction": Entry("at the joints; that of the robot file if missing"),
        "encoder_resolution": Entry("step of the measured position, per joint", "rad, m"),
        "torque_limit": Entry("where the drives saturate, per joint; that of the robot file if missing", "N*m"),
        "torque_resolution": Entry("step of the torque, per joint", "N*m"),
        "torque_noise": Entry("standard deviation of the recorded torque, per joint", "N*m"),
        "disturbance": Entry("standard deviation of a torque that acts and is not recorded, per joint", "N*m"),
        "torque_record": Entry(
            "`centred` (if missing): mean over a period around the sample; `command`: the torque from the sample on"
        ),
        "delay": Entry("from the reading of the encoders to the torque", "samples"),
        "flexible_joints": Entry(f"`{FROM_ROBOT}`: `drive` of the robot file; or a mapping"),
        "flexible_base": Entry("the base turns about the first axis"),
    },
    "friction": {
        "law": Entry("a [friction law](robot-file.md#friction-of-a-joint-or-a-motor)", required=True),
        "joints": Entry("list with a mapping of its parameters per joint", required=True),
    },
    "flexible_joints": {
        "rotor_inertia": Entry("seen at the joint, per joint", "kg m^2, kg", required=True),
        "stiffness": Entry("between rotor and link, per joint", "N m/rad, N/m", required=True),
        "damping": Entry("beside that stiffness, per joint", "N m s/rad, N s/m", required=True),
    },
    "flexible_base": {
        "inertia": Entry("of the base about that axis; from the inertia of the arm if missing", "kg m^2"),
        "frequency": Entry("of the base alone", "Hz"),
        "damping_ratio": Entry("of the base alone"),
    },
    "control": {
        "kind": Entry(
            f"{words(CONTROL_LAWS)}; if missing, `{CONTROL_LAWS[0]}`, or `{CONTROL_LAWS[1]}` where a robust "
            "PD loop would be too slow to follow a motion"
        ),
        "bandwidth": Entry(
            "of the position loop, per joint, in place of gains; if missing, 4 Hz, or more if the load needs it, as "
            "far as the loop is robust",
            "Hz",
        ),
        "damping": Entry("damping ratio of the loops; 1 if missing"),
        "kp": Entry("gain of the position, per joint; needs `kd`"),
        "kd": Entry("gain of the speed, per joint; needs `kp`"),
        "observer": Entry(f"of the speed: {words(OBSERVERS)}; `{OBSERVERS[0]}` if missing"),
        "feedforward": Entry(
            "`true`: the torques of the model along the motion are added to PD control; if missing, only where "
            "the load would bend a joint by a tenth of its motion"
        ),
        "jerk": Entry("tunes the Kalman observer, per joint; chosen for a robust loop if missing", "rad/s^3"),
    },
    "response": {
        "joint": Entry("name or number from 1 of the excited joint"),
        "signal": Entry(f"{words(SIGNALS)}; `{SIGNALS[0]}` if missing"),
        "band": Entry("[lowest, highest] excited frequency", "Hz"),
        "period": Entry("of the signal", "s"),
        "periods": Entry("number of recorded periods"),
        "settle": Entry("number of periods before them, in which transients decay"),
        "rms": Entry("of the excitation; the largest within the limits if missing", "rad/s^2"),
        "speed": Entry("mean speed of the joint; chosen if missing", "rad/s"),
        "realisations": Entry("number of experiments with different random phases"),
        "postures": Entry("list of positions of all joints, one experiment each", "rad, m"),
        "bandwidth": Entry("[of the loop of this joint, of the others]", "Hz"),
        "damping": Entry("damping ratio of all loops"),
    },
}


# ------------------------------------------------------------------------------------------------------------------
# Reads the experiment file (YAML)
# ------------------------------------------------------------------------------------------------------------------

EFFORT = units.TORQUE | units.FORCE


@dataclass(frozen=True)
class ControlSection:
    """Control of the virtual robot: law, gains or bandwidth, and observer.

    ``kind`` is "pd" or "computed_torque", None where the design chooses; its gains ``kp``, ``kd`` (n,) follow from
    ``bandwidth`` (n,) in Hz and ``damping`` if they are None. ``observer`` is "kalman" or "difference"; ``jerk``
    (n,), rad/s^3 (m/s^3), tunes the Kalman observer. ``feedforward`` says whether the torques of the model along
    the motion are added to PD control. ``bandwidth``, ``jerk`` and ``feedforward`` are designed from the arm if
    they are None. ``places`` are the places of the keys that are stated, as faults without a message.
    """

    kind: str | None = None
    bandwidth: tuple[float, ...] | None = None
    damping: float = 1.0
    kp: tuple[float, ...] | None = None
    kd: tuple[float, ...] | None = None
    observer: str = "kalman"
    jerk: tuple[float, ...] | None = None
    feedforward: bool | None = None
    places: Mapping[str, Fault] = field(default_factory=dict, compare=False)


@dataclass(frozen=True)
class Experiment:
    """The content of an experiment file; absent sections are empty.

    - ``excitation``: fields of the excitation problem; ``limits``: its limits, all those of the robot file if None;
      ``starts``: number of random starts.
    - ``writing``: arguments of the writing task; ``branch`` (n,): joint positions near which its inverse kinematics
      begins.
    - ``virtual_robot``: friction, instruments and flexible parts by name; ``control``: control law and observer.
    - ``response``: fields of a response experiment.
    - ``period``: sampling period, s; ``seed``: of all random numbers.
    """

    excitation: Mapping[str, Any] = field(default_factory=dict)
    limits: ExcitationLimits | None = None
    starts: int = 4
    writing: Mapping[str, Any] = field(default_factory=dict)
    branch: tuple[float, ...] | None = None
    virtual_robot: Mapping[str, Any] = field(default_factory=dict)
    control: ControlSection = field(default_factory=ControlSection)
    response: Mapping[str, Any] = field(default_factory=dict)
    period: float = 1e-3
    seed: int = 0


def load_experiment(path: str | os.PathLike[str], joints: int) -> Experiment:
    """Read the experiment file ``path`` for a robot of ``joints`` joints; raises InputError with every fault."""
    return loads_experiment(file_text(path, "experiment file"), joints, str(path))


def loads_experiment(text: str, joints: int, file: str = "experiment.yaml") -> Experiment:
    """Read an experiment from YAML ``text`` for a robot of ``joints`` joints; ``file`` names it in messages.

    Raises InputError with every fault and its line and column.
    """

    def read(root: Node, faults: FaultList) -> Experiment:
        return _ExperimentReader(faults, joints).experiment(root)

    return read_document(text, file, "experiment file", read)


Take = Callable[[Node, str], Any]


class _ExperimentReader(Reader):
    """Reads the sections of one experiment file for a robot of ``joints`` joints, and collects their faults."""

    def __init__(self, faults: FaultList, joints: int) -> None:
        super().__init__(faults)
        self.n = joints

    def experiment(self, root: Node) -> Experiment:
        top = self.section(
            root,
            "the experiment file",
            "experiment",
            {
                "schema": lambda node, what: self.choice(node, what, (SCHEMA,)),
                "excitation": self.excitation,
                "writing": self.writing,
                "virtual_robot": self.virtual_robot,
                "control": self.control,
                "response": self.response,
                "period": self.one(units.TIME, "s", positive=True),
                "seed": self.count,
            },
        )
        excitation, writing = dict(top.get("excitation", {})), dict(top.get("writing", {}))
        return Experiment(
            limits=excitation.pop("limits", None),
            starts=excitation.pop("starts", 4),
            excitation=excitation,
            branch=writing.pop("start", None),
            writing=writing,
            virtual_robot=top.get("virtual_robot", {}),
            control=top.get("control", ControlSection()),
            response=top.get("response", {}),
            period=top.get("period", 1e-3),
            seed=top.get("seed", 0),
        )

    # -- sections ----------------------------------------------------------------------------------------------------

    def excitation(self, node: Node, what: str) -> dict[str, Any]:
        return self.section(
            node,
            what,
            "excitation",
            {
                "harmonics": self.positive_count,
                "base_frequency": self.one(units.RATE, "Hz", positive=True),
                "objective": lambda n, w: self.choice(n, w, OBJECTIVES),
                "at_rest": self.yes_or_no,
                "starts": self.positive_count,
                "max_iterations": self.positive_count,
                "row_weights": self.each(UNITLESS, "one", "positive"),
                "limits": self.limits,
            },
        )

    def limits(self, node: Node, what: str) -> ExcitationLimits:
        values = self.section(
            node,
            what,
            "limits",
            {
                "lower": self.each(units.POSITION, "rad"),
                "upper": self.each(units.POSITION, "rad"),
                "speed": self.each(units.VELOCITY, "rad/s", "positive"),
                "acceleration": self.each(units.ACCELERATION, "rad/s^2", "positive"),
                "torque": self.each(EFFORT, "N*m", "positive"),
                "box": self.box,
            },
        )
        low, high = values.pop("box", (None, None))
        return ExcitationLimits(
            position_lower=values.pop("lower", None),
            position_upper=values.pop("upper", None),
            box_lower=low,
            box_upper=high,
            **values,
        )

    def box(self, node: Node, what: str) -> tuple[tuple[float | None, ...], tuple[float | None, ...]]:
        sides = self.section(node, what, "box", dict.fromkeys("xyz", self.open_pair))
        pairs = [sides.get(axis, (None, None)) for axis in "xyz"]
        return tuple(p[0] for p in pairs), tuple(p[1] for p in pairs)

    def writing(self, node: Node, what: str) -> dict[str, Any]:
        values = self.section(
            node,
            what,
            "writing",
            {
                "text": self.text,
                "duration": self.one(units.TIME, "s", positive=True),
                "peak_speed": self.one(units.VELOCITY, "m/s", positive=True),
                "pace": self.pace,
                "margin": self.one(units.LENGTH, "m"),
                "start": self.each(units.POSITION, "rad"),
                "plane": self.plane,
            },
        )
        return values

    def plane(self, node: Node, what: str) -> WritingPlane | None:
        length = self.one(units.LENGTH, "m")
        sides = self.section(node, what, "plane", {"x": self.pair, "y": length, "z": self.pair})
        if any(value is None or (isinstance(value, tuple) and None in value) for value in sides.values()):
            return None  # a fault was found in it
        try:
            return WritingPlane(**sides)
        except InputError as error:
            self.faults.error(node, f"{what}: {error.faults[0].message}")
            return None

    def virtual_robot(self, node: Node, what: str) -> dict[str, Any]:
        torque = self.each(EFFORT, "N*m", "not negative")
        return self.section(
            node,
            what,
            "virtual_robot",
            {
                "friction": self.friction,
                "encoder_resolution": self.each(units.POSITION, "rad", "not negative"),
                "torque_limit": self.each(EFFORT, "N*m", "positive"),
                "torque_resolution": torque,
                "torque_noise": torque,
                "disturbance": torque,
                "torque_record": lambda n, w: self.choice(n, w, TORQUE_RECORDS),
                "delay": self.count,
                "flexible_joints": self.flexible_joints,
                "flexible_base": lambda n, w: self.section(
                    n,
                    w,
                    "flexible_base",
                    {
                        "inertia": self.one(UNITLESS, "one", positive=True),
                        "frequency": self.one(units.RATE, "Hz", positive=True),
                        "damping_ratio": self.one(UNITLESS, "one"),
                    },
                ),
            },
        )

    def flexible_joints(self, node: Node, what: str) -> dict[str, Any] | str:
        """Read rotor inertias, stiffnesses and dampings of the joints, or the word ``from_robot``.

        The word stands for the values of the robot file.
        """
        if isinstance(node, ScalarNode):
            return self.choice(node, what, (FROM_ROBOT,))
        take = dict.fromkeys(KEYS["flexible_joints"], self.each(UNITLESS, "one"))
        return self.section(node, what, "flexible_joints", take)

    def response(self, node: Node, what: str) -> dict[str, Any]:
        values = self.section(
            node,
            what,
            "response",
            {
                "joint": self.text,
                "signal": lambda n, w: self.choice(n, w, SIGNALS),
                "band": self.band,
                "period": self.one(units.TIME, "s", positive=True),
                "periods": self.count,
                "settle": self.count,
                "rms": self.one(units.ACCELERATION, "rad/s^2", positive=True),
                "speed": self.one(units.VELOCITY, "rad/s", positive=True),
                "realisations": self.positive_count,
                "postures": self.postures,
                "bandwidth": self.band,
                "damping": self.one(UNITLESS, "one", positive=True),
            },
        )
        return {key: value for key, value in values.items() if value is not None}

    def band(self, node: Node, what: str) -> tuple[float, float] | None:
        """Read a pair of frequencies in rising order, Hz."""
        if not isinstance(node, SequenceNode) or len(node.items) != 2:
            self.faults.error(node, f"{what} is {describe(node)}, not a pair of frequencies")
            return None
        pair = [units.read_quantity(item, what, units.RATE, "Hz", self.faults) for item in node.items]
        return None if pair[0] is None or pair[1] is None else (pair[0], pair[1])

    def postures(self, node: Node, what: str) -> tuple[Any, ...] | None:
        """Read a list of postures, each with one position per joint."""
        if not isinstance(node, SequenceNode) or not node.items:
            self.faults.error(node, f"{what} is {describe(node)}, not a list of postures [[q1, q2, ..], ..]")
            return None
        reader = self.each(units.POSITION, "rad")
        return tuple(reader(item, f"{what}[{k}]") for k, item in enumerate(node.items))

    def friction(self, node: Node, what: str) -> FrictionModel | None:
        entries = read_entries(node, what, self.faults) or {}
        law = entries["law"][1].text if "law" in entries and isinstance(entries["law"][1], ScalarNode) else ""
        listed = entries["joints"][1] if "joints" in entries else None
        if not isinstance(listed, SequenceNode) or len(listed.items) != self.n:
            self.faults.error(listed or node, f"{what}.joints must list {self.n} mappings, one per joint")
            return None
        rows = []
        for i, item in enumerate(listed.items):
            values = read_entries(item, f"{what}.joints[{i}]", self.faults) or {}
            take = self.one(UNITLESS, "one")
            rows.append({key: take(value, f"{what}.joints[{i}].{key}") for key, (_, value) in values.items()})
        try:
            return FrictionModel.from_mapping({"law": law, "joints": rows})
        except (InputError, TypeError) as error:
            self.faults.error(node, str(getattr(error, "faults", [error])[0]))
            return None

    def control(self, node: Node, what: str) -> ControlSection:
        values = self.section(
            node,
            what,
            "control",
            {
                "kind": lambda n, w: self.choice(n, w, CONTROL_LAWS),
                "bandwidth": self.each(units.RATE, "Hz", "positive"),
                "damping": self.one(UNITLESS, "one", positive=True),
                "kp": self.each(UNITLESS, "one"),
                "kd": self.each(UNITLESS, "one"),
                "observer": lambda n, w: self.choice(n, w, OBSERVERS),
                "jerk": self.each({"rad/s^3": 1.0, "m/s^3": 1.0}, "rad/s^3", "positive"),
                "feedforward": self.yes_or_no,
            },
        )
        if ("kp" in values) != ("kd" in values):
            self.faults.error(node, f"{what} needs both kp and kd, or a bandwidth")
        entries = read_entries(node, what, FaultList(self.faults.file, "")) or {}
        if "bandwidth" in values and {"kp", "kd"} & set(values):
            self.faults.error(entries["bandwidth"][0], "bandwidth has no effect beside kp and kd", "state one of them")
        places = {key: self.faults.fault(entries[key][0], "", "", 0, "warning") for key in values}
        return ControlSection(**{key: value for key, value in values.items() if value is not None}, places=places)

    # -- values ------------------------------------------------------------------------------------------------------

    def section(self, node: Node, what: str, kind: str, take: Mapping[str, Take]) -> dict[str, Any]:
        """Read the values of a mapping of the section ``kind`` with the reader that ``take`` assigns to each key.

        Unknown keys and absent required ones are faults; absent keys are absent from the result.
        """
        values = self.values(node, what, KEYS[kind]) or {}
        return {name: take[name](value, name) for name, value in values.items()}

    def one(self, table: Mapping[str, float], bare: str, positive: bool = False) -> Take:
        """Make a reader of one value with a unit of ``table``; a number without a unit is in ``bare``."""
        return lambda node, what: self.quantity(node, what, table, bare, positive)

    def each(
        self, table: Mapping[str, float], bare: str, sign: Literal["any", "not negative", "positive"] = "any"
    ) -> Take:
        """Make a reader of one value per joint with a unit of ``table``; a number without a unit is in ``bare``.

        A value of another than the allowed ``sign`` is a fault.
        """

        def read(node: Node, what: str) -> tuple[float | None, ...]:
            values = self.per_joint(node, what, self.n, table, bare)
            items = node.items if isinstance(node, SequenceNode) else [node]
            for item, value in zip(items, values, strict=False):  # a list of another length is a fault already
                if value is not None and ((sign == "positive" and value <= 0.0) or (sign != "any" and value < 0.0)):
                    self.faults.error(
                        item, f"{what} must {'not be negative' if sign == 'not negative' else 'be positive'}"
                    )
            return values

        return read

    def count(self, node: Node, what: str) -> int:
        return self.whole(node, what, 0)

    def positive_count(self, node: Node, what: str) -> int:
        """Read a whole number of at least 1."""
        number = self.whole(node, what, 1)
        if number == 0:
            self.faults.error(node, f"{what} must be positive")
        return number

    def pace(self, node: Node, what: str) -> tuple[float | None, ...]:
        items = node.items if isinstance(node, SequenceNode) else [node]
        return tuple(self.number(item, what) for item in items)

    def pair(self, node: Node, what: str, open_side: bool = False) -> tuple[float | None, float | None]:
        if not isinstance(node, SequenceNode) or len(node.items) != 2:
            self.faults.error(node, f"{what} is {describe(node)}, not a pair [lowest, highest]")
            return None, None
        low, high = (
            None
            if open_side and isinstance(item, ScalarNode) and item.is_null
            else units.read_quantity(item, what, units.LENGTH, "m", self.faults)
            for item in node.items
        )
        return low, high

    def open_pair(self, node: Node, what: str) -> tuple[float | None, float | None]:
        """Read a pair [lowest, highest] of lengths in which either side may be null: ``[0.2, ~]``."""
        return self.pair(node, what, open_side=True)

    def yes_or_no(self, node: Node, what: str) -> bool:
        return self.choice(node, what, ("true", "false")) == "true"
