"""Checks of the inverse kinematics by an independent forward kinematics and by a numerical search for solutions.

No code is shared with the solver: the chain comes from the numbers of the description, and the search makes damped
Gauss-Newton steps from random configurations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import DerivationError
from rrrgen.verify.references.numeric_robot import Array, NumericRobot
from rrrgen.verify.report import Collector, Row
from rrrgen.verify.subject import STROKE

FUNCTION = "inverse_kinematics"
OWN_CHAIN, SEARCH = "forward kinematics (own)", "numerical search"

STARTS = 64
"""Random starts of the numerical search per target."""

STEPS = 60
FOUND = 1e-11
"""Error at which a start counts as converged; angles in rad, lengths divided by the reach of the arm."""

EXACT = 4e-12
"""Largest allowed error of a solution; angles in rad, lengths divided by the reach."""

SHARP = 1e-3
"""Solutions whose Jacobian has a smaller singular value are left out: near a multiple root they are ill-conditioned."""

APART = 1e-5
"""Two configurations with a smaller difference (rad, lengths divided by the reach) count as the same."""

Tell = Callable[[int, int, str], None]


class BatchKinematics:
    """Forward kinematics and the geometric Jacobian of a chain, for batches of configurations (N, n)."""

    def __init__(self, chain: NumericRobot, *, position: bool, redundant: bool = False) -> None:
        self._moving = chain.n - redundant
        self.revolute, self.n, path = np.array(chain.angles), chain.n, chain.path(chain.tip)
        around = chain.around_joints()
        self.around = [around[i] for i in path]
        self._turning, self._coupling = [chain.revolute[i] for i in path], chain.coupling[path]
        self.base, self.tool, self.position = chain.base, chain.tool, position
        lengths = np.sum(np.abs(chain.a[path])) + np.sum(np.abs(chain.d[path]))
        size = float(lengths + np.linalg.norm(chain.tool[:3, 3]))
        self.reach = size if size > 0.0 else 1.0

    def poses(self, q: Array) -> Array:
        """The poses (N, 4, 4) of the tip for configurations ``q`` (N, n)."""
        return self._walk(q)[0]

    def _walk(self, q: Array) -> tuple[Array, list[Array], list[Array]]:
        q = q @ self._coupling.T
        T = np.broadcast_to(self.base, (len(q), 4, 4))
        axes, points = [], []
        for k, (before, after) in enumerate(self.around):
            T = T @ before
            axes.append(T[:, :3, 2])
            points.append(T[:, :3, 3])
            motion = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
            if self._turning[k]:
                c, s = np.cos(q[:, k]), np.sin(q[:, k])
                motion[:, 0, 0], motion[:, 0, 1], motion[:, 1, 0], motion[:, 1, 1] = c, -s, s, c
            else:
                motion[:, 2, 3] = q[:, k]
            T = T @ motion @ after
        return T @ self.tool, axes, points

    def error(self, goals: Array, q: Array) -> tuple[Array, Array]:
        """The task error (N, 3 or 6) and its Jacobian by q; lengths are divided by the reach, angles in rad."""
        T, axes, points = self._walk(q)
        tip = T[:, :3, 3]
        linear, angular = [], []
        for k, (z, o) in enumerate(zip(axes, points, strict=True)):
            linear.append(np.cross(z, tip - o) / self.reach if self._turning[k] else z)
            angular.append(z if self._turning[k] else np.zeros_like(z))
        e, J = (goals[:, :3, 3] - tip) / self.reach, np.stack(linear, axis=2) @ self._coupling
        if self.position:
            return e, J
        turn = 0.5 * np.sum(np.cross(T[:, :3, :3], goals[:, :3, :3], axis=1), axis=2)
        return np.concatenate([e, turn], axis=1), np.concatenate(
            [J, np.stack(angular, axis=2) @ self._coupling], axis=1
        )

    def distance(self, goals: Array, q: Array) -> Array:
        """The largest entry (N,) of the difference between pose and goal; lengths are divided by the reach."""
        D = np.abs(self.poses(q) - goals)
        D[:, :3, 3] /= self.reach
        return np.asarray((D[:, :3, 3:] if self.position else D).reshape(len(q), -1).max(axis=1, initial=0.0))

    def apart(self, a: Array, b: Array) -> Array:
        """Largest difference (...) of two configurations: angles in rad modulo full turns, lengths over the reach."""
        d = a - b
        turned = np.abs(np.mod(d + np.pi, 2 * np.pi) - np.pi)
        return np.asarray(np.where(self.revolute, turned, np.abs(d) / self.reach).max(axis=-1))

    def sharpness(self, goals: Array, q: Array) -> Array:
        """The smallest singular value (N,) of the Jacobian, without the zero that a redundant arm always has."""
        values = np.linalg.svd(self.error(goals, q)[1], compute_uv=False)
        return np.asarray(values[:, min(values.shape[1], self._moving) - 1])

    def draw_configurations(self, count: int, rng: np.random.Generator) -> Array:
        """Draw random configurations (count, n): angles over a full turn, displacements up to ``STROKE`` (m)."""
        return rng.uniform(-1, 1, (count, self.n)) * np.where(self.revolute, np.pi, STROKE)

    def search(self, goals: Array, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Search for solutions by damped Gauss-Newton steps from ``q``: (configurations, whether each converged)."""
        identity, scale = np.eye(self.n), np.where(self.revolute, 1.0, self.reach)
        for _ in range(STEPS):
            e, J = self.error(goals, q)
            cost = np.sum(e * e, axis=1)
            H = np.einsum("nij,nik->njk", J, J) + (1e-2 * cost + 1e-14)[:, None, None] * identity
            step = np.linalg.solve(H, np.einsum("nij,ni->nj", J, e)[..., None])[..., 0]
            step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))
            q = q + step * scale
        return q, self.distance(goals, q) <= FOUND


