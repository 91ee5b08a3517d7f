"""The entries of the table of model functions, and the quantities that several of them take.

Data alone, before the number of joints and their kinds are known, so that nothing heavy is imported to read the table.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Any


@dataclass(frozen=True)
class ArgumentKind:
    """An argument of model functions, before the number of joints and their kinds are known.

    ``shape`` holds sizes separated by spaces, "" for a scalar: numbers, or n for the number of joints, 6+n with the
    coordinates of a floating base, b for that of the base parameters, k for that of the friction parameters, s for that
    of the joints and motors with friction. Of "rad | m" in ``unit``, the first is that of revolute, the second that of
    prismatic joints; "m/s, rad/s" are those of the linear and of the angular part; "SI" is one that differs between
    elements. ``meaning`` is followed by shape and unit in documents, and these by ``note``, which begins with its
    punctuation.

    ``constant``: usually the same for all states of a batch. ``spread``: one number may stand for all elements.
    ``from_file`` says which values of the robot file are the default; ``default`` is another one. ``optional``: only
    some robots have this input, and only they need it. ``for_drives`` is, of a vector with one element for each base
    parameter, the value of the elements for the drive inertias behind these. ``rigid``: a pose that is refused unless
    it is a rigid motion.
    """

    name: str
    shape: str
    unit: str
    meaning: str
    note: str = ""
    constant: bool = False
    spread: bool = False
    from_file: str = ""
    default: float | None = None
    optional: bool = False
    for_drives: float | None = None
    rigid: bool = False

    def __post_init__(self) -> None:
        if not self.unit:
            raise ValueError(f'the quantity {self.name} has no unit; "1" is that of a ratio')

    @property
    def words(self) -> str:
        """Meaning and note as plain text, for the comments of emitted code."""
        return re.sub(r":\w+:`(\w+)`", r"\1", self.meaning + self.note).replace("``", "")


_SHARED = (
    ArgumentKind(
        "accelerometer",
        "3",
        "m/s^2",
        "acceleration of the base origin minus gravity, in base axes",
        note=": what an accelerometer at the base origin measures",
    ),
    ArgumentKind("gyro", "3", "rad/s", "angular velocity of the base, in base axes"),
    ArgumentKind("gyro_rate", "3", "rad/s^2", "time derivatives of the components of ``gyro``"),
    ArgumentKind("q", "n", "rad | m", "joint positions"),
    ArgumentKind("dq", "n", "rad/s | m/s", "joint velocities"),
    ArgumentKind("ddq", "n", "rad/s^2 | m/s^2", "joint accelerations"),
    ArgumentKind("tau", "n", "N m | N", "joint torques"),
    ArgumentKind("e", "n", "any", "the vector"),
    ArgumentKind("v", "n", "rad/s | m/s", "reference velocities"),
    ArgumentKind("a", "n", "rad/s^2 | m/s^2", "reference accelerations"),
    ArgumentKind("q_d", "n", "rad | m", "desired positions"),
    ArgumentKind("dq_d", "n", "rad/s | m/s", "desired velocities"),
    ArgumentKind("ddq_d", "n", "rad/s^2 | m/s^2", "desired accelerations"),
    ArgumentKind("beta", "b", "SI", "base parameters", constant=True, from_file="those of the robot file"),
    ArgumentKind(
        "covariance",
        "n n",
        "(N m)^2 | N^2",
        "of the errors of r",
        note=", of ``contact-thresholds``",
        constant=True,
    ),
    ArgumentKind("d3q_d", "n", "rad/s^3 | m/s^3", "desired third derivatives"),
    ArgumentKind("d4q_d", "n", "rad/s^4 | m/s^4", "desired fourth derivatives"),
    ArgumentKind(
        "damping",
        "",
        "1",
        "share, such as 0.01, of the mean diagonal entry of J inv(M) J' below which its pivots are damped",
    ),
    ArgumentKind("dtheta", "n", "rad/s | m/s", "measured velocities of the rotors"),
    ArgumentKind("friction", "k", "SI", "friction parameters", constant=True, from_file="those of the robot file"),
    ArgumentKind(
        "gravity", "3", "m/s^2", "acceleration of gravity in the base frame", constant=True, from_file="the file's"
    ),
    ArgumentKind("Ia", "n", "kg m^2 | kg", "drive inertias", constant=True, from_file="those of the robot file"),
    ArgumentKind("J", "6 n", "m, 1", "Jacobian of the tip or of the point where it acts", note=", linear rows first"),
    ArgumentKind("kd", "n", "N m s/rad | N s/m", "gains of the velocity error", constant=True),
    ArgumentKind("ki", "n", "N m/(rad s) | N/(m s)", "gains of the integral", note="; zero for none", constant=True),
    ArgumentKind("kp", "n", "N m/rad | N/m", "gains of the position error", constant=True),
    ArgumentKind("mass", "", "kg", "mass of the body"),
    ArgumentKind(
        "orientation", "4", "1", "orientation of the base in the world", note=": the unit quaternion x, y, z, w"
    ),
    ArgumentKind("point", "3", "m", "the point in that frame"),
    ArgumentKind("q_0", "n", "rad | m", "positions at the start"),
    ArgumentKind("q_1", "n", "rad | m", "positions at the end"),
    ArgumentKind("r", "n", "N m | N", "estimated torques of the environment", note=", of :meth:`momentum_observer`"),
    ArgumentKind(
        "rotor_inertia",
        "n",
        "kg m^2 | kg",
        "inertias of the rotors, seen at the joints",
        constant=True,
        from_file="those of the robot file",
    ),
    ArgumentKind(
        "stiffness",
        "n",
        "N m/rad | N/m",
        "stiffnesses of the joints",
        note="; positive",
        constant=True,
        from_file="those of the robot file",
    ),
    ArgumentKind("T", "4 4", "1, m", "pose of the frame"),
    ArgumentKind("T_d", "4 4", "1, m", "desired pose of the tip in the base frame"),
    ArgumentKind(
        "tau_0", "n", "N m | N", "torques of a second task that must not move the tip", note="; zero for none"
    ),
    ArgumentKind(
        "tau_add", "n", "N m | N", "torques to add before the limits", note=", such as friction at the desired speeds"
    ),
    ArgumentKind(
        "tau_load",
        "n",
        "N m | N",
        "torques without friction",
        note="; needed where a law depends on the load",
        optional=True,
    ),
    ArgumentKind(
        "tau_max",
        "n",
        "N m | N",
        "largest torques",
        note="; infinite for none",
        constant=True,
        from_file="the limits of the robot file",
    ),
    ArgumentKind("theta", "n", "rad | m", "measured positions of the rotors, seen at the joints"),
    ArgumentKind("tool", "4 4", "1, m", "pose of the tool in the last link frame", constant=True, rigid=True),
    ArgumentKind("Ts", "", "s", "the period"),
    ArgumentKind(
        "twist", "6", "m/s, rad/s", "velocity of the base origin, then angular velocity of the base", note=", base axes"
    ),
    ArgumentKind(
        "twist_rate",
        "6",
        "m/s^2, rad/s^2",
        "time derivatives of the components of the twist",
        note="; the base origin is accelerated by ``dv/dt + omega x v``",
    ),
    ArgumentKind("V_d", "6", "m/s, rad/s", "desired velocity of the tip", note=", base frame"),
    ArgumentKind("weights", "n", "any", "the weights"),
    ArgumentKind(
        "width",
        "s",
        "rad/s | m/s",
        "speeds below which the sign in friction laws is smoothed",
        note="; positive",
        constant=True,
        spread=True,
    ),
    ArgumentKind("wrench", "6", "N, N m", "force, then moment about the base origin, on the base", note=", base axes"),
    ArgumentKind(
        "z", "n", "rad s | m s", "state of the integral", note="; zero at the start, then ``z_next`` of the last tick"
    ),
)
QUANTITIES = {quantity.name: quantity for quantity in _SHARED}
"""Quantities that several functions take, by name."""


def like(name: str, **changes: Any) -> ArgumentKind:
    """The quantity ``name`` of :data:`QUANTITIES` with the fields ``changes``."""
    return replace(QUANTITIES[name], **changes)


def about_tip(text: str, tip: str) -> str:
    """What ``text``, a text about the tip of the robot or its last link, says about the named ``tip``."""
    if not text:
        return text
    named = {"its last link": f"the link of the tip {tip}", "the last link": f"the link of the tip {tip}"}
    wording = re.sub(r"\b(its last link|the last link|the tip)\b", lambda m: named.get(m[1], f"the tip {tip}"), text)
    return f"{text.removesuffix('.')}, at the tip {tip}." if wording == text and text.endswith(".") else wording


class Needs(Enum):
    """What the robot must have for a function to exist."""

    NOTHING = "nothing"
    FRICTION = "friction"
    FRICTION_STATE = "a friction law with a state"
    FLOATING_BASE = "a floating base"
    TIP_POSITION = "joints that move the position of the tip"
    TIP_POSE = "joints that move the position of the tip, and joints that turn it"
    LOOPS = "closed loops"
    NEWTON = "closed loops that Newton's method solves"
    SHARED_JOINTS = "a named tip that shares joints with others"


@dataclass(frozen=True)
class ModelFunction:
    """One function of the model.

    ``summary`` is its first sentence, ``details`` are further paragraphs, ``returns`` describes its results, ``raises``
    its errors by type. ``takes`` lists its arguments in Python, those behind "*" given by keyword: quantities of
    ``where``, or else of :data:`rrrgen.derive.functions.model_function.QUANTITIES`. ``result`` is the named tuple in
    :mod:`rrrgen.runtime.results` of a function with several results. ``status``: it can fail, and then raises an error
    or, on request, returns a status. ``refuses``: it refuses unusable input (:mod:`rrrgen.program.guard`), and this is
    what its results are then. ``links_only`` names a result that ends with elements for the drive inertias,
    which Python cuts off. ``by_hand``: its method in Python is not made from the table.

    ``record`` names the recorder as "module:NAME", which is loaded when the function is derived: a function that takes
    a :class:`FunctionBuilder` and returns a :class:`Program`, or a tuple of such functions, whose programs are
    equivalent; the cheapest is emitted. ``combine`` names, likewise, a function that takes a :class:`FunctionBuilder`
    and the optimized programs of the functions ``of``: its program is another alternative, or, without ``record``, the
    only one. A function with ``of`` thus follows those in the table. ``differentiated``: its program is made of
    derivatives of the others, so that the numbers of the robot file are also tried in its general program instead of
    in theirs. ``more_joints_than``, ``most_joints`` (0 for any number) and ``needs`` say for which robots the function
    exists, and ``absent`` why it does not; with ``closed_loops`` False it does not for robots with such loops.
    ``of_tip``: it is about the tip, and a robot with named tips has one for each of them too (:meth:`at_tip`); ``tip``
    is the name of that tip. ``on_demand``: it takes long to derive and few programs call it, so Python compiles it
    when it is called.
    """

    name: str
    group: str
    summary: str
    takes: str
    returns: str
    where: tuple[ArgumentKind, ...] = ()
    record: str = ""
    combine: str = ""
    of: tuple[str, ...] = ()
    details: str = ""
    raises: tuple[tuple[str, str], ...] = ()
    result: str = ""
    status: bool = False
    refuses: str = ""
    links_only: str = ""
    differentiated: bool = False
    more_joints_than: int = 0
    most_joints: int = 0
    needs: Needs = Needs.NOTHING
    absent: str = ""
    closed_loops: bool = True
    by_hand: bool = False
    on_demand: bool = False
    of_tip: bool = False
    tip: str = ""

    def at_tip(self, tip: str) -> ModelFunction:
        """The same function about the named ``tip``, called ``<tip>_<name>``."""
        return replace(self, name=f"{tip}_{self.name}", tip=tip, summary=about_tip(self.summary, tip))

    def suits(self, joints: int) -> bool:
        """Whether the function exists for robots with so many ``joints``."""
        return joints > self.more_joints_than and not 0 < self.most_joints < joints

    @cached_property
    def arguments(self) -> tuple[ArgumentKind, ...]:
        """The arguments in Python, in order."""
        known = QUANTITIES | {quantity.name: quantity for quantity in self.where}
        return tuple(known[name] for name in self.takes.split() if name != "*")

    @property
    def keywords(self) -> tuple[ArgumentKind, ...]:
        """Those among the arguments that are given by keyword."""
        names = self.takes.split()
        return self.arguments[names.index("*") :] if "*" in names else ()
