"""Task error of an inverse-kinematics solution and its refinement, by the method of ``templates/c/ik/refine.c``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.ik.geometry.chain import multiply, translation
from rrrgen.ik.interpreter.branches import SEARCH, TOLERANCE
from rrrgen.ik.plan import ARM_ANGLE
from rrrgen.ik.recording.float_builder import wrapped
from rrrgen.ik.tolerances import elimination

if TYPE_CHECKING:
    from rrrgen.ik.interpreter.branches import Row
    from rrrgen.ik.plan import SolverPlan


ELIMINATION = elimination()

USUAL = (int(SEARCH["steps"]), SEARCH["damping"])
PATIENT = (int(SEARCH["descent_steps"]), SEARCH["damping"])
DESCENT = (int(SEARCH["descent_steps"]), SEARCH["descent_damping"])
"""Largest number of steps and initial damping of a refinement: USUAL for a candidate, PATIENT for a candidate from the
equations of a similar arm, DESCENT for a search from any configuration."""


class Task:
    """Task that solutions for one target must meet: its position, or its pose; lengths are relative to the reach."""

    def __init__(self, plan: SolverPlan, T: Sequence[float]) -> None:
        self.chain = plan.chain
        if plan.last_link is not None:
            self.chain = replace(plan.chain, tip=multiply(plan.last_link, translation((T[3], T[4], T[5]))))
        self._position = plan.task == "position"
        self._target = np.array(T[:3]) if self._position else np.array(T).reshape(4, 4)
        self._revolute = np.array([joint.revolute for joint in self.chain.joints])
        self._reach = plan.chain.reach
        self._units = np.where(self._revolute, 1.0, self._reach)
        self._locked = None if plan.locked in (None, ARM_ANGLE) else plan.locked

    def error(self, q: Any, held: int = 0) -> tuple[Any, Any]:
        """Remaining task error at ``q`` (angles in rad, lengths over the reach), and its Jacobian by q.

        The Jacobian's columns are zero for the joints in ``held`` (bit mask), which do not move.
        """
        F, J = self.chain.forward(q), self.chain.jacobian(q)
        J[:3] *= np.where(self._revolute, 1.0 / self._reach, 1.0)
        for k in range(self.chain.n):
            if (held >> k) & 1 or k == self._locked:
                J[:, k] = 0.0
        if self._position:
            return (self._target - F[:3, 3]) / self._reach, J[:3]
        missing = (self._target[:3, 3] - F[:3, 3]) / self._reach
        return np.concatenate([missing, _axis(self._target[:3, :3] @ F[:3, :3].T)]), J

    def refine(self, q: list[float], steps: int, damping: float, held: int = 0) -> tuple[list[float], float]:
        """Refine ``q`` by at most ``steps`` Levenberg-Marquardt steps.

        Returns the best configuration and its squared task error. ``damping`` is the initial one; joints in ``held``
        (bit mask) do not move.
        """
        x = np.array(q)
        e, J = self.error(x, held)
        cost = best = float(e @ e)
        found, worse = x.copy(), 0
        for _ in range(steps):
            if not (best > TOLERANCE["done"] and damping < SEARCH["most_damping"]):
                break
            d = _step(J, e, damping * cost**0.5 + TOLERANCE["eps"])
            x = x + d / max(1.0, float(np.abs(d).max(initial=0.0))) * self._units
            e, J = self.error(x, held)
            cost = float(e @ e)
            if cost < best:
                stuck = cost > SEARCH["stuck"] * best and damping > 1.0
                found, best, worse = x.copy(), cost, 0
                damping = SEARCH["less_damping"] * damping if damping > SEARCH["damping"] else damping
                if stuck:
                    break
            else:
                worse += 1
                if worse > SEARCH["worse_steps"] or not cost < SEARCH["diverged"]:
                    x, worse, damping = found.copy(), 0, SEARCH["more_damping"] * damping
                    e, J = self.error(x, held)
                    cost = float(e @ e)
        return [float(value) for value in found], best

    def aspect(self, q: Sequence[float]) -> int:
        """0 where the determinant of the Jacobian by the joints that are not prescribed is positive, else 1."""
        return int(not np.linalg.det(self._moving(q)) > 0.0)

    def smallest_gain(self, q: Sequence[float]) -> float:
        """The smallest singular value of that Jacobian, with lengths over the reach; 0 at a singular configuration."""
        return float(np.linalg.svd(self._moving(q), compute_uv=False)[-1])

    def _moving(self, q: Sequence[float]) -> Any:
        _, J = self.error(np.array(q))
        return J[:, [k for k in range(self.chain.n) if k != self._locked]]

    def reaches(self, q: Sequence[float], goal: float, steps: int, held: int) -> list[float] | None:
        """A configuration near ``q`` with the joints in ``held`` (bit mask) where they are that meets the target.

        Its squared task error is at most ``goal``. None if ``steps`` damped Gauss-Newton steps do not find it, or two
        of them do not halve the error.
        """
        x, cost, before = np.array(q), 0.0, 0.0
        while True:
            earlier, before = before, cost
            e, J = self.error(x, held)
            cost = float(e @ e)
            if cost <= goal:
                return [float(value) for value in x]
            if steps == 0 or (earlier > 0.0 and not 4.0 * cost < earlier):
                return None
            d = _step(J, e, SEARCH["damping"] * cost**0.5 + TOLERANCE["eps"])
            x = x + d / max(1.0, float(np.abs(d).max(initial=0.0))) * self._units
            steps -= 1

    def freed(self, row: Row, reference: Sequence[float]) -> bool:
        """Whether the singular solution ``row`` is one of a continuum, in which a joint can turn freely.

        If so it becomes the one with that joint at its value in ``reference``, if a path of solutions leads there.
        """
        moving = [k for k in range(self.chain.n) if k != self._locked]
        gain = np.linalg.svd(self._moving(row.q))[2][-1]
        j = moving[int(np.argmax(np.abs(gain)))]
        goal = (2.0 * ELIMINATION["done"]) ** 2

        def turned(q: Sequence[float], by: float) -> list[float] | None:
            x = list(q)
            x[j] += by
            return self.reaches(x, goal, int(ELIMINATION["steps"]), 1 << j)

        turn = TOLERANCE["turn"] * self._units[j]
        if turned(row.q, turn) is None and turned(row.q, -turn) is None:
            return False
        steps, by = int(SEARCH["path_steps"]), reference[j] - row.q[j]
        q: list[float] | None = row.q
        for _ in range(steps):
            q = None if q is None else turned(q, (wrapped(by) if self._revolute[j] else by) / steps)
        row.q = row.q if q is None else q
        return True

    def between(self, a: Sequence[float], b: Sequence[float], part: float) -> list[float]:
        """The configuration a + part (b - a), with differences of angles by at most pi."""
        return [
            x + part * (wrapped(y - x) if turning else y - x)
            for x, y, turning in zip(a, b, self._revolute, strict=True)
        ]

    def apart(self, a: Sequence[float], b: Sequence[float]) -> float:
        """Largest difference of two configurations: angles in rad, modulo full turns, displacements over the reach."""
        return max(
            (
                abs(wrapped(x - y)) if turning else abs(x - y) / self._reach
                for x, y, turning in zip(a, b, self._revolute, strict=True)
            ),
            default=0.0,
        )


def _step(J: Any, e: Any, damping: float) -> Any:
    """The step d that minimises |J d - e|^2 + damping^2 |d|^2."""
    n = J.shape[1]
    A = np.vstack([J, damping * np.eye(n)])
    return np.linalg.lstsq(A, np.concatenate([e, np.zeros(n)]), rcond=None)[0]


def _axis(E: Any) -> Any:
    """Rotation vector (3,) of the rotation matrix ``E``: its axis, with the angle (rad) as length.

    Below 26 degrees the length is the sine of the angle, which suffices for the iteration.
    """
    e = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    s2, c = float(e @ e), 0.5 * (float(np.trace(E)) - 1.0)
    if c >= SEARCH["small_turn"]:
        return e
    if s2 > TOLERANCE["eps"]:
        return e * (np.arctan2(s2**0.5, c) / s2**0.5)
    j = int(np.argmax(np.diag(E)))
    half = E[:, j] + np.eye(3)[j]
    return half * (np.pi / np.linalg.norm(half))
