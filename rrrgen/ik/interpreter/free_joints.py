"""Free joints: joints that the target does not determine, at a singular configuration.

Then one solution stands for a continuum of them; the free joint is set to its reference value. The method is that of
the emitted C (``templates/c/ik/open.c``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi

from rrrgen.ik.interpreter.branches import FREE, MULTIPLE, SEARCH, TOLERANCE, Query, Row, Settings, candidates
from rrrgen.ik.interpreter.refinement import USUAL, Task
from rrrgen.ik.interpreter.targets_and_limits import Limits
from rrrgen.ik.plan import ARM_ANGLE, SolverPlan

GONE, FIXED = 32, 64
"""Internal flags: GONE if another candidate replaces this one, FIXED if it was refined with its free joint held."""

_NO_ROW = 10.0


def held_joints(row: Row) -> int:
    """Bit mask of the free joints of a candidate, those that its target does not determine."""
    return (row.flags >> 16) & 0x7F


class FreeJoints:
    """Finds the free joints in the candidates of one target and sets them to their reference values."""

    def __init__(
        self, plan: SolverPlan, task: Task, query: Query, settings: Settings, accuracy: float, limits: Limits | None
    ) -> None:
        self._plan, self._task, self._query, self._settings = plan, task, query, settings
        self._accuracy, self._limits = accuracy, limits
        self._opens = plan.equations.opens
        self._tolerance = max(SEARCH["reopened"] * accuracy * accuracy, TOLERANCE["accept"])

    def reopen(self, rows: list[Row]) -> None:
        """Replace candidates that have a free joint by one in which this joint is at its reference value.

        With limits, it is at the value nearest to the reference for which all joints are within their limits. Such
        candidates are computed with a growing threshold below which the direction of a short vector counts as
        undetermined, until the joints found free are those that the target leaves free.
        """
        mask = sum(256 << joint for joint, _ in self._opens)
        pending = sum(bool(row.flags & mask) and self._loose(row) != 0 for row in rows)
        least = TOLERANCE["free"]
        while pending > 0 and least < 2 * TOLERANCE["doubt"]:
            for wide in candidates(self._plan, self._query, replace(self._settings, least=least))[0]:
                same = self._same_branch(rows, wide)
                if not same:
                    continue
                held = held_joints(wide)
                wide.q, wide.residual = self._task.refine(wide.q, *USUAL, held)
                if wide.residual > self._tolerance:
                    continue
                pending -= len(same)
                same = self._replaced(same, wide.q, held)
                if not same:
                    continue
                if self._limits is not None and self._limits.outside(wide.q, TOLERANCE["limit"]) > 0.0:
                    self._fit(wide, held, least)
                first = same[0]
                first.q, first.branch, first.residual = wide.q, wide.branch, wide.residual
                first.flags = (wide.flags & MULTIPLE) | FREE | FIXED
            least *= 10.0

    def _replaced(self, rows: list[Row], q: Sequence[float], held: int) -> list[Row]:
        """The ``rows`` on the continuum of the solution ``q``, which replaces them; they are marked as GONE.

        A row that is on another continuum stays, and stands for it: others that are on it too are marked as GONE.
        """
        gone: list[Row] = []
        aside: Row | None = None
        for row in rows:
            if self._joined(row.q, q, held):
                row.flags = GONE
                gone.append(row)
            elif aside is not None and self._joined(row.q, aside.q, held):
                row.flags = GONE
            else:
                row.flags &= 0xFFFF
                aside = row
        return gone

    def _joined(self, q: Sequence[float], to: Sequence[float], held: int) -> bool:
        """Whether the configurations ``q`` and ``to`` lie on one path of configurations that meet the target.

        If all configurations straight between them do not, the free joints ``held`` (bit mask) go straight to their
        values in ``to``, and the other joints follow. For a prescribed arm angle all joints go straight, because joints
        that follow might change it.
        """
        task, goal = self._task, self._tolerance
        if task.apart(q, to) < TOLERANCE["same"]:
            return True
        if all(task.reaches(task.between(q, to, part), goal, 0, held) for part in (0.25, 0.5, 0.75)):
            return True
        for left in range(int(SEARCH["path_steps"]) if self._plan.locked != ARM_ANGLE else 0, 0, -1):
            x = task.reaches(task.between(q, to, 1.0 / left), goal, int(SEARCH["path_corrections"]), held)
            if x is None or task.apart(x, q) > SEARCH["path_move"]:
                return False
            q = x
        return self._plan.locked != ARM_ANGLE

    def _same_branch(self, rows: list[Row], wide: Row) -> list[Row]:
        held = held_joints(wide)
        other = ~self._merged(held)
        return [row for row in rows if held and held_joints(row) == held and not (row.branch ^ wide.branch) & other]

    def _merged(self, held: int) -> int:
        """Branch bits of the choices that lead to the same solution if the joints ``held`` (bit mask) are free."""
        return sum(mask for joint, mask in self._opens if (held >> joint) & 1)

    def _loose(self, row: Row) -> int:
        """Bit mask of the free joints of a candidate, found by a test; its flags are updated.

        A joint is free if, after it is moved a little and held, the other joints can still meet the target.
        """
        held = held_joints(row)
        if held == 0 and not 0.0 <= row.residual <= TOLERANCE["tight"]:
            row.q, row.residual = self._task.refine(row.q, *USUAL)
        for j in range(len(row.q)):
            for side in (-1, 1):
                if (row.flags >> (8 + j)) & ~(held >> j) & 1:
                    q = list(row.q)
                    q[j] += side * TOLERANCE["turn"]
                    turned = self._task.reaches(q, self._accuracy**2, USUAL[0], 1 << j)
                    if turned is not None and self._stands(row.q, turned, j):
                        held |= 1 << j
        if held:
            row.flags |= held << 16 | FREE
        return held

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

    def _fit(self, wide: Row, held: int, least: float) -> None:
        """Move the free joints ``held`` (bit mask) to the values nearest to the reference for which all limits are met.

        ``wide`` is the candidate, which is changed in place; a vector shorter than ``least`` has no direction.
        """
        assert self._limits is not None
        q, margin = list(wide.q), TOLERANCE["limit"]
        free = [j for j in range(len(q)) if (held >> j) & 1]
        for j in free:
            if self._limits.outside(q, margin) > 0.0:
                self._shift(q, j)
        for j in free:
            if self._limits.outside(q, margin) > 0.0:
                q = _Search(self, wide.branch, held, least, j).nearest() or q
        q, error = self._task.refine(q, *USUAL, held)
        if error <= self._tolerance and not self._limits.outside(q, margin) > 0.0:
            wide.q, wide.residual = q, error

    def _shift(self, q: list[float], j: int) -> None:
        """Move joint ``j`` of ``q`` to its reference, or to the nearest value within its limits, in place.

        Unless the joint has no effect on the tip, another joint with the same axis turns back by the same amount,
        within its own limits; if there is none, nothing moves.
        """
        import numpy as np

        assert self._limits is not None
        near, x = 4 * TOLERANCE["doubt"], self._limits.clamped(self._query.reference[j], j)
        _, J = self._task.error(q)
        if np.abs(J[:, j]).sum() < near:
            q[j] = x
            return
        partner, sense = -1, 0.0
        for k in range(len(q) if len(J) == 6 else 0):
            same, opposite = (np.abs(J[:, j] + sign * J[:, k]).sum() < near for sign in (-1, 1))
            if k != j and (same or opposite):
                partner, sense = k, -1.0 if same else 1.0
        if partner < 0:
            return
        low = self._limits.lower[partner]
        width = self._limits.upper[partner] - low
        other = q[partner] + sense * (x - q[j])
        if width < 2 * pi and (other - low) % (2 * pi) > width:
            ends = (x + sense * ((low - other) % (2 * pi)), x - sense * ((other - low - width) % (2 * pi)))
            inside = [end for end in ends if end == self._limits.clamped(end, j)]
            if not inside:
                return
            x = min(inside, key=lambda end: abs(end - x))
        q[partner] += sense * (x - q[j])
        q[j] = x

    def row_with(self, j: int, x: float, branch: int, held: int, least: float) -> tuple[list[float], float]:
        """Solution of a ``branch`` with the free joint ``j`` at ``x``, and by how much it exceeds the limits, rad or m.

        The excess is 10 if the branch has no solution there. ``held`` is the bit mask of the free joints; a vector
        shorter than ``least`` has no direction.
        """
        assert self._limits is not None
        at = list(self._query.reference)
        at[j] = x
        other = ~self._merged(held)
        found, _ = candidates(self._plan, replace(self._query, reference=at), replace(self._settings, least=least))
        for row in found:
            if held_joints(row) == held and not (row.branch ^ branch) & other:
                for k in range(len(row.q)):
                    if k != j and (held >> k) & 1:
                        self._shift(row.q, k)
                return row.q, self._limits.outside(row.q, 0.5 * TOLERANCE["limit"])
        return at, _NO_ROW

    def start(self, j: int) -> float:
        """Value from which the search for joint ``j`` starts: its reference, moved within its limits."""
        return self.clamped(self._query.reference[j], j)

    def clamped(self, x: float, j: int) -> float:
        """The value nearest to ``x`` within the limits of joint ``j``, rad or m."""
        assert self._limits is not None
        return self._limits.clamped(x, j)


class _Search:
    """Search for the value of a free joint, nearest to its reference, for which all joints are within their limits."""

    def __init__(self, free: FreeJoints, branch: int, held: int, least: float, j: int) -> None:
        self._free, self._fixed, self._joint = free, (branch, held, least), j

    def _outside(self, x: float) -> float:
        return self._free.row_with(self._joint, x, *self._fixed)[1]

    def nearest(self) -> list[float] | None:
        """Joint positions within all limits with the free joint nearest to its reference; None if there are none.

        The value of the free joint is found by steps and bisection.
        """
        start = self._free.start(self._joint)
        found = [x for side in (-1, 1) if (x := self._towards(start, side)) is not None]
        if not found:
            return None
        return self._free.row_with(self._joint, min(found, key=lambda x: abs(x - start)), *self._fixed)[0]

    def _towards(self, start: float, side: int) -> float | None:
        back = middle = start
        before = now = self._outside(start)
        dips = 0
        for k in range(1, int(SEARCH["limit_steps"]) + 1):
            front = self._free.clamped(start + side * k * SEARCH["limit_step"], self._joint)
            ahead = self._outside(front)
            bad, good, deep = middle, front, ahead
            if ahead > 0.0 and k > 1 and now <= before and now <= ahead and dips < SEARCH["limit_dips"]:
                dips += 1
                good, deep = self._dip(back, front)
                bad = back
            if deep <= 0.0:
                return self._border(bad, good)
            back, before, middle, now = middle, now, front, ahead
        return None

    def _dip(self, a: float, b: float) -> tuple[float, float]:
        """Value between ``a`` and ``b`` with the smallest excess over the limits, and this excess, by ternary search.

        The search ends as soon as the excess is zero.
        """
        good, deep = b, 1.0
        for _ in range(int(SEARCH["dip_steps"])):
            u, v = a + (b - a) / 3, b - (b - a) / 3
            at_u, at_v = self._outside(u), self._outside(v)
            good, deep = (u, at_u) if at_u <= at_v else (v, at_v)
            a, b = (a, v) if at_u <= at_v else (u, b)
            if deep <= 0.0:
                break
        return good, deep

    def _border(self, bad: float, good: float) -> float:
        for _ in range(int(SEARCH["border_steps"])):
            half = 0.5 * (bad + good)
            bad, good = (half, good) if self._outside(half) > 0.0 else (bad, half)
        return good
