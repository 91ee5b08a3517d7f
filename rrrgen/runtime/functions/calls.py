"""What all model functions share: the engine that evaluates them, and the parameters they run with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.program import Role
from rrrgen.runtime.arguments import checked, choose, nominal_values

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robotfile.robot_spec import RobotSpec
    from rrrgen.runtime.engines import Engine

Array = NDArray[Any]


class Calls:
    """The derived functions of one robot and the engine that evaluates them.

    Args:
        derived: the programs of the robot's functions, with its base parameters and their nominal values.
        engine: evaluates a program by its name, compiled or with NumPy.
    """

    def __init__(self, derived: DerivedModel, engine: Engine) -> None:
        self.derived = derived
        self.engine = engine
        self.spec: RobotSpec = derived.spec
        self.n: int = derived.spec.n
        self.beta: Array | None = nominal_values(derived.beta_nominal)
        self.drive_inertia: Array | None = nominal_values(derived.drive_inertia_nominal)

    def _call(self, name: str, *values: Any) -> Array:
        """The first result of the function ``name``, which takes no parameters."""
        return self.engine.call(name, values)[0]

    def _call_with(self, name: str, values: tuple[Any, ...], beta: Any, Ia: Any = None) -> Array:
        """The first result of the function ``name`` with the parameters given, or the nominal ones."""
        return self._evaluate(name, values, beta, Ia)[0]

    def _evaluate(self, name: str, values: tuple[Any, ...], beta: Any, Ia: Any) -> Sequence[Array]:
        """All results of the function ``name`` with the parameters given, or the nominal ones."""
        chosen, parameters = self._chosen(name, beta, Ia)
        return self.engine.call(chosen, (*values, *parameters.values()))

    def _chosen(self, name: str, beta: Any, Ia: Any) -> tuple[str, dict[str, Any]]:
        """The name of the program to run, the nominal specialization if no parameters are given, and its parameters."""
        given = {Role.BASE_PARAMETERS: (beta, self.beta), Role.DRIVE_INERTIA: (Ia, self.drive_inertia)}
        return choose(self.derived.programs, name, given)

    def _checked(self, name: str, result: Any, status: Any, with_status: bool) -> Any:
        """``result`` if no state failed; otherwise LinAlgError, or both for the caller to look at."""
        return checked(self.derived.programs[name], result, np.asarray(status), with_status)
