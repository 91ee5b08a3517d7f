"""The Python interface of the inverse kinematics: checks arguments, asks an engine, returns arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrrgen.base.arrays import real_array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.classify import plan_with_tool
from rrrgen.ik.families import parameter
from rrrgen.ik.interpreter.solve import solve
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.result_layout import (
    LIMITS,
    NEAREST,
    RESIDUAL,
    STATUS,
    labels,
    most_rows,
    reasons_of,
    status_texts,
)
from rrrgen.ik.results import Answer, IKBatch, IKResult, SolverEngine, batch_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from rrrgen.robot.spec import RobotSpec

SORTS = ("branch", "nearest")


def options(limits: Any, sort: Any = "branch", residual: Any = False) -> int:
    """Option bits of a call of the C code, from its keyword arguments.

    Raises TypeError unless ``limits`` and ``residual`` are booleans, ValueError for an unknown order ``sort``.
    """
    if not isinstance(sort, str) or sort not in SORTS:
        raise ValueError(f"sort must be {' or '.join(map(repr, SORTS))}, not {sort!r}")
    bits = LIMITS * flag("limits", limits) + RESIDUAL * flag("residual", residual)
    return bits + NEAREST * (sort == "nearest")


def flag(name: str, value: Any) -> bool:
    """``value`` as a bool. Raises TypeError for anything else, such as a number passed by mistake."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, not {value!r}")
    return bool(value)


def real_number(name: str, value: Any) -> float:
    """``value`` as one float. Raises TypeError unless it is a single real number."""
    array = real_array(name, value)
    if array.shape != ():
        raise TypeError(f"{name} must be one number, not an array of shape {array.shape}")
    return float(array)


RIGID = 1e-3
"""Largest entry of R'R - 1 of a rotation, and of the last row's deviation: far more than six digits of a file leave."""


def refuse_no_pose(name: str, poses: NDArray[np.float64], rotations: bool = True) -> None:
    """Raise InputError if one of ``poses`` (..., 4, 4) is finite and no rigid motion.

    The last row must be 0 0 0 1 and, where ``rotations`` asks for it, the rotation orthonormal and right-handed; the
    solvers report wrong rotations by themselves. Numbers that are not finite are left to who computes with them.
    """
    poses = poses.reshape(-1, 4, 4)
    last = np.abs(poses[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1, initial=0.0)
    wrong = np.isfinite(poses[:, :3]).all(axis=(1, 2)) & ~(last <= RIGID)
    if wrong.any():
        row = " ".join(f"{value:g}" for value in poses[wrong][0, 3])
        raise InputError(f"{name}: the last row of a pose is 0 0 0 1, not {row}")
    if rotations:
        R = poses[np.isfinite(poses).all(axis=(1, 2)), :3, :3]
        defect = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0)
        if (defect > RIGID).any():
            hint = f"its columns deviate from unit length and right angles by up to {defect.max():.2g}"
            raise InputError(f"{name}: the rotation of a pose is not orthonormal: {hint}")
        if (np.linalg.det(R) < 0).any():
            raise InputError(f"{name}: the rotation of a pose is left-handed")


