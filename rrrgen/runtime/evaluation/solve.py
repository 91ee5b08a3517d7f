"""Solves the inverse kinematics for one target in floats: every solution, or the reason why there is none.

The method is that of the emitted C (``templates/c/ik/solve.c``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, sin, sqrt
from typing import TYPE_CHECKING

from rrrgen.errors import DerivationError
from rrrgen.ik.derive import ARM_ANGLE
from rrrgen.ik.tolerances import LONGEST_TOOL
from rrrgen.runtime.evaluation.branches import Query, Row, candidates
from rrrgen.runtime.evaluation.free_joints import FIXED, GONE, FreeJoints
from rrrgen.runtime.evaluation.kernels import INEXACT, MULTIPLE, NEAR, OUTSIDE, SEARCH, TOLERANCE, Settings
from rrrgen.runtime.evaluation.limits import Limits
from rrrgen.runtime.evaluation.targets import accuracy_of, repaired
from rrrgen.runtime.evaluation.task import DESCENT, PATIENT, USUAL, Task

if TYPE_CHECKING:
    from rrrgen.ik.plan import SolverPlan

OK, UNREACHABLE, OUTSIDE_LIMITS, NOT_FINITE, NOT_A_ROTATION, INCOMPLETE = range(6)
"""The statuses of the emitted code."""

_PUBLIC = 15


@dataclass(frozen=True)
class Wish:
    """Options of a call.

    ``limits`` keeps only solutions within the joint limits, ``nearest`` sorts them by the distance from the reference,
    ``residual`` also keeps solutions that meet the target only in part, as an arm of few joints does.
    """

    limits: bool = False
    nearest: bool = False
    residual: bool = False


@dataclass(frozen=True)
class Answer:
    """Result for one target: ``status``, solutions ``rows`` (their residuals not squared), and why there are none.

    ``stage`` is the number of the equation without a real root, ``distance`` (m) that of the target from the workspace.
    """

    status: int
    rows: tuple[Row, ...] = ()
    stage: int = 0
    distance: float = 0.0


class Evaluation:
    """Inverse kinematics of the solver ``plan``, evaluated in Python.

    ``reasons`` is the number of different texts that explain why a target has no solution. Raises DerivationError for a
    plan that is solved by elimination, for which only emitted C exists.
    """

    def __init__(self, plan: SolverPlan, reasons: int) -> None:
        self._parts = [plan] if plan.companion is None else [plan, plan.companion]
        if any(part.general for part in self._parts):
            raise DerivationError(f"{plan.chain.name}: {plan.title}: solved by the emitted C only; use the C backend")
        self._plan, self._chain = plan, plan.chain
        self._limits = Limits(plan.chain)
        self._banded = plan.snapped or plan.companion is not None
        self._most = max(part.max_solutions for part in self._parts)
        self._far_stage = reasons - 1 - bool(plan.incomplete)

    def solve(self, target: Sequence[float], q_ref: Sequence[float] | None, given: float, wish: Wish) -> Answer:
        """Find every solution for a ``target``: a position (3 numbers, m), that of the tool behind it if it is
        an input, or a pose (16 numbers, row-major).

        ``q_ref`` is the reference configuration or None, ``given`` the redundancy parameter, ``wish`` the options.
        """
        call = self.called(target, q_ref, given, wish)
        return call if isinstance(call, Answer) else call.solve()

    def closest(self, target: Sequence[float], q_ref: Sequence[float] | None, given: float, wish: Wish) -> Answer:
        """Find the configuration with the smallest error to a ``target``; arguments are those of :meth:`solve`."""
        call = self.called(target, q_ref, given, wish)
        return call if isinstance(call, Answer) else call.closest()

    def called(self, target: Sequence[float], q_ref: Sequence[float] | None, given: float, wish: Wish) -> Call | Answer:
        """Check the target; returns a call that can be solved, or the answer that says what is wrong with it."""
        if not all(map(isfinite, [*target, *(q_ref or ()), given])):
            return Answer(NOT_FINITE)
        T = repaired(target) if len(target) == 16 else list(target)
        if T is None:
            return Answer(NOT_A_ROTATION)
        place, tool = ((T[3], T[7], T[11]), ()) if len(T) == 16 else (T[:3], T[3:])
        longest = LONGEST_TOOL * self._chain.reach
        if any(abs(x) >= 1e6 * self._chain.scale for x in place) or any(abs(x) >= longest for x in tool):
            return Answer(UNREACHABLE, (), self._far_stage, -1.0)
        query = Query(T, [0.0] * self._chain.n if q_ref is None else q_ref, given)
        return Call(self, query, q_ref, accuracy_of(target, self._chain), wish)


class Call:
    """One call of the inverse kinematics, with a checked target ``query`` and the options ``wish``.

    ``accuracy`` is the assumed relative accuracy of the target.
    """

    def __init__(
        self, solver: Evaluation, query: Query, q_ref: Sequence[float] | None, accuracy: float, wish: Wish
    ) -> None:
        self._plan, self._parts, self._most = solver._plan, solver._parts, solver._most
        self._limits, self._banded, self._far_stage = solver._limits, solver._banded, solver._far_stage
        self.T = query.T
        self._query, self._q_ref, self._accuracy, self._wish = query, q_ref, accuracy, wish
        self._task = Task(solver._plan, query.T)
        self._usual = Settings(TOLERANCE["slack"], TOLERANCE["free"], 0.0 if solver._banded else None)
        self._rows: list[Row] = []
        self._stage = 0

    def solve(self) -> Answer:
        """Find all solutions; without any, find the distance of the nearest configuration from the target."""
        found = self._collect()
        self._rows, inside = self._finished(self._rows, self._q_ref)
        outside, distance = not inside, 0.0
        if not self._rows and not outside:
            if found:  # perhaps from slightly negative discriminants: without tolerance, the failing equation shows
                rows, self._stage = candidates(self._plan, self._query, replace(self._usual, slack=0.0))
                self._stage = self._far_stage - 1 if rows else self._stage
            kept, _, distance = self.descended()
            self._rows, _ = self._finished(kept, self._query.reference)
            outside = bool(kept)
        if not self._rows:
            return self._nothing(outside, distance)
        if self._wish.nearest:
            self._rows.sort(key=self._away)
        return Answer(INCOMPLETE if self._plan.incomplete else OK, tuple(self._rows), 0, distance)

    def closest(self) -> Answer:
        """Find the configuration with the smallest task error, by minimization from several initial configurations."""
        kept, best, distance = self.descended()
        rows, _ = self._finished([*kept, best][:1], self._query.reference)
        return Answer(OK if rows else OUTSIDE_LIMITS, tuple(rows), 0, distance)

    def _nothing(self, outside: bool, distance: float) -> Answer:
        if self._plan.incomplete:
            return Answer(INCOMPLETE, (), self._far_stage + 1 if outside else self._stage, distance)
        if outside:
            return Answer(OUTSIDE_LIMITS, (), 0, distance)
        return Answer(UNREACHABLE, (), self._stage, distance)

    def _collect(self) -> int:
        """Collect the solutions that meet the task; returns how many candidates the equations solved last had."""
        count = near = 0
        for part in self._parts:
            rows, stage = candidates(part, self._query, self._usual)
            count, self._stage = len(rows), max(self._stage, stage)
            self._reopen(part, rows)
            for row in rows:
                near |= row.flags & NEAR
                self._keep(row)
        if self._banded and (near or not self._rows):
            # near a double root: moved apart by the band, its two parts are candidates for the true arm
            for share in (1.0, SEARCH["band_2"], SEARCH["band_3"]):
                settings = replace(self._usual, band=TOLERANCE["band"] * share)
                rows, stage = candidates(self._parts[-1], self._query, settings)
                count, self._stage = len(rows), max(self._stage, stage)
                for row in rows:
                    self._keep(row)
        return count

    def _reopen(self, part: SolverPlan, rows: list[Row]) -> None:
        limits = self._limits if self._wish.limits and self._limits.any else None
        FreeJoints(part, self._task, self._query, self._usual, self._accuracy, limits).reopen(rows)

    def _keep(self, row: Row) -> None:
        if len(self._rows) < self._most and self._settled(row):
            row.flags &= _PUBLIC
            if not self._repeated(self._rows, row):
                self._rows.append(row)

    def _settled(self, row: Row) -> bool:
        """Whether a candidate meets the target; it is refined by a few Newton steps if it is not accurate enough."""
        if row.flags & GONE:
            return False
        if row.flags & FIXED or 0.0 <= row.residual <= TOLERANCE["tight"]:
            return True
        if self._plan.virtual and row.residual > TOLERANCE["loose"] and not self._wish.residual:
            return False
        row.q, row.residual = self._task.refine(row.q, *(PATIENT if self._banded else USUAL))
        if not row.residual <= TOLERANCE["accept"]:
            if not self._wish.residual or not row.residual <= SEARCH["beyond"]:
                return False
            row.flags |= INEXACT
        return True

    def _repeated(self, rows: list[Row], row: Row) -> bool:
        """Whether the solution ``row`` equals one of ``rows``, which is then flagged as a multiple root."""
        for other in rows:
            if self._task.apart(row.q, other.q) < TOLERANCE["same"]:
                other.flags |= MULTIPLE
                return True
        return False

    def _finished(self, rows: Sequence[Row], reference: Sequence[float] | None) -> tuple[list[Row], bool]:
        """Solutions with their angles moved by full turns next to ``reference`` and within the limits if possible.

        The squared residuals of the ``rows`` are replaced by their roots; solutions outside the limits are left out or
        flagged. Also returns whether all were within the limits.
        """
        kept, every = [], True
        for row in rows:
            q, inside = self._limits.placed(row.q, reference)
            every = every and inside
            if inside or not self._wish.limits:
                flags = row.flags if inside else row.flags | OUTSIDE
                kept.append(Row(q, flags, row.branch, sqrt(row.residual)))
        return kept, every

    def _away(self, row: Row) -> float:
        reference = self._q_ref or [0.0] * len(row.q)
        units = [1.0 if joint.revolute else self._plan.chain.reach for joint in self._plan.chain.joints]
        return sum(((x - r) / unit) ** 2 for x, r, unit in zip(row.q, reference, units, strict=True))

    def descended(self) -> tuple[list[Row], Row, float]:
        """Minimize the task error from several initial configurations, for a target without solutions.

        The initial ones are those of all branches with negative discriminants set to zero, and a few more. Returns the
        solutions found after all, the configuration with the smallest error, and its distance from the target, m.
        """
        found, _ = candidates(self._parts[-1], self._query, replace(self._usual, slack=1e30))
        reference, locked = self._query.reference, self._plan.locked
        kept: list[Row] = []
        best = Row(list(reference), INEXACT, 0, 1e30)
        for start in range(len(found) + int(SEARCH["starts"])):
            if len(kept) >= self._most or (start == len(found) and kept):
                break
            if start < len(found):
                x, branch = list(found[start].q), found[start].branch
            else:
                away = SEARCH["spread"] if start > len(found) else 0.0
                x, branch = [r + away * sin(start * (i + 1)) for i, r in enumerate(reference)], 0
            if locked not in (None, ARM_ANGLE):
                x[locked] = self._query.given
            q, cost = self._task.refine(x, *DESCENT)
            if cost <= TOLERANCE["accept"]:
                row = Row(q, MULTIPLE, branch, cost)
                if (kept or cost < best.residual) and not self._repeated(kept, row):
                    kept.append(row)
            if cost < best.residual:
                best = Row(q, INEXACT if cost > TOLERANCE["accept"] else MULTIPLE, branch, cost)
        return kept, best, 0.0 if kept else sqrt(best.residual) * self._plan.chain.reach
