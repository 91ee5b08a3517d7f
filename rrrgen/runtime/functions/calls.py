"""Base class of all model functions: chooses parameters, calls the engine, and raises errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.arrays import real_array
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.derive.functions.friction import surfaces_of
from rrrgen.program import Role, nominal_name
from rrrgen.robot.model.drives import stated_at_joints
from rrrgen.runtime.arguments import check_status, join_parameters, nominal_values, read_only

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robot.spec import RobotSpec
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
        from rrrgen.derive.functions.table import ALWAYS, GROUPS, find, functions_of

        entry = find(name)
        if entry is not None and 0 < entry.most_joints < self.n:
            raise ValueError(f"{name}: {entry.absent}")
        late = {*self._on_demand, *map(nominal_name, self._on_demand)}
        if name in late and "on demand" not in self._groups:
            self._groups["on demand"] = self._compiler()(self.spec, part="on demand")
            return self._with(name)
        for group in GROUPS:
            functions = functions_of(group, self.n, self.spec.tips)
            offered = {*functions, *map(nominal_name, functions)}
            if name in offered and self._compiled is not None and group not in self._groups:
                self._groups[group] = self._compiled(self.spec, groups=(group,))
                return self._with(name)
        derived = [
            *self._on_demand,
            *(program_name for model in self._groups.values() for program_name in model.derived.programs),
        ]
        further = [group for group in GROUPS if group not in (*ALWAYS, *self._groups)] if self._compiled else []
        others = [function_name for group in further for function_name in functions_of(group, self.n, self.spec.tips)]
        known = sorted({*self.derived.programs, *derived, *others})
        there = f"there are inverse_kinematics, {', '.join(known)}"
        raise ValueError(f"no function '{name}'; {' '.join(filter(None, (did_you_mean(name, known), there)))}")

    @cached_property
    def _on_demand(self) -> tuple[str, ...]:
        """Names of the functions that are compiled when they are called; none where nothing more can be compiled."""
        from rrrgen.derive.functions.table import functions_for

        functions = functions_for(self.spec, ("model",), "on demand") if self._compiled else ()
        return tuple(f.name for f in functions)

    def _has(self, name: str) -> bool:
        """Whether the robot has the function ``name`` of those that need no request, compiled already or not."""
        return name in self.derived.programs or name in self._on_demand

    @property
    def parts(self) -> tuple[Model, ...]:
        """Models that together have all functions that need no request: this one, and one of those on demand."""
        return tuple(dict.fromkeys((cast("Model", self), *map(self._with, self._on_demand))))

    def _at_tip(self, name: str, tip: str) -> str:
        """The name of the function ``name`` about the named ``tip``. Raises ValueError if the robot has no such tip."""
        if tip not in self.spec.tips:
            known = ", ".join(self.spec.tips) or "none: name them under tips in the robot file"
            raise ValueError(f"{name}: the robot has no tip {tip!r}; its tips are {known}")
        return f"{tip}_{name}"

    def _call(self, name: str, *values: Any) -> Array:
        """Evaluate the function ``name``, which takes no parameters; returns its first result."""
        return self.engine.call(name, values)[0]

    def _evaluate(
        self, name: str, values: tuple[Any, ...], beta: Any = None, Ia: Any = None, gravity: Any = None
    ) -> Sequence[Array]:
        """Evaluate the function ``name`` with the given or the nominal parameters; returns all its results."""
        if gravity is not None and not self.spec.gravity_input:
            self._check_beta(name, beta)
            return self.any_gravity._evaluate(name, values, beta, Ia, gravity)
        if name not in self.derived.programs and name not in self._specializations:
            return self._with(name)._evaluate(name, values, beta, Ia, gravity)
        chosen, parameters = self._choose_program(name, beta, Ia)
        if self.spec.gravity_input and self.derived.programs[chosen].takes(Role.GRAVITY):
            values = (*values, self.nominal_gravity if gravity is None else gravity)
        return self.engine.call(chosen, (*values, *parameters.values()))

    def _evaluate_by_name(
        self, name: str, values: Mapping[str, Any], beta: Any = None, Ia: Any = None, gravity: Any = None
    ) -> Sequence[Array]:
        """Evaluate the function ``name`` for arguments by name; returns all its results.

        ``values`` maps the names of inputs to their values; ``beta``, ``Ia`` and ``gravity`` are nominal if None.
        """
        if gravity is not None and not self.spec.gravity_input:
            self._check_beta(name, beta)
            return self.any_gravity._evaluate_by_name(name, values, beta, Ia, gravity)
        model = self._with(name)
        chosen, parameters = model._choose_program(name, beta, Ia)
        given = {**values, **parameters, "gravity": self.nominal_gravity if gravity is None else gravity}
        inputs = model.derived.programs[chosen].inputs
        return model.engine.call(chosen, [given[port.name] for port in inputs if port.role is not Role.LOOPS])

    def _check_beta(self, name: str, beta: Any) -> None:
        """Raise ValueError if ``beta`` has the length of this model's base parameters in a call with ``gravity``.

        Such a call needs the base parameters of :attr:`any_gravity`.
        """
        length, wanted = self.derived.b, self.any_gravity.derived.b
        if beta is not None and np.shape(beta)[-1:] == (length,) != (wanted,):
            raise ValueError(
                f"{name}: with gravity= beta must be the {wanted} base parameters of model.any_gravity, not the "
                f"{length} of the gravity of the robot file; any_gravity.beta, any_gravity.add_payload(...) and "
                "any_gravity.base_projection @ phi give them"
            )

    def _choose_program(self, name: str, beta: Any, Ia: Any) -> tuple[str, dict[str, Any]]:
        """Choose the program that evaluates the function ``name``; returns its name and its parameters by port name.

        It is the nominal specialization, if there is one, where no parameters are given. Raises ValueError for
        parameters that are missing, or that the function does not take.
        """
        if name in self._specializations and beta is None and Ia is None:
            return self._specializations[name], {}
        self._check_drive_inertia(name, Ia)
        if not self.derived.programs[name].takes(Role.BASE_PARAMETERS):
            return name, {}
        return name, {"beta": self._with_drives(name, beta, Ia)}

    def _check_drive_inertia(self, function: str, Ia: Any) -> None:
        """Raise ValueError if drive inertias are given to a robot whose file states none."""
        if Ia is not None and self.drive_inertia is None:
            raise ValueError(f"{function}: the robot file gives no drive inertia, so Ia is not part of the model")

    def _with_drives(self, function: str, beta: Any = None, Ia: Any = None) -> Any:
        """The argument beta of programs: base parameters, then drive inertias, both nominal if None."""
        self._check_drive_inertia(function, Ia)
        if beta is None and self.beta is None:
            raise ValueError(f"{function}: the robot file has no links, so beta= must be given")
        chosen = self.beta if beta is None else beta
        if self.drive_inertia is None:
            return chosen
        sizes = (self.derived.b, self.drive_inertia.size)
        return join_parameters(function, self.engine.dtype, chosen, self.drive_inertia if Ia is None else Ia, sizes)

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

    def _check_status(self, name: str, result: Any, status: Any, with_status: bool) -> Any:
        """Return ``result``, or raise LinAlgError if a state failed, ValueError if its input is refused.

        With ``with_status`` return result and status instead.
        """
        return check_status(self._with(name).derived.programs[name], result, np.asarray(status), with_status)

    # -- values of the robot file -----------------------------------------------------------------------------------

    def _append_drive_values(self, function: str, values: Any, further: float) -> Any:
        """``values`` (..., b), one for each base parameter, with the value ``further`` for every drive inertia."""
        if self.drive_inertia is None:
            return values
        return self._with_drives(function, values, np.full_like(self.drive_inertia, further))

    def _rigid(self, name: str, pose: ArrayLike) -> ArrayLike:
        """``pose`` (..., 4, 4) as it is; InputError if one is no rigid motion. Other shapes are left to the call."""
        from rrrgen.ik.inverse_kinematics import refuse_no_pose

        poses = real_array(name, pose)
        if poses.shape[-2:] == (4, 4):
            refuse_no_pose(name, poses)
        return pose

    def _widths(self, width: ArrayLike) -> Array:
        """``width`` as an array with one entry for each joint and motor with friction, rad/s or m/s."""
        wide = np.asarray(width)
        return wide if wide.ndim else np.full(len(surfaces_of(self.spec)), float(wide))

    def _loads(self, function: str, tau_load: ArrayLike | None) -> tuple[ArrayLike, ...]:
        """``(tau_load,)`` if a friction law depends on the load, else (); ValueError if it is needed and None."""
        if all(port.name != "tau_load" for port in self.derived.programs[function].inputs):
            return ()
        if tau_load is None:
            raise ValueError(f"{function} needs tau_load: a friction law of this robot depends on the load")
        return (tau_load,)

    def _largest_torques(self, tau_max: ArrayLike | None) -> ArrayLike:
        """``tau_max``, or the torque limits (n,) of the robot file if it is None."""
        limits = [joint.limits.torque for joint in self.spec.joints]
        return [float("inf") if limit is None else limit for limit in limits] if tau_max is None else tau_max

    def _drive(self, key: str, given: ArrayLike | None, missing: float | None = None) -> Any:
        """Return ``given`` or, if it is None, the values ``key`` (n,) of the drives in the robot file."""
        if given is not None:
            return given
        values, absent = stated_at_joints(self.spec, key, missing)
        if absent:
            name = {"inertia": "rotor_inertia"}.get(key, key)
            raise ValueError(f"the robot file states no '{key}' under 'drive' of {', '.join(absent)}: give {name}=")
        return np.array(values)
