"""The state of a model function while it is recorded: its input ports, the chain, and the inertias of the links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import sympy as sp

from rrrgen.derive.drive_inertia import DriveInertia
from rrrgen.derive.parameters.base_parameters import BaseSet
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.derive.recursions.chain import Chain, nominal_constant, program_chain, rational, symbolic_constant
from rrrgen.derive.recursions.inertia import PseudoInertia
from rrrgen.model import RobotModel
from rrrgen.model.drive_terms import inertia_terms
from rrrgen.program import Builder, Port, Program, Role, Value
from rrrgen.robotfile.robot_spec import RobotSpec

Constant = Callable[[sp.Expr], Value]

JOINT_PORTS = {
    "q": (Role.POSITION, "joint positions", ""),
    "dq": (Role.VELOCITY, "joint velocities", "/s"),
    "ddq": (Role.ACCELERATION, "joint accelerations", "/s^2"),
    "tau": (Role.TORQUE, "joint torques", "torque"),
    "e": (Role.COVECTOR, "vector multiplied from the left", "any"),
}
"""Joint vectors by name: role, meaning, and the suffix of the unit of position ("torque", "any": another unit)."""


@dataclass(frozen=True)
class Parametrization:
    """How base parameters map to pseudo-inertias of the links in canonical frames.

    ``basis`` is the compiler's set; ``inverse`` (b, b) maps the user's base parameters to it (None: they are the same).
    ``names`` and ``units`` are those of the public base parameters.
    """

    basis: BaseSet
    names: tuple[str, ...]
    units: tuple[str, ...]
    inverse: tuple[tuple[sp.Expr, ...], ...] | None

    def inertias(self, n: int, beta: Sequence[Any], constant: Constant) -> list[PseudoInertia]:
        """The pseudo-inertias of ``n`` links for ``beta`` (b,): entries outside the base set are zero."""
        values = list(beta)
        if self.inverse is not None:
            values = [_combine([constant(v) for v in row], beta) for row in self.inverse]
        entries: list[dict[str, Any]] = [{} for _ in range(n)]
        for (i, entry), value in zip(self.basis.parameters, values, strict=True):
            entries[i][entry] = value
        return [PseudoInertia(**link) for link in entries]


def _combine(row: Sequence[Any], values: Sequence[Any]) -> Any:
    total: Any = 0
    for factor, value in zip(row, values, strict=True):
        if factor:
            total = total + factor * value
    return total


def parametrize(basis: BaseSet, change: BasisChange | None) -> Parametrization:
    """The parametrization in the user's base parameters if there is a ``change``, else in the compiler's."""
    if change is None:
        return Parametrization(basis, basis.names, tuple(basis.units), None)
    return Parametrization(basis, change.names, change.units, change.inverse)


class Recording:
    """A function being recorded, with the geometry as nominal numbers or, for closed forms, as inputs ``symbols``."""

    def __init__(self, model: RobotModel, parametrization: Parametrization, symbols: Sequence[sp.Expr] = ()) -> None:
        self.model = model
        self.parametrization = parametrization
        self.builder = Builder()
        self._declared: dict[Role, list[Value]] = {}
        self.constant: Constant = symbolic_constant(self.builder, symbols) if symbols else nominal_constant(model)
        revolute = all(joint.revolute for joint in model.joints)
        prismatic = not any(joint.revolute for joint in model.joints)
        self.position_unit = "rad" if revolute else "m" if prismatic else "rad | m"
        self.torque_unit = "N m" if revolute else "N" if prismatic else "N m | N"

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.n

    def _input(self, port: Port) -> list[Value]:
        self._declared[port.role] = values = list[Value](self.builder.input(port))
        return values

    def inputs_of(self, program: Program, known: Mapping[Role, Sequence[Value]] | None = None) -> list[Sequence[Value]]:
        """Values for the input ports of ``program`` by role: ``known`` ones, else the inputs declared here."""
        values = {**self._declared, **(known or {})}
        return [values[port.role] for port in program.inputs]

    def joints(self, name: str) -> list[Value]:
        """Declare the joint vector ``name`` (n,), one of :data:`JOINT_PORTS`, as an input."""
        role, meaning, suffix = JOINT_PORTS[name]
        if suffix == "any":
            unit = ""
        elif suffix == "torque":
            unit = self.torque_unit
        else:
            unit = " | ".join(part + suffix for part in self.position_unit.split(" | "))
        return self._input(Port(name, (self.n,), unit, "", meaning, role))

    def chain(self) -> Chain:
        """Declare q as an input and return the chain at q."""
        return program_chain(self.model, self.builder, self.constant, self.joints("q"))

    def beta(self) -> list[Value]:
        """Declare the base parameters beta (b,) as an input."""
        names = self.parametrization.names
        meaning = "base parameters " + ", ".join(names)
        return self._input(Port("beta", (len(names),), "SI", "", meaning, Role.BASE_PARAMETERS))

    def inertias(self) -> list[PseudoInertia]:
        """Declare the base parameters as an input and return the pseudo-inertias of the links."""
        return self.parametrization.inertias(self.n, self.beta(), self.constant)

    def drive_inertia(self) -> DriveInertia:
        """Declare the drive inertias Ia as an input if the robot file states any."""
        terms = inertia_terms(self.model.spec)
        if not terms:
            return DriveInertia((), ())
        unit = "kg m^2" if self.position_unit == "rad" else "kg" if self.position_unit == "m" else "kg m^2 | kg"
        meaning = drive_inertia_meaning(self.model.spec)
        values = self._input(Port("Ia", (len(terms),), unit, "", meaning, Role.DRIVE_INERTIA))
        return DriveInertia(values, [[w if type(w) is int else rational(w) for w in t.direction] for t in terms])


def drive_inertia_meaning(spec: RobotSpec) -> str:
    """The description of the input Ia in generated files."""
    if spec.drives is None:
        return "drive inertia seen at the joints"
    names = ", ".join(term.name for term in inertia_terms(spec))
    return f"drive inertia, seen at the joint or at the motor it is named after: {names}"


Recorder: TypeAlias = Callable[[Recording], Program]
"""What records one function; several of one function are equivalent, and the cheapest is emitted."""
