"""Integration of a plant with flexible joints or base in compiled C, by Runge-Kutta steps that suit its fastest mode.

The equations are those of :meth:`rrrgen.lab.plant.plant.Plant.state_derivative`, recorded as a program. A simulated
second of a flexible arm takes a tenth of a second instead of ten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.joint_simulation import Directed
from rrrgen.lab.plant.friction import NoFriction
from rrrgen.lab.plant.integration import MOST_STOPS, breaks_away
from rrrgen.lab.plant.plant import Plant
from rrrgen.program import Builder, Port, Program, Role, Value
from rrrgen.program.builder import replay
from rrrgen.robot.friction.laws import FrictionLaw
from rrrgen.robot.friction.models import FrictionModel, MixedFriction

LARGEST_STEP = 0.7
"""Largest Runge-Kutta step, in units of the fastest time constant; the method is stable up to 2.78."""
MOST_STEPS = 2000
"""Number of Runge-Kutta steps per sample above which the implicit solver is used instead."""
DIFFERENCE = 1e-7


class _SmoothBuilder(Builder):
    """A builder that records tanh(x/width) for sgn(x)."""

    def __init__(self, width: float) -> None:
        super().__init__()
        self.width = Fraction(width)

    def sign(self, x: Value) -> Value:
        return self.tanh(self.div(x, self.width))


class CompiledIntegrator:
    """Integrates ``plant`` by compiled C in Runge-Kutta steps short enough for the rate ``fastest`` (1/s) of its modes.

    The bristles of a friction law with a state relax faster at higher speed; the steps are shortened accordingly.
    """

    def __init__(self, plant: Plant, program: Program, fastest: float) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.function_files import Extension, function_files
        from rrrgen.runtime.build import build_extension

        self.plant, self.fastest = plant, fastest
        sizes = {"size": program.inputs[0].size, "n": program.inputs[1].size}
        files = function_files(
            "plant",
            "the virtual robot",
            [program],
            "double",
            extension=Extension("plant", sizes),
        )
        declared = "int plant_advance(double *, const double *, double, int);"
        self._ffi, self._lib = build_extension(files, declared, "plant", NATIVE)

    def advance(self, state: Array, tau: Array, duration: float) -> Array:
        """The state ``duration`` seconds later under the constant torque ``tau`` (n,).

        Raises numpy.linalg.LinAlgError where the mass matrix is not positive definite.
        """
        rate = self.fastest
        if self.plant.friction.has_state:
            speeds = self.plant.speeds(state)
            zero, one = np.zeros(speeds.size), np.ones(speeds.size)
            friction = self.plant.friction
            rate += float(np.max(np.abs(friction.rate(one, speeds) - friction.rate(zero, speeds))))
        count = max(1, math.ceil(rate * duration / LARGEST_STEP))
        after = np.array(state, dtype=float)
        vectors = [
            self._ffi.from_buffer("double[]", array) for array in (after, np.ascontiguousarray(tau, dtype=float))
        ]
        if self._lib.plant_advance(*vectors, duration / count, count):
            raise np.linalg.LinAlgError("M(q) is not positive definite")
        return after


def compiled_integrator(plant: Plant, state: Array, duration: float) -> CompiledIntegrator | None:
    """Make an integrator of a flexible ``plant`` in C; None where it has no C code or steps would be too short.

    ``state`` is typical of the motion, ``duration`` that of a sample, s.
    """
    if plant.joints is None and plant.base is None:
        return None
    program, fastest = plant_program(plant), fastest_rate(plant, state)
    if program is None or fastest * duration / LARGEST_STEP > MOST_STEPS:
        return None
    return CompiledIntegrator(plant, program, fastest)


def fastest_rate(plant: Plant, state: Array) -> float:
    """The largest magnitude (1/s) of the eigenvalues of the plant at ``state``, with every joint about to slide."""
    derivative, at = plant.state_derivative(), np.array(state, dtype=float)
    layout = plant.layout
    for part in ("dq", "rotor_speed", "base_speed"):
        if part in layout:
            at[layout[part]] = 0.0
    tau = plant.body.bias(at[layout["q"]], np.zeros(plant.n))
    columns = []
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = DIFFERENCE
        columns.append((derivative(at + step, 0.0, tau) - derivative(at - step, 0.0, tau)) / (2.0 * DIFFERENCE))
    return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())


def plant_program(plant: Plant) -> Program | None:
    """Record the time derivative of the state of ``plant`` as a program.

    Returns None if the robot model or the friction model cannot be recorded.
    """
    dynamics, friction = plant.body.forward_dynamics_program(), plant.friction
    model = friction.model
    if dynamics is None or not (isinstance(friction, NoFriction) or isinstance(model, FrictionModel | MixedFriction)):
        return None
    builder = _SmoothBuilder(friction.width)
    layout, n = plant.layout, plant.n
    state = builder.input(Port("state", (max(part.stop for part in layout.values()),), "", "", "state of the plant"))
    tau = builder.input(Port("tau", (n,), "N m | N", "joint", "torques of the drives", Role.TORQUE))
    parts: dict[str, list[Any]] = {name: list(state[where]) for name, where in layout.items()}
    rates: dict[str, list[Any]] = {"q": parts["dq"]}
    sliding = list(parts["dq" if plant.joints is None else "rotor_speed"])
    if plant.base is not None:
        sliding[0] = sliding[0] - parts["base_speed"][0]
    net: list[Any] = list(tau)
    if isinstance(model, FrictionModel | MixedFriction):
        torques, bristles = _friction(builder, model, parts.get("z"), sliding, tau)
        net = [a - b for a, b in zip(net, torques, strict=True)]
        if bristles is not None:
            rates["z"] = bristles
    load = net
    if plant.joints is not None:
        joints = plant.joints
        twist = [a - b for a, b in zip(parts["rotor"], parts["q"], strict=True)]
        speed = [a - b for a, b in zip(parts["rotor_speed"], parts["dq"], strict=True)]
        load = [
            Fraction(k) * a + Fraction(d) * b
            for k, d, a, b in zip(joints.stiffness, joints.damping, twist, speed, strict=True)
        ]
        rates["rotor"] = parts["rotor_speed"]
        rates["rotor_speed"] = [(a - b) / Fraction(J) for a, b, J in zip(net, load, joints.rotor_inertia, strict=True)]
    values = {Role.POSITION: parts["q"], Role.VELOCITY: parts["dq"], Role.TORQUE: load}
    inputs: list[Sequence[Any]] = [
        values[port.role] if port.role in values else [Fraction(0)] * port.size for port in dynamics.inputs
    ]
    results = replay(dynamics, builder, inputs)
    failed: Any = 0 if dynamics.status is None else results.pop(dynamics.status.output)[0]
    rates["dq"] = results[0]
    if plant.base is not None:
        base = plant.base
        restoring = Fraction(base.damping) * parts["base_speed"][0] + Fraction(base.stiffness) * parts["base"][0]
        rates["base"] = parts["base_speed"]
        rates["base_speed"] = [-(restoring + net[0]) / Fraction(base.inertia)]
    flat = [value for name in layout for value in rates[name]]
    outputs = [
        (Port("rates", (len(flat),), "", "", "time derivative of the state"), flat),
        (Port("failed", (), "", "", "1 where M(q) is not positive definite"), [failed]),
    ]
    return builder.program("rates", outputs, summary="Time derivative of the state of the virtual robot.")


def _friction(
    smooth: Builder, model: FrictionModel | MixedFriction, z: list[Any] | None, speeds: list[Any], tau: Sequence[Any]
) -> tuple[list[Any], list[Any] | None]:
    """Record the friction torques (n,) and, where a law has a state, the rates of the bristles.

    Laws without a state are smoothed, those with one are not. The load of a law that depends on it is the drive torque
    ``tau`` (n,) less friction.
    """
    torques: list[Any] = []
    rates: list[Any] = []
    for i, ((law, values, offset), v) in enumerate(zip(joint_laws(model), speeds, strict=True)):
        row = [Fraction(float(value)) for value in values]
        bent = None if z is None or law.rate is None else z[i]
        ops: Any = smooth if bent is None else _Exact(smooth)
        torques.append(torque_under(smooth, law, ops, v, [*row, Fraction(offset)], tau[i], bent))
        rates.append(0 if bent is None or law.rate is None else law.rate(ops, bent, v, row))
    return torques, None if z is None else rates


def joint_laws(model: FrictionModel | MixedFriction) -> list[tuple[FrictionLaw, Array, float]]:
    """The friction law of each joint with its parameters and the constant torque added to it, N m (N)."""
    if isinstance(model, FrictionModel):
        return [(model.law, row, 0.0) for row in model.parameters]
    offsets = model.offset.tolist()
    return [
        (joint_model.law, joint_model.parameters[0], offset)
        for joint_model, offset in zip(model.models, offsets, strict=True)
    ]


def torque_under(
    builder: Builder, law: FrictionLaw, ops: Any, speed: Any, values: Sequence[Any], tau: Any, z: Any = None
) -> Any:
    """Record the friction torque of one joint at ``speed`` under the torque ``tau`` of its drive.

    ``values`` are the parameters of ``law`` and a constant torque; ``ops`` are the operations that the law uses, ``z``
    is its state (None: steady sliding). The load of a law that depends on it is ``tau`` less the friction.
    """
    *row, offset = values
    torque = _torque_of(law, ops, speed, row, z) + offset
    if not law.has_load:
        return torque
    share, net = _torque_of(law, ops, speed, law.under_load(row, 1), z) + offset - torque, tau - torque
    return tau - net / (1 + share * Builder.sign(builder, net))


def _torque_of(law: FrictionLaw, ops: Any, speed: Any, row: Sequence[Any], z: Any) -> Any:
    """Friction torque of one joint at ``speed`` under ``law``, whose internal state is ``z`` (None: steady sliding).

    ``ops`` are the operations that the law uses, ``row`` its parameters.
    """
    if z is None or law.state_torque is None:
        return law.torque(ops, speed, row)
    return law.state_torque(ops, z, speed, row)


class _Exact:
    """Operations of a :class:`_SmoothBuilder`, except that sgn(x) is recorded as it is, not as tanh(x/width)."""

    def __init__(self, builder: Builder) -> None:
        self.exp, self.tanh = builder.exp, builder.tanh
        self._builder = builder

    def sign(self, x: Value) -> Value:
        return Builder.sign(self._builder, x)


# ------------------------------------------------------------------------------------------------------------------
# Integration of a rigid plant in compiled C, by the steps of :class:`rrrgen.lab.plant.integration.RigidIntegrator`.
#
# Mass matrix, ``c + g`` and friction are recorded as programs whose parameters are inputs, so that one build serves
# all parameters of a robot with the same friction laws; Runge-Kutta steps, stops of joints and sticking are the
# template ``c/rigid_plant.c``. A sample of the RRR with Stribeck friction takes 8 us instead of 180.
# ------------------------------------------------------------------------------------------------------------------

WORTH_BUILDING = 4000
"""Number of Runge-Kutta steps from which C takes less time than NumPy: a build of 0.4 s against 0.1 ms a step."""


class CompiledRigidIntegrator:
    """Integrates the rigid ``plant`` by ``steps`` Runge-Kutta steps a sample, in compiled C."""

    def __init__(self, plant: Plant, terms: Program, friction: Program, parameters: Array, steps: int = 2) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.function_files import Extension, function_files
        from rrrgen.runtime.build import build_extension

        self.steps = steps
        self._parameters = parameters
        values = {"n": plant.n, "parameters": parameters.size, "most_stops": MOST_STOPS}
        extension = Extension("rigid_plant", values)
        files = function_files("rigid", "the virtual robot", [terms, friction], "double", extension=extension)
        declared = "int rigid_advance(double *, const double *, const double *, const double *, double, int);"
        self._ffi, self._lib = build_extension(files, declared, "rigid", NATIVE)
        self._jumps = breaks_away(plant).astype(float)

    def advance(self, state: Array, tau: Array, duration: float) -> Array:
        """The state ``duration`` seconds later under the constant torque ``tau`` (n,).

        Raises numpy.linalg.LinAlgError where the mass matrix is not positive definite.
        """
        after = np.array(state, dtype=float)
        arrays = (after, np.ascontiguousarray(tau, dtype=float), self._parameters, self._jumps)
        pointers = [self._ffi.from_buffer("double[]", array) for array in arrays]
        if self._lib.rigid_advance(*pointers, duration / self.steps, self.steps):
            raise np.linalg.LinAlgError("M(q) is not positive definite")
        return after


def compiled_rigid_integrator(plant: Plant, steps: int) -> CompiledRigidIntegrator | None:
    """Make an integrator of a rigid ``plant`` in C.

    None for a plant that needs the stiff solver, and for models and friction that cannot be recorded or compiled.
    """
    model = plant.friction.model
    known = isinstance(plant.friction, NoFriction) or isinstance(model, FrictionModel | MixedFriction)
    recorded = None if plant.needs_stiff_solver or not known else plant.body.terms_program()
    if recorded is None:
        return None
    dynamics, values = recorded
    laws = joint_laws(model) if isinstance(model, FrictionModel | MixedFriction) else []
    rows = [np.append(row, offset) for _, row, offset in laws]
    parameters = np.concatenate([*values, *rows]).astype(float)
    first = sum(value.size for value in values)
    return CompiledRigidIntegrator(
        plant,
        _terms(plant.n, dynamics, [value.size for value in values], parameters.size),
        _friction_program(plant.n, [law for law, _, _ in laws], first, parameters.size),
        parameters,
        steps,
    )


def _vector(name: str, size: int, role: Role = Role.OTHER) -> Port:
    return Port(name, (size,), "", "joint", name, role)


def _terms(n: int, dynamics: Program, sizes: list[int], count: int) -> Program:
    """Program of M(q) (n, n) and ``h = c + g`` (n,) from q, dq and all ``count`` parameters of the plant.

    The first ``sizes`` of these are the parameters of ``dynamics`` and the inertias (n,) added to the diagonal of M.
    """
    builder = Builder()
    q, dq = (builder.input(_vector(*arguments)) for arguments in (("q", n, Role.POSITION), ("dq", n, Role.VELOCITY)))
    given = builder.input(_vector("parameters", count))
    bounds = np.cumsum([0, *sizes])
    *inputs, added = (given[start:stop] for start, stop in pairwise(bounds))
    M, c, g = replay(dynamics, builder, [q, dq, *inputs])
    mass = list(M)
    for i in range(n):
        mass[i * n + i] = builder.add(mass[i * n + i], added[i])
    bias: list[Value] = [builder.add(a, b) for a, b in zip(c, g, strict=True)]
    outputs = [(Port("M", (n, n), "", "joint", "mass matrix"), mass), (_vector("h", n), bias)]
    return builder.program("terms", outputs, summary="Mass matrix, and torques of velocity and gravity.")


def _friction_program(n: int, laws: list[FrictionLaw], first: int, count: int) -> Program:
    """Program of the friction torques (n,) at speeds dq that slide in ``direction``, under the drive torques tau.

    From index ``first`` on, the ``count`` parameters of the plant are those of the ``laws`` (one per joint, or none),
    each followed by a constant torque.
    """
    builder = Builder()
    dq = builder.input(_vector("dq", n, Role.VELOCITY))
    direction = builder.input(_vector("direction", n))
    tau = builder.input(_vector("tau", n, Role.TORQUE))
    given = builder.input(_vector("parameters", count))
    torques: list[Any] = [] if laws else [0] * n
    for i, law in enumerate(laws):
        last = first + len(law.parameters) + 1
        torques.append(torque_under(builder, law, Directed(builder, direction[i]), dq[i], given[first:last], tau[i]))
        first = last
    return builder.program("friction", [(_vector("torque", n), torques)], summary="Friction in a given direction.")
