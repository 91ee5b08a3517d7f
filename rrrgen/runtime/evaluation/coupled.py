"""Joint positions q of a mechanism from the solutions of its chain of rows.

The rows from the base to the tip are solved as if each had a drive. Their displacements y belong to joint positions q
where ``y = S q`` up to full turns of the angles. With a regular part B of S, ``q = B^-1 (y_B + 2 pi z)`` for whole
numbers z; only finitely many z give different arms, and those are kept that fit the other rows.
"""

from __future__ import annotations

from itertools import product
from math import gcd, lcm, prod
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from rrrgen.errors import DerivationError
from rrrgen.model.mechanism import coupling_to_tip
from rrrgen.runtime.evaluation.engine import Answer, Engine, batch_of
from rrrgen.runtime.evaluation.kernels import TOLERANCE
from rrrgen.runtime.ik_arguments import LIMITS, NEAREST, RESIDUAL
from rrrgen.runtime.results import FREE, OUTSIDE, IKBatch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rrrgen.ik.geometry.chain import Chain
    from rrrgen.robotfile.robot_spec import RobotSpec

    Array = NDArray[np.float64]

FULL = 2 * np.pi

LARGEST_COUNT = 1024
"""Ways to turn the rows by full turns, for one solution of them, that are tried."""

NEAR = 1e-4
"""How far (rad; lengths over the reach) a solution of the rows may be off the coupling before it is refined on it."""

STEPS = 6

ACCEPT = 4e-12
"""Largest error of a pose, in rad or over the reach, of a solution on the coupling."""

SAME = 1e-7
"""Solutions closer than this (rad; lengths over the reach) are one."""


class Coupling:
    """Converts solutions for the joint angles ``y`` along the chain from base to tip to the independent positions q.

    In a mechanism with coupled joints, ``y = S q`` with a constant matrix S. Raises DerivationError if y does not
    determine q, or if too many combinations of full turns had to be tried.
    """

    def __init__(self, spec: RobotSpec, chain: Chain, *, position: bool) -> None:
        S = coupling_to_tip(spec)
        self.chain, self.n, self._position = chain, spec.n, position
        if S.rank() < spec.n:
            missing = ", ".join(j.name for j, k in zip(spec.joints, range(spec.n), strict=True) if not any(S[:, k]))
            told = f"{missing} do not move the tip" if missing else "the rows to the tip do not determine q"
            raise DerivationError(f"{spec.name}: no inverse kinematics: {told}")
        self._pivots = list(S.T.rref()[1])
        inverse = S.extract(self._pivots, list(range(spec.n))).inv()
        self._revolute = np.array([joint.revolute for joint in chain.joints])
        turning = [i for i in range(S.rows) if self._revolute[i]]
        turns = self._full_turns(S, turning)
        self._counts = [
            _turns_until_alike(S * inverse[:, k], inverse[:, k], turning, turns) if self._revolute[p] else 1
            for k, p in enumerate(self._pivots)
        ]
        if prod(self._counts) > LARGEST_COUNT:
            raise DerivationError(
                f"{spec.name}: no inverse kinematics: with these ratios {prod(self._counts)} positions of the drives "
                f"give one pose of the rows, and at most {LARGEST_COUNT} are tried"
            )
        self.S, self._inverse = np.array(S, float), np.array(inverse, float)
        self.count = prod(self._counts)
        self._periods = FULL * np.array(turns, float)
        self._limits = _Limits(spec, self.S)

    def _full_turns(self, S: sp.Matrix, turning: list[int]) -> list[sp.Rational]:
        """By how many turns each q alone may change so that all angles of the rows make full turns; 0 if it may not."""
        found: list[sp.Rational] = []
        for k in range(self.n):
            column = {i: sp.Rational(S[i, k]) for i in range(S.rows) if S[i, k] != 0 and i in turning}
            free = len(column) == sum(S[i, k] != 0 for i in range(S.rows))
            # the least t > 0 for which every column[i] t is whole
            ratios = [(int(abs(value.p)), int(value.q)) for value in column.values()]
            found.append(sp.Rational(lcm(*(q for _, q in ratios)), gcd(*(p for p, _ in ratios))) if free else sp.S.Zero)
        return found

    def solutions(self, y: Array, goal: Array, reference: Array | None, *, refined: bool) -> list[tuple[Array, bool]]:
        """The joint positions of one solution ``y`` of the rows, each with whether it is inside all limits.

        ``refined``: also where y is off the coupling, as it may be where an angle of the rows is free.
        """
        found: list[tuple[Array, bool]] = []
        for z in product(*(range(count) for count in self._counts)):
            q = self._inverse @ (y[self._pivots] + FULL * np.array(z))
            off = (self.S @ q - y) / np.where(self._revolute, 1.0, self.chain.reach)
            off[self._revolute] = np.remainder(off[self._revolute] + np.pi, FULL) - np.pi
            if np.abs(off).max() > NEAR and not refined:
                continue
            exact = self._on_coupling(q, goal)
            if exact is not None:
                found.append(self._limits.placed(exact, self._periods, reference))
        return found

    def apart(self, a: Array, b: Array) -> float:
        """How far two configurations are apart, over full turns."""
        d = a - b
        turn = self._periods > 0
        d[turn] = np.remainder(d[turn] + self._periods[turn] / 2, self._periods[turn]) - self._periods[turn] / 2
        return float(np.abs(self.S @ d).max())

    def _on_coupling(self, q: Array, goal: Array) -> Array | None:
        """``q`` refined on the true mechanism by Gauss-Newton steps; None where it does not meet the goal."""
        for _ in range(STEPS):
            error = self._error(q, goal)
            if np.abs(error).max() <= TOLERANCE["tight"] ** 0.5:
                break
            J = self.chain.jacobian(self.S @ q) @ self.S
            J[:3] /= self.chain.reach
            q = q + np.linalg.lstsq(J[: len(error)], error, rcond=1e-9)[0]
        return q if np.abs(self._error(q, goal)).max() <= ACCEPT else None

    def _error(self, q: Array, goal: Array) -> Array:
        T = self.chain.forward(self.S @ q)
        if self._position:
            return np.asarray((goal[:3] - T[:3, 3]) / self.chain.reach)
        turn = 0.5 * np.cross(T[:3, :3], goal[:3, :3], axis=0).sum(axis=1)
        D = np.abs(T[:3, :3] - goal[:3, :3]).max()
        if D > 1.0:  # beyond a quarter turn the sine no longer tells
            turn = turn + D
        return np.concatenate([(goal[:3, 3] - T[:3, 3]) / self.chain.reach, turn])


