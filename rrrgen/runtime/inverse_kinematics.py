"""Inverse kinematics in compiled C: the solver is emitted, built and called through cffi."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.emit.c.ik.files import Emitted, emit, emit_tool_solver
from rrrgen.ik.inverse_kinematics import InverseKinematics, evaluated_solver, evaluated_tool_solver, solvable_plan
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.result_layout import most_rows
from rrrgen.ik.results import Answer, IKBatch, empty_batch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rrrgen.emit import Real
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.runtime.engines import EngineName


class _Compiled:
    """Inverse-kinematics engine that calls the emitted C through cffi, with numbers of the type ``real``."""

    def __init__(self, plan: SolverPlan, rows: int, ffi: Any, lib: Any, name: str, real: Real) -> None:
        self._n, self._rows, self._locked = plan.n, rows, plan.locked is not None
        self._ffi, self._name, self._scalar = ffi, name, np.dtype(np.float64 if real == "double" else np.float32)
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
        goal, reference = self._convert(goal), self._convert(reference)
        code = function(self._pointer(goal), self._pointer(reference), *extra, bits, out)
        k, rows, n, scalar = out.count, self._rows, self._n, self._scalar
        q = np.frombuffer(self._ffi.buffer(out.q), scalar, rows * n).reshape(rows, n)[:k].copy()
        flags = np.frombuffer(self._ffi.buffer(out.flags), np.uint32, rows)[:k].copy()
        branch = np.frombuffer(self._ffi.buffer(out.branch), np.uint32, rows)[:k].copy()
        residual = np.frombuffer(self._ffi.buffer(out.residual), scalar, rows)[:k].copy()
        return Answer(code, q, flags, branch, residual, out.stage, float(out.distance))

    def batch(
        self,
        goals: NDArray[np.float64],
        reference: NDArray[np.float64] | None,
        given: NDArray[np.float64] | None,
        bits: int,
    ) -> IKBatch:
        """Solve for every target, one after the other or in one call of C."""
        out = empty_batch(len(goals), self._rows, self._n, self._scalar)
        goals, reference, given = self._convert(goals), self._convert(reference), self._convert(given)
        extra = (self._pointer(given),) if self._locked else ()
        self._batch(
            len(goals), self._pointer(goals), self._pointer(reference), *extra, bits,
            self._pointer(out.q), self._pointer(out.counts), self._pointer(out.flags), self._pointer(out.branch),
            self._pointer(out.statuses), self._pointer(out.distances),
        )  # fmt: skip
        return out

    def _convert(self, array: NDArray[Any] | None) -> Any:
        """The numbers in the type of the C code; None for None."""
        return None if array is None else np.ascontiguousarray(array, self._scalar)

    def _pointer(self, array: NDArray[Any] | None) -> Any:
        """The array for a call of C, of which it is only the address."""
        if array is None:
            return self._ffi.NULL
        return self._ffi.cast("void *", array.ctypes.data)


def load_solver(
    spec: RobotSpec, redundancy: int | None = None, backend: EngineName = "c", real: Real = "double"
) -> InverseKinematics:
    """Derive, emit, compile and load the inverse kinematics of ``spec``.

    ``redundancy`` is the number (from 0) of the joint to prescribe in a redundant arm; None lets rrrgen choose.
    ``backend="numpy"`` evaluates the solver in Python instead: no compiler is needed, but a target takes milliseconds.
    ``real`` is the floating-point type of the C code, and of its solutions; targets of float are those of float
    functions, which a solver in double refuses for their rounding.
    Raises :class:`rrrgen.base.errors.DerivationError` with the reason if the chain has no solver, and
    :class:`rrrgen.base.errors.BuildError` if "c" finds no C compiler.
    """
    if backend == "numpy":
        return evaluated_solver(spec, redundancy)
    return _build_solver(emit(spec, solvable_plan(spec, redundancy), real), spec.name, spec.name, real)


def load_tool_solver(spec: RobotSpec, backend: EngineName = "c", real: Real = "double") -> InverseKinematics:
    """The inverse kinematics of a position task with the tool as an input, as :func:`load_solver` makes it.

    A target is six numbers: the position of the tool in the base frame, then in the frame of the last link. Raises
    DerivationError with the reason for an arm that has no such solver.
    """
    if backend == "numpy":
        return evaluated_tool_solver(spec)
    return _build_solver(emit_tool_solver(spec, real), f"{spec.name}_tool", spec.name, real)


def _build_solver(emitted: Emitted, prefix: str, name: str, real: Real) -> InverseKinematics:
    """Compile and load an emitted solver in the type ``real``, whose functions begin with ``prefix``."""
    from rrrgen.runtime.build import build_extension

    plan = emitted.plan
    ffi, lib = build_extension(emitted.files, _declarations(emitted.files[f"{prefix}_ik.h"]), f"{prefix}_ik")
    return InverseKinematics(plan, _Compiled(plan, most_rows(plan), ffi, lib, prefix, real), name)


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
