"""Base class of all model functions: chooses parameters, calls the engine, and raises errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.program import Role, nominal_name
from rrrgen.runtime.arguments import checked, joined, nominal_values, read_only

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robotfile.robot_spec import RobotSpec
    from rrrgen.runtime.engines import Engine
    from rrrgen.runtime.model import Model

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
        self._compiled: Callable[..., Model] | None = None
        self._any_gravity: Model | None = None
        self._groups: dict[str, Model] = {}

    @property
    def any_gravity(self) -> Model:
        """The model of the same robot with gravity as an input; in C it is ``<name>_any_gravity``.

        Its functions take ``gravity``, by default that of the robot file. It has more base parameters, because gravity
        across the first joint axis makes masses identifiable that gravity along it does not; a choice of base
        parameters in the robot file does not apply to it. It is compiled when it is first used.
        """
        if self.spec.gravity_input:
            return self  # type: ignore[return-value]
        if self._any_gravity is None:
            self._any_gravity = self._compiler()(self.spec.in_any_gravity())
        self._any_gravity.engine.threads = self.engine.threads
        return self._any_gravity

    @cached_property
    def nominal_gravity(self) -> Array:
        """The acceleration of gravity of the robot file in the base frame, (3,), m/s^2."""
        return read_only(np.array([float(self.spec.nominal(value)) for value in self.spec.gravity]))

    def _compiler(self) -> Callable[..., Model]:
        if self._compiled is None:
            raise TypeError("this model was made without its description and cannot be copied; use rrrgen.compile")
        return self._compiled

    def _with(self, name: str) -> Model:
        """Model whose compiled code has the function ``name``: this one, or one compiled later for more functions."""
        if name in self.derived.programs:
            return self  # type: ignore[return-value]
        for held in self._groups.values():
            if name in held.derived.programs:
                held.engine.threads = self.engine.threads
                return held
        from rrrgen.derive.functions.table import GROUPS, functions_of

        for group in GROUPS:
            functions = functions_of(group, self.n)
            offered = {*functions, *map(nominal_name, functions)}
            if name in offered and self._compiled is not None and group not in self._groups:
                self._groups[group] = self._compiled(self.spec, groups=(group,))
                return self._with(name)
        others = [each for group in GROUPS if group != "model" for each in functions_of(group, self.n)]
        known = sorted({*self.derived.programs, *(others if self._compiled is not None else ())})
        raise ValueError(f"no function '{name}'; there are inverse_kinematics, {', '.join(known)}")

    def _call(self, name: str, *values: Any) -> Array:
        """Evaluate the function ``name``, which takes no parameters; returns its first result."""
        return self.engine.call(name, values)[0]

    def _call_with(self, name: str, values: tuple[Any, ...], beta: Any, Ia: Any = None, gravity: Any = None) -> Array:
        """Evaluate the function ``name`` with the given or the nominal parameters; returns its first result."""
        return self._evaluate(name, values, beta, Ia, gravity)[0]

    def _evaluate(
        self, name: str, values: tuple[Any, ...], beta: Any = None, Ia: Any = None, gravity: Any = None
    ) -> Sequence[Array]:
        """Evaluate the function ``name`` with the given or the nominal parameters; returns all its results."""
        if gravity is not None and not self.spec.gravity_input:
            self._check_beta(name, beta)
            return self.any_gravity._evaluate(name, values, beta, Ia, gravity)
        if name not in self.derived.programs and name not in self._specializations:
            return self._with(name)._evaluate(name, values, beta, Ia, gravity)
        chosen, parameters = self._chosen(name, beta, Ia)
        if self.spec.gravity_input and self.derived.programs[chosen].takes(Role.GRAVITY):
            values = (*values, self.nominal_gravity if gravity is None else gravity)
        return self.engine.call(chosen, (*values, *parameters.values()))

    def _named(
        self, name: str, values: Mapping[str, Any], beta: Any = None, Ia: Any = None, gravity: Any = None
    ) -> Sequence[Array]:
        """Evaluate the function ``name`` for arguments by name; returns all its results.

        ``values`` maps the names of inputs to their values; ``beta``, ``Ia`` and ``gravity`` are nominal if None.
        """
        if gravity is not None and not self.spec.gravity_input:
            self._check_beta(name, beta)
            return self.any_gravity._named(name, values, beta, Ia, gravity)
        model = self._with(name)
        chosen, parameters = model._chosen(name, beta, Ia)
        given = {**values, **parameters, "gravity": self.nominal_gravity if gravity is None else gravity}
        return model.engine.call(chosen, [given[port.name] for port in model.derived.programs[chosen].inputs])

    def _check_beta(self, name: str, beta: Any) -> None:
        """Raise ValueError if ``beta`` has the length of this model's base parameters in a call with ``gravity``.

        Such a call needs the base parameters of :attr:`any_gravity`.
        """
        own, wanted = self.derived.b, self.any_gravity.derived.b
        if beta is not None and np.shape(beta)[-1:] == (own,) != (wanted,):
            raise ValueError(
                f"{name}: with gravity= beta must be the {wanted} base parameters of model.any_gravity, not the {own} "
                "of the gravity of the robot file; any_gravity.beta, any_gravity.add_payload(...) and "
                "any_gravity.base_projection @ phi give them"
            )

    def _chosen(self, name: str, beta: Any, Ia: Any) -> tuple[str, dict[str, Any]]:
        """Choose the program that evaluates the function ``name``; returns its name and its parameters by port name.

        It is the nominal specialization, if there is one, where no parameters are given. Raises ValueError for
        parameters that are missing, or that the function does not take.
        """
        if name in self._specializations and beta is None and Ia is None:
            return self._specializations[name], {}
        if Ia is not None and self.drive_inertia is None:
            raise ValueError(f"{name}: the robot file gives no drive inertia, so Ia is not part of the model")
        if not self.derived.programs[name].takes(Role.BASE_PARAMETERS):
            return name, {}
        return name, {"beta": self._with_drives(name, beta, Ia)}

    def _with_drives(self, function: str, beta: Any = None, Ia: Any = None) -> Any:
        """The argument beta of programs: base parameters, then drive inertias, both nominal if None."""
        if beta is None and self.beta is None:
            raise ValueError(f"{function}: the robot file has no links, so beta= must be given")
        chosen = self.beta if beta is None else beta
        if self.drive_inertia is None:
            return chosen
        sizes = (self.derived.b, self.drive_inertia.size)
        return joined(function, self.engine.dtype, chosen, self.drive_inertia if Ia is None else Ia, sizes)

    def _of_links(self, array: Array) -> Array:
        """Take off the columns or elements of the drive inertias, the last ones of ``array`` (..., k + d)."""
        if self.drive_inertia is None:
            return array
        return np.ascontiguousarray(array[..., : -self.drive_inertia.size])

    @cached_property
    def _specializations(self) -> dict[str, str]:
        """Names of functions mapped to those of their nominal specializations, which have the parameters folded in."""
        programs = self.derived.programs
        return {program.specializes: name for name, program in programs.items() if program.specializes}

    def _checked(self, name: str, result: Any, status: Any, with_status: bool) -> Any:
        """Return ``result``, or raise LinAlgError if a state failed; with ``with_status`` return both instead."""
        return checked(self.derived.programs[name], result, np.asarray(status), with_status)
