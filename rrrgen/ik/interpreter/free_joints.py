"""Free joints: joints that the target does not determine, at a singular configuration.

Then one solution stands for a continuum of them; the free joint is set to its reference value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING

from rrrgen.ik.interpreter.candidates import CandidateRow, Query, candidates
from rrrgen.ik.interpreter.task import USUAL, PositionLimits, Task
from rrrgen.ik.plan import ARM_ANGLE
from rrrgen.ik.recording.float_builder import FREE, MULTIPLE, SEARCH, TOLERANCE, RootTolerances

if TYPE_CHECKING:
    from rrrgen.ik.plan import SolverPlan


class FreeJoints:
    """Finds the free joints in the candidates of one target and sets them to their reference values.

    ``accuracy`` is the relative error of the target's numbers. With ``limits``, free joints are set to the values
    nearest to the reference for which all joints are within their limits.
    """

    def __init__(
        self,
        plan: SolverPlan,
        task: Task,
        query: Query,
        settings: RootTolerances,
        accuracy: float,
        limits: PositionLimits | None,
    ) -> None:
        self._plan, self._task, self._query, self._settings = plan, task, query, settings
        self._accuracy, self._limits = accuracy, limits
        self._goal = max(SEARCH["reopened"] * accuracy * accuracy, TOLERANCE["accept"])

    def resolve(self, rows: Sequence[CandidateRow]) -> list[CandidateRow]:
        """The candidates ``rows``; those that have a free joint are replaced by one with this joint at its reference.

        Such candidates are computed with a growing threshold below which the direction of a short vector counts as
        undetermined, until the joints found free are those that the target leaves free.
        """
        for row in rows:
            if row.doubtful:
                self._find_free(row)
        kept, least = list(rows), TOLERANCE["free"]
        pending = sum(bool(row.free) for row in rows)
        # A vector that is only rounding error still has a direction, and a joint angle computed from it looks
        # determined. Too small a threshold accepts such angles; too large a one frees joints that the target does
        # determine. So it starts small and grows, and what it frees is tested: the candidates that it joins must be
        # connected by a path of solutions.
        while pending > 0 and least < 2 * TOLERANCE["doubt"]:
            for wide in self._candidates(self._query.reference, least):
                same = [row for row in kept if wide.free and self._is_same_branch(row, wide.free, wide.branch)]
                if not same:
                    continue
                wide.q, wide.residual = self._task.refine(wide.q, *USUAL, wide.free)
                if wide.residual > self._goal:
                    continue
                pending -= len(same)
                joined = self._split(same, wide, kept)
                if joined:
                    if self._limits is not None and self._limits.outside(wide.q, TOLERANCE["limit"]) > 0.0:
                        self._fit(wide, self._limits, least)
                    flags = (wide.flags & MULTIPLE) | FREE
                    kept[kept.index(joined[0])] = CandidateRow(wide.q, flags, wide.branch, wide.residual, settled=True)
                    kept = [row for row in kept if row not in joined]
            least *= 10.0
        return kept

    def _candidates(self, reference: Sequence[float], least: float) -> list[CandidateRow]:
        settings = replace(self._settings, least=least)
        return candidates(self._plan, replace(self._query, reference=reference), settings)[0]

    def _is_same_branch(self, row: CandidateRow, free: frozenset[int], branch: int) -> bool:
        """Whether ``row`` has these ``free`` joints and this ``branch``, but for choices that then do not matter."""
        merged = sum(mask for joint, mask in self._plan.equations.opens if joint in free)
        return row.free == free and not (row.branch ^ branch) & ~merged

    def _split(self, rows: Sequence[CandidateRow], wide: CandidateRow, kept: list[CandidateRow]) -> list[CandidateRow]:
        """Those of ``rows`` that are on the continuum of ``wide``.

        A row that is on another continuum stays, and stands for it: others that are on it too leave ``kept``.
        """
        joined: list[CandidateRow] = []
        aside: CandidateRow | None = None
        for row in rows:
            if self._is_joined(row.q, wide.q, wide.free):
                joined.append(row)
            elif aside is not None and self._is_joined(row.q, aside.q, wide.free):
                kept.remove(row)
            else:
                row.free, aside = frozenset(), row
        return joined

    def _is_joined(self, q: Sequence[float], to: Sequence[float], held: frozenset[int]) -> bool:
        """Whether the configurations ``q`` and ``to`` lie on one path of configurations that meet the target.

        If all configurations straight between them do not, the free joints ``held`` go straight to their values in
        ``to``, and the other joints follow. For a prescribed arm angle all joints go straight, because joints that
        follow might change it.
        """
        task, goal = self._task, self._goal
        if task.apart(q, to) < TOLERANCE["same"]:
            return True
        if all(task.reaches(task.between(q, to, part), goal, 0) for part in (0.25, 0.5, 0.75)):
            return True
        if self._plan.locked == ARM_ANGLE:
            return False
        for left in range(int(SEARCH["path_steps"]), 0, -1):
            x = task.reaches(task.between(q, to, 1.0 / left), goal, int(SEARCH["path_corrections"]), held)
            if x is None or task.apart(x, q) > SEARCH["path_move"]:
                return False
            q = x
        return True

    def _find_free(self, row: CandidateRow) -> None:
        """Find the free joints of a candidate by a test.

        A joint is free if, after it is moved a little and held, the other joints can still meet the target.
        """
        if not row.free and not 0.0 <= row.residual <= TOLERANCE["tight"]:
            row.q, row.residual = self._task.refine(row.q, *USUAL)
        row.free |= {j for j in row.doubtful - row.free if self._moves_freely(row.q, j)}
        row.flags |= FREE if row.free else 0

    def _moves_freely(self, q: Sequence[float], j: int) -> bool:
        for side in (-1, 1):
            x = list(q)
            x[j] += side * TOLERANCE["turn"]
            turned = self._task.reaches(x, self._accuracy**2, USUAL[0], frozenset({j}))
            if turned is not None and self._stands(q, turned, j):
                return True
        return False

    def _stands(self, before: Sequence[float], after: Sequence[float], j: int) -> bool:
        """Whether all joints except ``j`` and one other have the same positions in ``before`` and ``after``, (n,) each.

        The other one may have the same axis. It is tested only for an arm with a prescribed arm angle, which could also
        meet the target by changing this angle.
        """
        if self._plan.locked != ARM_ANGLE:
            return True
        moved = [abs(x - y) for k, (x, y) in enumerate(zip(before, after, strict=True)) if k != j]
        return sum(moved) - max(moved) <= SEARCH["standing"] * self._accuracy

    # -- limits -------------------------------------------------------------------------------------------------------

    def _fit(self, wide: CandidateRow, limits: PositionLimits, least: float) -> None:
        """Move the free joints of ``wide`` to the values nearest to the reference for which all limits are met.

        A vector shorter than ``least`` has no direction.
        """
        q, margin = list(wide.q), TOLERANCE["limit"]
        for j in sorted(wide.free):
            if limits.outside(q, margin) > 0.0:
                q = self._shift(q, j, limits)
        for j in sorted(wide.free):
            if limits.outside(q, margin) > 0.0:
                q = self._search(q, j, limits, wide, least)
        q, error = self._task.refine(q, *USUAL, wide.free)
        if error <= self._goal and not limits.outside(q, margin) > 0.0:
            wide.q, wide.residual = q, error

    def _shift(self, q: list[float], j: int, limits: PositionLimits) -> list[float]:
        """``q`` with joint ``j`` at its reference, or at the nearest value within its limits.

        Unless the joint has no effect on the tip, another joint with the same axis turns back by the same amount,
        within its own limits; if there is none, nothing moves.
        """
        near, x = 4 * TOLERANCE["doubt"], limits.clamp(self._query.reference[j], j)
        _, columns = self._task.error(q)
        if sum(map(abs, columns[j])) < near:
            return [*q[:j], x, *q[j + 1 :]]
        partner, sense = -1, 0.0
        for k, column in enumerate(columns if len(columns[j]) == 6 else ()):
            for sign in (1.0, -1.0):
                alike = sum(abs(u + sign * v) for u, v in zip(columns[j], column, strict=True)) < near
                if k != j and alike:
                    partner, sense = k, sign
        if partner < 0:
            return q
        low = limits.lower[partner]
        width = limits.upper[partner] - low
        other = q[partner] + sense * (x - q[j])
        if width < 2 * pi and (other - low) % (2 * pi) > width:  # the partner is outside: move it to one of its limits
            ends = (x + sense * ((low - other) % (2 * pi)), x - sense * ((other - low - width) % (2 * pi)))
            inside = [end for end in ends if end == limits.clamp(end, j)]
            if not inside:
                return q
            x = min(inside, key=lambda end: abs(end - x))
        q[partner] += sense * (x - q[j])
        q[j] = x
        return q

    def _search(self, q: list[float], j: int, limits: PositionLimits, wide: CandidateRow, least: float) -> list[float]:
        """The solution with all joints within their limits whose free joint ``j`` is nearest to its reference.

        ``q`` where there is none. The value of the free joint is found by steps to both sides, then by bisection; where
        the excess over the limits has a minimum between two steps, by a ternary search first, because the interval
        inside the limits may be shorter than a step.
        """

        def excess(x: float) -> float:
            return self._solution_with(j, x, limits, wide, least)[1]

        start = limits.clamp(self._query.reference[j], j)
        ends = []
        for side in (-1, 1):
            back = middle = start
            before = now = excess(start)
            dips = 0
            for k in range(1, int(SEARCH["limit_steps"]) + 1):
                front = limits.clamp(start + side * k * SEARCH["limit_step"], j)
                ahead = excess(front)
                bad, good, deep = middle, front, ahead
                if ahead > 0.0 and k > 1 and now <= before and now <= ahead and dips < SEARCH["limit_dips"]:
                    dips += 1
                    bad, (good, deep) = back, _dip(excess, back, front)
                if deep <= 0.0:
                    ends.append(_border(excess, bad, good))
                    break
                back, before, middle, now = middle, now, front, ahead
        if not ends:
            return q
        return self._solution_with(j, min(ends, key=lambda x: abs(x - start)), limits, wide, least)[0]

    def _solution_with(
        self, j: int, x: float, limits: PositionLimits, wide: CandidateRow, least: float
    ) -> tuple[list[float], float]:
        """Solution of the branch of ``wide`` with its free joint ``j`` at ``x``, and its excess over the limits.

        The excess is 10 if the branch has no solution there.
        """
        at = [*self._query.reference[:j], x, *self._query.reference[j + 1 :]]
        for row in self._candidates(at, least):
            if self._is_same_branch(row, wide.free, wide.branch):
                q = row.q
                for k in sorted(wide.free - {j}):
                    q = self._shift(q, k, limits)
                return q, limits.outside(q, 0.5 * TOLERANCE["limit"])
        return at, 10.0


def _dip(excess: Callable[[float], float], a: float, b: float) -> tuple[float, float]:
    """Value between ``a`` and ``b`` with the smallest excess over the limits, and this excess, by ternary search.

    The search ends as soon as the excess is zero.
    """
    good, deep = b, 1.0
    for _ in range(int(SEARCH["dip_steps"])):
        u, v = a + (b - a) / 3, b - (b - a) / 3
        at_u, at_v = excess(u), excess(v)
        good, deep = (u, at_u) if at_u <= at_v else (v, at_v)
        a, b = (a, v) if at_u <= at_v else (u, b)
        if deep <= 0.0:
            break
    return good, deep


def _border(excess: Callable[[float], float], bad: float, good: float) -> float:
    """The end of the interval without excess that holds ``good``, between it and ``bad``, by bisection."""
    for _ in range(int(SEARCH["border_steps"])):
        half = 0.5 * (bad + good)
        bad, good = (half, good) if excess(half) > 0.0 else (bad, half)
    return good