class Evaluated:
    """Inverse-kinematics engine that evaluates the solver in Python: slow, but without a compiler."""

    def __init__(self, plan: SolverPlan) -> None:
        self._plan = plan

    def answer(
        self, goal: NDArray[np.float64], reference: NDArray[np.float64] | None, given: float, bits: int, closest: bool
    ) -> Answer:
        """Solve for one target, or find the configuration nearest to it."""
        q_ref = None if reference is None else reference.tolist()
        solutions = solve(self._plan, goal.ravel().tolist(), q_ref, given, bits, closest=closest)
        rows = solutions.rows
        return Answer(
            solutions.status,
            np.array([row.q for row in rows], float).reshape(len(rows), self._plan.n),
            np.array([row.flags for row in rows], np.uint32),
            np.array([row.branch for row in rows], np.uint32),
            np.array([row.residual for row in rows], float),
            solutions.stage,
            solutions.distance,
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
        return batch_of(answers, most_rows(self._plan), self._plan.n)


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

    def __init__(self, plan: SolverPlan, engine: SolverEngine, name: str) -> None:
        self.plan = plan
        self.labels = labels(plan)
        self.max_solutions = most_rows(plan)
        self.n = plan.n
        self._reasons, self._texts = reasons_of(plan), status_texts(plan)
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
            InputError: a wrong shape, a last row of a pose other than 0 0 0 1, or a redundant arm without
                ``redundancy`` and ``q_ref``.
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
        reference, given = self._reference(q_ref), self._redundancy_parameter(redundancy, q_ref)
        prescribed = None
        if self._locked:
            value = real_array("redundancy", given)
            if value.shape not in ((), batch):
                raise InputError(f"redundancy must be one number or of shape {batch}, not of shape {value.shape}")
            prescribed = np.ascontiguousarray(np.broadcast_to(value, batch).reshape(len(goals)))
        flat_batch, rows = self._engine.batch(goals, reference, prescribed, chosen), self.max_solutions
        return IKBatch(
            flat_batch.q.reshape(*batch, rows, self.n),
            flat_batch.counts.reshape(batch),
            flat_batch.flags.reshape(*batch, rows),
            flat_batch.branch.reshape(*batch, rows),
            flat_batch.statuses.reshape(batch),
            flat_batch.distances.reshape(batch),
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
        given = self._redundancy_parameter(redundancy, q_ref)
        value = real_number("redundancy", given) if self._locked else 0.0
        answer = self._engine.answer(goal, reference, value, bits, closest)
        code, count = answer.code, len(answer.q)
        reason = "" if code == 0 else self._texts[code]
        if code == 1 or (code == 5 and count == 0):
            reason = self._reasons[answer.stage]
        return IKResult(answer.q, answer.flags, answer.branch, answer.residual, STATUS[code], reason, answer.distance)

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
                refuse_no_pose("target", goals, rotations=False)
                goals = goals[:, :3, 3]
            if goals.shape[1:] != (3,):
                raise InputError(
                    f"{self._name} solves for positions: give (3,) or a pose (4, 4), not {goals.shape[1:]}"
                )
        elif goals.shape[1:] != (4, 4):
            raise InputError(
                f"{self._name} solves for poses: give a homogeneous transform (4, 4), not {goals.shape[1:]}"
            )
        else:
            refuse_no_pose("target", goals, rotations=False)
        return np.ascontiguousarray(goals)

    def _reference(self, q_ref: ArrayLike | None) -> NDArray[np.float64] | None:
        if q_ref is None:
            return None
        reference = np.ascontiguousarray(real_array("q_ref", q_ref))
        if reference.shape != (self.n,):
            raise InputError(f"q_ref must hold {self.n} numbers, not shape {reference.shape}")
        return reference

    def _redundancy_parameter(self, redundancy: Any, q_ref: ArrayLike | None) -> Any:
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


def solvable_plan(spec: RobotSpec, redundancy: int | None = None) -> SolverPlan:
    """The plan of the solver of ``spec``. Raises DerivationError with the reason if the chain has none."""
    plan = make_plan(spec, redundancy)
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {plan.reason}")
    return plan


def evaluated_solver(spec: RobotSpec, redundancy: int | None = None) -> InverseKinematics:
    """The inverse kinematics of ``spec`` evaluated in Python: no compiler is needed, but a target takes milliseconds.

    ``redundancy`` is the number (from 0) of the joint to prescribe in a redundant arm; None lets rrrgen choose.
    Raises :class:`rrrgen.base.errors.DerivationError` with the reason if the chain has no solver.
    """
    return _python_solver(solvable_plan(spec, redundancy), spec.name)


def evaluated_tool_solver(spec: RobotSpec) -> InverseKinematics:
    """The inverse kinematics of a position task with the tool as an input, evaluated in Python."""
    return _python_solver(plan_with_tool(spec), spec.name)


def _python_solver(plan: SolverPlan, name: str) -> InverseKinematics:
    return InverseKinematics(plan, Evaluated(plan), name)
