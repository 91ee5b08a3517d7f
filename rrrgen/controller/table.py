"""The controller described once: its modes, its optional parts, the bits of its status, and every field of its structs.

The C structs with their checks and comments, and the same structs in Python and other languages, follow from this
module: one name, one order, one default for each field.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext.suggestions import did_you_mean

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

PERIOD = 1e-3
"""Default of the period, s."""

LARGEST = 1e9
"""Bound of every parameter that has no narrower one: products of a few of them stay finite in single precision."""


@dataclass(frozen=True)
class Field:
    """A member of a struct: ``count`` numbers of type real, or 32-bit integers if ``integer``.

    Parameters lie between ``low`` and ``high``; ``infinite`` ones may also be plus or minus infinity, which stands for
    no limit. ``defaults`` has one number, or one for each element. ``array`` is False for a single number,
    ``signed`` for an unsigned integer.
    """

    name: str
    count: int
    unit: str
    text: str
    low: float = -LARGEST
    high: float = LARGEST
    defaults: tuple[float, ...] = (0.0,)
    integer: bool = False
    infinite: bool = False
    array: bool = True
    signed: bool = True

    @property
    def values(self) -> tuple[float, ...]:
        """The default of every element."""
        return self.defaults * self.count if len(self.defaults) == 1 else self.defaults


@dataclass(frozen=True)
class Mode:
    """A control law that the unit can run: ``laws`` are the model functions of which it calls the first that exists.

    ``reference`` names the fields of the input that it follows; they must be finite while the mode is chosen.
    """

    name: str
    text: str
    laws: tuple[str, ...] = ()
    reference: tuple[str, ...] = ()


JOINT, TIP = ("q_d", "dq_d", "ddq_d"), ("T_d", "V_d")

MODES = (
    Mode("free", "no torque"),
    Mode("gravity", "gravity compensation for guidance by hand: g(q) - guide_damping dq", ("gravity",)),
    Mode("pd_gravity", "PID with gravity and friction: pd_kp e + pd_kd e' + pd_ki z + g(q) + f(dq_d)",
         ("pd_gravity",), JOINT),
    Mode("feedforward", "PID with the torques of the desired motion as feed-forward", ("feedforward",), JOINT),
    Mode("computed_torque", "inverse dynamics in the loop: M (ddq_d + kp e + kd e' + ki z) + c + g + f(dq_d)",
         ("computed_torque",), JOINT),
    Mode("joint_impedance", "spring and damper at the joints: joint_stiffness e + joint_damping e' + g(q)",
         ("gravity",), JOINT[:2]),
    Mode("impedance", "spring and damper at the tip: J' (stiffness e_x + damping (V_d - J dq)) + g(q)",
         ("impedance",), TIP),
    Mode("adaptive", "passivity-based, adapts the base parameters (Slotine and Li)", ("slotine_li",), JOINT),
    Mode("operational_space", "motion of the tip, decoupled (Khatib), damped near singular configurations",
         ("operational_space", "position_operational_space"), (*TIP, "A_d")),
    Mode("velocity", "velocity of the tip by differential inverse kinematics within all limits, then computed torque",
         ("computed_torque",), ("V_d",)),
)  # fmt: skip
"""All modes; the number of a mode is its place here, whichever of them are generated."""

GROUPS = ("control", "observer")
"""The groups of model functions that the unit calls."""

ALWAYS = ("free", "gravity")
"""Modes that every unit has: gravity is also the torque of a damped stop."""

PARTS = {
    "observer": "momentum observer of external torques with contact detection",
    "estimator": "base parameters estimated online, by the gradient method, from the motion of the filter kalman",
    "kalman": "joint speeds by a filter of constant acceleration, with the gains of a steady-state Kalman filter",
    "differences": "joint speeds by filtered differences",
    "friction": "compensation of friction",
    "payload": "a payload at the tip as parameters",
    "any_gravity": "the acceleration of gravity in the base frame as a parameter",
}
"""Optional parts, by name."""

USUAL_PARTS = ("observer", "friction", "payload")
"""Parts of a unit if nothing else is asked for."""

STATUS = {
    "NOT_FINITE": "a joint position or speed is not finite: the sample is not used",
    "JUMP": "a joint position or speed jumped further than it can move: the sample is not used",
    "STALE": "the sample counter did not change: the sample is not used",
    "PERIOD": "the time since the last tick is not the period: integrals and adaptation are frozen",
    "REFERENCE": "the reference is not finite: damped stop",
    "MODE": "this mode is not known: the last one stays",
    "OUTPUT": "the law gave numbers that are not finite: damped stop",
    "MODEL": "near a singular configuration or a limit the law is damped, or the arm stops, by `model_action`",
    "SATURATED": "a torque is at its limit",
    "RATE": "a torque changes as fast as it may",
    "POSITION": "a joint is outside its limits and moves outwards: damped stop",
    "SPEED": "a joint is too fast: damped stop",
    "CONTACT": "the external torques are above a threshold: the reaction is `contact_action`",
    "CONTACT_UNKNOWN": "the observer has no estimate in this tick: a contact would not be seen",
    "NO_INIT": "the state was not initialized: no torque, brakes closed",
}
"""The bits of the status, from the lowest, each with its text."""

PHASES = {
    "RUN": "the law of the mode",
    "HOLD": "the last torque, while samples are missing; returns by itself",
    "STOP": "damped stop, g(q) - stop_damping dq, until a reset",
    "BRAKE": "no torque, brakes closed, until a reset",
}
"""The phases of the controller, from 0."""


@dataclass(frozen=True)
class ControllerUnit:
    """The unit of one robot: its model, and the modes and parts that were chosen, in the order of the tables.

    ``period`` (s) is the default of ``Ts``, for which gains of filters are proposed; ``given`` are defaults of other
    parameters that replace the proposals.
    """

    model: DerivedModel
    modes: tuple[str, ...]
    parts: tuple[str, ...]
    period: float = PERIOD
    given: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.spec.n

    def has(self, name: str) -> bool:
        """Whether the unit has the mode or part ``name``."""
        return name in self.modes or name in self.parts

    @property
    def filtered(self) -> bool:
        """Whether the unit computes the joint speeds itself."""
        return self.has("kalman") or self.has("differences")

    @property
    def adapts(self) -> bool:
        """Whether the base parameters change while the controller runs."""
        return self.has("adaptive") or self.has("estimator")

    def law(self, mode: str) -> str:
        """The model function that the mode calls: the first that this robot has; "" for none."""
        entry = next(candidate for candidate in MODES if candidate.name == mode)
        return next((law for law in entry.laws if law in self.model.programs), "")

    @property
    def tip_rows(self) -> int:
        """Rows of the tip's motion in operational space: 6 for pose, 3 for position."""
        return 6 if self.law("operational_space") == "operational_space" else 3

    @property
    def integrators(self) -> int:
        """Number of states of the integral action: that of the largest law."""
        joints = self.n if any(map(self.has, ("pd_gravity", "feedforward", "computed_torque", "velocity"))) else 0
        return max(joints, self.tip_rows if self.has("operational_space") else 0)