def check_inverse_kinematics(
    model: Any,
    chain: NumericRobot,
    samples: int,
    rng: np.random.Generator,
    rows: Collector,
    tell: Tell | None = None,
    tip: str = "",
) -> None:
    """Check the solutions of the solver at random, singular and unreachable targets.

    Every solution must meet its target. The configuration whose pose is the target must be among the solutions, and so
    must every solution that the search finds from ``STARTS`` random starts for each of samples / 20 targets. A target
    out of reach must have none. Missing solutions count only where the solver claims to be complete. A robot without a
    solver is listed among the skipped checks, with the reason. With a named ``tip``, the solver is that of the tip and
    ``chain`` the one of its own joints.
    """
    function = f"{tip}_{FUNCTION}" if tip else FUNCTION
    try:
        solver = model.tip_ik(tip) if tip else model.ik
    except DerivationError as reason:  # there is nothing to compare
        rows.skipped.append((function, str(reason)))
        return
    except Exception as error:  # an unexpected error is a failed check
        rows.rows.append(
            _row(function, "no solver", OWN_CHAIN, samples, np.inf, 0.0, f"{type(error).__name__}: {error}")
        )
        return
    arm = BatchKinematics(chain, position=solver.plan.task == "position", redundant=solver.plan.locked is not None)
    checks = _Checks(solver, arm, rng, rows, function)
    try:
        checks.at_random(samples)
        checks.at_singular(max(samples // 4, 10))
        checks.against_search(max(samples // 20, 2), tell)
        checks.out_of_reach()
    except Exception as error:  # any exception means that the comparisons were not made
        rows.rows.append(
            _row(function, "no answer", OWN_CHAIN, samples, np.inf, 0.0, f"{type(error).__name__}: {error}")
        )


def _row(
    function: str, what: str, reference: str, samples: int, difference: float, tolerance: float, note: str = ""
) -> Row:
    return Row(f"{function}: {what}", reference, "-", samples, float(difference), tolerance, note)


class _Checks:
    def __init__(
        self, solver: Any, arm: BatchKinematics, rng: np.random.Generator, rows: Collector, function: str
    ) -> None:
        self.solver, self.arm, self.rng, self.rows, self.function = solver, arm, rng, rows, function

    def _add(self, *entry: Any) -> None:
        self.rows.rows.append(_row(self.function, *entry))

    def _share(self, what: str, *entry: Any) -> None:
        """Add the row ``entry`` for the check ``what`` that no solution is missing.

        It is listed as skipped if the solver itself says that it may miss solutions.
        """
        if self.solver.plan.incomplete:
            self.rows.skipped.append((f"{self.function}: {what}", self.solver.plan.incomplete))
        else:
            self._add(what, *entry)

    def _solve(self, goals: Array, q: Array) -> list[Array]:
        """Solve for every goal (N, 4, 4); returns the solutions (k, n) of each.

        A redundant arm is solved at the redundancy parameter of ``q`` (N, n).
        """
        locked = self.solver.plan.locked is not None
        given = {"redundancy": np.array([self.solver.parameter(x) for x in q])} if locked else {}
        targets = goals[:, :3, 3] if self.arm.position else goals
        batch = self.solver.solve_batch(targets, limits=False, **given)
        return [rows[:count] for rows, count in zip(batch.q, batch.counts, strict=True)]

    def _worst(self, goals: Array, solutions: list[Array]) -> float:
        owner = np.repeat(np.arange(len(goals)), [len(rows) for rows in solutions])
        every = np.concatenate(solutions)
        if not np.all(np.isfinite(every)):
            return float("nan")
        return float(np.max(self.arm.distance(goals[owner], every), initial=0.0))

    def _missing_mask(self, q: Array, solutions: list[Array]) -> NDArray[np.bool_]:
        """Mask (N,) of the configurations ``q`` (N, n) that are missing in the ``solutions`` of their targets."""
        return np.array([not np.any(self.arm.apart(rows, x) < APART) for x, rows in zip(q, solutions, strict=True)])

    def at_random(self, samples: int) -> None:
        """Check solutions for ``samples`` targets, each the pose of a random configuration (the seed).

        Every solution must reach its target by forward kinematics, the seed must be among them, and none occur twice.
        """
        q = self.arm.draw_configurations(samples, self.rng)
        goals = self.arm.poses(q)
        solutions = self._solve(goals, q)
        self._add("FK(row) = target", OWN_CHAIN, samples, self._worst(goals, solutions), EXACT)
        sharp = self.arm.sharpness(goals, q) > SHARP
        missed = self._missing_mask(q, solutions) & sharp
        note = f"seed lost at q = {np.round(q[np.argmax(missed)], 6).tolist()}" if missed.any() else ""
        tried, lost = int(sharp.sum()), int(missed.sum())
        self._share("share of seeds not found", OWN_CHAIN, tried, lost / max(tried, 1), 0.0, note)
        twice = sum(
            bool(np.any(self.arm.apart(rows[i], rows[:i]) < 1e-7)) for rows in solutions for i in range(1, len(rows))
        )
        self._add("rows that come twice", OWN_CHAIN, samples, twice, 0.0)

    def at_singular(self, samples: int) -> None:
        """Check that singular targets, at multiples of an eighth turn, have solutions and that these reach them."""
        eighths = np.pi / 4 * self.rng.integers(-4, 5, (samples, self.arm.n))
        q = np.where(self.arm.revolute, eighths, 0.1 * eighths)
        q[0] = 0.0
        goals = self.arm.poses(q)
        solutions = self._solve(goals, q)
        self._add("FK(row) = target, singular", OWN_CHAIN, samples, self._worst(goals, solutions), EXACT)
        empty = np.array([len(rows) == 0 for rows in solutions])
        note = f"no row at q = {np.round(q[np.argmax(empty)], 6).tolist()}" if empty.any() else ""
        self._share("share of singular targets without a row", OWN_CHAIN, samples, empty.mean(), 0.0, note)

    def against_search(self, targets: int, tell: Tell | None) -> None:
        """Check that the solver finds every solution that a numerical search finds for ``targets`` random targets.

        ``tell`` is called with the progress.
        """
        solutions = confirmed_rows = rows = missed = 0
        where = ""
        for k, seed in enumerate(self.arm.draw_configurations(targets, self.rng)):
            if tell is not None:
                tell(k, targets, "inverse kinematics: numerical search")
            goals = np.repeat(self.arm.poses(seed[None]), STARTS, axis=0)
            q, met = self.arm.search(goals, self.arm.draw_configurations(STARTS, self.rng))
            q = self._distinct(q[met & (self.arm.sharpness(goals, q) > SHARP)])
            if not len(q):
                continue
            answers = self._solve(goals[: len(q)], q)
            lost = self._missing_mask(q, answers)
            solutions, missed = solutions + len(q), missed + int(lost.sum())
            if self.solver.plan.locked is None:
                rows += len(answers[0])
                confirmed_rows += sum(bool(np.any(self.arm.apart(q, row) < APART)) for row in answers[0])
            if lost.any() and not where:
                where = f"; not among the rows: q = {np.round(q[np.argmax(lost)], 6).tolist()}"
        if not solutions:
            reason = f"the numerical search found no solution of {targets} targets that is clear of singularities"
            self.rows.skipped.append((f"{self.function}: share of other solutions not among the rows", reason))
            return
        counted = f"; the search found {confirmed_rows} of {rows} rows" if rows else ""
        note = f"{solutions} solutions of {targets} targets by {STARTS} starts each{counted}{where}"
        self._share("share of other solutions not among the rows", SEARCH, targets, missed / solutions, 0.0, note)

    def _distinct(self, q: Array) -> Array:
        kept: list[Array] = []
        for x in q:
            if not kept or not np.any(self.arm.apart(np.array(kept), x) < APART):
                kept.append(x)
        return np.array(kept).reshape(-1, self.arm.n)

    def out_of_reach(self) -> None:
        """Check that a target pose farther away than the arm can reach has no solution."""
        if not np.all(self.arm.revolute):
            return
        q = np.zeros((1, self.arm.n))
        goals = self.arm.poses(q)
        goals[:, :3, 3] += 3.0 * self.arm.reach
        self._add("rows of a target out of reach", OWN_CHAIN, 1, len(self._solve(goals, q)[0]), 0.0)
