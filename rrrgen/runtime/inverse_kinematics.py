"""The Python interface of the emitted inverse kinematics: builds the C code, checks arguments, returns NumPy arrays."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrrgen.errors import DerivationError, InputError
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.families import parameter
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.sources import Emitted, emit
from rrrgen.runtime.ik_arguments import options, real_array, real_number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from rrrgen.robotfile.robot_spec import RobotSpec

MULTIPLE, FREE, OUTSIDE, INEXACT = 1, 2, 4, 8
"""Bits of :attr:`IKResult.flags`; see the emitted header."""

STATUS = ("ok", "unreachable", "outside limits", "not finite", "not a rotation", "incomplete")
"""What the numbers of :attr:`IKBatch.statuses` mean. Where an arm has no complete solver, ``plan.incomplete`` says why
and "incomplete" is the status with rows and without them, but for targets farther than a million reaches."""


@dataclass(frozen=True)
class IKResult:
    """All solutions found for one target.

    ``q`` (k, n) are the configurations in rad or m; ``flags`` (k,) sums of MULTIPLE, FREE, OUTSIDE, INEXACT;
    ``branches`` (k,) numbers that stay constant along a path without singularities
    (:meth:`InverseKinematics.branch_names` decodes them); ``residual`` (k,) the remaining task error. Without a
    solution, ``status`` and ``reason`` say why, and ``distance`` (m) is the distance of the target from the workspace
    (negative if unknown). With the status "incomplete" there may be further solutions, even if none was found.
    """

    q: NDArray[np.float64]
    flags: NDArray[np.uint32]
    branches: NDArray[np.uint32]
    residual: NDArray[np.float64]
    status: str
    reason: str
    distance: float

    def __len__(self) -> int:
        return len(self.q)


@dataclass(frozen=True)
class IKBatch:
    """Solutions of a batch of targets of shape (...).

    For each target the first ``counts`` (...) of the ``q`` (..., rows, n) are solutions; the rest of ``q`` is NaN.
    ``flags`` and ``branches`` are (..., rows); ``statuses`` and ``distances`` (...).
    """

    q: NDArray[np.float64]
    counts: NDArray[np.int32]
    flags: NDArray[np.uint32]
    branches: NDArray[np.uint32]
    statuses: NDArray[np.int32]
    distances: NDArray[np.float64]


class InverseKinematics:
    """The compiled inverse kinematics of one robot, created by :func:`load_solver`.

    ``plan`` describes the family of the arm, ``max_solutions`` is the largest number of solutions, ``n`` the number of
    joints.
    """

    def __init__(self, emitted: Emitted, ffi: Any, lib: Any, name: str) -> None:
        self.plan: SolverPlan = emitted.plan
        self.labels = emitted.labels
        self.max_solutions = emitted.rows
        self.n = emitted.plan.chain.n
        self._ffi, self._name = ffi, name
        self._solve = getattr(lib, f"{name}_inverse_kinematics")
        self._closest = getattr(lib, f"{name}_closest")
        self._batch = getattr(lib, f"{name}_inverse_kinematics_batch")
        self._reason = getattr(lib, f"{name}_ik_reason")
        self._status_string = getattr(lib, f"{name}_ik_status_string")
        self._locked = emitted.plan.locked is not None

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
        """All configurations that bring the tip to ``target``: a pose (4, 4), or a position (3,) for position solvers.

        ``q_ref`` (n,) gives angles that are free at singular configurations, determines the full turns of angles, and
        the order with ``sort="nearest"``. ``limits`` leaves out solutions outside the joint limits. ``redundancy`` is
        the prescribed joint or arm angle of a redundant arm, by default its value in ``q_ref``. ``residual`` keeps
        solutions that meet a pose only as far as 4 or 5 joints can. Raises InputError for wrong shapes, TypeError for
        wrong types.
        """
        return self._call(self._solve, target, q_ref, options(limits, sort, residual), redundancy)

    def closest(
        self, target: ArrayLike, q_ref: ArrayLike | None = None, *, limits: bool = True, redundancy: float | None = None
    ) -> IKResult:
        """The one configuration with the smallest least-squares error to ``target``, even if that is unreachable.

        Arguments are as in :meth:`solve`.
        """
        return self._call(self._closest, target, q_ref, options(limits), redundancy)

    def solve_batch(
        self,
        targets: ArrayLike,
        q_ref: ArrayLike | None = None,
        *,
        limits: bool = True,
        sort: Literal["branch", "nearest"] = "branch",
        redundancy: ArrayLike | None = None,
    ) -> IKBatch:
        """All configurations for each of ``targets``, (..., 4, 4) or (..., 3), in one call of the C code.

        Arguments are as in :meth:`solve`, except that ``redundancy`` is one number or one per target, (...).
        """
        chosen = options(limits, sort)
        given_targets = real_array("targets", targets)
        core = 2 if given_targets.shape[-2:] == (4, 4) else 1
        batch = given_targets.shape[:-core]
        goals = self._targets(given_targets.reshape(-1, *given_targets.shape[-core:]))
        N, rows = len(goals), self.max_solutions
        q = np.full((N, rows, self.n), np.nan)
        counts, statuses = np.zeros(N, np.int32), np.zeros(N, np.int32)
        flags, branches = np.zeros((N, rows), np.uint32), np.zeros((N, rows), np.uint32)
        distances = np.zeros(N)
        reference = self._reference(q_ref)
        extra: tuple[Any, ...] = ()
        given = self._given(redundancy, q_ref)
        if self._locked:
            value = real_array("redundancy", given)
            if value.shape not in ((), batch):
                raise InputError(f"redundancy must be one number or of shape {batch}, not of shape {value.shape}")
            prescribed = np.ascontiguousarray(np.broadcast_to(value, batch).reshape(N))
            extra = (self._pointer("double *", prescribed),)
        self._batch(
            N, self._pointer("double *", goals), self._pointer("double *", reference), *extra, chosen,
            self._pointer("double *", q), self._pointer("int *", counts), self._pointer("unsigned *", flags),
            self._pointer("unsigned *", branches), self._pointer("int *", statuses),
            self._pointer("double *", distances),
        )  # fmt: skip
        return IKBatch(
            q.reshape(*batch, rows, self.n),
            counts.reshape(batch),
            flags.reshape(*batch, rows),
            branches.reshape(*batch, rows),
            statuses.reshape(batch),
            distances.reshape(batch),
        )

    def sweep(
        self, target: ArrayLike, values: ArrayLike, q_ref: ArrayLike | None = None, *, limits: bool = True
    ) -> IKBatch:
        """The solutions of one target for the ``values`` (N,) of the redundancy parameter, rad or m.

        Raises DerivationError if the arm is not redundant.
        """
        if not self._locked:
            raise DerivationError(f"{self._name} has no redundancy parameter")
        parameters = np.atleast_1d(real_array("values", values))
        goal = self._targets(real_array("target", target)[None])
        goals = np.broadcast_to(goal, (len(parameters), *goal.shape[1:]))
        return self.solve_batch(goals, q_ref, limits=limits, redundancy=parameters)

    def branch_names(self, branch: int) -> dict[str, int]:
        """A branch number decoded into named choices, such as elbow; 0 is the plus side of a choice between two."""
        return {name: (int(branch) >> bit) & ((1 << bits) - 1) for name, bit, bits in self.labels}

    # -- arguments ----------------------------------------------------------------------------------------------------

    def _call(
        self, function: Any, target: ArrayLike, q_ref: ArrayLike | None, bits: int, redundancy: float | None
    ) -> IKResult:
        goal = self._targets(real_array("target", target)[None])
        out = self._ffi.new(f"{self._name}_ik_solutions *")
        reference = self._reference(q_ref)
        given = self._given(redundancy, q_ref)
        extra = (real_number("redundancy", given),) if self._locked else ()
        code = function(self._pointer("double *", goal), self._pointer("double *", reference), *extra, bits, out)
        k, rows = out.count, self.max_solutions
        q = np.frombuffer(self._ffi.buffer(out.q), float, rows * self.n).reshape(rows, self.n)[:k].copy()
        flags = np.frombuffer(self._ffi.buffer(out.flags), np.uint32, rows)[:k].copy()
        branches = np.frombuffer(self._ffi.buffer(out.branch), np.uint32, rows)[:k].copy()
        residual = np.frombuffer(self._ffi.buffer(out.residual), float, rows)[:k].copy()
        status = STATUS[code]
        reason = "" if code == 0 else self._text(self._status_string(code))
        if code == 1 or (code == 5 and k == 0):
            reason = self._text(self._reason(out.stage))
        return IKResult(q, flags, branches, residual, status, reason, float(out.distance))

    def _text(self, pointer: Any) -> str:
        return str(self._ffi.string(pointer).decode())

    def _pointer(self, kind: str, array: NDArray[Any] | None) -> Any:
        if array is None:
            return self._ffi.NULL
        return self._ffi.cast(kind, array.ctypes.data)

    def _targets(self, goals: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.plan.task == "position":
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
        """The redundancy parameter of a configuration (n,): the prescribed joint, or the arm angle."""
        return parameter(self.plan, real_array("q", q))


def load_solver(spec: RobotSpec, redundancy: int | None = None) -> InverseKinematics:
    """Derive, emit, compile and load the inverse kinematics of ``spec``; ``redundancy`` as in :func:`classify.plan`.

    Raises :class:`rrrgen.errors.DerivationError` with the reason where the chain has no solver, and
    :class:`rrrgen.errors.BuildError` without a C compiler.
    """
    from rrrgen.runtime.build import build_extension

    emitted = emit(spec, make_plan(spec, redundancy))
    ffi, lib = build_extension(emitted.files, _declarations(emitted.files[f"{spec.name}_ik.h"]), f"{spec.name}_ik")
    return InverseKinematics(emitted, ffi, lib, spec.name)


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
