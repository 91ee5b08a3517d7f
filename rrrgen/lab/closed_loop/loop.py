"""Simulation of controller and robot in closed loop, in compiled C: from robot parameters to motion and torques.

The torque is held constant between controller samples. The motion is integrated with the midpoint rule. Dry friction is
set-valued at rest: each time step solves for the friction torque, within its limits, that keeps a joint at rest. So
sgn(dq) needs no smoothing and the times of velocity reversals need not be located.
Friction with a state enters with the exact mean over a step of its deflection at the step's mean speed, which does not
damp the ringing of a joint on stiff bristles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.closed_loop.controller import LoopController, Tables
from rrrgen.lab.closed_loop.loop_recording import LoopRecording
from rrrgen.lab.friction.joint_simulation import Directed
from rrrgen.lab.identify.parameters import Column
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.program.builder import replay
from rrrgen.robot.model.mechanism import refuse_newton

# ------------------------------------------------------------------------------------------------------------------
# Equations of motion for the closed-loop simulation as programs, with the estimated parameters as an input.
#
# The parameter vector theta holds one parameter for each column of the regressor (base parameters first), then the
# shape parameters of the friction laws (such as the Stribeck velocity), surface by surface. A *friction surface* is a
# joint or motor that has a friction term; surface j slides at the speed ``u_j = w_j dq``, with the constant row
# ``w_j`` (n,).
# ------------------------------------------------------------------------------------------------------------------

SLIDING = ("viscous", "coulomb", "offset")


@dataclass(frozen=True, eq=False)
class LoopEquations:
    """Mass matrix, load torques and friction of a robot, from its full ``regressor``.

    The load torques are all torques for ddq = 0 without friction.
    """

    regressor: FullRegressor

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.regressor.model.n

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """Descriptions of the regressor columns, one for each parameter that enters the torques linearly."""
        return self.regressor.columns

    @property
    def shapes(self) -> Array:
        """Shape parameters of the friction laws of all surfaces, in order, as the regressor holds them."""
        return np.array([value for surface in self.regressor.surfaces for value in surface.shapes])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters in theta, friction shape parameters last."""
        shapes = (
            f"{shape}{surface.owner}" for surface in self.regressor.surfaces for shape in surface.definition.shapes
        )
        return (*self.regressor.names, *shapes)

    @property
    def size(self) -> int:
        """Length of theta, friction shape parameters included."""
        return len(self.columns) + sum(len(s.definition.shapes) for s in self.regressor.surfaces)

    @cached_property
    def directions(self) -> Array:
        """Matrix W (m, n) that maps joint speeds to sliding speeds of the m friction surfaces, ``u = W dq``."""
        directions = [column.direction for column in self.columns if column.kind in SLIDING]
        directions += [surface.direction for surface in self.regressor.surfaces]
        kept = dict.fromkeys(tuple(float(w) for w in direction) for direction in directions)
        return np.array([[*direction] for direction in kept]).reshape(len(kept), self.n)

    @cached_property
    def bent(self) -> tuple[bool, ...]:
        """Whether the friction of each of the m surfaces has a state, so that it builds up gradually."""
        flags = [False] * len(self.directions)
        for surface in self.regressor.surfaces:
            flags[self._surface(surface.direction)] |= surface.has_state
        return tuple(flags)

    @cached_property
    def carried(self) -> Array | None:
        """Matrix (m, n) that maps joint torques without friction to the loads of the surfaces, None without any load.

        Rows of surfaces whose friction does not depend on the load are zero.
        """
        matrix = np.zeros((len(self.directions), self.n))
        for surface in self.regressor.surfaces:
            if surface.definition.has_load:
                matrix[self._surface(surface.direction)] = surface.carried
        return matrix if matrix.any() else None

    def programs(self) -> tuple[Program, ...]:
        """Programs of the equations of motion.

        ``terms(q, dq, theta)`` gives the mass matrix M (n, n) and load torques (n,);
        ``friction(u, d, s, size, theta)`` the friction torques (m,) of the surfaces, see :func:`friction_inputs`, and
        with a state also :func:`bristle_ports`.
        """
        return (self._terms(), self._friction()) if len(self.directions) else (self._terms(),)

    def _terms(self) -> Program:
        builder, n = Builder(), self.n
        q = builder.input(Port("q", (n,), "rad | m", "joint", "positions", Role.POSITION))
        dq = builder.input(Port("dq", (n,), "rad/s | m/s", "joint", "velocities", Role.VELOCITY))
        theta = builder.input(self._port())
        known: dict[Role, list[Any]] = {Role.POSITION: list(q), Role.VELOCITY: list(dq)}
        model: Any = self.regressor.model
        derived, programs = model.derived, model.derived.programs
        refuse_newton(derived.spec, "the simulated closed loop")
        # without drive inertia, which is added below
        known[Role.BASE_PARAMETERS] = [*theta[: derived.b], *[0] * (derived.beta_size - derived.b)]
        M = _replay_program(programs["mass_matrix"], builder, known)
        load = _replay_program(programs["bias"], builder, known)
        for k, column in enumerate(self.columns):
            if column.kind == "inertia":
                w = [Fraction(component) for component in column.direction]
                for i in range(n):
                    for j in range(n):
                        M[n * i + j] = M[n * i + j] + w[i] * w[j] * theta[k]
        outputs = [
            (Port("M", (n, n), "kg m^2", "joint", "mass matrix"), M),
            (Port("load", (n,), "N m | N", "joint", "velocity and gravity torques"), load),
        ]
        return builder.program("terms", outputs, summary="Mass matrix and load of the simulated robot.")

    def _friction(self) -> Program:
        builder, m = Builder(), len(self.directions)
        u, d, s, size = friction_inputs(builder, m)
        theta = builder.input(self._port())
        torques: list[Any] = [0] * m
        reach: list[Any] = [1] * m
        damping: list[Any] = [0] * m
        for k, column in enumerate(self.columns):
            if column.kind in SLIDING:
                j = self._surface(column.direction)
                factor: Any = {"viscous": u[j], "coulomb": d[j], "offset": 1}[column.kind]
                torques[j] = torques[j] + theta[k] * factor
        k = len(self.columns) - sum(len(surface.definition.linear) for surface in self.regressor.surfaces)
        shape = len(self.columns)
        for surface in self.regressor.surfaces:
            law, j = surface.definition, self._surface(surface.direction)
            linear = dict(zip((parameter.name for parameter in law.linear), theta[k:], strict=False))
            shapes = theta[shape : shape + len(law.shapes)]
            at = s[j] if surface.has_state else d[j]
            factors = law.factors(Directed(builder, d[j]), u[j], at, shapes)
            factors += [at * size[j]] if law.has_load else []
            for (name, weight), factor in zip(linear.items(), factors, strict=True):
                if name != law.damping:  # the simulation adds the damping of bristles
                    torques[j] = torques[j] + weight * factor
            if surface.has_state:
                reach[j] = law.reach(Directed(builder, d[j]), u[j], shapes)
                damping[j] = linear.get(law.damping, 0)
            k, shape = k + len(linear), shape + len(shapes)
        outputs = [(Port("f", (m,), "N m | N", "", "friction of the surfaces"), torques)]
        if any(self.bent):
            outputs += list(zip(bristle_ports(m), (reach, damping), strict=True))
        return builder.program("friction", outputs, summary="Friction in given directions.")

    def _port(self) -> Port:
        return Port("theta", (self.size,), "mixed", "", "parameters of all columns, then shapes")

    def _surface(self, direction: Sequence[float]) -> int:
        return int(np.flatnonzero((self.directions == np.asarray(direction, float)).all(axis=1))[0])


