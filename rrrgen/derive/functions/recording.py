"""The state of a model function while it is recorded: its input ports, the chain, and the inertias of the links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import sympy as sp

from rrrgen.derive.functions.model_function import QUANTITIES, ModelFunction
from rrrgen.derive.parameters.base_parameters import BaseSet
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.derive.recursions.drive_inertia import DriveInertia, directions
from rrrgen.derive.recursions.linear_algebra import dot
from rrrgen.derive.recursions.link_frames import Chain, nominal_constant, program_chain, symbolic_constant
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia
from rrrgen.program import Builder, Domain, Port, Program, Role, Value
from rrrgen.program.polynomials import to_expression
from rrrgen.robot.model import RobotModel
from rrrgen.robot.model.drives import inertia_terms
from rrrgen.robot.spec import RobotSpec

Constant = Callable[[sp.Expr], Value]

DOMAINS = {
    **dict.fromkeys(("Ts", "T"), Domain.PERIOD),
    **dict.fromkeys(("width", "gain"), Domain.POSITIVE),
    **dict.fromkeys(("tau_max", "dq_max", "ddq_max", "threshold", "change_threshold"), Domain.LIMIT),
    "r": Domain.ESTIMATE,
    "beta_min": Domain.LOWER,
    "beta_max": Domain.UPPER,
}
"""The quantities of the table that are limits, periods, estimates, or must be positive, with the values that are
accepted."""

JOINT_ROLES = {
    "q": Role.POSITION,
    "dq": Role.VELOCITY,
    "ddq": Role.ACCELERATION,
    "tau": Role.TORQUE,
    "e": Role.COVECTOR,
    "weights": Role.COVECTOR,
    "v": Role.REFERENCE_VELOCITY,
    "a": Role.REFERENCE_ACCELERATION,
    "q_d": Role.DESIRED_POSITION,
    "dq_d": Role.DESIRED_VELOCITY,
    "ddq_d": Role.DESIRED_ACCELERATION,
}
"""Roles of joint vectors by name."""

BASE_ROLES = {
    "orientation": Role.ORIENTATION,
    "twist": Role.TWIST,
    "twist_rate": Role.TWIST_RATE,
    "wrench": Role.WRENCH,
}
"""Roles of the inputs of a floating base by name."""


@dataclass(frozen=True)
class Parametrization:
    """The map from base parameters to pseudo-inertias of the links in their canonical frames.

    ``basis`` is the compiler's set, ``change`` its relation to the set of the robot file (None: they are the same).
    ``names`` and ``units`` are those of the public base parameters.
    """

    basis: BaseSet
    names: tuple[str, ...]
    units: tuple[str, ...]
    change: BasisChange | None

    @property
    def inverse(self) -> tuple[tuple[sp.Expr, ...], ...] | None:
        """The matrix (b, b) from the user's base parameters to the compiler's set; None if they are the same."""
        return None if self.change is None else self.change.inverse

    @cached_property
    def projection(self) -> tuple[tuple[sp.Expr, ...], ...]:
        """The exact K of ``beta = K phi``, shape (b, 10 n), for the public base parameters."""
        if self.change is None:
            return self.basis.projection
        rows = []
        for factors in self.change.forward:
            row = [sp.S.Zero] * len(self.basis.projection[0])
            for factor, base in zip(factors, self.basis.projection, strict=True):
                if factor:
                    row = [sp.expand(x + to_expression(factor) * y) for x, y in zip(row, base, strict=True)]
            rows.append(tuple(row))
        return tuple(rows)

    def inertias(self, n: int, beta: Sequence[Any], constant: Constant) -> list[PseudoInertia]:
        """The pseudo-inertias of ``n`` links for ``beta`` (b,): entries outside the base set are zero.

        ``constant`` converts exact constants to the kind of number that ``beta`` has.
        """
        values = list(beta)
        if self.inverse is not None:
            values = [dot([constant(v) for v in row], beta) for row in self.inverse]
        entries: list[dict[str, Any]] = [{} for _ in range(n)]
        for (i, entry), value in zip(self.basis.parameters, values, strict=True):
            entries[i][entry] = value
        return [PseudoInertia(**link) for link in entries]


def parametrize(basis: BaseSet, change: BasisChange | None) -> Parametrization:
    """The parametrization in the user's base parameters if there is a ``change``, else in the compiler's."""
    if change is None:
        return Parametrization(basis, basis.names, tuple(basis.units), None)
    return Parametrization(basis, change.names, change.units, change)


class FunctionBuilder:
    """A function being recorded, with the geometry as nominal numbers or, for closed forms, as inputs ``symbols``."""

    def __init__(self, model: RobotModel, parametrization: Parametrization, symbols: Sequence[sp.Expr] = ()) -> None:
        self.model = model
        self.parametrization = parametrization
        self.builder = Builder()
        self._declared: dict[Role, list[Value]] = {}
        self._extra: dict[str, list[Value]] = {}
        self.constant: Constant = symbolic_constant(self.builder, symbols) if symbols else nominal_constant(model)
        revolute = all(joint.revolute for joint in model.joints)
        prismatic = not any(joint.revolute for joint in model.joints)
        self._kind = 0 if revolute else 1 if prismatic else None
        self.position_unit, self.torque_unit = self.unit("rad | m"), self.unit("N m | N")
        self.function: ModelFunction | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.n

    @property
    def branches(self) -> bool:
        """Whether the robot branches: its mass matrix is then factorized from the tips to the base."""
        return self.model.spec.parents != tuple(range(-1, self.model.links - 1))

    def with_gravity_input(self) -> FunctionBuilder:
        """A new, empty recording of the same robot in which gravity is an input."""
        spec = replace(self.model.spec, gravity_input=True)
        return FunctionBuilder(replace(self.model, spec=spec), self.parametrization)

    def _input(self, port: Port) -> list[Value]:
        self._declared[port.role] = values = list[Value](self.builder.input(port))
        return values

    def inputs_of(self, program: Program, known: Mapping[Role, Sequence[Value]] | None = None) -> list[Sequence[Value]]:
        """List the values to be used for the inputs of ``program``, which is recorded as a part of this function.

        An input has the value that ``known`` holds for its role, otherwise that of the input with this role declared
        here.
        """
        if program.takes(Role.LOOPS):
            self.loop_positions()
        values = {**self._declared, **(known or {})}
        return [values[port.role] for port in program.inputs]

    def joints(self, name: str) -> list[Value]:
        """The joint vector ``name`` (n,), one of :data:`JOINT_ROLES`; declared as an input when first asked for."""
        role = JOINT_ROLES[name]
        return self._declared.get(role) or self._input(self.port(name))

    def on_base(self, name: str) -> list[Value]:
        """The input ``name`` of a floating base, one of :data:`BASE_ROLES`; declared when first asked for."""
        return self._declared.get(BASE_ROLES[name]) or self._input(self.port(name))

    def positions(self) -> list[Value]:
        """The input q (n,) and, behind it, that of the passive joints of loops that Newton's method solves."""
        return [*self.joints("q"), *(self.loop_positions() if self.model.spec.newton else ())]

    def loop_positions(self) -> list[Value]:
        """The input loop_q (p,), positions of passive joints that close the loops; declared when first asked for."""
        return self._declared.get(Role.LOOPS) or self._input(loop_port(self, "loop_q", LOOP_Q, Role.LOOPS))

    def chain(self) -> Chain:
        """Declare q as an input and return the chain at q, in the gravity of the robot file."""
        return program_chain(self.model, self.builder, self.constant, self.positions())

    def chain_in_gravity(self, *rates: str) -> Chain:
        """The chain at the input q, for a function that depends on gravity; ``rates`` are its further joint vectors.

        If gravity is an input of the functions, it is declared after all joint vectors.
        """
        if not self.model.spec.gravity_input:
            return self.chain()
        for name in ("q", *rates):
            self.joints(name)
        return program_chain(self.model, self.builder, self.constant, self.positions(), self.gravity())

    def chain_at(self, q: Sequence[Value], *rates: str) -> Chain:
        """The chain at positions ``q`` (n,) other than the input q, for a function that depends on gravity.

        ``rates`` are the function's further joint vectors; if gravity is an input, it is declared after them.
        """
        if not self.model.spec.gravity_input:
            return program_chain(self.model, self.builder, self.constant, q)
        for name in rates:
            self.joints(name)
        return program_chain(self.model, self.builder, self.constant, q, self.gravity())

    def take(self, name: str, *shape: int) -> list[Value]:
        """The input ``name`` as the table states it, declared when first asked for.

        ``shape`` is needed where the table names a size that is not that of the joints or of the base parameters.
        """
        if name not in self._extra:
            self._extra[name] = list[Value](self.builder.input(self.port(name, *shape)))
        return self._extra[name]

    def port(self, name: str, *shape: int) -> Port:
        """The port of the input ``name`` of the function, as the table states it."""
        arguments = {quantity.name: quantity for quantity in self.function.arguments} if self.function else {}
        quantity = arguments.get(name) or QUANTITIES[name]
        n, b = self.n, len(self.parametrization.names) + self.drives
        sizes = {"n": n, "3n": 3 * n, "6+n": 6 + n, "3(6+n)": 3 * (6 + n), "b": b}
        shape = shape or tuple(sizes[size] if size in sizes else int(size) for size in quantity.shape.split())
        domain = DOMAINS.get(name, Domain.FINITE)
        role = JOINT_ROLES.get(name) or BASE_ROLES.get(name, Role.OTHER)
        return Port(name, shape, self.unit(quantity.unit), "", quantity.words, role, domain)

    def unit(self, unit: str) -> str:
        """The ``unit`` of the table for the joints of this robot: of "rad | m" one part where all joints are alike."""
        parts = unit.split(" | ")
        return parts[min(self._kind, len(parts) - 1)] if self._kind is not None else unit

    def gravity(self) -> list[Value]:
        """The acceleration of gravity (3,); declared as an input when first asked for."""
        if Role.GRAVITY in self._declared:
            return self._declared[Role.GRAVITY]
        meaning = "acceleration of gravity; minus the acceleration of an accelerated base"
        return self._input(Port("gravity", (3,), "m/s^2", "base frame", meaning, Role.GRAVITY))

    @cached_property
    def drives(self) -> int:
        """Number of drive inertias."""
        return len(inertia_terms(self.model.spec))

    def beta(self) -> list[Value]:
        """The base parameters, then the drive inertias: beta (b + drives,); an input when first asked for."""
        if Role.BASE_PARAMETERS in self._declared:
            return self._declared[Role.BASE_PARAMETERS]
        names = "base parameters " + ", ".join(self.parametrization.names)
        return self._input(
            self.beta_port(names + (f", then {drive_inertia_meaning(self.model.spec)}" if self.drives else ""))
        )

    def beta_port(self, meaning: str, role: Role = Role.BASE_PARAMETERS, name: str = "beta") -> Port:
        """Make a port for base parameters and drive inertias (b + drives,); ``meaning`` is for emitted files."""
        return Port(name, (len(self.parametrization.names) + self.drives,), "SI", "", meaning, role)

    def friction(self, port: Port) -> list[Value]:
        """The friction parameters, of the shape of ``port``; declared as an input when first asked for."""
        return self._declared.get(Role.FRICTION) or self._input(port)

    def inertias(self) -> list[PseudoInertia]:
        """Declare beta as an input and return the pseudo-inertias of the links that the base parameters give."""
        links = self.beta()[: len(self.parametrization.names)]
        return self.parametrization.inertias(self.model.links, links, self.constant)

    def drive_inertia(self) -> DriveInertia:
        """The drive inertias Ia, the last elements of beta, and their directions; declares beta if there are any."""
        values = self.beta()[-self.drives :] if self.drives else ()
        return DriveInertia(values, directions(self.model.spec))


LOOP_Q = "positions of the passive joints, which close the loops at q"


def loop_port(r: FunctionBuilder, name: str, meaning: str, role: Role = Role.OTHER) -> Port:
    """A port of positions (p,) of the passive joints, in the order of the loops."""
    assert r.model.spec.mechanism is not None
    rows = [r.model.spec.rows[row] for row in r.model.spec.mechanism.passive]
    kinds = [row.is_revolute for row in rows]
    unit = "rad" if all(kinds) else "m" if not any(kinds) else "rad | m"
    return Port(name, (len(rows),), unit, "", f"{meaning}: {', '.join(row.name for row in rows)}", role)


def drive_inertia_meaning(spec: RobotSpec) -> str:
    """The description of the drive inertias in generated files."""
    names = ", ".join(term.name for term in inertia_terms(spec))
    where = "at the joints" if spec.drives is None else "at the joint or at the motor it is named after"
    return f"drive inertia seen {where}: {names}"


Recorder: TypeAlias = Callable[[FunctionBuilder], Program]
"""A function that records one model function. Where a model function has several recorders, their programs are
equivalent, and the cheapest is emitted."""