def unit_of(
    model: DerivedModel,
    modes: Sequence[str] | None = None,
    parts: Sequence[str] | None = None,
    period: float = PERIOD,
    given: Mapping[str, tuple[float, ...]] | None = None,
) -> ControllerUnit:
    """The unit for a robot with its control laws.

    Args:
        model: the derived robot with the groups "control" and "observer"; with gravity as an input for the part of that
            name.
        modes: names of modes; None for all that the robot can have.
        parts: names of optional parts; None for the usual ones.
        period: default of the period, s.
        given: defaults of parameters by name, instead of the proposals.

    Raises:
        InputError: a name is unknown, a robot cannot have a mode, or two parts exclude each other.
    """
    possible = available_modes(model)
    chosen = _choose("mode", possible if modes is None else modes, [mode.name for mode in MODES])
    for name in chosen:
        if name not in possible:
            raise InputError(f"{model.spec.name} cannot have the mode '{name}'; its modes are {', '.join(possible)}")
    usual = [part for part in USUAL_PARTS if part in available_parts(model)]
    taken = _choose("part", usual if parts is None else parts, list(PARTS))
    if "kalman" in taken and "differences" in taken:
        raise InputError("the parts 'kalman' and 'differences' exclude each other: both compute the joint speeds")
    if "estimator" in taken and "kalman" not in taken:
        raise InputError("the part 'estimator' needs the accelerations of the part 'kalman'")
    if ("any_gravity" in taken) != model.spec.gravity_input:
        raise InputError("the part 'any_gravity' and the model with gravity as an input belong together")
    for name in taken:
        if name not in available_parts(model):
            raise InputError(
                f"{model.spec.name} cannot have the part '{name}'; parts are {', '.join(available_parts(model))}"
            )
    every = tuple(mode.name for mode in MODES if mode.name in (*ALWAYS, *chosen))
    return ControllerUnit(model, every, tuple(part for part in PARTS if part in taken), period, dict(given or {}))


