"""What derivation delivers: programs, base parameters and how they came about."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from rrrgen.derive.functions.recording import Parametrization
from rrrgen.derive.parameters.base_parameters import BaseParameter, BaseSet, Regrouping
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.model import RobotModel
from rrrgen.program import OperationCount, Program, Role
from rrrgen.robotfile.robot_spec import RobotSpec


@dataclass(frozen=True)
class PassReport:
    """What one optimization pass did to one function."""

    name: str
    function: str
    before: OperationCount
    after: OperationCount


@dataclass(frozen=True)
class DerivedModel:
    """Everything that backends, the runtime and reports need to know about one robot.

    ``alternatives`` holds every function as derived, in equivalent ways; ``programs`` (filled by optimization) maps
    public function names to the cheapest programs, in the order of emission. With inertias in the file every function
    that takes base parameters has a twin ``<function>_nominal`` with the file's numbers folded in.
    ``base_projection`` is K of ``beta = K phi`` (b x 10 n) at nominal geometry.
    """

    spec: RobotSpec
    model: RobotModel
    own_basis: BaseSet
    parametrization: Parametrization
    basis_change: BasisChange | None
    alternatives: dict[str, tuple[Program, ...]]
    base_parameters: tuple[BaseParameter, ...]
    base_projection: tuple[tuple[float, ...], ...]
    regrouping: tuple[Regrouping, ...]
    beta_nominal: tuple[Fraction, ...] | None
    drive_inertia_nominal: tuple[Fraction, ...] | None
    programs: dict[str, Program] = field(default_factory=dict)
    passes: tuple[PassReport, ...] = ()

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
