"""Differential inverse kinematics as a method of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.emit.controller.differential_ik import DAMPING, declaration
from rrrgen.runtime.arguments import prepare
from rrrgen.runtime.functions.table_functions import TableFunctions

if TYPE_CHECKING:
    from rrrgen.runtime.differential_ik import Solve


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
        rows = [np.ascontiguousarray(each.reshape(-1, *port.shape)) for each, port in zip(whole, ports, strict=True)]
        dq, status = np.empty((len(rows[0]), self.n), self.engine.dtype), np.empty(len(rows[0]), np.intc)
        solve = self._solver()
        for k in range(len(dq)):
            status[k] = solve([row[k] for row in rows], dq[k])
        return self._judged(dq.reshape(*batch, self.n), status.reshape(batch), with_status)

    def _all_limits(self, given: tuple[Any, ...]) -> list[Any]:
        """The limits given, or those of the robot file: lowest and highest positions, speeds, accelerations."""
        joints = [joint.limits for joint in self.spec.joints]
        stated = (
            [-np.inf if each.lower is None else float(each.lower) for each in joints],
            *(
                [np.inf if getattr(each, name) is None else float(getattr(each, name)) for each in joints]
                for name in ("upper", "velocity", "acceleration")
            ),
        )
        return [own if value is None else value for value, own in zip(given, stated, strict=True)]

    def _solver(self) -> Solve:
        if self._differential is None:
            from rrrgen.runtime.differential_ik import compiled_solver, numpy_solver

            if self.engine.name == "numpy":
                self._differential = numpy_solver
            else:
                single = self.engine.dtype == np.float32
                self._differential = compiled_solver(self.spec.name, self.n, "float" if single else "double")
        return self._differential

    def _judged(self, dq: Any, status: Any, with_status: bool) -> Any:
        if with_status:
            return dq, status
        if np.any(status):
            from rrrgen.runtime.differential_ik import MESSAGES

            first = int(np.argmax(status != 0))
            place = f"; {np.count_nonzero(status)} of {status.size} states" if status.ndim else ""
            raise np.linalg.LinAlgError(f"differential_ik: {MESSAGES[int(status.flat[first])]}{place}")
        return dq
