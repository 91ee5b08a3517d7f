"""The Python interface of the inverse kinematics: checks arguments, calls C or its evaluation, returns arrays."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrrgen.backends.c.solver.files import Emitted, emit
from rrrgen.backends.c.solver.parts.tool import emit_tool_solver
from rrrgen.errors import DerivationError, InputError
from rrrgen.ik.answers import STATUS_TEXTS, labels, most_rows, reasons_of
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.families import parameter
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.run_time_tool import plan_with_tool
from rrrgen.runtime.evaluation.coupled import CoupledEvaluation
from rrrgen.runtime.evaluation.ending import Wish
from rrrgen.runtime.evaluation.engine import Answer, Engine, batch_of, empty_batch
from rrrgen.runtime.evaluation.solve import Evaluation
from rrrgen.runtime.ik_arguments import LIMITS, NEAREST, RESIDUAL, options, real_array, real_number
from rrrgen.runtime.results import STATUS, IKBatch, IKResult

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from rrrgen.robotfile.robot_spec import RobotSpec
    from rrrgen.runtime.engines import EngineName


class _Compiled:
    """Inverse-kinematics engine that calls the emitted C through cffi."""

    def __init__(self, plan: SolverPlan, rows: int, ffi: Any, lib: Any, name: str) -> None:
        self._n, self._rows, self._locked = plan.n, rows, plan.locked is not None
        self._ffi, self._name = ffi, name
        self._solve = getattr(lib, f"{name}_inverse_kinematics")
        self._closest = getattr(lib, f"{name}_closest")
        self._batch = getattr(lib, f"{name}_inverse_kinematics_batch")

    def answer(
        self, goal: NDArray[np.float64], reference: NDArray[np.float64] | None, given: float, bits: int, closest: bool
    ) -> Answer:
        """Solve for one target, or find the configuration nearest to it."""
        out = self._ffi.new(f"{self._name}_ik_solutions *")
        extra = (given,) if self._locked else ()
        function = self._closest if closest else self._solve
        code = function(self._pointer("double *", goal), self._pointer("double *", reference), *extra, bits, out)
        k, rows, n = out.count, self._rows, self._n
        q = np.frombuffer(self._ffi.buffer(out.q), float, rows * n).reshape(rows, n)[:k].copy()
        flags = np.frombuffer(self._ffi.buffer(out.flags), np.uint32, rows)[:k].copy()
        branch = np.frombuffer(self._ffi.buffer(out.branch), np.uint32, rows)[:k].copy()
        residual = np.frombuffer(self._ffi.buffer(out.residual), float, rows)[:k].copy()
        return Answer(code, q, flags, branch, residual, out.stage, float(out.distance))

    def batch(
        self,
        goals: NDArray[np.float64],
        reference: NDArray[np.float64] | None,
        given: NDArray[np.float64] | None,
        bits: int,
    ) -> IKBatch:
        """Solve for every target, one after the other or in one call of C."""
        out = empty_batch(len(goals), self._rows, self._n)
        extra = (self._pointer("double *", given),) if self._locked else ()
        self._batch(
            len(goals), self._pointer("double *", goals), self._pointer("double *", reference), *extra, bits,
            self._pointer("double *", out.q), self._pointer("int *", out.counts),
            self._pointer("unsigned *", out.flags), self._pointer("unsigned *", out.branch),
            self._pointer("int *", out.statuses), self._pointer("double *", out.distances),
        )  # fmt: skip
        return out

    def _pointer(self, kind: str, array: NDArray[Any] | None) -> Any:
        if array is None:
            return self._ffi.NULL
        return self._ffi.cast(kind, array.ctypes.data)


class _Evaluated:
    """Inverse-kinematics engine that evaluates the solver in Python: slow, but without a compiler."""

    def __init__(self, plan: SolverPlan, rows: int) -> None:
        self._n, self._rows = plan.n, rows
        coupled = plan.coupling is not None
        self._evaluation = CoupledEvaluation(plan) if coupled else Evaluation(plan, len(reasons_of(plan)))

    def answer(
        self, goal: NDArray[np.float64], reference: NDArray[np.float64] | None, given: float, bits: int, closest: bool
    ) -> Answer:
        """Solve for one target, or find the configuration nearest to it."""
        wish = Wish(bool(bits & LIMITS), bool(bits & NEAREST), bool(bits & RESIDUAL))
        function = self._evaluation.closest if closest else self._evaluation.solve
        found = function(goal.ravel().tolist(), None if reference is None else reference.tolist(), given, wish)
        rows = found.rows
        return Answer(
            found.status,
            np.array([row.q for row in rows], float).reshape(len(rows), self._n),
            np.array([row.flags for row in rows], np.uint32),
            np.array([row.branch for row in rows], np.uint32),
            np.array([row.residual for row in rows], float),
            found.stage,
            found.distance,
        )

    def batch(
        self,
        goals: NDArray[np.float64],
        reference: NDArray[np.float64] | None,
        given: NDArray[np.float64] | None,
        bits: int,
    ) -> IKBatch:
        """Solve for every target, one after the other."""
        values = [0.0] * len(goals) if given is None else given.tolist()
        answers = [
            self.answer(goal, reference, value, bits, closest=False) for goal, value in zip(goals, values, strict=True)
        ]
        return batch_of(answers, self._rows, self._n)


class InverseKinematics:
    """The inverse kinematics of one robot: ``rrrgen.compile(robot).ik``.

    ``plan`` describes the family of the arm, ``max_solutions`` is the largest number of solutions of one target, ``n``
    the number of joints. ``labels`` names the choices between roots that make up a branch number, such as "elbow", each
    as (name, position of its first bit in the number, number of bits).

    Args:
        plan: the family of the arm with its equations, or the reason why it has no solver.
        engine: solves checked targets: the emitted C, or its evaluation in Python.
        name: the name of the robot, for messages.
    """

    def __init__(self, plan: SolverPlan, engine: Engine, name: str) -> None:
        self.plan = plan
        self.labels = labels(plan)
        self.max_solutions = most_rows(plan)
        self.n = plan.n
        self._reasons = reasons_of(plan)
        self._engine, self._name = engine, name
        self._locked = plan.locked is not None

    def solve(
        self,
        target: ArrayLike,
        q_ref: ArrayLike | None = None,
        *,
        limits: bool = True,
        sort: Literal["branch", "nearest"] = "branch",
        redundancy: float | None = None,
        residual: bool = False,
    ) -> IKResult:
        """Find all configurations that bring the tip to one target.

        Args:
            target: pose of the tip in the base frame, (4, 4), or its position, (3,), m, for solvers of positions.
            q_ref: reference configuration, (n,), rad or m: it gives angles that are free at singular configurations,
                the full turns of angles, and the order with ``sort="nearest"``; by default zeros without added turns.
            limits: leave out solutions outside the joint limits; otherwise they are flagged.
            sort: "branch" keeps the order of the branches, "nearest" puts the solution nearest to ``q_ref`` first.
            redundancy: the prescribed joint or arm angle of a redundant arm, rad or m; by default its value in
                ``q_ref``.
            residual: keep solutions that meet a pose only as far as 4 or 5 joints can, with their remaining error.

        Returns:
            The solutions; without any, the status and the reason.

        Raises:
            InputError: a wrong shape, or a redundant arm without ``redundancy`` and ``q_ref``.
            TypeError: numbers of a wrong kind.
            DerivationError: ``redundancy`` is given to an arm that is not redundant.
        """
        return self._call(target, q_ref, options(limits, sort, residual), redundancy)

    def closest(
        self, target: ArrayLike, q_ref: ArrayLike | None = None, *, limits: bool = True, redundancy: float | None = None
    ) -> IKResult:
        """Find the configuration with the smallest least-squares error to a target, even if that is out of reach.

        Args:
            target: pose of the tip in the base frame, (4, 4), or its position, (3,), m, for solvers of positions.
            q_ref: a configuration, (n,), rad or m, from which the search starts too.
            limits: search only inside the joint limits.
            redundancy: the prescribed joint or arm angle of a redundant arm, rad or m; by default its value in
                ``q_ref``.

        Returns:
            One solution with its ``residual``. Errors are those of :meth:`solve`.
        """
        return self._call(target, q_ref, options(limits), redundancy, closest=True)

    def solve_batch(
        self,
        targets: ArrayLike,
        q_ref: ArrayLike | None = None,
        *,
        limits: bool = True,
        sort: Literal["branch", "nearest"] = "branch",
        redundancy: ArrayLike | None = None,
    ) -> IKBatch:
        """Find all configurations for each of many targets, in one call of the C code.

        Args:
            targets: poses of the tip in the base frame, (..., 4, 4), or positions, (..., 3), m.
            q_ref: one reference configuration for all, (n,), rad or m, used as in :meth:`solve`.
            limits: leave out solutions outside the joint limits; otherwise they are flagged.
            sort: "branch" keeps the order of the branches, "nearest" puts the solution nearest to ``q_ref`` first.
            redundancy: the prescribed joint or arm angle of a redundant arm, rad or m, one number or one for each
                target, (...); by default its value in ``q_ref``.

        Returns:
            The solutions in arrays of fixed size. Errors are those of :meth:`solve`.
        """
        chosen = options(limits, sort)
        given_targets = real_array("targets", targets)
        core = 2 if given_targets.shape[-2:] == (4, 4) else 1
        batch = given_targets.shape[:-core]
        goals = self._targets(given_targets.reshape(-1, *given_targets.shape[-core:]))
        reference, given = self._reference(q_ref), self._given(redundancy, q_ref)
        prescribed = None
        if self._locked:
            value = real_array("redundancy", given)
            if value.shape not in ((), batch):
                raise InputError(f"redundancy must be one number or of shape {batch}, not of shape {value.shape}")
            prescribed = np.ascontiguousarray(np.broadcast_to(value, batch).reshape(len(goals)))
        found, rows = self._engine.batch(goals, reference, prescribed, chosen), self.max_solutions
        return IKBatch(
            found.q.reshape(*batch, rows, self.n),
            found.counts.reshape(batch),
            found.flags.reshape(*batch, rows),
            found.branch.reshape(*batch, rows),
            found.statuses.reshape(batch),
            found.distances.reshape(batch),
        )

    def sweep(
        self, target: ArrayLike, values: ArrayLike, q_ref: ArrayLike | None = None, *, limits: bool = True
    ) -> IKBatch:
        """The solutions of one target for many values of the redundancy parameter.

        Args:
            target: pose of the tip in the base frame, (4, 4), or its position, (3,), m, for solvers of positions.
            values: values of the prescribed joint or arm angle, (N,), rad or m.
            q_ref: reference configuration, (n,), rad or m, used as in :meth:`solve`.
            limits: leave out solutions outside the joint limits; otherwise they are flagged.

        Returns:
            A batch of N targets. Raises DerivationError if the arm is not redundant.
        """
        if not self._locked:
            raise DerivationError(f"{self._name} has no redundancy parameter")
        parameters = np.atleast_1d(real_array("values", values))
        goal = self._targets(real_array("target", target)[None])
        goals = np.broadcast_to(goal, (len(parameters), *goal.shape[1:]))
        return self.solve_batch(goals, q_ref, limits=limits, redundancy=parameters)

    def branch_names(self, branch: int) -> dict[str, int]:
        """Decode a ``branch`` number into its named choices, such as ``{"shoulder": 0, "elbow": 1}``.

        Of a choice between two roots, 0 is the one with the plus sign.
        """
        return {name: (int(branch) >> bit) & ((1 << bits) - 1) for name, bit, bits in self.labels}

    # -- arguments ----------------------------------------------------------------------------------------------------

    def _call(
        self, target: ArrayLike, q_ref: ArrayLike | None, bits: int, redundancy: float | None, *, closest: bool = False
    ) -> IKResult:
        goal = self._targets(real_array("target", target)[None])
        reference = self._reference(q_ref)
        given = self._given(redundancy, q_ref)
        value = real_number("redundancy", given) if self._locked else 0.0
        found = self._engine.answer(goal, reference, value, bits, closest)
        code, count = found.code, len(found.q)
        reason = "" if code == 0 else STATUS_TEXTS[code]
        if code == 1 or (code == 5 and count == 0):
            reason = self._reasons[found.stage]
        return IKResult(found.q, found.flags, found.branch, found.residual, STATUS[code], reason, found.distance)

    def _targets(self, goals: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.plan.task == "position":
            if self.plan.last_link is not None:
                if goals.shape[1:] != (6,):
                    raise InputError(
                        f"{self._name}: give the position of the tool in the base frame, then in the last link frame, "
                        f"(6,), not {goals.shape[1:]}"
                    )
                return np.ascontiguousarray(goals)
            if goals.shape[1:] == (4, 4):
                goals = goals[:, :3, 3]
            if goals.shape[1:] != (3,):
                raise InputError(
                    f"{self._name} solves for positions: give (3,) or a pose (4, 4), not {goals.shape[1:]}"
                )
        elif goals.shape[1:] != (4, 4):
            raise InputError(
                f"{self._name} solves for poses: give a homogeneous transform (4, 4), not {goals.shape[1:]}"
            )
        return np.ascontiguousarray(goals)

    def _reference(self, q_ref: ArrayLike | None) -> NDArray[np.float64] | None:
        if q_ref is None:
            return None
        reference = np.ascontiguousarray(real_array("q_ref", q_ref))
        if reference.shape != (self.n,):
            raise InputError(f"q_ref must hold {self.n} numbers, not shape {reference.shape}")
        return reference

    def _given(self, redundancy: Any, q_ref: ArrayLike | None) -> Any:
        if not self._locked:
            if redundancy is not None:
                raise DerivationError(f"{self._name} has no redundancy parameter")
            return None
        if redundancy is not None:
            return redundancy
        if q_ref is None:
            raise InputError(f"{self._name} is redundant: give redundancy ({self.plan.redundancy}) or q_ref")
        return self.parameter(q_ref)

    def parameter(self, q: ArrayLike) -> float:
        """The redundancy parameter at ``q`` (n,): the prescribed joint (rad or m), or the arm angle (rad)."""
        joints, coupling = real_array("q", q), self.plan.coupling
        return parameter(self.plan, joints if coupling is None else np.array(coupling.matrix) @ joints)


def load_solver(spec: RobotSpec, redundancy: int | None = None, backend: EngineName = "c") -> InverseKinematics:
    """Derive, emit, compile and load the inverse kinematics of ``spec``.

    ``redundancy`` is the number (from 0) of the joint to prescribe in a redundant arm; None lets rrrgen choose.
    ``backend="numpy"`` evaluates the solver in Python instead: no compiler is needed, but a target takes milliseconds.
    Raises :class:`rrrgen.errors.DerivationError` with the reason if the chain has no solver, and
    :class:`rrrgen.errors.BuildError` if "c" finds no C compiler.
    """
    plan = make_plan(spec, redundancy)
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {plan.reason}")
    if backend == "numpy":
        return InverseKinematics(plan, _Evaluated(plan, most_rows(plan)), spec.name)
    return _built(emit(spec, plan), spec.name, spec.name)


def load_tool_solver(spec: RobotSpec, backend: EngineName = "c") -> InverseKinematics:
    """The inverse kinematics of a position task with the tool as an input, as :func:`load_solver` makes it.

    A target is six numbers: the position of the tool in the base frame, then in the frame of the last link. Raises
    DerivationError with the reason for an arm that has no such solver.
    """
    if backend == "numpy":
        plan = plan_with_tool(spec)
        return InverseKinematics(plan, _Evaluated(plan, most_rows(plan)), spec.name)
    return _built(emit_tool_solver(spec), f"{spec.name}_tool", spec.name)


def _built(emitted: Emitted, prefix: str, name: str) -> InverseKinematics:
    """Compile and load an emitted solver, whose functions begin with ``prefix``."""
    from rrrgen.runtime.build import build_extension

    plan = emitted.plan
    ffi, lib = build_extension(emitted.files, _declarations(emitted.files[f"{prefix}_ik.h"]), f"{prefix}_ik")
    return InverseKinematics(plan, _Compiled(plan, most_rows(plan), ffi, lib, prefix), name)


def _declarations(header: str) -> str:
    """The declarations of an emitted header, reduced to the subset of C that cffi parses."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    text = re.sub(r"#ifdef __cplusplus.*?#endif", "", text, flags=re.S)
    defined = dict(re.findall(r"#define (\w+) (\d+)", text))
    text = re.sub(r"^\s*#.*$", "", text, flags=re.M)
    text = re.sub(r"\b\w+_RESTRICT\b", "", text)
    for name, value in defined.items():
        text = re.sub(rf"\b{name}\b", value, text)
    return text