def _turns_until_alike(rows: sp.Matrix, step: sp.Matrix, turning: list[int], turns: list[sp.Rational]) -> int:
    """How often q may take ``step`` turns, which moves the rows by ``rows``, before it repeats over its own turns."""
    ratios = [rows[i] for i in turning]
    ratios += [value / period for value, period in zip(step, turns, strict=True) if period]
    return lcm(*(int(sp.Rational(ratio).q) for ratio in ratios))


class CoupledEngine:
    """Inverse kinematics of a mechanism with coupled joints, by the ``engine`` that solves its chain without couplings.

    ``rows`` is the largest number of solutions, ``unfit`` the status code if no solution satisfies the couplings.
    """

    def __init__(self, engine: Engine, rows: int, coupling: Coupling, unfit: int) -> None:
        self._engine, self._rows, self._coupling, self._unfit = engine, rows, coupling, unfit

    def answer(
        self, goal: NDArray[np.float64], reference: NDArray[np.float64] | None, given: float, bits: int, closest: bool
    ) -> Answer:
        """Solve for one target. Raises DerivationError for the nearest configuration, which the rows do not tell."""
        if closest or bits & RESIDUAL:
            raise DerivationError("joints follow others: only solutions that meet the target are found")
        rows = None if reference is None else np.ascontiguousarray(self._coupling.S @ reference)
        found = self._engine.answer(goal, rows, given, 0, closest=False)
        kept: list[tuple[NDArray[np.float64], int, int]] = []
        outside = False
        for y, flags, branch in zip(found.q, found.flags, found.branch, strict=True):
            for q, inside in self._coupling.solutions(y, goal[0], reference, refined=bool(flags & FREE)):
                outside = outside or not inside
                if (inside or not bits & LIMITS) and all(self._coupling.apart(q, other[0]) > SAME for other in kept):
                    kept.append((q, int(flags) | (0 if inside else OUTSIDE), int(branch)))
        if bits & NEAREST and reference is not None:
            kept.sort(key=lambda each: float(np.sum((each[0] - reference) ** 2)))
        code = found.code
        if code == 0 and not kept:
            code = 2 if outside else 1
        stage = found.stage if found.code == 1 else self._unfit
        q = np.array([each[0] for each in kept], float).reshape(len(kept), self._coupling.n)
        flags_, branches = (np.array([each[k] for each in kept], np.uint32) for k in (1, 2))
        return Answer(code, q, flags_, branches, np.zeros(len(kept)), stage, -1.0 if code == 1 else 0.0)

    def batch(
        self,
        goals: NDArray[np.float64],
        reference: NDArray[np.float64] | None,
        given: NDArray[np.float64] | None,
        bits: int,
    ) -> IKBatch:
        """Solve for every target, one after the other."""
        answers = [
            self.answer(goals[i : i + 1], reference, 0.0 if given is None else float(given[i]), bits, closest=False)
            for i in range(len(goals))
        ]
        return batch_of(answers, self._rows, self._coupling.n)


class _Limits:
    """The limits of q, and of all rows, which may follow several joints."""

    def __init__(self, spec: RobotSpec, S: Array) -> None:
        ends = [(joint.limits.lower, joint.limits.upper) for joint in spec.joints]
        self._ends = [(-np.inf if a is None else a, np.inf if b is None else b) for a, b in ends]
        rows = zip(spec.rows, spec.mechanism.matrix if spec.mechanism else (), strict=False)
        self._rows = [
            (np.array(factors, float), joint.limits.lower, joint.limits.upper)
            for joint, factors in rows
            if joint.name not in {each.name for each in spec.joints}
        ]

    def placed(self, q: Array, periods: Array, reference: Array | None) -> tuple[Array, bool]:
        """``q`` moved by full turns next to the reference and inside the limits where possible, and whether all are."""
        row, inside, margin = q.copy(), True, TOLERANCE["limit"]
        for k, ((low, high), period) in enumerate(zip(self._ends, periods, strict=True)):
            if period:
                middle = 0.0 if reference is None else float(reference[k])
                row[k] = middle + np.remainder(row[k] - middle + period / 2, period) - period / 2
                turns = np.ceil(max(low - margin - row[k], 0.0) / period) - np.ceil(
                    max(row[k] - high - margin, 0.0) / period
                )
                if low - margin <= row[k] + period * turns <= high + margin:
                    row[k] += period * turns
            inside = inside and low - margin <= row[k] <= high + margin
        for factors, lower, upper in self._rows:
            value = float(factors @ row)
            inside = (
                inside and (lower is None or value >= lower - margin) and (upper is None or value <= upper + margin)
            )
        return row, bool(inside)
