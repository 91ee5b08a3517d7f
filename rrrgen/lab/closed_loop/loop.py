"""Simulation of controller and robot in closed loop, in compiled C: from robot parameters to motion and torques.

The torque is held constant between controller samples. The motion is integrated with the midpoint rule. Dry friction is
set-valued at rest: each time step solves for the friction torque, within its limits, that keeps a joint at rest. So
sgn(dq) needs no smoothing and the instants of velocity reversals need not be located.
Friction with a state enters with the exact mean over a step of its deflection at the step's mean speed, which does not
damp the ringing of a joint on stiff bristles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.closed_loop.controller import LoopController, Tables
from rrrgen.lab.closed_loop.loop_recording import LoopRecording
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
    """Result of one closed-loop simulation over N samples of n joints; arrays are (N, n), in SI units.

    ``q`` and ``dq`` are the simulated motion; during the warm-up, before the simulation starts, they are the measured
    one. ``tau`` is the torque in the form in which a recording stores it, ``acting`` the torque that moves the joints
    from each sample on. ``diverged`` is the index of the sample at which the motion left its bounds, None if it did
    not.
    """

    q: Array
    dq: Array
    tau: Array
    acting: Array
    diverged: int | None


class Equations(Protocol):
    """Interface of the equations of motion of n joints with m friction surfaces and ``size`` parameters theta.

    ``directions`` (m, n) maps joint speeds to sliding speeds of the surfaces. ``programs()`` returns ``terms(q, dq,
    theta) -> M, load`` and, if m > 0, ``friction(u, d, s, size, theta) -> f``: the friction torques (m,) at sliding
    speeds u in directions d (+1 or -1). ``bent`` (m,) marks surfaces whose friction has a state, the deflection z of
    its bristles; if any has, friction also returns ``reach`` (m,), the deflection in steady sliding forwards, and
    ``damping`` (m,). Such friction is linear in s = z / reach, which follows d gradually after a reversal, and
    ``damping dz/dt`` is added.
    ``carried`` (m, n) maps the joint torques without friction to the loads of the surfaces, whose sizes friction may
    depend on; None if it does not.
    """

    @property
    def n(self) -> int: ...  # noqa: D102
    @property
    def size(self) -> int: ...  # noqa: D102
    @property
    def directions(self) -> Array: ...  # noqa: D102
    @property
    def bent(self) -> tuple[bool, ...]: ...  # noqa: D102
    @property
    def carried(self) -> Array | None: ...  # noqa: D102
    def programs(self) -> tuple[Program, ...]: ...  # noqa: D102


class CompiledLoop:
    """Closed-loop simulation of ``controller`` and the robot ``equations``, compiled once for any parameter values."""

    def __init__(self, equations: Equations, controller: LoopController) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.function_files import Extension, function_files
        from rrrgen.runtime.build import build_extension

        self.equations, self.controller = equations, controller
        carried = np.zeros(0) if equations.carried is None else equations.carried
        values = {
            **{"n": equations.n, "m": len(equations.directions), "W": _literals(equations.directions)},
            **{"states": any(equations.bent), "bent": ", ".join(str(int(each)) for each in equations.bent)},
            **{"loads": equations.carried is not None, "carried": _literals(carried)},
        }
        programs = equations.programs()
        files = function_files(
            "loop", "a simulated closed loop", programs, "double", extension=Extension("loop", values)
        )
        self._ffi, self._lib = build_extension(files, DECLARED, "loop", NATIVE)
        self._tables: Tables = controller.tables()

    def replay(self, recording: LoopRecording) -> Run:
        """Run the controller on the *measured* motion, without simulating the robot; the result holds its torques."""
        return self._run(np.zeros(self.equations.size), recording, len(recording))

    def run(self, theta: Array, recording: LoopRecording) -> Run:
        """Simulate the closed loop with robot parameters ``theta`` along the reference of ``recording``.

        ``theta`` (p,) is in the order of the equations: linear parameters, then shape parameters of friction laws.
        """
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


def _literals(values: Array) -> str:
    """The entries of ``values`` as C literals with commas between them."""
    return ", ".join(repr(float(value)) for value in values.ravel())
