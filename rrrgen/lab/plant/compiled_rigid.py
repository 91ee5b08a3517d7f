"""Integration of a rigid plant in compiled C, by the steps of :class:`rrrgen.lab.plant.integration.RigidIntegrator`.

Mass matrix, ``c + g`` and friction are recorded as programs whose parameters are inputs, so that one build serves all
parameters of a robot with the same friction laws; Runge-Kutta steps, stops of joints and sticking are the template
``c/rigid_plant.c``. A sample of the RRR with Stribeck friction takes 8 us instead of 180.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.plant.compiled_plant import joint_laws, torque_under
from rrrgen.lab.plant.friction import NoFriction
from rrrgen.lab.plant.integration import MOST_STOPS, breaks_away
from rrrgen.lab.plant.plant import Plant
from rrrgen.program import Builder, Port, Program, Role, Value
from rrrgen.program.builder import replay
from rrrgen.robot.friction.law import FrictionLaw
from rrrgen.robot.friction.models import FrictionModel
from rrrgen.robot.friction.stated import MixedFriction

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
        pointers = [self._ffi.from_buffer("double[]", each) for each in arrays]
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
        _friction(plant.n, [law for law, _, _ in laws], first, parameters.size),
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
    q, dq = (builder.input(_vector(*each)) for each in (("q", n, Role.POSITION), ("dq", n, Role.VELOCITY)))
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


def _friction(n: int, laws: list[FrictionLaw], first: int, count: int) -> Program:
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
        torques.append(torque_under(builder, law, _Directed(builder, direction[i]), dq[i], given[first:last], tau[i]))
        first = last
    return builder.program("friction", [(_vector("torque", n), torques)], summary="Friction in a given direction.")


class _Directed:
    """Operations of a builder with sgn(dq) replaced by the ``direction`` in which a joint slides, also from rest."""

    def __init__(self, builder: Builder, direction: Value) -> None:
        self.exp, self.tanh = builder.exp, builder.tanh
        self._direction = direction

    def sign(self, x: Value) -> Value:
        return self._direction
