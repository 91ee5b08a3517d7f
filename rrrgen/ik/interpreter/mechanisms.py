"""Inverse kinematics, in floats, of a mechanism in which joints follow other joints.

The chain from base to tip, one row of the DH table after the other, is solved as if each row had its own drive. Of its
solutions y those are kept for which positions q of the driven joints with ``y = S q`` exist; every such q is refined on
the mechanism itself. The method is that of the emitted C (``templates/c/ik/coupled.c``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.errors import InternalError
from rrrgen.ik.interpreter.branches import FREE, INEXACT, SEARCH, TOLERANCE, Row
from rrrgen.ik.interpreter.refinement import USUAL, Task
from rrrgen.ik.interpreter.solve import (
    INCOMPLETE,
    OK,
    OUTSIDE_LIMITS,
    PUBLIC,
    Answer,
    Call,
    Evaluation,
    Wish,
    descended,
    finished,
    sort_by_distance,
    without_solution,
)
from rrrgen.ik.interpreter.targets_and_limits import NONE
from rrrgen.ik.plan import ARM_ANGLE
from rrrgen.ik.result_layout import most_rows, reasons_of

if TYPE_CHECKING:
    from rrrgen.ik.geometry.mechanism import Coupling
    from rrrgen.ik.plan import SolverPlan


class CoupledTask(Task):
    """Task that solutions for one target must meet, as a function of the positions q of the driven joints."""

    def __init__(self, plan: SolverPlan, coupling: Coupling, T: Sequence[float]) -> None:
        super().__init__(plan, T)
        self._coupling, self._row_units = coupling, self._units
        self._units = np.where(coupling.revolute, 1.0, self.chain.reach)
        self._rates = np.array(coupling.matrix) * self._units / self._row_units[:, None]
        self.held = None if self._locked is None else coupling.leader(self._locked)

    def error(self, q: Any, held: int = 0) -> tuple[Any, Any]:
        """Remaining task error at the positions ``q`` of the driven joints, and its Jacobian by q.

        Lengths are relative to the reach, angles in rad; ``held`` is not used.
        """
        e, J = super().error(self._coupling.rows(q))
        J = J @ self._rates
        if self.held is not None:
            J[:, self.held] = 0.0  # the prescribed joint does not move
        return e, J

    def off(self, y: Sequence[float], q: Sequence[float]) -> float:
        """Largest difference of the displacements ``y`` of the chain from S ``q``: rad, or lengths over the reach."""
        return super().apart(self._coupling.rows(q), y)

    def apart(self, a: Sequence[float], b: Sequence[float]) -> float:
        """Largest difference of the displacements ``S q`` of two configurations: rad, or lengths over the reach.

        Each q counts modulo its period.
        """
        d = [
            x - y - (period * ceil((x - y) / period - 0.5) if period else 0.0)
            for x, y, period in zip(a, b, self._coupling.periods, strict=True)
        ]
        return float(np.max(np.abs(self._coupling.rows(d)) / self._row_units, initial=0.0))


class CoupledEvaluation:
    """Inverse kinematics of a mechanism with the solver ``plan``, evaluated in Python."""

    def __init__(self, plan: SolverPlan) -> None:
        if plan.coupling is None:
            raise InternalError("the plan has no coupling")
        chain = replace(plan, coupling=None)
        self._plan, self._coupling, self._most = plan, plan.coupling, most_rows(plan)
        self._chain = Evaluation(chain, len(reasons_of(chain)))
        self._unfit = len(reasons_of(plan)) - 1

    def solve(self, target: Sequence[float], q_ref: Sequence[float] | None, given: float, wish: Wish) -> Answer:
        """Find every solution for a ``target``: a position (3 numbers, m) or a pose (16 numbers, row-major).

        ``q_ref`` is the reference configuration or None, ``given`` the redundancy parameter, ``wish`` the options.
        """
        call = self._called(target, q_ref, given, wish)
        if isinstance(call, Answer):
            return call
        found, task = call.solve(), CoupledTask(self._plan, self._coupling, call.T)
        kept: list[Row] = []
        for row in found.rows:
            self._couple(task, row, wish, kept)
        rows, inside = self._finished(kept, q_ref, wish)
        outside, distance, stage = not inside, 0.0, self._unfit if found.rows else found.stage
        doubt = bool(self._plan.incomplete) or found.status == INCOMPLETE
        if not rows and not outside:
            kept, _, distance = self._descended(call, task, q_ref, given)
            rows, _ = self._finished(kept, q_ref, wish)
            outside = bool(kept)
            doubt |= outside and self._plan.general
        if not rows:
            outside |= doubt and self._plan.general
            return without_solution(doubt, outside, self._unfit - 1, stage, distance)
        if wish.nearest:
            units = [1.0 if turning else self._plan.chain.reach for turning in self._coupling.revolute]
            sort_by_distance(rows, q_ref or [0.0] * self._coupling.n, units)
        return Answer(INCOMPLETE if doubt else OK, tuple(rows), 0, distance)

    def closest(self, target: Sequence[float], q_ref: Sequence[float] | None, given: float, wish: Wish) -> Answer:
        """Find the configuration with the smallest error to a ``target``; arguments are those of :meth:`solve`."""
        call = self._called(target, q_ref, given, wish)
        if isinstance(call, Answer):
            return call
        task = CoupledTask(self._plan, self._coupling, call.T)
        kept, best, distance = self._descended(call, task, q_ref, given)
        rows, _ = self._finished([*kept, best][:1], q_ref, wish)
        return Answer(OK if rows else OUTSIDE_LIMITS, tuple(rows), 0, distance)

    def _called(
        self, target: Sequence[float], q_ref: Sequence[float] | None, given: float, wish: Wish
    ) -> Call | Answer:
        y = self._coupling.rows([0.0] * self._coupling.n if q_ref is None else q_ref)
        return self._chain.called(target, y, given, Wish(residual=wish.residual))

    def _couple(self, task: CoupledTask, row: Row, wish: Wish, kept: list[Row]) -> None:
        """Append to ``kept`` all positions q of the driven joints that belong to the solution ``row`` of the chain."""
        for q in self._coupling.leading(row.q):
            flags = row.flags
            if task.off(row.q, q) > SEARCH["coupled"] and not flags & FREE and not wish.residual:
                continue
            e, _ = task.error(q)
            cost = float(e @ e)
            if not cost <= TOLERANCE["tight"]:
                q, cost = task.refine(q, *USUAL)
            if not cost <= TOLERANCE["accept"]:
                if not wish.residual or not cost <= SEARCH["beyond"]:
                    continue
                flags |= INEXACT
            if len(kept) < self._most and all(task.apart(q, other.q) >= TOLERANCE["same"] for other in kept):
                kept.append(Row(q, flags & PUBLIC, row.branch, cost))

    def _descended(
        self, call: Call, task: CoupledTask, q_ref: Sequence[float] | None, given: float
    ) -> tuple[list[Row], Row, float]:
        """Minimize the task error from what is nearest on the chain without the coupling, and a few more starts.

        See :func:`~rrrgen.ik.interpreter.solve.descended`.
        """
        reference, locked = [0.0] * self._coupling.n if q_ref is None else list(q_ref), self._plan.locked
        found, nearest, _ = call.descended()
        starts = [(next(self._coupling.leading(row.q)), row.branch) for row in found or [nearest]]
        fixed = None
        if task.held is not None and locked not in (None, ARM_ANGLE):
            fixed = (task.held, given / self._coupling.matrix[locked][task.held])
        return descended(task, starts, reference, fixed, self._most)

    def _finished(self, rows: Sequence[Row], q_ref: Sequence[float] | None, wish: Wish) -> tuple[list[Row], bool]:
        return finished(rows, wish, lambda q: self._placed(q, q_ref))

    def _placed(self, q: Sequence[float], q_ref: Sequence[float] | None) -> tuple[list[float], bool]:
        """Move ``q`` by full periods next to ``q_ref`` and within the limits if possible.

        Returns the moved positions, and whether all limits are met.
        """
        margin, inside, placed = TOLERANCE["limit"], True, []
        for k, (x, period, (lower, upper)) in enumerate(
            zip(q, self._coupling.periods, self._coupling.limits, strict=True)
        ):
            low, high = _end(lower, -1) - margin, _end(upper, 1) + margin
            if period:
                middle = 0.0 if q_ref is None else q_ref[k]
                x -= period * ceil((x - middle) / period - 0.5)
                moved = x + period * (ceil(max(low - x, 0.0) / period) - ceil(max(x - high, 0.0) / period))
                x = moved if low <= moved <= high else x
            inside = inside and low <= x <= high
            placed.append(x)
        for each in self._coupling.followers:
            value = sum(f * x for f, x in zip(each.factors, placed, strict=True))
            inside = inside and _end(each.lower, -1) - margin <= value <= _end(each.upper, 1) + margin
        return placed, inside


def _end(limit: float | None, side: int) -> float:
    return side * NONE if limit is None else limit