def friction_inputs(builder: Builder, m: int) -> tuple[Any, Any, Any, Any]:
    """Inputs of a friction program for m surfaces.

    They are the sliding speeds u, the directions d of sliding (+1 or -1), the directions s of friction with a state (-1
    to 1), and the sizes of the load torques.
    """
    speeds = builder.input(Port("u", (m,), "rad/s | m/s", "", "speeds of the surfaces", Role.VELOCITY))
    directions = builder.input(Port("d", (m,), "", "", "directions in which they slide"))
    states = builder.input(Port("s", (m,), "", "", "directions of friction with a state"))
    sizes = builder.input(Port("size", (m,), "N m | N", "", "sizes of their loads"))
    return speeds, directions, states, sizes


def bristle_ports(m: int) -> tuple[Port, Port]:
    """Outputs of a friction program for m surfaces: deflection in steady sliding and damping of their bristles."""
    reach = Port("reach", (m,), "rad | m", "", "deflections in steady sliding forwards")
    return reach, Port("damping", (m,), "N m s/rad | N s/m", "", "torques per rate of the deflections")


def _replay_program(program: Program, builder: Builder, known: dict[Role, list[Any]]) -> list[Any]:
    inputs: list[Any] = [known.get(port.role, [Fraction(0)] * port.size) for port in program.inputs]
    return list(replay(program, builder, inputs)[0])


# ------------------------------------------------------------------------------------------------------------------
# Simulation of controller and robot in closed loop, in compiled C
# ------------------------------------------------------------------------------------------------------------------

STEP = 2.5e-4
"""Longest step of the simulation, s."""

DECLARED = (
    "int loop_run(const double *, const int *, int, const double *, const int *, const int *, "
    + 7 * "const double *, "
    + "double *, double *, double *, double *, double *, double *);"
)


