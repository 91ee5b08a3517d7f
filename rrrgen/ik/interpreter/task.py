"""What a solution of the inverse kinematics must meet: the target, by a refinement of its error, and the joint limits.

The refinement is that of the emitted C, with steps by modified Gram-Schmidt where the C takes Householder reflections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, ceil, hypot, pi, sqrt
from operator import mul
from typing import TYPE_CHECKING

from rrrgen.ik.geometry.chain import multiply, translation
from rrrgen.ik.geometry.mechanism import identity_coupling
from rrrgen.ik.geometry.rigid_transforms import Vector, cross, dot, minus
from rrrgen.ik.plan import ARM_ANGLE
from rrrgen.ik.recording.float_builder import SEARCH, TOLERANCE, wrap
from rrrgen.ik.tolerances import ROUNDINGS

if TYPE_CHECKING:
    from rrrgen.ik.geometry.chain import Matrix
    from rrrgen.ik.interpreter.candidates import Query
    from rrrgen.ik.plan import SolverPlan

USUAL = (int(SEARCH["steps"]), SEARCH["damping"])
PATIENT = (int(SEARCH["descent_steps"]), SEARCH["damping"])
DESCENT = (int(SEARCH["descent_steps"]), SEARCH["descent_damping"])
"""Largest number of steps and initial damping of a refinement: USUAL for a candidate, PATIENT for a candidate from the
equations of a similar arm, DESCENT for a search from any configuration."""

NONE_HELD: frozenset[int] = frozenset()

Columns = list[list[float]]


class Task:
    """Task that solutions for one target must meet: its position, or its pose; lengths are relative to the reach.

    Configurations q are those of the driven joints, of an arm those of the chain; ``units`` are the natural sizes of
    their changes: 1 rad, or the reach in m. ``prescribed`` is the joint whose value the redundancy parameter gives, if
    any, with that value.
    """

    def __init__(self, plan: SolverPlan, query: Query) -> None:
        self.chain = plan.chain
        if plan.last_link is not None:
            self.chain = replace(plan.chain, tip=multiply(plan.last_link, translation(query.tool)))
        self._position, self._target, self._reach = plan.task == "position", query.T, plan.chain.reach
        self._coupling, self._follow = plan.coupling or identity_coupling(plan.chain), plan.coupling is not None
        self._row_units = [1.0 if joint.revolute else self._reach for joint in plan.chain.joints]
        self.units = [1.0 if turning else self._reach for turning in self._coupling.revolute]
        self.prescribed: tuple[int, float] | None = None
        if plan.locked is not None and plan.locked != ARM_ANGLE:
            leader = self._coupling.leader(plan.locked)
            if leader is not None:
                self.prescribed = (leader, query.given / self._coupling.matrix[plan.locked][leader])

    def error(self, q: Sequence[float], held: frozenset[int] = NONE_HELD) -> tuple[list[float], Columns]:
        """Remaining task error at ``q`` (angles in rad, lengths over the reach), and the columns of its Jacobian.

        They are derivatives by q over :attr:`units`; zero for the joints in ``held`` and the prescribed one, which do
        not move.
        """
        y = self._coupling.rows(q)
        F, T, size = self.chain.tip_pose(y), self._target, 3 if self._position else 6
        columns = [
            [x * unit / self._reach if i < 3 else x for i, x in enumerate(column[:size])]
            for column, unit in zip(self.chain.tip_motion(y), self._row_units, strict=True)
        ]
        if self._follow:
            # by q: J S, from the derivatives by y over their units to those by q over theirs
            rates = [[f / u for f in row] for row, u in zip(self._coupling.matrix, self._row_units, strict=True)]
            components = list(zip(*columns, strict=True))
            columns = [
                [unit * _dot(component, [row[j] for row in rates]) for component in components]
                for j, unit in enumerate(self.units)
            ]
        for k in range(len(columns)):
            if k in held or (self.prescribed is not None and k == self.prescribed[0]):
                columns[k] = [0.0] * size
        missing = [(T[i][3] - F[i][3]) / self._reach for i in range(3)]
        if self._position:
            return missing, columns
        return missing + _rotation_vector([[_dot(T[i][:3], F[j][:3]) for j in range(3)] for i in range(3)]), columns

    def refine(
        self, q: Sequence[float], steps: int, damping: float, held: frozenset[int] = NONE_HELD
    ) -> tuple[list[float], float]:
        """Refine ``q`` by at most ``steps`` Levenberg-Marquardt steps.

        Returns the best configuration and its squared task error. ``damping`` is the initial one, in proportion to the
        error, which keeps the convergence fast at singular configurations. Up to three steps in a row may increase the
        error, because the bottom of a curved valley is followed by leaving it and coming back. Joints in ``held`` do
        not move.
        """
        configuration = x = list(q)
        e, columns = self.error(x, held)
        cost = best = _dot(e, e)
        worse = 0
        for _ in range(steps):
            if not (best > TOLERANCE["done"] and damping < SEARCH["most_damping"]):
                break
            x = self._take_step(x, columns, e, damping * sqrt(cost))
            e, columns = self.error(x, held)
            cost = _dot(e, e)
            if cost < best:
                stuck = cost > SEARCH["stuck"] * best and damping > 1.0  # at the minimum, which is not zero
                configuration, best, worse = x, cost, 0
                damping = SEARCH["less_damping"] * damping if damping > SEARCH["damping"] else damping
                if stuck:
                    break
            else:
                worse += 1
                if worse > SEARCH["worse_steps"] or not cost < SEARCH["diverged"]:
                    x, worse, damping = configuration, 0, SEARCH["more_damping"] * damping
                    e, columns = self.error(x, held)
                    cost = _dot(e, e)
        return configuration, best

    def reaches(
        self, q: Sequence[float], goal: float, steps: int, held: frozenset[int] = NONE_HELD
    ) -> list[float] | None:
        """A configuration near ``q`` with the joints in ``held`` where they are that meets the target.

        Its squared task error is at most ``goal``. None if ``steps`` damped Gauss-Newton steps do not find it, or two
        of them do not halve the error.
        """
        x, cost, before = list(q), 0.0, 0.0
        for step in range(steps + 1):
            earlier, before = before, cost
            e, columns = self.error(x, held)
            cost = _dot(e, e)
            if cost <= goal:
                return x
            if step == steps or (earlier > 0.0 and not 4.0 * cost < earlier):
                break
            x = self._take_step(x, columns, e, SEARCH["damping"] * sqrt(cost))
        return None

    def _take_step(self, x: Sequence[float], columns: Columns, e: Sequence[float], damping: float) -> list[float]:
        """``x`` after one damped step, which is cut to one radian or one reach in each joint."""
        d = damped_step(columns, e, damping + TOLERANCE["eps"])
        most = max(1.0, *map(abs, d))
        return [value + part / most * unit for value, part, unit in zip(x, d, self.units, strict=True)]

    def between(self, a: Sequence[float], b: Sequence[float], part: float) -> list[float]:
        """The configuration a + part (b - a), with differences of angles by at most pi."""
        return [x + part * wrap(y - x, period) for x, y, period in zip(a, b, self._coupling.periods, strict=True)]

    def apart(self, a: Sequence[float], b: Sequence[float]) -> float:
        """Largest difference of two configurations, rad or lengths over the reach; for a mechanism, of its rows.

        Every joint counts modulo its period, an angle modulo full turns.
        """
        d = [wrap(x - y, period) for x, y, period in zip(a, b, self._coupling.periods, strict=True)]
        return self._size(self._coupling.rows(d))

    def off(self, y: Sequence[float], q: Sequence[float]) -> float:
        """Largest difference of the displacements ``y`` of the chain from S ``q``: rad, or lengths over the reach."""
        rows = zip(y, self._coupling.rows(q), self.chain.joints, strict=True)
        return self._size([wrap(x - follower, 2 * pi * joint.revolute) for x, follower, joint in rows])

    def _size(self, rows: Sequence[float]) -> float:
        return max((abs(x) / unit for x, unit in zip(rows, self._row_units, strict=True)), default=0.0)


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(map(mul, a, b), 0.0)


def damped_step(columns: Columns, e: Sequence[float], damping: float) -> list[float]:
    """The d that minimises |J d - e|^2 + damping^2 |d|^2, for a matrix J of these ``columns`` and ``damping`` > 0.

    Modified Gram-Schmidt on J stacked on damping times the identity, with e as a further column: as accurate as
    Householder's method (Björck 1967).
    """
    n = len(columns)
    A = [[*column, *(damping * (i == j) for i in range(n))] for j, column in enumerate(columns)]
    A.append([*e, *[0.0] * n])
    upper = []
    for k in range(n):
        square = _dot(A[k], A[k])
        upper.append([_dot(A[k], other) / square for other in A[k + 1 :]])
        for j, factor in enumerate(upper[k], k + 1):
            A[j] = [x - factor * y for x, y in zip(A[j], A[k], strict=True)]
    d: list[float] = []
    for *row, right in reversed(upper):
        d.insert(0, right - _dot(row, d))
    return d


def _rotation_vector(E: Columns) -> list[float]:
    """Rotation vector (3,) of the rotation matrix ``E``: its axis, with the angle (rad) as length.

    Below 26 degrees the length is the sine of the angle, which suffices for the iteration.
    """
    e = [0.5 * (E[(i + 2) % 3][(i + 1) % 3] - E[(i + 1) % 3][(i + 2) % 3]) for i in range(3)]
    s, c = hypot(*e), 0.5 * (E[0][0] + E[1][1] + E[2][2] - 1.0)
    if c >= SEARCH["small_turn"]:
        return e
    if s * s > TOLERANCE["eps"]:
        return [x * (atan2(s, c) / s) for x in e]
    j = max(range(3), key=lambda i: E[i][i])  # half a turn: R + 1 = 2 a a', of which the largest column is taken
    axis = [E[i][j] + (i == j) for i in range(3)]
    return [x * (pi / hypot(*axis)) for x in axis]


# ------------------------------------------------------------------------------------------------------------------
# Joint limits: choice of the full turns of every angle, and excess over the limits
# ------------------------------------------------------------------------------------------------------------------

UNLIMITED = 1e30
"""The limit of a joint that has none."""


class PositionLimits:
    """Position limits of the joints of an arm or a mechanism: ``lower`` and ``upper``, rad or m; +-UNLIMITED if none.

    ``exist`` tells whether any joint has one.
    """

    def __init__(self, plan: SolverPlan) -> None:
        coupling = plan.coupling or identity_coupling(plan.chain)
        self.exist = any(end is not None for pair in coupling.limits for end in pair)
        self.lower, self.upper = ([_bounds(pair)[side] for pair in coupling.limits] for side in (0, 1))
        self._periods, self._followers = coupling.periods, coupling.followers

    def shift_by_periods(self, q: Sequence[float], reference: Sequence[float] | None) -> tuple[list[float], bool]:
        """Move ``q`` by full periods: next to the reference, if there is one, then within the limits if possible.

        Returns the configuration, and whether all joints are within their limits.
        """
        row, every = list(q), True
        for i, period in enumerate(self._periods):
            if reference is not None:
                row[i] = reference[i] + wrap(row[i] - reference[i], period)
            low, high = self.lower[i] - TOLERANCE["limit"], self.upper[i] + TOLERANCE["limit"]
            x = row[i]
            if period:
                x += period * (ceil(max(low - x, 0.0) / period) - ceil(max(x - high, 0.0) / period))
            if low <= x <= high:
                row[i] = x
            else:
                every = False
        for follower in self._followers:
            low, high = _bounds((follower.lower, follower.upper))
            value = _dot(follower.factors, row)
            every = every and low - TOLERANCE["limit"] <= value <= high + TOLERANCE["limit"]
        return row, every

    def outside(self, q: Sequence[float], margin: float) -> float:
        """Largest excess of a joint over its limits widened by ``margin``, rad or m; 0 if all are inside.

        Angles may be moved by full turns.
        """
        worst = 0.0
        for x, lower, upper, period in zip(q, self.lower, self.upper, self._periods, strict=True):
            low, high = lower - margin, upper + margin
            out = max(low - x, x - high)
            if period:
                over = (x - low) % period
                out = 0.0 if over <= high - low else min(over - (high - low), period - over)
            worst = max(worst, out)
        return worst

    def clamp(self, x: float, joint: int) -> float:
        """The value nearest to ``x`` within the limits of ``joint``, rad or m."""
        return min(max(x, self.lower[joint]), self.upper[joint])


def _bounds(ends: tuple[float | None, float | None]) -> tuple[float, float]:
    lower, upper = ends
    return -UNLIMITED if lower is None else float(lower), UNLIMITED if upper is None else float(upper)


# ------------------------------------------------------------------------------------------------------------------
# Checks target poses, and corrects rotation matrices that are nearly orthonormal
# ------------------------------------------------------------------------------------------------------------------


def orthonormalize(T: Matrix) -> tuple[Matrix, float] | None:
    """The pose ``T`` (3, 4) with an orthonormal rotation matrix, and by how much that of ``T`` was not orthonormal.

    None if it is too far from a rotation. Its first two columns are corrected to first order, the third follows.
    """
    x, y, z, p = ((T[0][k], T[1][k], T[2][k]) for k in range(4))
    xx, yy, xy = dot(x, x) - 1.0, dot(y, y) - 1.0, dot(x, y)
    defect = sum(map(abs, (xx, yy, xy, *minus(cross(x, y), z))))
    if not defect <= TOLERANCE["orthonormal"]:
        return None
    if defect > ROUNDINGS * TOLERANCE["eps"]:
        x, y = (
            _linear_combination(1.0 - 0.5 * xx, x, -0.5 * xy, y),
            _linear_combination(1.0 - 0.5 * yy, y, -0.5 * xy, x),
        )
        z = cross(x, y)
    return tuple(zip(x, y, z, p, strict=True)), defect


def _linear_combination(a: float, x: Vector, b: float, y: Vector) -> Vector:
    return (a * x[0] + b * y[0], a * x[1] + b * y[1], a * x[2] + b * y[2])
