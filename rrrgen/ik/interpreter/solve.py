"""Solves the inverse kinematics for one target in floats: every solution, or the reason why there is none.

The method is that of the emitted C (``templates/c/ik/solve.c``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sin, sqrt
from typing import TYPE_CHECKING

from rrrgen.ik.interpreter.branches import (
    INEXACT,
    MULTIPLE,
    NEAR,
    OUTSIDE,
    SEARCH,
    TOLERANCE,
    Query,
    Row,
    Settings,
    candidates,
)
from rrrgen.ik.interpreter.free_joints import FIXED, GONE, FreeJoints
from rrrgen.ik.interpreter.general_6r import ELIMINATION, General6R
from rrrgen.ik.interpreter.refinement import DESCENT, PATIENT, USUAL, Task
from rrrgen.ik.interpreter.targets_and_limits import Limits, accuracy_of, repaired
from rrrgen.ik.plan import ARM_ANGLE
from rrrgen.ik.result_layout import may_lack
from rrrgen.ik.tolerances import FARTHEST, LONGEST_TOOL

if TYPE_CHECKING:
    from rrrgen.ik.plan import SolverPlan


# ------------------------------------------------------------------------------------------------------------------
# What a call of the inverse kinematics returns, and how it ends, for an arm as for a mechanism.
#
# The solutions get their final form, or a descent from many starts looks for the nearest configuration. The method is
# that of the emitted C (``templates/c/ik/finish.c``, ``descend.c`` and ``solve.c``).
# ------------------------------------------------------------------------------------------------------------------

OK, UNREACHABLE, OUTSIDE_LIMITS, NOT_FINITE, NOT_A_ROTATION, INCOMPLETE = range(6)
"""The statuses of the emitted code."""

PUBLIC = 15
"""Mask of the flags that the caller sees."""


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


def finished(
    rows: Sequence[Row], wish: Wish, placed: Callable[[Sequence[float]], tuple[list[float], bool]]
) -> tuple[list[Row], bool]:
    """The solutions ``rows`` in their final form, and whether all were within the joint limits.

    ``placed`` moves a configuration by full turns and tells whether it is within the limits. Squared residuals are
    replaced by their roots; solutions outside the limits are left out or flagged.
    """
    kept, every = [], True
    for row in rows:
        q, inside = placed(row.q)
        every = every and inside
        if inside or not wish.limits:
            kept.append(Row(q, row.flags if inside else row.flags | OUTSIDE, row.branch, sqrt(row.residual)))
    return kept, every


def sort_by_distance(rows: list[Row], reference: Sequence[float], units: Sequence[float]) -> None:
    """Sort ``rows`` by the distance of their q from ``reference``, each joint relative to its unit of ``units``."""
    rows.sort(key=lambda row: sum(((x - r) / u) ** 2 for x, r, u in zip(row.q, reference, units, strict=True)))


def without_solution(incomplete: bool, outside: bool, outside_stage: int, stage: int, distance: float) -> Answer:
    """The answer of a call that returns no solution.

    ``outside`` tells that there are solutions, but none within the joint limits; a solver that is ``incomplete`` says
    so by the reason ``outside_stage``. Otherwise ``stage`` is the reason, and ``distance`` (m) that of the target.
    """
    if incomplete:
        return Answer(INCOMPLETE, (), outside_stage if outside else stage, distance)
    return Answer(OUTSIDE_LIMITS, (), 0, distance) if outside else Answer(UNREACHABLE, (), stage, distance)


def repeated(task: Task, rows: Sequence[Row], row: Row) -> bool:
    """Whether the solution ``row`` equals one of ``rows``, which is then flagged as a multiple root."""
    for other in rows:
        if task.apart(row.q, other.q) < TOLERANCE["same"]:
            other.flags |= MULTIPLE
            return True
    return False


def descended(
    task: Task,
    starts: Sequence[tuple[list[float], int]],
    reference: Sequence[float],
    given: tuple[int, float] | None,
    most: int,
) -> tuple[list[Row], Row, float]:
    """Minimize the task error from several configurations, for a target without solutions.

    These are the ``starts``, each with its branch number; if no solution is found from them, also ``reference`` and a
    few configurations around it. ``given`` is the prescribed joint with its value, ``most`` the largest number of
    solutions. Returns the solutions found after all, the configuration with the smallest error, and its distance from
    the target, m.
    """
    kept: list[Row] = []
    best = Row(list(reference), INEXACT, 0, 1e30)
    for start in range(len(starts) + int(SEARCH["starts"])):
        if len(kept) >= most or (start == len(starts) and kept):
            break
        if start < len(starts):
            x, branch = list(starts[start][0]), starts[start][1]
        else:
            away = SEARCH["spread"] if start > len(starts) else 0.0
            x, branch = [r + away * sin(start * (i + 1)) for i, r in enumerate(reference)], 0
        if given is not None:
            x[given[0]] = given[1]
        q, cost = task.refine(x, *DESCENT)
        if cost <= TOLERANCE["accept"]:
            row = Row(q, MULTIPLE, branch, cost)
            if (kept or cost < best.residual) and not repeated(task, kept, row):
                kept.append(row)
        if cost < best.residual:
            best = Row(q, INEXACT if cost > TOLERANCE["accept"] else MULTIPLE, branch, cost)
    return kept, best, 0.0 if kept else sqrt(best.residual) * task.chain.reach


# ------------------------------------------------------------------------------------------------------------------
# Solves the inverse kinematics for one target in floats
# ------------------------------------------------------------------------------------------------------------------


class Evaluation:
    """Inverse kinematics of the solver ``plan``, evaluated in Python.

    ``reasons`` is the number of different texts that explain why a target has no solution.
    """

    def __init__(self, plan: SolverPlan, reasons: int) -> None:
        self._parts = [plan] if plan.companion is None else [plan, plan.companion]
        self._plan, self._chain = plan, plan.chain
        self._limits = Limits(plan.chain)
        self._banded = plan.snapped or plan.companion is not None
        self._most = max(part.max_solutions for part in self._parts)
        self._far_stage = reasons - 1 - may_lack(plan)

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
        if any(abs(x) >= FARTHEST * self._chain.scale for x in place) or any(abs(x) >= longest for x in tool):
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
        self._doubt = bool(solver._plan.incomplete)

    def solve(self) -> Answer:
        """Find all solutions; without any, find the distance of the nearest configuration from the target."""
        found = self._collect()
        self._rows, inside = self._finished(self._rows, self._q_ref)
        outside, distance = not inside, 0.0
        if not self._rows and not outside:
            if found:  # perhaps from slightly negative discriminants: without tolerance, the failing equation shows
                rows, self._stage = self._candidates(self._plan, replace(self._usual, slack=0.0))
                self._stage = self._far_stage - 1 if rows else self._stage
            kept, _, distance = self.descended()
            self._rows, _ = self._finished(kept, self._query.reference)
            outside = bool(kept)
            self._doubt |= outside and self._plan.general  # the descents have found what the elimination lacks
        if not self._rows:
            outside |= self._doubt and self._plan.general  # the same reason, whether there are solutions or not
            return without_solution(self._doubt, outside, self._far_stage + 1, self._stage, distance)
        if self._wish.nearest:
            units = [1.0 if joint.revolute else self._plan.chain.reach for joint in self._plan.chain.joints]
            sort_by_distance(self._rows, self._query.reference, units)
        return Answer(INCOMPLETE if self._doubt else OK, tuple(self._rows), 0, distance)

    def closest(self) -> Answer:
        """Find the configuration with the smallest task error, by minimization from several initial configurations."""
        kept, best, distance = self.descended()
        rows, _ = self._finished([*kept, best][:1], self._query.reference)
        return Answer(OK if rows else OUTSIDE_LIMITS, tuple(rows), 0, distance)

    def _collect(self) -> int:
        """Collect the solutions that meet the task; returns how many candidates the equations solved last had."""
        count = near = 0
        for part in self._parts:
            rows, stage = self._candidates(part, self._usual)
            count, self._stage = len(rows), max(self._stage, stage)
            if not part.general:
                self._reopen(part, rows)
            for row in rows:
                near |= row.flags & NEAR
            known = len(self._rows)
            self._add(rows, known)
            lacking = self._plan.general and not part.general and len(self._rows) > known
            self._doubt |= lacking  # the elimination lacks a solution of the arm nearby
        if self._banded and (near or not self._rows):
            # near a double root: moved apart by the band, its two parts are candidates for the true arm
            for share in (1.0, SEARCH["band_2"], SEARCH["band_3"]):
                settings = replace(self._usual, band=TOLERANCE["band"] * share)
                rows, stage = self._candidates(self._parts[-1], settings)
                count, self._stage = len(rows), max(self._stage, stage)
                known = len(self._rows)
                self._add(rows, known)
                self._doubt |= self._plan.general and len(self._rows) > known
        return count

    def _candidates(self, part: SolverPlan, settings: Settings) -> tuple[list[Row], int]:
        """Candidates of one part of the plan, and the latest choice that had no real root; an elimination is one."""
        if not part.general:
            return candidates(part, self._query, settings)
        general = General6R(part, self._task, self.T, self._query.given)
        rows = general.candidates(self._query.reference)
        self._doubt |= not general.certain
        return rows, int(not rows)

    def _add(self, rows: Sequence[Row], known: int) -> None:
        """Keep the ``rows`` that are new. The first ``known`` solutions are no multiple roots for being found again."""
        flags = [row.flags for row in self._rows[:known]]
        for row in rows:
            self._keep(row)
        for row, before in zip(self._rows, flags, strict=False):
            row.flags = before

    def _reopen(self, part: SolverPlan, rows: list[Row]) -> None:
        limits = self._limits if self._wish.limits and self._limits.any else None
        FreeJoints(part, self._task, self._query, self._usual, self._accuracy, limits).reopen(rows)

    def _keep(self, row: Row) -> None:
        if len(self._rows) < self._most and self._settled(row):
            row.flags &= PUBLIC
            if not repeated(self._task, self._rows, row):
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

    def _finished(self, rows: Sequence[Row], reference: Sequence[float] | None) -> tuple[list[Row], bool]:
        kept, inside = finished(rows, self._wish, lambda q: self._limits.placed(q, reference))
        if self._plan.general:
            for row in kept:
                row.branch = self._task.aspect(row.q)
                row.flags |= MULTIPLE if self._task.smallest_gain(row.q) < ELIMINATION["singular"] else 0
        return kept, inside

    def descended(self) -> tuple[list[Row], Row, float]:
        """Minimize the task error from the branches, with negative discriminants set to zero, and a few more starts.

        See :func:`~rrrgen.ik.interpreter.solve.descended`.
        """
        found, _ = self._candidates(self._parts[-1], replace(self._usual, slack=1e30))
        locked = self._plan.locked
        given = None if locked in (None, ARM_ANGLE) else (locked, self._query.given)
        return descended(self._task, [(row.q, row.branch) for row in found], self._query.reference, given, self._most)
