"""Recorders of friction as the robot file states it, at the joints and at coupled motors.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.recursions.linear_algebra import dot
from rrrgen.derive.recursions.link_frames import rational, rational_float
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.robot.friction.laws import LAWS, FrictionLaw
from rrrgen.robot.model.drives import unit
from rrrgen.robot.spec import FrictionSpec, RobotSpec

LINEAR = "tau_f = fv dq + fc sgn(dq) + offset   (14.11)"


@dataclass(frozen=True)
class Surface:
    """A joint or motor with friction: its ``name``, and what the robot file states about its ``friction``.

    Its speed is ``w . dq`` with w = ``direction`` (n,), and its friction f adds ``w f`` to the joint torques. Its load
    is ``load . tau``, with tau (n,) the joint torques of the robot without friction.
    """

    name: str
    direction: tuple[Any, ...]
    friction: FrictionSpec
    load: tuple[Any, ...]

    @property
    def law(self) -> FrictionLaw | None:
        """The friction law, None for the linear one."""
        return None if self.friction.law is None else LAWS[self.friction.law.name]

    @property
    def has_state(self) -> bool:
        """Whether the law has a state, the deflection of its bristles."""
        return self.law is not None and self.law.step is not None

    @property
    def has_load(self) -> bool:
        """Whether the law depends on the load."""
        return self.law is not None and self.law.has_load


def friction_of(spec: RobotSpec) -> tuple[Surface, ...]:
    """The joints and coupled motors for which ``spec`` states friction."""
    surfaces = [
        Surface(joint.name, unit(i, spec.n), joint.friction, unit(i, spec.n))
        for i, joint in enumerate(spec.joints)
        if joint.friction is not None
    ]
    if spec.drives is not None:
        rows, inverse = spec.drives.motor_from_joint, spec.drives.joint_from_motor
        for k, motor in enumerate(spec.drives.motors):
            if motor.friction is not None:
                weights, load = (tuple(rational(w) for w in values) for values in (rows.row(k), inverse.col(k)))
                surfaces.append(Surface(motor.name, weights, motor.friction, load))
    return tuple(surfaces)


def friction(r: FunctionBuilder) -> Program:
    """Record the friction torques (n,) with the laws and parameters of the robot file. (14.11)-(14.14)

    A law with a state, the deflection of bristles, has its value at steady sliding.
    """
    dq, spec = r.joints("dq"), r.model.spec
    surfaces = friction_of(spec)
    loads = _loads(r, surfaces)
    torques = _at_joints(
        r, surfaces, lambda surface: _sliding(r, surface, dot(surface.direction, dq), loads.get(surface, 0))
    )
    named = any(surface.law is not None for surface in surfaces)
    formula, notes = ("", _laws(surfaces)) if named else (LINEAR, [])
    if any(surface.has_state for surface in surfaces):
        notes.append("Laws with a state z are taken in sliding; friction_step carries z.")
    if spec.drives is not None:
        notes.append("Coupled motors add S^-T tau_fm, with the same law at their shafts: dq_m = S^-1 dq.")
    return r.builder.program("friction", [(_port(r), torques)], "Joint friction.", formula, notes)


def friction_step(r: FunctionBuilder) -> Program:
    """Record one period of friction: from dq, the states z and the period Ts to the next z and the torques (n,)."""
    dq, surfaces = r.joints("dq"), friction_of(r.model.spec)
    moved = [surface for surface in surfaces if surface.has_state]
    meaning = "bristle deflections of " + ", ".join(surface.name for surface in moved)
    z = dict(zip(moved, r.builder.input(Port("z", (len(moved),), r.position_unit, "", meaning)), strict=True))
    (period,) = r.take("Ts")
    loads = _loads(r, surfaces)
    following: list[Any] = []

    def torque(surface: Surface) -> Any:
        speed = dot(surface.direction, dq)
        if surface not in z:
            return _sliding(r, surface, speed, loads.get(surface, 0))
        law, values, offset = _numbers(surface)
        assert law.step is not None
        raised = law.under_load(values, loads.get(surface, 0))
        after, value = law.step(r.builder, z[surface], speed, raised, period)
        following.append(after)
        return value + offset

    torques = _at_joints(r, surfaces, torque)
    port = Port("z_next", (len(moved),), r.position_unit, "", "bristle deflections at the end of the period", state="z")
    return r.builder.program(
        "friction_step",
        [(port, following), (_port(r), torques)],
        "One period of joint friction with a state, stable for every period.",
        "exact for constant dq",
        _laws(surfaces),
    )


@dataclass(frozen=True)
class RunTimeFriction:
    """Friction under the laws of the robot file with parameters that are an input of the recorded function.

    ``values`` are the parameters at each joint or motor. ``widths`` (rad/s or m/s) are the speeds over which a smooth
    function replaces the jump of sgn; None for the exact sgn.
    """

    recording: FunctionBuilder
    values: dict[Surface, list[Any]]
    widths: Sequence[Any] | None

    @staticmethod
    def declare(r: FunctionBuilder, smooth: bool) -> RunTimeFriction:
        """The friction of a function, with its inputs declared: ``friction``, and ``width`` if ``smooth``."""
        surfaces = surfaces_of(r.model.spec)
        names = [name for name, _ in friction_parameters(r.model.spec)]
        meaning = "friction parameters " + ", ".join(names)
        given = iter(r.friction(Port("friction", (len(names),), "SI", "", meaning, Role.FRICTION)))
        counts = [3 if surface.law is None else len(surface.law.parameters) + 1 for surface in surfaces]
        values = {s: [next(given) for _ in range(count)] for s, count in zip(surfaces, counts, strict=True)}
        widths = r.take("width", len(surfaces)) if smooth else None
        return RunTimeFriction(r, values, widths)

    @property
    def has_load(self) -> bool:
        """Whether a law depends on the load."""
        return any(surface.has_load for surface in self.values)

    def torques(self, dq: Sequence[Any], load: Sequence[Any] | None = None) -> list[Any]:
        """The friction torques (n,) at the joint velocities ``dq`` (n,) under the joint torques ``load`` (n,).

        Without ``load``, it is declared as an input if a law depends on it.
        """
        b, surfaces = self.recording.builder, tuple(self.values)
        loads = _loads(self.recording, surfaces, load)

        def torque(surface: Surface) -> Any:
            ops = b if self.widths is None else _SmoothFunctions(b, self.widths[surfaces.index(surface)])
            at = loads.get(surface, 0)
            return _surface_friction(ops, surface, dot(surface.direction, dq), self.values[surface], at)

        return _at_joints(self.recording, surfaces, torque)

    @property
    def laws(self) -> list[str]:
        """Notes for the header, one per friction law: the joints and motors that it acts at, and its formula."""
        return _laws(tuple(self.values))


def friction_with(r: FunctionBuilder) -> Program:
    """Record the friction torques (n,) under the laws of the robot file, with their parameters as an input."""
    dq = r.joints("dq")
    friction = RunTimeFriction.declare(r, smooth=False)
    return r.builder.program(
        "friction_with",
        [(_port(r), friction.torques(dq))],
        "Joint friction with its parameters at run time.",
        "",
        [*friction.laws, "sgn(0) = 0."],
    )


def smooth_friction(r: FunctionBuilder) -> Program:
    """Record smooth friction torques (n,): sgn(s) in the friction laws is replaced by tanh(s / width).

    The parameters of the laws are an input. Meant for controllers and optimisation, which need derivatives.
    """
    dq = r.joints("dq")
    friction = RunTimeFriction.declare(r, smooth=True)
    return r.builder.program(
        "smooth_friction",
        [(_port(r), friction.torques(dq))],
        "Joint friction with its parameters at run time, smooth.",
        "sgn(s) replaced by tanh(s / width)",
        friction.laws,
    )


@dataclass(frozen=True)
class _SmoothFunctions:
    """The functions sign, exp and tanh that friction laws call, recorded; sign(x) is replaced by tanh(x / width)."""

    builder: Builder
    width: Any

    def sign(self, x: Any) -> Any:
        return self.builder.tanh(x / self.width)

    def exp(self, x: Any) -> Any:
        return self.builder.exp(x)

    def tanh(self, x: Any) -> Any:
        return self.builder.tanh(x)


def friction_parameters(spec: RobotSpec) -> tuple[tuple[str, Fraction], ...]:
    """Names and nominal values of the friction parameters at run time, joint by joint, then motor by motor.

    Under a law: its parameters and the offset; otherwise viscous, coulomb, offset. A robot whose file states no
    friction has the linear law at all joints, with zeros.
    """
    parameters = []
    for surface in surfaces_of(spec):
        given = surface.friction
        if given.law is None:
            values = {"viscous": given.viscous, "coulomb": given.coulomb}
        else:
            names = (p.name for p in LAWS[given.law.name].parameters)
            values = dict(zip(names, given.law.values, strict=True))
        values["offset"] = given.offset
        parameters += [(f"{surface.name}_{name}", rational_float(value)) for name, value in values.items()]
    return tuple(parameters)


def surfaces_of(spec: RobotSpec) -> tuple[Surface, ...]:
    """The joints and motors with friction: those of the robot file, or all joints if the file states none."""
    return friction_of(spec) or tuple(
        Surface(joint.name, unit(i, spec.n), FrictionSpec(), unit(i, spec.n)) for i, joint in enumerate(spec.joints)
    )


def _loads(r: FunctionBuilder, surfaces: Sequence[Surface], load: Sequence[Any] | None = None) -> dict[Surface, Any]:
    """Magnitude of the load of every surface whose law depends on the load, from the joint torques ``load`` (n,).

    Where ``load`` is None, the joint torques are declared as an input.
    """
    loaded = [surface for surface in surfaces if surface.has_load]
    if not loaded:
        return {}
    tau = load if load is not None else r.take("tau_load")
    return {surface: r.builder.abs(dot(surface.load, tau)) for surface in loaded}


def _surface_friction(ops: Any, surface: Surface, speed: Any, values: Sequence[Any], load: Any) -> Any:
    """Friction of one joint or motor at its ``speed`` with the parameters ``values``.

    ``ops`` provides the functions sign, exp and tanh; ``load`` is the magnitude of the load torque.
    """
    *parameters, offset = values
    if surface.law is None:
        return parameters[0] * speed + parameters[1] * ops.sign(speed) + offset
    return surface.law.torque(ops, speed, surface.law.under_load(parameters, load)) + offset


def _sliding(r: FunctionBuilder, surface: Surface, speed: Any, load: Any) -> Any:
    """Friction of one joint or motor at its ``speed``, under a load whose torque has the magnitude ``load``."""
    if surface.law is None:
        given = surface.friction
        viscous, coulomb, offset = (rational_float(v) for v in (given.viscous, given.coulomb, given.offset))
        return viscous * speed + coulomb * r.builder.sign(speed) + offset
    law, values, offset = _numbers(surface)
    return law.torque(r.builder, speed, law.under_load(values, load)) + offset


def _numbers(surface: Surface) -> tuple[FrictionLaw, list[Any], Any]:
    """The friction law of a joint or motor, and the exact values of its parameters and of the constant offset."""
    assert surface.friction.law is not None
    values = [rational_float(value) for value in surface.friction.law.values]
    return LAWS[surface.friction.law.name], values, rational_float(surface.friction.offset)


def _at_joints(r: FunctionBuilder, surfaces: Sequence[Surface], torque: Callable[[Surface], Any]) -> list[Any]:
    """The joint torques ``sum of w f`` over all surfaces."""
    total: list[Any] = [0] * r.n
    for surface in surfaces:
        value = torque(surface)
        total = [sum_ + w * value if w else sum_ for sum_, w in zip(total, surface.direction, strict=True)]
    return total


def _laws(surfaces: Sequence[Surface]) -> list[str]:
    """Notes for the header, one per friction law: the joints and motors that it acts at, and its formula."""
    owners: dict[str, list[str]] = {}
    for surface in surfaces:
        owners.setdefault(LINEAR if surface.law is None else surface.law.formula, []).append(surface.name)
    return [f"{', '.join(names)}: {formula}" for formula, names in owners.items()]


def _port(r: FunctionBuilder) -> Port:
    return Port("tau_f", (r.n,), r.torque_unit, "", "friction torques, added to the rigid body's", Role.TORQUE)
