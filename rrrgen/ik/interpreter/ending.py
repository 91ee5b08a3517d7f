"""What a call of the inverse kinematics returns, and how it ends, for an arm as for a mechanism.

The solutions get their final form, or a descent from many starts looks for the nearest configuration. The method is
that of the emitted C (``templates/c/ik/finish.c``, ``descend.c`` and ``solve.c``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sin, sqrt

from rrrgen.ik.interpreter.branches import Row
from rrrgen.ik.interpreter.kernels import INEXACT, MULTIPLE, OUTSIDE, SEARCH, TOLERANCE
from rrrgen.ik.interpreter.refinement import DESCENT, Task

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