def available_modes(model: DerivedModel) -> list[str]:
    """The modes that the robot can have: those whose law it has."""
    return [mode.name for mode in MODES if not mode.laws or any(law in model.programs for law in mode.laws)]


def available_parts(model: DerivedModel) -> list[str]:
    """The parts that the robot can have."""
    takes = {port.name for program in model.programs.values() for port in program.inputs}
    needs = {"observer": "momentum_observer" in model.programs, "friction": "friction" in takes}
    needs["payload"] = "add_payload" in model.programs
    return [part for part in PARTS if needs.get(part, True)]


def _choose(what: str, names: Iterable[str], known: Sequence[str]) -> list[str]:
    chosen = [names] if isinstance(names, str) else list(dict.fromkeys(names))
    for name in chosen:
        if name not in known:
            hint = did_you_mean(name, known) or f"there are {', '.join(known)}"
            raise InputError(f"controller: there is no {what} '{name}'; {hint}")
    return chosen


def mode_number(name: str) -> int:
    """The number of a mode in all structs."""
    return [mode.name for mode in MODES].index(name)


# ------------------------------------------------------------------------------------------------------------------
# The fields of the structs
# ------------------------------------------------------------------------------------------------------------------

POSITION, SPEED, TORQUE = "rad | m", "rad/s | m/s", "N m | N"


def parameters(unit: ControllerUnit, proposed: dict[str, tuple[float, ...]]) -> list[Field]:
    """The fields of the parameters, reals before integers.

    ``proposed`` are default gains by name, from :func:`rrrgen.controller.proposals.proposals`.
    """
    fields = list(_parameters(unit, proposed))
    return [field for field in fields if not field.integer] + [field for field in fields if field.integer]


