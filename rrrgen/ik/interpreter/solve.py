"""Solves the inverse kinematics for one target in floats: every solution, or the reason why there is none.

The equations are the recorded ones, which the emitted C is printed from as well; the decisions about their candidates
(which of them is a solution, a multiple one, one of a continuum) are those of the C, with the tolerances of
:mod:`rrrgen.ik.tolerances`. How a number is found is not: roots of quartics and of general chains, damped steps, task
errors and limits are computed by other methods than in C, so that each side checks the other.

All of it is plain Python, but for general chains of six joints, for which NumPy is loaded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sin, sqrt
from typing import TYPE_CHECKING

from rrrgen.ik.geometry.chain import translation
from rrrgen.ik.interpreter.candidates import CandidateRow, Query, candidates
from rrrgen.ik.interpreter.free_joints import FreeJoints
from rrrgen.ik.interpreter.task import DESCENT, PATIENT, USUAL, PositionLimits, Task, orthonormalize
from rrrgen.ik.recording.float_builder import (
    FREE,
    INEXACT,
    MULTIPLE,
    NEAR,
    OUTSIDE,
    SEARCH,
    TOLERANCE,
    RootTolerances,
)
from rrrgen.ik.result_layout import (
    INCOMPLETE,
    LIMITS,
    NEAREST,
    NOT_A_ROTATION,
    NOT_FINITE,
    OK,
    OUTSIDE_LIMITS,
    RESIDUAL,
    UNREACHABLE,
    may_lack,
    most_rows,
    parts_of,
    reasons_of,
)
from rrrgen.ik.tolerances import FARTHEST, LONGEST_TOOL, ROUNDINGS

if TYPE_CHECKING:
    from rrrgen.ik.plan import SolverPlan

PUBLIC = MULTIPLE | FREE | OUTSIDE | INEXACT
"""Mask of the flags that the caller sees."""


@dataclass(frozen=True)
class Solutions:
    """Result for one target: ``status``, solutions ``rows`` (their residuals not squared), and why there are none.

    ``stage`` is the number of the equation without a real root, ``distance`` (m) that of the target from the workspace.
    """

    status: int
    rows: tuple[CandidateRow, ...] = ()
    stage: int = 0
    distance: float = 0.0


def solve(
    plan: SolverPlan,
    target: Sequence[float],
    q_ref: Sequence[float] | None = None,
    given: float = 0.0,
    options: int = 0,
    *,
    closest: bool = False,
) -> Solutions:
    """Find every solution for a ``target``, or with ``closest`` the configuration with the smallest error to it.

    The target is a position (3 numbers, m), that of the tool behind it if it is an input, or a pose (16 numbers,
    row-major). ``q_ref`` is the reference configuration or None, ``given`` the redundancy parameter, ``options`` the
    sum of option bits of a call of the emitted code.
    """
    if not all(map(isfinite, [*target, *(x * x for x in (*(q_ref or ()), given))])):
        return Solutions(NOT_FINITE)
    chain = plan.chain
    T, defect = translation((target[0], target[1], target[2])), 0.0
    if len(target) == 16:
        pose = orthonormalize(tuple(tuple(target[4 * i : 4 * i + 4]) for i in range(3)))
        if pose is None:
            return Solutions(NOT_A_ROTATION)
        T, defect = pose
    tool = (target[3], target[4], target[5]) if plan.last_link is not None else (0.0, 0.0, 0.0)
    far = any(abs(row[3]) >= FARTHEST * chain.scale for row in T)
    if far or any(abs(x) >= LONGEST_TOOL * chain.reach for x in tool):
        return Solutions(UNREACHABLE, (), _far_stage(plan), -1.0)
    query = Query(T, [0.0] * plan.n if q_ref is None else q_ref, given, tool)
    accuracy = max(defect, ROUNDINGS * chain.scale / chain.reach * TOLERANCE["eps"])
    call = (_Call if plan.coupling is None else _CoupledCall)(plan, query, accuracy, options, bool(q_ref))
    return call.closest() if closest else call.solve()


def _far_stage(plan: SolverPlan) -> int:
    """Number of the reason of targets too far away; that of unproved limits follows it, where there is one."""
    return len(reasons_of(plan)) - 1 - may_lack(plan) - (plan.coupling is not None)


class _Call:
    """One call of the inverse kinematics of an arm: a checked target ``query``, and the ``options``.

    ``accuracy`` is the assumed relative accuracy of the target; with ``turns``, angles are moved next to the reference.
    """

    def __init__(self, plan: SolverPlan, query: Query, accuracy: float, options: int, turns: bool) -> None:
        self.plan, self.query, self.task, self._limits = plan, query, Task(plan, query), PositionLimits(plan)
        self._accuracy, self._options = accuracy, options
        self._centre = query.reference if turns else None
        self._most = most_rows(plan)
        self._banded = plan.snapped or plan.companion is not None
        self._usual = RootTolerances(TOLERANCE["slack"], TOLERANCE["free"], 0.0 if self._banded else None)
        self._rows: list[CandidateRow] = []
        self._stage = 0
        self._doubt = bool(plan.incomplete)
        self._unexplained = False

    def solve(self) -> Solutions:
        """Find all solutions; without any, find the distance of the nearest configuration from the target."""
        self._collect()
        rows, inside = self._finish(self._rows)
        outside, distance = not inside, 0.0
        if not rows and not outside:
            self._explain()
            kept, _, distance = self.descend()
            rows, _ = self._finish(kept)
            outside = bool(kept)
            self._doubt |= outside and self.plan.general  # the descents have found what the elimination lacks
        if rows:
            if self._options & NEAREST:
                rows.sort(key=self._distance)
            return Solutions(INCOMPLETE if self._doubt else OK, tuple(rows), 0, distance)
        if self._doubt:  # of a general arm the same reason, whether there are solutions outside the limits or not
            stage = _far_stage(self.plan) + 1 if outside or self.plan.general else self._stage
            return Solutions(INCOMPLETE, (), stage, distance)
        return Solutions(OUTSIDE_LIMITS if outside else UNREACHABLE, (), 0 if outside else self._stage, distance)

    def closest(self) -> Solutions:
        """Find the configuration with the smallest task error, by minimization from several initial configurations."""
        kept, best, distance = self.descend()
        rows, _ = self._finish([*kept, best][:1])
        return Solutions(OK if rows else OUTSIDE_LIMITS, tuple(rows), 0, distance)

    def descend(self) -> tuple[list[CandidateRow], CandidateRow, float]:
        """Minimize the task error from several configurations, for a target without solutions.

        They are those of :meth:`_starts` and, if no solution is found from them, the reference and a few configurations
        around it. Returns the solutions found after all, the configuration with the smallest error, and its distance
        from the target, m.
        """
        kept: list[CandidateRow] = []
        best = CandidateRow(list(self.query.reference), INEXACT, 0, 1e30)
        starts = self._starts()
        for k in range(len(starts) + int(SEARCH["starts"])):
            if len(kept) >= self._most or (k == len(starts) and kept):
                break
            if k < len(starts):
                x, branch = list(starts[k].q), starts[k].branch
            else:
                away = SEARCH["spread"] if k > len(starts) else 0.0
                x, branch = [r + away * sin(k * (i + 1)) for i, r in enumerate(self.query.reference)], 0
            if self.task.prescribed is not None:
                x[self.task.prescribed[0]] = self.task.prescribed[1]
            q, cost = self.task.refine(x, *DESCENT)
            met = cost <= TOLERANCE["accept"]
            if met and (kept or cost < best.residual):
                self._add(kept, CandidateRow(q, MULTIPLE, branch, cost))
            if cost < best.residual:
                best = CandidateRow(q, MULTIPLE if met else INEXACT, branch, cost)
        return kept, best, 0.0 if kept else sqrt(best.residual) * self.task.chain.reach

    def _starts(self) -> list[CandidateRow]:
        """Where descents begin: the branches, with negative discriminants set to zero."""
        return self._candidates(parts_of(self.plan)[-1], replace(self._usual, slack=1e30))[0]

    def _collect(self) -> None:
        """Collect the solutions that meet the task, in the order of the branches."""
        near = False
        for part in parts_of(self.plan):
            rows = self._solve_equations(part, self._usual)
            if not part.general:
                limits = self._limits if self._options & LIMITS and self._limits.exist else None
                rows = FreeJoints(part, self.task, self.query, self._usual, self._accuracy, limits).resolve(rows)
            near |= any(row.flags & NEAR for row in rows)
            self._doubt |= self._keep(rows) and self.plan.general and not part.general
        if self._banded and (near or not self._rows):
            # near a double root: moved apart by the band, its two parts are candidates for the true arm
            for share in (1.0, SEARCH["band_2"], SEARCH["band_3"]):
                rows = self._solve_equations(part, replace(self._usual, band=TOLERANCE["band"] * share))
                self._doubt |= self._keep(rows) and self.plan.general

    def _solve_equations(self, part: SolverPlan, settings: RootTolerances) -> list[CandidateRow]:
        """The candidates of one part of the plan; the latest choice without a real root becomes the reason."""
        rows, stage = self._candidates(part, settings)
        self._stage, self._unexplained = max(self._stage, stage), bool(rows)
        return rows

    def _candidates(self, part: SolverPlan, settings: RootTolerances) -> tuple[list[CandidateRow], int]:
        """Candidates of one part of the plan, and the latest choice that had no real root; an elimination is one."""
        if not part.general:
            return candidates(part, self.query, settings)
        from rrrgen.ik.interpreter.general_6r import General6R

        general = General6R(part, self.task, self.query)
        rows = general.candidates()
        self._doubt |= not general.certain
        return rows, int(not rows)

    def _explain(self) -> None:
        """Find the equation without a real root, for a target whose candidates all miss it.

        They may come from slightly negative discriminants: without tolerance, the failing equation shows.
        """
        if self._unexplained:
            rows, self._stage = self._candidates(self.plan, replace(self._usual, slack=0.0))
            self._stage = _far_stage(self.plan) - 1 if rows else self._stage

    def _keep(self, rows: Sequence[CandidateRow]) -> bool:
        """Keep those of ``rows`` that meet the target and are new; returns whether there are any.

        Solutions known before are no multiple roots for being found again.
        """
        flags = [row.flags for row in self._rows]
        for row in rows:
            if len(self._rows) < self._most and self._meets(row):
                row.flags &= PUBLIC
                self._add(self._rows, row)
        for row, before in zip(self._rows, flags, strict=False):
            row.flags = before
        return len(self._rows) > len(flags)

    def _add(self, rows: list[CandidateRow], row: CandidateRow) -> None:
        """Append ``row`` to ``rows``, unless it equals one of them, which is then flagged as a multiple root."""
        for other in rows:
            if self.task.apart(row.q, other.q) < TOLERANCE["same"]:
                other.flags |= MULTIPLE
                return
        rows.append(row)

    def _meets(self, row: CandidateRow) -> bool:
        """Whether a candidate meets the target; it is refined by a few Newton steps if it is not accurate enough."""
        if row.settled or 0.0 <= row.residual <= TOLERANCE["tight"]:
            return True
        if self.plan.virtual and row.residual > TOLERANCE["loose"] and not self._options & RESIDUAL:
            return False
        row.q, row.residual = self.task.refine(row.q, *(PATIENT if self._banded else USUAL))
        return self._is_accepted(row)

    def _is_accepted(self, row: CandidateRow) -> bool:
        """Whether the error of a refined row is that of a solution, or may remain by the options; the flag says so."""
        if row.residual <= TOLERANCE["accept"]:
            return True
        if not self._options & RESIDUAL or not row.residual <= SEARCH["beyond"]:
            return False
        row.flags |= INEXACT
        return True

    def _finish(self, rows: Sequence[CandidateRow]) -> tuple[list[CandidateRow], bool]:
        """The solutions ``rows`` in their final form, and whether all were within the joint limits.

        They are moved by full turns; squared residuals are replaced by their roots; solutions outside the limits are
        left out or flagged.
        """
        kept, every = [], True
        for row in rows:
            q, inside = self._limits.shift_by_periods(row.q, self._centre)
            every = every and inside
            if inside or not self._options & LIMITS:
                kept.append(CandidateRow(q, row.flags | (0 if inside else OUTSIDE), row.branch, sqrt(row.residual)))
        if self.plan.general and self.plan.coupling is None:
            from rrrgen.ik.interpreter.general_6r import label

            label(self.task, kept)
        return kept, every

    def _distance(self, row: CandidateRow) -> float:
        """Squared distance of a solution from the reference, each joint relative to its unit."""
        return sum(
            ((x - r) / unit) ** 2 for x, r, unit in zip(row.q, self.query.reference, self.task.units, strict=True)
        )


class _CoupledCall(_Call):
    """One call of the inverse kinematics of a mechanism, in which joints follow other joints.

    The chain from base to tip, one row of the DH table after the other, is solved as if each row had its own drive. Of
    its solutions y those are kept for which positions q of the driven joints with ``y = S q`` exist; every such q is
    refined on the mechanism itself.
    """

    def __init__(self, plan: SolverPlan, query: Query, accuracy: float, options: int, turns: bool) -> None:
        super().__init__(plan, query, accuracy, options, turns=True)
        assert plan.coupling is not None
        self._coupling = plan.coupling
        y = self._coupling.rows(query.reference)
        self._chain = _Call(
            replace(plan, coupling=None), replace(query, reference=y), accuracy, options & RESIDUAL, turns=True
        )

    def _collect(self) -> None:
        solutions = self._chain.solve()
        self._doubt |= solutions.status == INCOMPLETE
        self._stage = len(reasons_of(self.plan)) - 1 if solutions.rows else solutions.stage
        for row in solutions.rows:
            for new in self._couple(row):
                if len(self._rows) < self._most and all(
                    self.task.apart(new.q, other.q) >= TOLERANCE["same"] for other in self._rows
                ):
                    self._rows.append(new)

    def _couple(self, row: CandidateRow) -> Iterator[CandidateRow]:
        """All positions q of the driven joints that belong to the solution ``row`` of the chain."""
        for q in self._coupling.leading(row.q):
            if self.task.off(row.q, q) > SEARCH["coupled"] and not row.flags & FREE and not self._options & RESIDUAL:
                continue
            error, _ = self.task.error(q)
            new = CandidateRow(q, row.flags & PUBLIC, row.branch, sum(x * x for x in error))
            if not new.residual <= TOLERANCE["tight"]:
                new.q, new.residual = self.task.refine(q, *USUAL)
            if self._is_accepted(new):
                yield new

    def _explain(self) -> None:
        pass  # the chain has found the reason

    def _starts(self) -> list[CandidateRow]:
        """Where descents begin: at what is nearest on the chain without the coupling."""
        rows, nearest, _ = self._chain.descend()
        return [replace(row, q=next(self._coupling.leading(row.q))) for row in rows or [nearest]]