@dataclass(frozen=True, eq=False)
class SimulatedLoop:
    """Result of one closed-loop simulation over N samples of n joints; arrays are (N, n), in SI units.

    ``q`` and ``dq`` are the simulated motion; during the warm-up, before the simulation starts, they are the measured
    one. ``tau`` is the torque in the form in which a recording stores it, ``acting`` the torque that moves the joints
    from each sample on. ``diverged`` is the index of the sample at which the motion left its bounds, None if it did
    not.
    """

    q: Array
    dq: Array
    tau: Array
    acting: Array
    diverged: int | None


class Equations(Protocol):
    """Interface of the equations of motion of n joints with m friction surfaces and ``size`` parameters theta.

    ``directions`` (m, n) maps joint speeds to sliding speeds of the surfaces. ``programs()`` returns ``terms(q, dq,
    theta) -> M, load`` and, if m > 0, ``friction(u, d, s, size, theta) -> f``: the friction torques (m,) at sliding
    speeds u in directions d (+1 or -1). ``bent`` (m,) marks surfaces whose friction has a state, the deflection z of
    its bristles; if any has, friction also returns ``reach`` (m,), the deflection in steady sliding forwards, and
    ``damping`` (m,). Such friction is linear in s = z / reach, which follows d gradually after a reversal, and
    ``damping dz/dt`` is added.
    ``carried`` (m, n) maps the joint torques without friction to the loads of the surfaces, whose sizes friction may
    depend on; None if it does not.
    """

    @property
    def n(self) -> int: ...  # noqa: D102
    @property
    def size(self) -> int: ...  # noqa: D102
    @property
    def directions(self) -> Array: ...  # noqa: D102
    @property
    def bent(self) -> tuple[bool, ...]: ...  # noqa: D102
    @property
    def carried(self) -> Array | None: ...  # noqa: D102
    def programs(self) -> tuple[Program, ...]: ...  # noqa: D102


class CompiledLoop:
    """Closed-loop simulation of ``controller`` and the robot ``equations``, compiled once for any parameter values."""

    def __init__(self, equations: Equations, controller: LoopController) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.function_files import Extension, function_files
        from rrrgen.runtime.build import build_extension

        self.equations, self.controller = equations, controller
        carried = np.zeros(0) if equations.carried is None else equations.carried
        values = {
            **{"n": equations.n, "m": len(equations.directions), "W": _literals(equations.directions)},
            **{"states": any(equations.bent), "bent": ", ".join(str(int(flag)) for flag in equations.bent)},
            **{"loads": equations.carried is not None, "carried": _literals(carried)},
        }
        programs = equations.programs()
        files = function_files(
            "loop", "a simulated closed loop", programs, "double", extension=Extension("loop", values)
        )
        self._ffi, self._lib = build_extension(files, DECLARED, "loop", NATIVE)
        self._tables: Tables = controller.tables()

    def replay(self, recording: LoopRecording) -> SimulatedLoop:
        """Run the controller on the *measured* motion, without simulating the robot; the result holds its torques."""
        return self._run(np.zeros(self.equations.size), recording, len(recording))

    def run(self, theta: Array, recording: LoopRecording) -> SimulatedLoop:
        """Simulate the closed loop with robot parameters ``theta`` along the reference of ``recording``.

        ``theta`` (p,) is in the order of the equations: linear parameters, then shape parameters of friction laws.
        """
        return self._run(np.ascontiguousarray(theta, float), recording, recording.warm)

    def _run(self, theta: Array, recording: LoopRecording, warm: int) -> SimulatedLoop:
        samples, n, tables = len(recording), self.equations.n, self._tables
        whole = int(np.floor(recording.delay + 1e-9))
        part = max(0.0, recording.delay - whole)
        steps = max(1, int(np.ceil(recording.period / STEP - 1e-9)))
        counts = np.array([samples, recording.every, warm, steps, whole], np.int32)
        q, dq, command, acting = (np.zeros((samples, n)) for _ in range(4))
        doubles: list[Any] = [
            *(np.array([recording.period, part]), recording.bounds, recording.q, recording.reference),
            *(recording.reference_velocity, recording.feedforward, recording.start),
            *(np.zeros(tables.signals), np.zeros(tables.memory + 1), q, dq, command, acting),
        ]
        doubles = [self._ffi.from_buffer("double[]", np.ascontiguousarray(array, float)) for array in doubles]
        ends = self._lib.loop_run(
            self._ffi.from_buffer("double[]", theta),
            self._ffi.from_buffer("int[]", tables.operations),
            len(tables.operations),
            self._ffi.from_buffer("double[]", tables.coefficients),
            self._ffi.from_buffer("int[]", tables.outputs),
            self._ffi.from_buffer("int[]", counts),
            *doubles,
        )
        diverged = None if ends == samples else int(ends)
        return SimulatedLoop(q, dq, recording.as_recorded(command), recording.apply_delay(acting), diverged)


def _literals(values: Array) -> str:
    """The entries of ``values`` as C literals with commas between them."""
    return ", ".join(repr(float(value)) for value in values.ravel())
