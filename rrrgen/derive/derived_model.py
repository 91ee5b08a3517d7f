"""What derivation delivers: a :class:`RecordedModel`, and a :class:`DerivedModel` once every program is optimized."""

from __future__ import annotations

from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.recording import Parametrization, Recording
from rrrgen.derive.parameters.base_parameters import BaseParameter, BaseSet, Regrouping
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.model import RobotModel
from rrrgen.program import OperationCount, Program, Role
from rrrgen.robotfile.robot_spec import RobotSpec


@dataclass(frozen=True)
class Derivation:
    """What every function of one robot is recorded from: the exact chain and its minimal parameters."""

    spec: RobotSpec
    model: RobotModel
    own_basis: BaseSet
    basis_change: BasisChange | None
    parametrization: Parametrization

    def recording(self) -> Recording:
        """A function to be recorded, with nominal geometry."""
        return Recording(self.model, self.parametrization)


@dataclass(frozen=True)
class ParametrizedRobot:
    """A robot and its base parameters, which whoever reads its functions needs to know.

    ``base_projection`` is K of ``beta = K phi`` (b x 10 n) at nominal geometry.
    """

    spec: RobotSpec
    base_parameters: tuple[BaseParameter, ...]
    base_projection: tuple[tuple[float, ...], ...]
    regrouping: tuple[Regrouping, ...]
    beta_nominal: tuple[Fraction, ...] | None
    drive_inertia_nominal: tuple[Fraction, ...] | None

    @property
    def name(self) -> str:
        """The robot's name, prefix of every emitted symbol."""
        return self.spec.name

    @property
    def nominal(self) -> dict[Role, tuple[Fraction, ...]]:
        """The parameters that the file gives numbers for, by the role of the port that takes them."""
        values = {Role.BASE_PARAMETERS: self.beta_nominal, Role.DRIVE_INERTIA: self.drive_inertia_nominal}
        return {role: numbers for role, numbers in values.items() if numbers is not None}

    @property
    def b(self) -> int:
        """Number of base parameters."""
        return len(self.base_parameters)


@dataclass(frozen=True)
class RecordedModel(ParametrizedRobot):
    """Every function as it was recorded, in one or more equivalent ways, before any optimization."""

    derivation: Derivation
    alternatives: dict[str, tuple[Program, ...]]

    def optimized(self, programs: dict[str, Program], passes: tuple[PassReport, ...]) -> DerivedModel:
        """The same robot with the programs that optimization made of the alternatives."""
        known: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(ParametrizedRobot)}
        return DerivedModel(**known, programs=programs, passes=passes)


@dataclass(frozen=True)
class PassReport:
    """What one optimization pass did to one function."""

    name: str
    function: str
    before: OperationCount
    after: OperationCount


@dataclass(frozen=True)
class DerivedModel(ParametrizedRobot):
    """Everything that back ends, the runtime and reports need: every function at its cheapest.

    ``programs`` maps public function names to programs, in the order of emission. With inertias in the file every
    function that takes base parameters has a specialization ``<function>_nominal`` with the file's numbers folded in.
    """

    programs: dict[str, Program]
    passes: tuple[PassReport, ...]
