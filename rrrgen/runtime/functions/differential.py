"""Differential inverse kinematics as a method of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.emit import Real
from rrrgen.emit.controller.differential_ik import DAMPING, TOLERANCE, declaration, differential_ik_files, steps
from rrrgen.runtime.arguments import prepare
from rrrgen.runtime.functions.table_functions import TableFunctions


class DifferentialFunctions(TableFunctions):
    """Differential inverse kinematics: joint speeds for a velocity of the tip, within all joint limits."""

    _differential: Solve | None = None

    def differential_ik(
        self,
        q: ArrayLike,
        dq_last: ArrayLike,
        J: ArrayLike,
        V: ArrayLike,
        *,
        weight: ArrayLike | None = None,
        dq_ref: ArrayLike | None = None,
        damping: ArrayLike = DAMPING,
        q_min: ArrayLike | None = None,
        q_max: ArrayLike | None = None,
        dq_max: ArrayLike | None = None,
        ddq_max: ArrayLike | None = None,
        Ts: ArrayLike,
        with_status: bool = False,
    ) -> Any:
        """Joint speeds for a velocity of the tip within speeds, accelerations and positions, through singularities too.

        Minimizes ``sum of weight_k (J dq - V)_k^2 + damping^2 |dq - dq_ref|^2`` inside the box of the speeds dq_max, of
        the change ``ddq_max Ts`` since the last tick, and of the speeds from which a joint still stops before the limit
        of its position. It is the C function ``<name>_differential_ik`` of ``generate --with control``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq_last: joint speeds of the last tick, (..., n), rad/s or m/s.
            J: Jacobian of the tip or of a point, (..., 6, n), linear rows first, SI units.
            V: wanted velocity, (..., 6), m/s and rad/s, in the axes of J.
            weight: weights of the rows, (6,) or (..., 6); zero leaves a row out; by default all are 1.
            dq_ref: joint speeds to prefer where V leaves a choice, (..., n), rad/s or m/s; by default zero.
            damping: positive; small beside the singular values of a regular J.
            q_min: lower limits, (n,) or (..., n), rad or m; by default those of the robot file.
            q_max: upper limits, (n,) or (..., n), rad or m; by default those of the robot file.
            dq_max: largest speeds, (n,) or (..., n), rad/s or m/s; by default those of the robot file.
            ddq_max: largest accelerations, (n,) or (..., n), rad/s^2 or m/s^2; by default those of the robot file.
            Ts: the period, (...), s.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            dq, (..., n), rad/s or m/s. The status, (...), is 0; 1 where a joint is too fast to keep its limits of speed
            or position, and slows down; 2 where the active set was not found in the steps allowed; 3 for an input that
            is not finite, limits that contradict each other, a negative weight, and damping or Ts that is not positive:
            then every joint brakes with ddq_max, and its speed is 0 where even that is not usable.

        Raises:
            numpy.linalg.LinAlgError: the status is not 0 at some state, and ``with_status`` is False.
        """
        limits = self._all_limits((q_min, q_max, dq_max, ddq_max))
        rest = np.zeros(self.n) if dq_ref is None else dq_ref
        values = [q, dq_last, J, V, np.ones(6) if weight is None else weight, rest, damping, *limits, Ts]
        ports = declaration(self.n).inputs
        batch, arrays = prepare("differential_ik", ports, values, self.engine.dtype)
        whole = [np.broadcast_to(array, (*batch, *port.shape)) for array, port in zip(arrays, ports, strict=True)]
        rows = [np.ascontiguousarray(stack.reshape(-1, *port.shape)) for stack, port in zip(whole, ports, strict=True)]
        dq, status = np.empty((len(rows[0]), self.n), self.engine.dtype), np.empty(len(rows[0]), np.intc)
        solve = self._solver()
        for k in range(len(dq)):
            status[k] = solve([row[k] for row in rows], dq[k])
        return self._check_solution(dq.reshape(*batch, self.n), status.reshape(batch), with_status)

    def _all_limits(self, given: tuple[Any, ...]) -> list[Any]:
        """The limits given, or those of the robot file: lowest and highest positions, speeds, accelerations."""
        joints = [joint.limits for joint in self.spec.joints]
        stated = (
            [-np.inf if limits.lower is None else float(limits.lower) for limits in joints],
            *(
                [np.inf if getattr(limits, name) is None else float(getattr(limits, name)) for limits in joints]
                for name in ("upper", "velocity", "acceleration")
            ),
        )
        return [default if value is None else value for value, default in zip(given, stated, strict=True)]

    def _solver(self) -> Solve:
        if self._differential is None:
            if self.engine.name == "numpy":
                self._differential = numpy_solver
            else:
                single = self.engine.dtype == np.float32
                self._differential = compiled_solver(self.spec.name, self.n, "float" if single else "double")
        return self._differential

    def _check_solution(self, dq: Any, status: Any, with_status: bool) -> Any:
        if with_status:
            return dq, status
        if np.any(status):
            first = int(np.argmax(status != 0))
            place = f"; {np.count_nonzero(status)} of {status.size} states" if status.ndim else ""
            raise np.linalg.LinAlgError(f"differential_ik: {MESSAGES[int(status.flat[first])]}{place}")
        return dq


# ------------------------------------------------------------------------------------------------------------------
# Differential inverse kinematics in Python: calls the emitted C, or the same active-set method in NumPy.
# ------------------------------------------------------------------------------------------------------------------

Array: TypeAlias = NDArray[Any]
Solve: TypeAlias = Callable[[Sequence[Array], Array], int]
"""Takes the arguments of the C function in its order, and the array for dq; returns the status."""

OK, LIMITS, STOPPED, INVALID = range(4)
MESSAGES = (
    "ok",
    "a joint is too fast for its limits",
    "no solution within the steps",
    "an input is not finite, limits contradict each other, a weight is negative, or damping or Ts is not positive",
)
"""Text for each status code."""


def compiled_solver(robot: str, n: int, real: Real) -> Solve:
    """Compile the emitted C function for a robot of ``n`` joints; the result calls it through cffi."""
    from rrrgen.runtime.build import build_extension

    name = f"{robot}_differential_ik"
    vectors, scalar = [f"const {real} *"] * 6, f"{real}"
    arguments = ", ".join([*vectors, scalar, *vectors[:4], scalar, f"{real} *"])
    ffi, lib = build_extension(differential_ik_files(robot, n, real), f"int {name}({arguments});", name)
    function, kind = getattr(lib, name), f"{real}[]"

    def solve(values: Sequence[Array], dq: Array) -> int:
        given = [float(value) if value.ndim == 0 else ffi.from_buffer(kind, value) for value in values]
        return int(function(*given, ffi.from_buffer(kind, dq)))

    return solve


def numpy_solver(values: Sequence[Array], dq: Array) -> int:
    """Solve one tick in NumPy, by the method of the emitted C; writes the speeds to ``dq`` (n,), returns the status.

    ``values`` are the inputs of the C function in its order.
    """
    q, dq_last, J, V, weight, dq_ref, damping, q_min, q_max, dq_max, ddq_max, Ts = values
    n = len(q)
    H = J.reshape(6, n).T @ (weight[:, None] * J.reshape(6, n)) + damping**2 * np.eye(n)
    g = -(J.reshape(6, n).T @ (weight * V)) - damping**2 * dq_ref
    finite = all(np.all(np.isfinite(array)) for array in (H, g, q, dq_last, Ts))
    ordered = np.all(q_max >= q_min) and np.all(dq_max >= 0) and np.all(ddq_max >= 0)
    if not (finite and ordered and damping > 0 and Ts > 0 and np.all(weight >= 0)):
        dq[:] = _slower(dq_last, ddq_max, float(Ts))
        return INVALID
    low, high, met = _box(q, dq_last, (q_min, q_max), dq_max, ddq_max, float(Ts))
    x, convergence = _active_set(H, g, low, high)
    dq[:] = np.minimum(np.maximum(x, low), high)
    return (OK if met else LIMITS) if convergence else STOPPED


def _slower(last: Array, ddq_max: Array, Ts: float) -> Array:
    """The speeds (n,) that are left of ``last`` after a period of braking; 0 where that is not known."""
    with np.errstate(invalid="ignore"):
        change = ddq_max * Ts
        known = np.isfinite(last) & np.isfinite(change) & (ddq_max >= 0) & (Ts > 0) & (np.abs(last) > change)
        return np.where(known, last - np.sign(last) * change, 0.0)


def _approach(d: Array, ddq_max: Array, Ts: float) -> Array:
    """Largest joint speeds v (n,) that still allow a stop within the distances ``d`` (n,), rad or m.

    ``d = v Ts + v^2/(2 ddq_max)``: one period ``Ts`` (s) at that speed, then braking with ``ddq_max``.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = 2 * d / (Ts + np.sqrt(Ts * Ts + 2 * np.maximum(d, 0) / ddq_max))
    return np.where(d > 0, np.where(np.isinf(d), d, speed), 0.0)