def _parameters(unit: ControllerUnit, proposed: dict[str, tuple[float, ...]]) -> Iterator[Field]:
    n, limits = unit.n, [joint.limits for joint in unit.model.spec.joints]

    def limit(key: str, missing: float = math.inf) -> tuple[float, ...]:
        return tuple(
            missing if getattr(joint_limits, key) is None else float(getattr(joint_limits, key))
            for joint_limits in limits
        )

    def gains(name: str, count: int, unit_of: str, text: str, **more: Any) -> Field:
        return Field(name, count, unit_of, text, 0.0, LARGEST, proposed.get(name, (0.0,)), **more)

    yield Field("Ts", 1, "s", "period", 1e-6, 1.0, (unit.period,), array=False)
    yield Field(
        "period_tolerance", 1, "", "relative deviation of the period that is allowed", 0.0, 1.0, (0.5,), array=False
    )
    yield Field("blend", 1, "s", "time constant of the fading torque step at a change of mode; 0 for none",
                0.0, 1e3, (0.05,), array=False)  # fmt: skip
    yield Field(
        "fade",
        1,
        "s",
        "time constant of the fading gravity torque, for sensor_action 1",
        1e-6,
        1e3,
        (0.2,),
        array=False,
    )
    yield Field(
        "q_min",
        n,
        POSITION,
        "smallest positions; -INFINITY for none",
        defaults=limit("lower", -math.inf),
        infinite=True,
    )
    yield Field("q_max", n, POSITION, "largest positions; INFINITY for none", defaults=limit("upper"), infinite=True)
    yield Field("q_jump", n, POSITION, "largest step of a position in one period; INFINITY for no check", 0.0, LARGEST,
                proposed["q_jump"], infinite=True)  # fmt: skip
    yield Field("dq_max", n, SPEED, "largest speeds; INFINITY for none", 0.0, LARGEST, limit("velocity"), infinite=True)
    yield Field(
        "rest_speed",
        n,
        SPEED,
        "slower joints count as at rest: inside their limits, unused by the estimator",
        0.0,
        LARGEST,
        (0.01,),
    )
    yield Field(
        "tau_max", n, TORQUE, "largest torques; INFINITY for none", 0.0, LARGEST, limit("torque"), infinite=True
    )
    yield Field(
        "tau_rate",
        n,
        "N m/s | N/s",
        "largest change of the torques; INFINITY for none",
        0.0,
        LARGEST,
        (math.inf,),
        infinite=True,
    )
    yield gains("stop_damping", n, "N m s/rad | N s/m", "damping of a stop")
    yield gains("guide_damping", n, "N m s/rad | N s/m", "damping of the mode gravity")
    if unit.has("pd_gravity") or unit.has("feedforward"):
        yield gains("pd_kp", n, "N m/rad | N/m", "modes pd_gravity, feedforward: gains of the position error")
        yield gains("pd_kd", n, "N m s/rad | N s/m", "gains of the speed error")
        yield gains("pd_ki", n, "N m/(rad s) | N/(m s)", "gains of the integral")
    if unit.has("computed_torque") or unit.has("velocity"):
        yield gains("kp", n, "1/s^2", "modes computed_torque, velocity: gains of the position error")
        yield gains("kd", n, "1/s", "gains of the speed error; kd Ts < 1")
        yield gains("ki", n, "1/s^3", "gains of the integral")
    if unit.has("joint_impedance"):
        yield gains("joint_stiffness", n, "N m/rad | N/m", "mode joint_impedance: springs")
        yield gains("joint_damping", n, "N m s/rad | N s/m", "dampers")
    if unit.has("impedance"):
        yield gains("stiffness", 6, "N/m, N m/rad", "mode impedance: spring along and about the axes of the base")
        yield gains("damping", 6, "N s/m, N m s/rad", "damper along and about these axes")
    b = unit.model.beta_size
    if unit.has("adaptive"):
        yield gains("lam", n, "1/s", "mode adaptive: bandwidth of the error")
        yield gains("k", n, "N m s/rad | N s/m", "gains of s")
        yield gains("gamma", b, "SI", "adaptation gains, (unit of beta)^2/J; 0 for parameters to keep")
    if unit.has("estimator"):
        text = "estimator: gains of the parameters, (unit of beta)^2/(N m)^2; 0 for parameters to keep"
        yield gains("estimator_gain", b, "SI", text)
    if unit.adapts:
        yield Field(
            "beta_min",
            b,
            "SI",
            "lower bounds of beta; -INFINITY for none",
            defaults=proposed["beta_min"],
            infinite=True,
        )
        yield Field(
            "beta_max", b, "SI", "upper bounds of beta; INFINITY for none", defaults=proposed["beta_max"], infinite=True
        )
    if unit.has("operational_space"):
        rows = unit.tip_rows
        yield gains("tip_kp", rows, "1/s^2", "mode operational_space: gains of the error of the tip")
        yield gains("tip_kd", rows, "1/s", "gains of the error of its velocity; tip_kd Ts < 1")
        yield gains("tip_ki", rows, "1/s^3", "gains of the integral")
        yield gains("tip_damping", 1, "", "damping near singular configurations", array=False)
        yield gains("null_damping", n, "N m s/rad | N s/m", "damping of motions that do not move the tip")
    if unit.has("velocity"):
        yield gains("ik_weight", 6, "", "mode velocity: weights of the rows of the tip's velocity; 0 leaves a row out")
        yield Field("ik_damping", 1, "m, rad", "damping", 1e-6, 1e3, (0.02,), array=False)
        yield Field(
            "ddq_max", n, "rad/s^2 | m/s^2", "largest accelerations", 0.0, LARGEST, limit("acceleration"), infinite=True
        )
    yield Field("beta", b, "SI", "base parameters, then drive inertias", defaults=proposed["beta"])
    if unit.has("friction"):
        yield Field("friction", len(proposed["friction"]), "SI", "friction parameters", defaults=proposed["friction"])
        yield Field("friction_width", n, SPEED, "speeds below which friction is smoothed", 1e-9, LARGEST, (0.01,))
    if unit.has("payload"):
        yield Field("payload_mass", 1, "kg", "mass of the payload", 0.0, 1e6, array=False)
        yield Field("payload_com", 3, "m", "its centre of mass in the frame of the tip", -1e3, 1e3)
        yield Field(
            "payload_inertia", 9, "kg m^2", "its inertia about the centre of mass, 3x3, axes of the tip", -1e6, 1e6
        )
    if unit.has("any_gravity"):
        gravity = tuple(float(unit.model.spec.nominal(g)) for g in unit.model.spec.gravity)
        yield Field("gravity", 3, "m/s^2", "acceleration of gravity in the base frame", -1e3, 1e3, gravity)
    if unit.has("kalman"):
        yield gains("kalman_gain", 3 * n, "1, 1/s, 1/s^2", "gains of position, speed and acceleration for every joint")
    if unit.has("differences"):
        yield gains("speed_pole", 1, "1/s", "pole of the filter of the speeds", array=False)
    if unit.has("observer"):
        yield Field("observer_gain", 1, "1/s", "pole of the momentum observer", 1e-3, 1e6, (50.0,), array=False)
        yield Field(
            "threshold",
            n,
            TORQUE,
            "contact: thresholds of the estimate; INFINITY for none",
            1e-9,
            LARGEST,
            (math.inf,),
            infinite=True,
        )
        yield Field(
            "change_threshold",
            n,
            TORQUE,
            "contact: thresholds of its change; INFINITY for none",
            1e-9,
            LARGEST,
            (math.inf,),
            infinite=True,
        )
        yield Field(
            "contact_action",
            1,
            "",
            "reaction to contact: 0 report, 1 mode gravity, 2 stop, 3 brake",
            0,
            3,
            (0,),
            True,
            array=False,
        )
    yield Field(
        "hold_ticks",
        1,
        "ticks",
        "bad samples in a row that are bridged by the last torque",
        0,
        1000,
        (3,),
        True,
        array=False,
    )
    yield Field(
        "recover_ticks",
        1,
        "ticks",
        "good samples in a row before a reset is accepted",
        1,
        1000000,
        (10,),
        True,
        array=False,
    )
    yield Field(
        "sensor_action",
        1,
        "",
        "after more bad samples: 0 brake, 1 gravity of the last good position, fading",
        0,
        1,
        (0,),
        True,
        array=False,
    )
    yield Field(
        "model_action", 1, "", "near singular configurations: 0 damped law, 1 stop", 0, 1, (0,), True, array=False
    )
    yield Field(
        "watch_sample",
        1,
        "",
        "1: the sample counter of the input must change every tick",
        0,
        1,
        (1,),
        True,
        array=False,
    )


