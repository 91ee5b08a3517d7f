"""Given paths q(s): the path itself, dynamics along it, time-optimal timing, and the timed motion."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.base.arrays import Array
from rrrgen.base.errors import BuildError, InputError
from rrrgen.emit import Real
from rrrgen.emit.c.path_timing import further_inputs, timing_files, work_size
from rrrgen.program import Program
from rrrgen.runtime.functions.parameters import FrictionFunctions
from rrrgen.runtime.results import Motion

# ------------------------------------------------------------------------------------------------------------------
# Sampled joint paths q(s), and cubic splines through waypoints.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Path:
    """A path q(s) in joint space, sampled at N points of the path parameter s.

    ``s`` (N,) rises, in any unit; ``q`` (N, n) are the joint positions, rad or m, ``q_s`` and ``q_ss`` (N, n) their
    first and second derivatives by s. Raises :class:`rrrgen.base.errors.InputError` for arrays that do not fit
    together.
    """

    s: Array
    q: Array
    q_s: Array
    q_ss: Array

    def __post_init__(self) -> None:
        for name in ("s", "q", "q_s", "q_ss"):
            values = np.array(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if not np.all(np.isfinite(values)):
                raise InputError(f"path: {name} has numbers that are not finite")
        if self.s.ndim != 1 or len(self.s) < 2 or not np.all(np.diff(self.s) > 0.0):
            raise InputError("path: s must be at least two rising numbers, (N,)")
        for name in ("q", "q_s", "q_ss"):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape != (len(self.s), *self.q.shape[1:]):
                raise InputError(f"path: {name} must have shape (N, n) with N = {len(self.s)} points, not {shape}")


def spline_path(waypoints: ArrayLike, points: int = 1000) -> Path:
    """The cubic spline through waypoints, with continuous curvature, as a path.

    The parameter s is 0 at the first waypoint and 1 at the last, between them in proportion to the square root of the
    distances of the waypoints, which avoids loops. At the ends the curvature q'' is zero.

    Args:
        waypoints: joint positions, (k, n), rad or m, k at least 2; neighbours must differ.
        points: N, the number of points of the path, at least 2.

    Returns:
        The path, with N points equally spaced in s.

    Raises:
        InputError: fewer than two waypoints, or neighbours that are equal.
    """
    w = np.asarray(waypoints, dtype=float)
    if w.ndim != 2 or len(w) < 2 or not np.all(np.isfinite(w)):
        raise InputError(f"waypoints must be at least two rows of finite joint positions, (k, n), not {w.shape}")
    if points < 2:
        raise InputError(f"a path has at least two points, not {points}")
    steps = np.sqrt(np.linalg.norm(np.diff(w, axis=0), axis=1))
    if not np.all(steps > 0.0):
        raise InputError(f"waypoints {int(np.argmin(steps))} and {int(np.argmin(steps)) + 1} (from 0) are equal")
    knots = np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps)
    curve, h = _curvatures(knots, w), np.diff(knots)[:, None]
    s = np.linspace(0.0, 1.0, points)
    k = np.minimum(np.searchsorted(knots, s, side="right") - 1, len(h) - 1)
    after = (s - knots[k])[:, None]
    before, h = h[k] - after, h[k]
    left, right = curve[k] / (6.0 * h), curve[k + 1] / (6.0 * h)
    start, end = w[k] / h - left * h**2, w[k + 1] / h - right * h**2
    q = left * before**3 + right * after**3 + start * before + end * after
    q_s = 3.0 * (right * after**2 - left * before**2) + end - start
    return Path(s, q, q_s, 6.0 * (left * before + right * after))


def _curvatures(knots: Array, values: Array) -> Array:
    """Second derivatives (k, n) at the ``knots`` (k,) of the natural cubic spline through ``values`` (k, n)."""
    h = np.diff(knots)
    A = np.eye(len(knots))
    slopes = np.diff(values, axis=0) / h[:, None]
    right = np.zeros_like(values)
    for i in range(1, len(knots) - 1):
        A[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = 6.0 * (slopes[i] - slopes[i - 1])
    return np.linalg.solve(A, right)


# ------------------------------------------------------------------------------------------------------------------
# Methods of a model for given paths: dynamics along them and time-optimal timing; compiled when first called.
# ------------------------------------------------------------------------------------------------------------------

EXCESS = 0.02
"""Share by which torques may exceed their limits between the points of a path, and by which a motion may be stretched
for speeds and accelerations there, before a warning advises more points."""


class PathFunctions(FrictionFunctions):
    """Methods for motion along a given path q(s): dynamics in terms of s, and time-optimal timing."""

    _timing: TimingKernel | None = None

    def time_path(
        self,
        path: Path,
        *,
        tau_max: ArrayLike | None = None,
        dq_max: ArrayLike | None = None,
        ddq_max: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        start: float = 0.0,
        end: float = 0.0,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> TimedPath:
        """The fastest motion along a path within limits of torque, speed and acceleration.

        At the points all limits are kept. So that speeds and accelerations keep theirs between the points, too, the
        motion is slowed down as a whole by a certified bound of them; torques are checked there.

        Args:
            path: the path, from :func:`rrrgen.spline_path` or a :class:`rrrgen.Path` of own samples.
            tau_max: largest torques, friction included, (n,), N m or N; by default the limits of the robot file.
            dq_max: largest speeds, (n,), rad/s or m/s; by default the limits of the robot file.
            ddq_max: largest accelerations, (n,), rad/s^2 or m/s^2; by default the limits of the robot file.
            friction: friction parameters, (k,), SI units; by default those of the robot file.
            start: ds/dt at the first point; 0 starts at rest. It is divided by the stretch of the motion.
            end: ds/dt at the last point; 0 ends at rest. Likewise.
            beta: base parameters, (b,), SI units; by default those of the robot file.
            Ia: drive inertias, (n,), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,), m/s^2; by default the file's.

        Returns:
            The timed path: ``duration``, ``ds_dt`` and ``t`` at the points, and ``sample(times)``. A warning says where
            more points would make it faster by more than 2 %, or where torques between the points exceed their limits.

        Raises:
            InputError: the path or the limits are unusable, or no motion keeps them; the message says where.
            BuildError: the model has no compiler (backend="numpy").
        """
        if not isinstance(path, Path):
            given_type = type(path).__name__
            raise TypeError(f"time_path: path is of type {given_type}; rrrgen.spline_path(waypoints) makes a path")
        if gravity is not None and not self.spec.gravity_input:
            self._check_beta("time_path", beta)
            return self.any_gravity.time_path(
                path, tau_max=tau_max, dq_max=dq_max, ddq_max=ddq_max, friction=friction, start=start, end=end,
                beta=beta, Ia=Ia, gravity=gravity,
            )  # fmt: skip
        if path.q.shape[1] != self.n:
            raise InputError(f"time_path: the path has {path.q.shape[1]} joints, {self.spec.name} has {self.n}")
        kernel = self._timing_kernel()
        given = {"tau_max": tau_max, "dq_max": dq_max, "ddq_max": ddq_max}
        limits = {name: self._limits_of(name, value) for name, value in given.items()}
        chosen = self.nominal_gravity if gravity is None else gravity
        values = self._parameters_for(kernel, {"beta": self._with_drives("time_path", beta, Ia), "gravity": chosen})
        losses = self._friction_for(friction)
        status, where, ds_dt, t, stretch = kernel.time(path, limits, losses, (start, end), values)
        if status:
            heavy = self._heavy(path.q[where], limits["tau_max"], values)
            raise InputError(f"time_path: {kernel.text(status)}: point {where}, s = {path.s[where]:.6g}{heavy}")
        shares = kernel.check(path, limits, losses, values, ds_dt)
        between = f"time_path: between the {len(path.s)} points of the path"
        if shares[0] > 1.0 + EXCESS:
            text = f"the torques exceed their limits by up to {100.0 * (shares[0] - 1.0):.0f} %: take more points"
            warnings.warn(f"{between} {text}", stacklevel=2)
        if stretch > 1.0 + EXCESS:
            text = f"the whole motion takes {100.0 * (stretch - 1.0):.0f} % longer: take more points"
            warnings.warn(f"{between} speeds or accelerations are largest, and {text}", stacklevel=2)
        return TimedPath(path, ds_dt, t, kernel.sample, stretch, shares)

    def _heavy(self, q: Any, tau_max: Any, values: dict[str, Any]) -> str:
        """Text for an error message: the joints whose torque limits cannot hold the arm at ``q`` against gravity."""
        g = self._evaluate("gravity", (q,), self._of_links(values["beta"]), gravity=values.get("gravity"))[0]
        loads = zip(self.spec.joints, np.abs(g), tau_max, strict=True)
        overloads = [
            f"{joint.name} needs {need:.3g} and has {limit:.3g}" for joint, need, limit in loads if need > limit
        ]
        return f"; to hold the arm against gravity {', '.join(overloads)} N m (N)" if overloads else ""

    def _timing_kernel(self) -> TimingKernel:
        """The compiled kernel, built when it is first asked for."""
        if self._timing is None:
            if self.engine.name != "c":
                raise BuildError("time_path runs compiled C, and this model was made with backend='numpy'")
            program = self._with("path_dynamics").derived.programs["path_dynamics"]
            friction = self._with("friction_with").derived.programs["friction_with"]
            real: Real = "double" if self.engine.dtype == np.float64 else "float"
            self._timing = TimingKernel(self.spec.name, program, friction, real)
        return self._timing

    def _limits_of(self, name: str, value: Any) -> Any:
        """Limits (n,) of the quantity ``name``: ``value``, or those of the robot file if it is None."""
        key = {"tau_max": "torque", "dq_max": "velocity", "ddq_max": "acceleration"}[name]
        if value is None:
            stated = [getattr(joint.limits, key) for joint in self.spec.joints]
            value = [np.inf if limit is None else limit for limit in stated]
        return self._vector(name, value, self.n)

    def _friction_for(self, friction: ArrayLike | None) -> Any:
        """Friction parameters (k,): ``friction``, or those of the robot file if it is None; None without friction."""
        values = self.friction_parameters if friction is None else friction
        checked = self._vector("friction", values, self.friction_parameters.size)
        return checked if np.any(checked) else None

    def _parameters_for(self, kernel: TimingKernel, given: dict[str, Any]) -> dict[str, Any]:
        """Check the ``given`` parameters; returns those that the path dynamics take."""
        program = self._with("path_dynamics").derived.programs["path_dynamics"]
        sizes = {port.name: port.size for port in program.inputs}
        return {name: self._vector(name, given[name], sizes[name]) for name in kernel.further}

    @staticmethod
    def _vector(name: str, value: Any, size: int) -> Any:
        array = np.asarray(value, dtype=float)
        if array.shape != (size,):
            raise ValueError(f"time_path: {name} must be {size} numbers, ({size},), not {array.shape}")
        if np.any(np.isnan(array)):
            raise ValueError(f"time_path: {name} must be {size} numbers, not {array.tolist()}")
        return array


# ------------------------------------------------------------------------------------------------------------------
# The emitted C that computes the fastest motion along a path, compiled for one robot.
# ------------------------------------------------------------------------------------------------------------------

LIMITS = ("tau_max", "dq_max", "ddq_max")


class TimingKernel:
    """The compiled C functions that time a path, ``<name>_time_path``, and sample the result, ``<name>_timed_path``.

    ``path_dynamics`` and ``friction_with`` are the programs of the robot's dynamics along a path and of its friction.
    """

    def __init__(self, robot: str, path_dynamics: Program, friction_with: Program, real: Real) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.function_files import function_files
        from rrrgen.emit.c.language import Dialect
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
        return [np.ascontiguousarray(array, self.dtype) for array in (path.s, path.q, path.q_s, path.q_ss)]

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
        """Positions, velocities and accelerations, (m, n) each, of the timed path at the times ``times`` (m,), s.

        ``ds_dt`` and ``t`` (N,) are the timing at the N points of ``path``.
        """
        arrays = self._dense(path)
        held, call = self._path(arrays), getattr(self.lib, f"{self.robot}_timed_path")
        motion = tuple(np.empty((len(times), self.n), self.dtype) for _ in range(3))
        speeds, times_at_points = self._address(ds_dt), self._address(t)
        # rows are reached by arithmetic: a view each takes longer
        q, dq, ddq = (self._address(array) for array in motion)
        for row, now in zip(range(0, self.n * len(times), self.n), times.tolist(), strict=True):
            call(held, speeds, times_at_points, now, q + row, dq + row, ddq + row)
        return motion[0], motion[1], motion[2]


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


# ------------------------------------------------------------------------------------------------------------------
# A path with its timing: duration, speed along it, and the motion at any time.
# ------------------------------------------------------------------------------------------------------------------

Sampler = Callable[[Path, Array, Array, Array], tuple[Array, Array, Array]]


class TimedPath:
    """The fastest motion along ``path``: ``ds_dt`` (N,) and the times ``t`` (N,), s, at its points.

    ``speed_share`` and ``acceleration_share`` are the largest speed and acceleration over their limits at any time,
    at most 1. ``torque_share`` is the largest torque over its limit, at the points and at eighths between them. 0
    stands for no limit. The motion is slower by the factor ``stretch`` than the limits at the points alone allow.
    """

    def __init__(
        self,
        path: Path,
        ds_dt: Array,
        t: Array,
        sampler: Sampler,
        stretch: float,
        shares: tuple[float, float, float],
    ) -> None:
        self.path, self.ds_dt, self.t, self._sampler = path, ds_dt, t, sampler
        self.stretch = stretch
        self.torque_share, self.speed_share, self.acceleration_share = shares

    def __repr__(self) -> str:
        points, n = self.path.q.shape
        return f"<rrrgen.TimedPath: {n} joints, {points} points, {self.duration:.6g} s>"

    @property
    def duration(self) -> float:
        """The time from the first point to the last, s."""
        return float(self.t[-1])

    @property
    def d2s_dt2(self) -> Array:
        """Second time derivative of the path parameter s, constant between neighbouring points, (N - 1,)."""
        return np.asarray(np.diff(np.square(self.ds_dt)) / (2.0 * np.diff(self.path.s)))

    def sample(self, t: ArrayLike) -> Motion:
        """The desired motion at any times, for instance at the constant rate of a controller.

        Between the points q is the quintic polynomial in s that agrees with q, q_s and q_ss at both ends, as in the
        emitted function ``<name>_timed_path``. Before 0 and after the duration the arm rests at the nearer end.

        Args:
            t: times, (...), s.

        Returns:
            The named tuple (q_d, dq_d, ddq_d), (..., n) each, rad or m, per s and per s^2.
        """
        times = np.asarray(t, dtype=float)
        parts = self._sampler(self.path, self.ds_dt, self.t, times.reshape(-1))
        return Motion(*(part.reshape(*times.shape, self.path.q.shape[1]) for part in parts))
