"""The simulated loop in compiled C: one run takes the parameters of the robot, and gives motion and torques.

Between samples the torque is held; the robot moves by steps of the midpoint rule, in which friction that holds a joint
is found exactly (time stepping with set-valued friction), so that sgn needs no smoothing and reversals no search.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rrrgen.arrays import Array
from rrrgen.closed_loop.controller import LoopController, Tables
from rrrgen.closed_loop.loop_recording import LoopRecording
from rrrgen.program import Program

STEP = 2.5e-4
"""Longest step of the simulation, s."""

DECLARED = (
    "int loop_run(const double *, const int *, int, const double *, const int *, const int *, "
    + 7 * "const double *, "
    + "double *, double *, double *, double *, double *, double *);"
)


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated loop over N samples of n joints; arrays are (N, n), those of the warm-up as measured.

    ``tau`` is the torque as it is recorded, ``acting`` the one that moves the joints from each sample on. ``diverged``
    is the sample at which the motion left its bounds, None if it did not.
    """

    q: Array
    dq: Array
    tau: Array
    acting: Array
    diverged: int | None


class Equations(Protocol):
    """Interface of the equations of motion of n joints: ``size`` parameters, ``directions`` (m, n) of friction.

    ``programs()`` are ``terms(q, dq, theta) -> M, load`` and, with m > 0, ``friction(u, s, theta) -> f`` of the
    surfaces at the speeds u in the directions s.
    """

    @property
    def n(self) -> int: ...  # noqa: D102
    @property
    def size(self) -> int: ...  # noqa: D102
    @property
    def directions(self) -> Array: ...  # noqa: D102
    def programs(self) -> tuple[Program, ...]: ...  # noqa: D102


class CompiledLoop:
    """The loop of ``controller`` and the robot of ``equations``, compiled once for all parameters."""

    def __init__(self, equations: Equations, controller: LoopController) -> None:
        from rrrgen.backends.c.functions import Extension, function_files
        from rrrgen.runtime.build import NATIVE, build_extension

        self.equations, self.controller = equations, controller
        W = ", ".join(repr(float(w)) for w in equations.directions.ravel())
        values = {"n": equations.n, "m": len(equations.directions), "W": W}
        programs = equations.programs()
        files = function_files(
            "loop", "a simulated closed loop", programs, "double", extension=Extension("loop", values)
        )
        self._ffi, self._lib = build_extension(files, DECLARED, "loop", NATIVE)
        self._tables: Tables = controller.tables()

    def replay(self, recording: LoopRecording) -> Run:
        """The torques that the controller computes from the *measured* motion."""
        return self._run(np.zeros(self.equations.size), recording, len(recording))

    def run(self, theta: Array, recording: LoopRecording) -> Run:
        """The loop with the parameters ``theta`` (columns, then shapes) along the reference of ``recording``."""
        return self._run(np.ascontiguousarray(theta, float), recording, recording.warm)

    def _run(self, theta: Array, recording: LoopRecording, warm: int) -> Run:
        samples, n, tables = len(recording), self.equations.n, self._tables
        whole = int(np.floor(recording.delay + 1e-9))
        part = max(0.0, recording.delay - whole)
        steps = max(1, int(np.ceil(recording.period / STEP - 1e-9)))
        counts = np.array([samples, recording.every, warm, steps, whole], np.int32)
        q, dq, command, acting = (np.zeros((samples, n)) for _ in range(4))
        doubles: list[Any] = [
            *(np.array([recording.period, part]), recording.bounds, recording.q, recording.reference),
            *(recording.reference_velocity, recording.feedforward, recording.start),
            *(np.zeros(tables.signals), np.zeros(tables.memory + 1), q, dq, command, acting),
        ]
        doubles = [self._ffi.from_buffer("double[]", np.ascontiguousarray(each, float)) for each in doubles]
        ends = self._lib.loop_run(
            self._ffi.from_buffer("double[]", theta),
            self._ffi.from_buffer("int[]", tables.operations),
            len(tables.operations),
            self._ffi.from_buffer("double[]", tables.coefficients),
            self._ffi.from_buffer("int[]", tables.outputs),
            self._ffi.from_buffer("int[]", counts),
            *doubles,
        )
        diverged = None if ends == samples else int(ends)
        return Run(q, dq, recording.as_recorded(command), recording.held(acting), diverged)