def inputs(unit: ControllerUnit) -> list[Field]:
    """The fields of the input."""
    n = unit.n
    wanted = {name for mode in MODES if mode.name in unit.modes for name in mode.reference}
    fields = [Field("q", n, POSITION, "measured joint positions")]
    if not unit.filtered:
        fields.append(Field("dq", n, SPEED, "measured joint speeds"))
    for name, count, quantity, text in (
        ("q_d", n, POSITION, "desired positions"),
        ("dq_d", n, SPEED, "desired speeds"),
        ("ddq_d", n, "rad/s^2 | m/s^2", "desired accelerations"),
        ("T_d", 16, "-, m", "desired pose of the tip in the base frame, 4x4, row-major"),
        ("V_d", 6, "m/s, rad/s", "desired velocity of the tip, linear, then angular, base frame"),
        ("A_d", 6, "m/s^2, rad/s^2", "desired acceleration of the tip"),
    ):
        if name in wanted:
            fields.append(Field(name, count, quantity, text))
    fields.append(Field("dt", 1, "s", "time since the last tick", array=False))
    fields.append(Field("sample", 1, "", "counter of the measurements", integer=True, array=False, signed=False))
    fields.append(Field("mode", 1, "", "wanted mode", integer=True, array=False))
    return fields


def outputs(unit: ControllerUnit) -> list[Field]:
    """The fields of the output."""
    n = unit.n
    fields = [Field("tau", n, TORQUE, "torques to apply"), Field("dq", n, SPEED, "joint speeds that the law used")]
    if unit.has("observer"):
        fields.append(Field("r", n, TORQUE, "estimated external torques"))
        fields.append(
            Field("contact_ratio", 1, "", "largest estimate over its threshold; contact above 1", array=False)
        )
    if unit.has("velocity"):
        fields.append(Field("q_r", n, POSITION, "mode velocity: positions that the joints follow"))
        fields.append(Field("dq_r", n, SPEED, "mode velocity: speeds that the joints follow, within all limits"))
    if unit.adapts:
        fields.append(Field("beta", unit.model.beta_size, "SI", "base parameters that the laws use"))
    for name, text, signed in (
        ("status", "set of bits, see below", False),
        ("joints", "joint k is part of the fault: bit k", False),
        ("phase", "0 run, 1 hold, 2 stop, 3 brake", True),
        ("mode", "mode that acts", True),
        ("brake", "1: close the brakes", True),
    ):
        fields.append(Field(name, 1, "", text, integer=True, array=False, signed=signed))
    return fields


