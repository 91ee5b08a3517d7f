"""The results of derivation: :class:`RecordedModel` before optimization, :class:`DerivedModel` after it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.recording import Parametrization, Recording
from rrrgen.derive.parameters.base_parameters import BaseParameter, BaseSet, Regrouping
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.program import Program, Role
from rrrgen.program.passes.interface import PassReport
from rrrgen.robot.model import RobotModel
from rrrgen.robot.robot_spec import RobotSpec


@dataclass(frozen=True)
class Derivation:
    """The starting point of every function of one robot: its geometry in canonical frames and its base parameters.

    ``compiler_basis`` is the set of base parameters that the compiler chooses, ``basis_change`` its relation to the set
    of the robot file (None if the file has none); ``parametrization`` converts the set in use to inertias of the links.
    """

    spec: RobotSpec
    model: RobotModel
    compiler_basis: BaseSet
    basis_change: BasisChange | None
    parametrization: Parametrization

    def recording(self) -> Recording:
        """A new, empty recording of a function at nominal geometry."""
        return Recording(self.model, self.parametrization)


@dataclass(frozen=True)
class ParametrizedRobot:
    """A robot with its base parameters, their relation to the standard parameters, and their nominal values.

    ``base_projection`` is K of ``beta = K phi``, shape (b, 10 n), at nominal geometry; ``regrouping`` says for every
    standard parameter whether it is kept, regrouped or without effect. ``beta_nominal`` (b,) and
    ``drive_inertia_nominal`` are the values of the robot file, None where it states none.
    """

    spec: RobotSpec
    base_parameters: tuple[BaseParameter, ...]
    base_projection: tuple[tuple[float, ...], ...]
    regrouping: tuple[Regrouping, ...]
    beta_nominal: tuple[Fraction, ...] | None
    drive_inertia_nominal: tuple[Fraction, ...] | None

    @property
    def name(self) -> str:
        """The name of the robot, which is the prefix of every emitted symbol."""
        return self.spec.name

    @property
    def nominal(self) -> dict[Role, tuple[Fraction, ...]]:
        """The parameters whose values the robot file states, by the role of their port: beta with drive inertias."""
        if self.beta_nominal is None:
            return {}
        return {Role.BASE_PARAMETERS: (*self.beta_nominal, *(self.drive_inertia_nominal or ()))}

    @property
    def b(self) -> int:
        """Number of base parameters."""
        return len(self.base_parameters)

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.spec.rows)

    @property
    def beta_size(self) -> int:
        """Number of elements of the port beta: base parameters, then drive inertias."""
        return self.b + len(self.drive_inertia_nominal or ())

    def recorded(self, derivation: Derivation, alternatives: dict[str, tuple[Program, ...]]) -> RecordedModel:
        """Make a recorded model of this robot; ``alternatives`` lists equivalent programs for every function."""
        return RecordedModel(**self._known(), derivation=derivation, alternatives=alternatives)

    def _known(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(ParametrizedRobot)}


@dataclass(frozen=True)
class RecordedModel(ParametrizedRobot):
    """Every function as recorded, before optimization: ``alternatives`` lists equivalent programs per function."""

    derivation: Derivation
    alternatives: dict[str, tuple[Program, ...]]

    def optimized(self, programs: dict[str, Program], passes: tuple[PassReport, ...]) -> DerivedModel:
        """Make the derived model of this robot from the optimized ``programs`` and the reports of the ``passes``."""
        return DerivedModel(**self._known(), programs=programs, passes=passes)


@dataclass(frozen=True)
class DerivedModel(ParametrizedRobot):
    """A robot with its optimized functions: all that backends, runtime and reports need.

    ``programs`` maps public function names to programs, in the order of emission. If the robot file states inertias,
    every function of the base parameters has a specialization ``<function>_nominal`` with those numbers folded in.
    """

    programs: dict[str, Program]
    passes: tuple[PassReport, ...]
