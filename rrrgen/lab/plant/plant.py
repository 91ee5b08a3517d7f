"""Equations of motion of the virtual robot: ``M(q) ddq + c + g + tau_f = tau``, with optional flexible joints and base.

The state of a rigid robot is ``[q, dq]``. A flexible joint adds a rotor that drives the link through a spring and a
damper (two-mass system). A flexible base rotates about the axis of joint 1 against a spring and a damper: the links
move with the sum of base and joint angle; encoder and friction of joint 1 depend on the joint angle alone. Source:
(14.6), section 14.6.6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError
from rrrgen.lab.plant.friction import Friction, NoFriction
from rrrgen.program import Builder, Program, Role
from rrrgen.program.builder import replay
from rrrgen.robot.model.mechanism import refuse_newton

Array = NDArray[Any]


class Dynamics(Protocol):
    """Interface of the robot model that a plant needs; :class:`rrrgen.Model` implements it."""

    n: int

    def mass_matrix(self, q: Array, beta: Array | None = None) -> Array:
        """Mass matrix M(q), (n, n), kg m^2, for base parameters ``beta`` (those of the robot file if None)."""
        ...

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array, beta: Array | None = None) -> Array:
        """Joint torques ``M ddq + c + g`` (n,), N m (N), for base parameters ``beta`` (None: as in the robot file)."""
        ...


@dataclass(frozen=True)
class FlexibleJoints:
    """Rotor, spring and damper of every joint: inertia (kg m^2), stiffness (N m/rad), damping (N m s/rad), (n,) each.

    Seen at the joint; for prismatic joints mass, N/m and N s/m.
    """

    rotor_inertia: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]

    def __post_init__(self) -> None:
        if min(self.rotor_inertia) <= 0.0 or min(self.stiffness) <= 0.0 or min(self.damping) < 0.0:
            raise InputError("flexible joints: rotor inertia and stiffness must be positive, damping not negative")


@dataclass(frozen=True)
class FlexibleBase:
    """A base that swings about the axis of joint 1: its inertia (kg m^2), natural frequency (Hz) and damping ratio."""

    inertia: float
    frequency: float = 28.0
    damping_ratio: float = 0.1

    def __post_init__(self) -> None:
        if self.inertia <= 0.0 or self.frequency <= 0.0 or self.damping_ratio < 0.0:
            raise InputError("flexible base: inertia and frequency must be positive, the damping ratio not negative")

    @property
    def stiffness(self) -> float:
        """Stiffness of the spring, ``J (2 pi f)^2``, N m/rad."""
        return self.inertia * (2.0 * math.pi * self.frequency) ** 2

    @property
    def damping(self) -> float:
        """Coefficient of the damper, ``2 zeta J (2 pi f)``, N m s/rad."""
        return 2.0 * self.damping_ratio * self.inertia * 2.0 * math.pi * self.frequency


class RigidBody:
    """Mass matrix, bias torque and acceleration of a robot model at one state.

    ``beta`` are base parameters other than those of the robot file, ``drive_inertia`` (n,) is added to the diagonal of
    M, kg m^2 (kg). Uses the preallocated calls of a compiled model where it has them.
    """

    def __init__(self, model: Any, beta: ArrayLike | None = None, drive_inertia: ArrayLike | None = None) -> None:
        self.n: int = model.n
        parameters = None if beta is None else np.asarray(beta, dtype=float)
        self._model, self._parameters = model, parameters
        self._added = None if drive_inertia is None else np.diag(np.asarray(drive_inertia, dtype=float))
        self._zero = np.zeros(self.n)
        self._direct: Callable[[Array, Array, Array], Array] | None = None
        self._mass: Callable[[Array], Array]
        self._torque: Callable[[Array, Array, Array], Array]
        if hasattr(model, "bind"):
            self._mass = model.bind("mass_matrix", parameters)
            self._torque = model.bind("inverse_dynamics", parameters)
            if self._added is None:
                self._direct = model.bind("forward_dynamics", parameters)
        else:
            self._mass = lambda q: np.asarray(model.mass_matrix(q, parameters))
            self._torque = lambda q, dq, ddq: np.asarray(model.inverse_dynamics(q, dq, ddq, parameters))

    def forward_dynamics_program(self) -> Program | None:
        """The program of forward dynamics with all parameters as numbers; None where there is none.

        If the added inertia cancels the drive inertia of the robot file, the program is that of the links alone. There
        is none for a model without programs, and for any other added inertia.
        """
        programs = getattr(getattr(self._model, "derived", None), "programs", {})
        if "forward_dynamics" not in programs:
            return None
        drives = self._model.drive_inertia
        if self._added is not None and (drives is None or np.any(np.diag(self._added) + drives)):
            return None
        none = self._added is not None and drives is not None
        beta = self._beta(np.zeros(drives.size) if none else drives)
        return _fold_parameters(programs["forward_dynamics"], {Role.BASE_PARAMETERS: beta})

    def _beta(self, drives: Array | None) -> Any:
        """The argument beta of programs, the base parameters and then ``drives`` (k,); None if they are not known."""
        links = self._model.beta if self._parameters is None else self._parameters
        return links if links is None or drives is None else np.concatenate([links, drives])

    def terms_program(self) -> tuple[Program, list[Array]] | None:
        """The program of M(q), c and g, and the values of its parameters in the order of its inputs after q and dq.

        The inertias (n,) added to the diagonal of M come last. None for a model without programs or compiled code, or
        with parameters whose values are not known.
        """
        programs = getattr(getattr(self._model, "derived", None), "programs", {})
        if "dynamics_terms" not in programs or self._model.engine.name != "c":
            return None
        known = {
            Role.BASE_PARAMETERS: self._beta(self._model.drive_inertia),
            Role.GRAVITY: self._model.nominal_gravity,
        }
        program = programs["dynamics_terms"]
        values: list[Any] = [known.get(port.role) for port in program.inputs[2:]]
        if any(value is None for value in values):
            return None
        added = np.zeros(self.n) if self._added is None else np.diag(self._added)
        return program, [*values, added]

    def mass(self, q: Array) -> Array:
        """Mass matrix M(q) including drive inertia, (n, n), kg m^2 (kg)."""
        return self._mass(q).copy() if self._added is None else self._mass(q) + self._added

    def bias(self, q: Array, dq: Array) -> Array:
        """Velocity and gravity torques ``c + g``, (n,), N m (N)."""
        return self._torque(q, dq, self._zero).copy()

    def acceleration(self, q: Array, dq: Array, net: Array) -> Array:
        """Acceleration ``M^-1 (net - c - g)``, (n,), rad/s^2 (m/s^2), under the net torque ``net`` (n,)."""
        if self._direct is not None:
            return self._direct(q, dq, net).copy()
        return np.asarray(np.linalg.solve(self.mass(q), net - self.bias(q, dq)))


def _fold_parameters(program: Program, known: dict[Role, Array]) -> Program:
    """Replace the input parameters ``known`` of ``program`` (by role) by constants."""
    builder = Builder()
    inputs: list[Any] = []
    for port in program.inputs:
        if port.role in known:
            inputs.append([Fraction(float(value)) for value in known[port.role]])
        else:
            inputs.append(builder.input(port))
    return builder.rewritten(program, replay(program, builder, inputs))


@dataclass(frozen=True)
class Plant:
    """The simulated mechanics: rigid body, friction, optional flexible joints and base.

    Source: (14.6), (14.11)-(14.14).
    """

    body: RigidBody
    friction: Friction
    joints: FlexibleJoints | None = None
    base: FlexibleBase | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.body.n

    @property
    def needs_stiff_solver(self) -> bool:
        """Whether the state has more than ``[q, dq]``, or joint speeds alone do not decide between stick and slip."""
        flexible = self.joints is not None or self.base is not None
        return flexible or self.friction.has_state or self.friction.couples_joints

    @cached_property
    def layout(self) -> dict[str, slice]:
        """Slices of the state vector by name: ``q``, ``dq`` of the links, then rotors, bristles and base if present."""
        parts = [("q", self.n), ("dq", self.n)]
        if self.joints is not None:
            parts += [("rotor", self.n), ("rotor_speed", self.n)]
        if self.friction.has_state:
            parts += [("z", self.n)]
        if self.base is not None:
            parts += [("base", 1), ("base_speed", 1)]
        places, start = {}, 0
        for name, size in parts:
            places[name] = slice(start, start + size)
            start += size
        return places

    def initial_state(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """The state in which the encoders read ``q`` (n,) and rotors and links move with ``dq`` (n,).

        The springs of flexible joints start deflected by ``c + g``, the torque of the motion without acceleration; the
        base starts at rest.
        """
        layout = self.layout
        state = np.zeros(max(part.stop for part in layout.values()))
        state[layout["q"]] = q
        state[layout["dq"]] = dq
        if self.joints is not None:
            bias = self.body.bias(np.asarray(q, dtype=float), np.asarray(dq, dtype=float))
            deflection = bias / np.asarray(self.joints.stiffness)
            state[layout["rotor"]] = q
            state[layout["q"]] = np.asarray(q) - deflection
            state[layout["rotor_speed"]] = dq
        return state

    def encoders(self, state: Array) -> Array:
        """Positions at the encoders (n,), relative to the base; those of the rotors if the joints are flexible."""
        return self._relative(state, "rotor" if self.joints is not None else "q", "base")

    def speeds(self, state: Array) -> Array:
        """Speeds at the encoders (n,), relative to the base; those of the rotors if the joints are flexible."""
        return self._relative(state, "rotor_speed" if self.joints is not None else "dq", "base_speed")

    def _relative(self, state: Array, part: str, base: str) -> Array:
        layout = self.layout
        values = state[layout[part]].copy()
        if self.base is not None:
            values[0] -= state[layout[base]][0]
        return values

    def state_derivative(self) -> Callable[[Array, float, Array], Array]:
        """The right-hand side ``f(state, t, tau)`` for the stiff solver, with smoothed friction."""
        layout = self.layout
        body, friction, flexible, base = self.body, self.friction, self.joints, self.base
        z = layout.get("z")
        moved = "rotor_speed" if flexible is not None else "dq"
        size = max(part.stop for part in layout.values())

        def derivative(state: Array, _: float, tau: Array) -> Array:
            rates = np.zeros(size)
            q, dq = state[layout["q"]], state[layout["dq"]]
            sliding = state[layout[moved]].copy()
            if base is not None:
                sliding[0] -= state[layout["base_speed"]][0]
            if z is None:
                net = tau - friction.smooth_torque(sliding, tau)
            else:
                net = tau - friction.state_torque(state[z], sliding, tau)
                rates[z] = friction.rate(state[z], sliding)
            load = net
            if flexible is not None:
                load = np.asarray(flexible.stiffness) * (state[layout["rotor"]] - q)
                load += np.asarray(flexible.damping) * (state[layout["rotor_speed"]] - dq)
                rates[layout["rotor"]] = state[layout["rotor_speed"]]
                rates[layout["rotor_speed"]] = (net - load) / np.asarray(flexible.rotor_inertia)
            rates[layout["q"]] = dq
            rates[layout["dq"]] = body.acceleration(q, dq, load)
            if base is not None:
                angle, speed = state[layout["base"]], state[layout["base_speed"]]
                rates[layout["base"]] = speed
                restoring = base.damping * speed + base.stiffness * angle
                rates[layout["base_speed"]] = (-restoring - net[0]) / base.inertia
            return rates

        return derivative


def make_plant(
    model: Any,
    *,
    beta: ArrayLike | None = None,
    friction: Friction | None = None,
    drive_inertia: ArrayLike | None = None,
    joints: FlexibleJoints | None = None,
    base: FlexibleBase | None = None,
) -> Plant:
    """Build the plant of a robot model, with the base parameters of its robot file or the given ``beta``.

    ``friction`` is none by default. ``drive_inertia`` (n,), kg m^2 (kg), is added to the diagonal of M, which already
    includes the drive inertia of the robot file; the rotors of flexible ``joints`` replace both. Raises InputError if
    flexible joints are combined with coupled drives or with ``drive_inertia``, or do not match the number of joints.
    """
    if (spec := getattr(model, "spec", None)) is not None:
        refuse_newton(spec, "the virtual robot")
    if joints is not None:
        if getattr(getattr(model, "spec", None), "drives", None) is not None:
            raise InputError(
                "flexible joints have a rotor each, but the drives of this robot are coupled (`drives` of its file): "
                "leave out flexible_joints, or describe the robot without coupled drives"
            )
        if drive_inertia is not None:
            raise InputError("flexible joints have rotors: give the drive inertia as rotor_inertia")
        if len(joints.rotor_inertia) != model.n:
            raise InputError(f"flexible joints: {len(joints.rotor_inertia)} rotors for {model.n} joints")
        drive_inertia = without_drives(model)
    chosen = friction if friction is not None else NoFriction(model.n)
    return Plant(RigidBody(model, beta, drive_inertia), chosen, joints, base)


def without_drives(model: Any) -> Array | None:
    """Correction (n,) that removes the drive inertia of the robot file from the diagonal of M.

    None if the file states no drive inertia.
    """
    stated = getattr(model, "drive_inertia", None)
    return None if stated is None else -np.asarray(stated)