def memory(unit: ControllerUnit) -> list[Field]:
    """The reals that the controller keeps from tick to tick; none of them is ever other than finite."""
    n = unit.n
    fields = [
        Field("q_last", n, POSITION, "last good positions"),
        Field("tau_last", n, TORQUE, "torques of the last tick"),
        Field("bump", n, TORQUE, "what is left of the step at the last change of mode"),
        Field("fading", 1, "", "share of the gravity torque without samples", array=False),
    ]
    if unit.integrators:
        fields.append(Field("z", unit.integrators, "rad s | m s", "integrals"))
    if unit.has("kalman"):
        fields.append(Field("x", 3 * n, "", "prediction of position, speed and acceleration"))
    if unit.has("differences"):
        fields.append(Field("speed", n, SPEED, "filtered speeds"))
    if unit.has("observer"):
        for name in ("p", "u", "r", "change"):
            fields.append(Field(name, n, "", "state of the momentum observer and of contact detection"))
    if unit.has("velocity"):
        fields.append(Field("q_r", n, POSITION, "positions of the differential inverse kinematics"))
        fields.append(Field("dq_r", n, SPEED, "speeds of the differential inverse kinematics"))
    if unit.adapts:
        fields.append(Field("beta", unit.model.beta_size, "SI", "adapted parameters"))
    return fields