def _box(
    q: Array, dq_last: Array, limits: tuple[Array, Array], dq_max: Array, ddq_max: Array, Ts: float
) -> tuple[Array, Array, bool]:
    """Lower and upper bounds of the joint speeds (n,) that follow from all limits, and whether they can all be met.

    They cannot if a joint is too fast to keep its limits of speed or position with the largest acceleration.
    """
    slowest, fastest = dq_last - ddq_max * Ts, dq_last + ddq_max * Ts
    high = np.minimum(_approach(limits[1] - q, ddq_max, Ts), dq_max)
    low = -np.minimum(_approach(q - limits[0], ddq_max, Ts), dq_max)
    above, below = high < slowest, low > fastest
    low, high = np.maximum(low, slowest), np.minimum(high, fastest)
    low, high = np.where(below, fastest, low), np.where(above, slowest, high)
    return low, high, not np.any(above | below)


def _active_set(H: Array, g: Array, low: Array, high: Array) -> tuple[Array, bool]:
    """Minimize ``x' H x/2 + g' x`` subject to ``low <= x <= high`` by block pivoting; False if it did not converge."""
    n, tolerance = len(g), TOLERANCE * float(np.finfo(float).eps)
    fixed = low >= high
    at = np.where(fixed, -1, 0)
    x = low.astype(float)
    fewest, patience = n + 1, 0
    for _ in range(steps(n)):
        x = np.where(at < 0, low, np.where(at > 0, high, 0.0))
        free = at == 0
        if np.any(free):
            x[free] = np.linalg.solve(H[np.ix_(free, free)], -g[free] - H[np.ix_(free, ~free)] @ x[~free])
        slack = tolerance * np.abs(x)
        outside = np.where(x < low - slack, -1, np.where(x > high + slack, 1, 0))
        slope, size = g + H @ x, np.abs(g) + np.abs(H) @ np.abs(x)
        leaves = (np.where(at < 0, slope, -slope) < -tolerance * size) & ~fixed
        to = np.where(free, outside, np.where(leaves, 0, at))
        wrong = np.flatnonzero(to != at)
        if not len(wrong):
            return x, True
        fewest, patience = (len(wrong), 3) if len(wrong) < fewest else (fewest, patience - 1)
        at = to if patience >= 0 else np.where(np.arange(n) == wrong[-1], to, at)
    return np.where(at < 0, low, np.where(at > 0, high, x)), False
