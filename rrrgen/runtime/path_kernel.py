"""The emitted C that computes the fastest motion along a path, compiled for one robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.emit import Real
from rrrgen.emit.c.path_timing.files import further_inputs, timing_files, work_size
from rrrgen.program import Program
from rrrgen.runtime.path import Path

LIMITS = ("tau_max", "dq_max", "ddq_max")


class TimingKernel:
    """The compiled C functions that time a path, ``<name>_time_path``, and sample the result, ``<name>_timed_path``.

    ``path_dynamics`` and ``friction_with`` are the programs of the robot's dynamics along a path and of its friction.
    """

    def __init__(self, robot: str, path_dynamics: Program, friction_with: Program, real: Real) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.dialect import Dialect
        from rrrgen.emit.c.function_files import function_files
        from rrrgen.runtime.build import build_extension

        title = f"dynamics along a path and friction of {robot}"
        files = function_files(robot, title, [path_dynamics, friction_with], real)
        files |= timing_files(path_dynamics, Dialect(robot, real))
        self.robot, self.further = robot, [port.name for port in further_inputs(path_dynamics)]
        self.n = path_dynamics.inputs[0].size
        self._pointer, self.dtype = f"{real} *", np.dtype(np.float64 if real == "double" else np.float32)
        declared = _declarations(robot, self.n, len(self.further), real)
        self.ffi, self.lib = build_extension(files, declared, f"{robot}-timing", NATIVE)

    def _address(self, array: Array) -> Any:
        return self.ffi.cast(self._pointer, array.ctypes.data)

    def _path(self, arrays: Sequence[Array]) -> Any:
        """C structure of a path that points into ``arrays``, which must outlive it."""
        path = self.ffi.new(f"{self.robot}_path *")
        path.points = len(arrays[0])
        for name, array in zip(("s", "q", "q_s", "q_ss"), arrays, strict=True):
            setattr(path, name, self._address(array))
        return path

    def _dense(self, path: Path) -> list[Array]:
        return [np.ascontiguousarray(each, self.dtype) for each in (path.s, path.q, path.q_s, path.q_ss)]

    def time(
        self,
        path: Path,
        limits: Mapping[str, Array],
        friction: Array | None,
        ends: tuple[float, float],
        parameters: Mapping[str, Array],
    ) -> tuple[int, int, Array, Array, float]:
        """Compute the fastest motion along ``path``: (status, point, ds/dt (N,), times t (N,) in s, stretch).

        The number is that of the point at which the status arose. ``limits`` maps names to limits (n,), ``friction``
        are the friction parameters or None, ``ends`` is ds/dt at both ends, ``parameters`` maps names to model
        parameters.
        """
        arrays, (given, friction) = self._dense(path), self._limits(limits, friction)
        given.start, given.end = ends
        inputs = [np.ascontiguousarray(parameters[name], self.dtype) for name in self.further]
        count, where = len(path.s), self.ffi.new("int *")
        work = np.empty(work_size(self.n, count), self.dtype)
        ds_dt, t = np.zeros(count, self.dtype), np.zeros(count, self.dtype)
        call = getattr(self.lib, f"{self.robot}_time_path")
        stretch = self.ffi.new(self._pointer)
        status = call(self._path(arrays), given, *map(self._address, (*inputs, work, ds_dt, t)), stretch, where)
        return int(status), int(where[0]), ds_dt, t, float(stretch[0])

    def check(
        self,
        path: Path,
        limits: Mapping[str, Array],
        friction: Array | None,
        parameters: Mapping[str, Array],
        ds_dt: Array,
    ) -> tuple[float, float, float]:
        """The largest torque, speed and acceleration over their limits, at the speeds ``ds_dt`` (N,) at the points."""
        arrays, (given, friction) = self._dense(path), self._limits(limits, friction)
        inputs = [np.ascontiguousarray(parameters[name], self.dtype) for name in self.further]
        call = getattr(self.lib, f"{self.robot}_timing_check")
        shares = self.ffi.new(f"{self.robot}_timing_shares *")
        call(self._path(arrays), given, *map(self._address, (*inputs, ds_dt)), shares)
        return float(shares.torque), float(shares.speed), float(shares.acceleration)

    def _limits(self, limits: Mapping[str, Array], friction: Array | None) -> tuple[Any, Array | None]:
        """C structure of limits, and the friction parameters that it points to, which must outlive it."""
        given = self.ffi.new(f"{self.robot}_path_limits *")
        for name in LIMITS:
            setattr(given, name, [float(value) for value in limits[name]])
        if friction is not None:
            friction = np.ascontiguousarray(friction, self.dtype)
            given.friction = self._address(friction)
        return given, friction

    def text(self, status: int) -> str:
        """Text that explains a status code."""
        text: bytes = self.ffi.string(getattr(self.lib, f"{self.robot}_timing_status_string")(status))
        return text.decode()

    def sample(self, path: Path, ds_dt: Array, t: Array, times: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations, (m, n) each, of the timed path at the instants ``times`` (m,), s.

        ``ds_dt`` and ``t`` (N,) are the timing at the N points of ``path``.
        """
        arrays = self._dense(path)
        held, call = self._path(arrays), getattr(self.lib, f"{self.robot}_timed_path")
        found = tuple(np.empty((len(times), self.n), self.dtype) for _ in range(3))
        speeds, instants = self._address(ds_dt), self._address(t)
        for k, now in enumerate(times):
            call(held, speeds, instants, float(now), *(self._address(each[k]) for each in found))
        return found[0], found[1], found[2]


def _declarations(p: str, n: int, further: int, real: Real) -> str:
    """C declarations that cffi reads: the path structures and functions of the robot ``p`` with ``n`` joints.

    ``further`` is the number of model parameters that the timing function takes.
    """
    vectors = f"const {real} *, " * further
    return f"""
        typedef struct {{ int points; const {real} *s; const {real} *q; const {real} *q_s;
            const {real} *q_ss; }} {p}_path;
        typedef struct {{ {real} tau_max[{n}]; {real} dq_max[{n}]; {real} ddq_max[{n}];
            const {real} *friction; {real} start; {real} end; }} {p}_path_limits;
        const char *{p}_timing_status_string(int);
        int {p}_time_path(const {p}_path *, const {p}_path_limits *, {vectors}{real} *, {real} *, {real} *,
            {real} *, int *);
        typedef struct {{ {real} torque; {real} speed; {real} acceleration; int torque_at; int speed_at;
            int acceleration_at; }} {p}_timing_shares;
        void {p}_timing_check(const {p}_path *, const {p}_path_limits *, {vectors}const {real} *, {p}_timing_shares *);
        void {p}_timed_path(const {p}_path *, const {real} *, const {real} *, {real}, {real} *, {real} *, {real} *);
    """
