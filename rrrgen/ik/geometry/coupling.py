"""Joint positions q of a mechanism from the displacements y of its rows, ``y = S q``.

The rows of the DH table from the base to the tip are solved as if each had a drive. Their displacements y belong to
joint positions q where ``y = S q`` up to full turns of the angles. With a regular part B of S, ``q = B^-1 (y_B + 2 pi
z)`` for whole numbers z. Only finitely many z give different arms; those are kept for which q also gives the
displacements of the rows outside B.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import gcd, lcm, pi, prod
from typing import TYPE_CHECKING

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.ik.geometry.chain import Chain, numeric_chain
from rrrgen.ik.geometry.fixed_rows import without_fixed_rows
from rrrgen.ik.geometry.telescope import without_telescopes
from rrrgen.robot.model.mechanism import FollowerLimits, chain_to_tip, coupling_to_tip, follower_limits

if TYPE_CHECKING:
    from rrrgen.robot.robot_spec import RobotSpec

LARGEST_COUNT = 1024
"""Largest number of combinations of full turns of the rows that are tried for one solution of the chain."""

Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Coupling:
    """The relation ``y = S q`` between the chain of rows from base to tip and the joint positions q of a mechanism.

    * ``matrix``: S, (rows, n).
    * ``pivots`` and ``inverse``: indices of n linearly independent rows of S, and the inverse (n, n) of these rows.
    * ``counts``: for each pivot row the number of full turns that are tried, 0 to count - 1; more give the same q.
    * ``periods``: for each joint of q the change (rad or m) with which all angles of the rows make full turns; 0 if
      there is none.
    * ``revolute``, ``limits``: for each joint of q, whether it is revolute, and its position limits (rad or m).
    * ``followers``: the position limits of rows that follow several joints of q.
    """

    matrix: Rows
    pivots: tuple[int, ...]
    inverse: Rows
    counts: tuple[int, ...]
    periods: tuple[float, ...]
    revolute: tuple[bool, ...]
    limits: tuple[tuple[float | None, float | None], ...]
    followers: tuple[FollowerLimits, ...]

    @property
    def n(self) -> int:
        """The number of joints of q."""
        return len(self.inverse)

    @property
    def count(self) -> int:
        """The number of joint positions that give one configuration of the rows."""
        return prod(self.counts)

    def rows(self, q: Sequence[float]) -> list[float]:
        """The displacements ``y = S q`` of the rows."""
        return [sum(f * float(x) for f, x in zip(factors, q, strict=True)) for factors in self.matrix]

    def leading(self, y: Sequence[float]) -> Iterator[list[float]]:
        """Yield every q whose pivot rows have the displacements ``y`` up to full turns; other rows are not checked."""
        for z in product(*(range(count) for count in self.counts)):
            x = [float(y[p]) + 2 * pi * k for p, k in zip(self.pivots, z, strict=True)]
            yield [sum(f * value for f, value in zip(factors, x, strict=True)) for factors in self.inverse]

    def leader(self, row: int) -> int | None:
        """The one joint of q that ``row`` follows; None if it follows several."""
        found = [k for k, factor in enumerate(self.matrix[row]) if factor]
        return found[0] if len(found) == 1 else None


def solved_chain(spec: RobotSpec) -> tuple[Chain, sp.Matrix]:
    """The chain from base to tip whose joints are solved for, and its coupling ``y = S q``.

    Its joints are the rows, without fixed ones; the slides of a telescope are one joint.
    """
    return without_fixed_rows(*without_telescopes(numeric_chain(chain_to_tip(spec)), coupling_to_tip(spec)))


def coupling_of(spec: RobotSpec, chain: Chain, S: sp.Matrix) -> Coupling:
    """The coupling ``y = S q`` of the mechanism ``spec``, whose joints from base to tip are ``chain``.

    Raises DerivationError if the rows do not determine q, or if too many combinations of full turns had to be tried.
    """
    n = spec.n
    if S.rank() < n:
        missing = ", ".join(j.name for j, k in zip(spec.joints, range(n), strict=True) if not any(S[:, k]))
        raise DerivationError(f"{missing} do not move the tip" if missing else "the rows to the tip do not determine q")
    pivots = tuple(S.T.rref()[1])
    inverse = S.extract(list(pivots), list(range(n))).inv()
    turning = [i for i, joint in enumerate(chain.joints) if joint.revolute]
    turns = _full_turns(S, turning)
    counts = tuple(
        _turns_until_alike(S * inverse[:, k], inverse[:, k], turning, turns) if p in turning else 1
        for k, p in enumerate(pivots)
    )
    if prod(counts) > LARGEST_COUNT:
        raise DerivationError(
            f"with these ratios {prod(counts)} positions of the drives give one pose of the rows, and at most "
            f"{LARGEST_COUNT} are tried"
        )
    return Coupling(
        _floats(S),
        pivots,
        _floats(inverse),
        counts,
        tuple(2 * pi * float(turn) for turn in turns),
        tuple(joint.is_revolute for joint in spec.joints),
        tuple((joint.limits.lower, joint.limits.upper) for joint in spec.joints),
        follower_limits(spec),
    )


def _floats(matrix: sp.Matrix) -> Rows:
    return tuple(tuple(float(matrix[i, j]) for j in range(matrix.cols)) for i in range(matrix.rows))


def _full_turns(S: sp.Matrix, turning: list[int]) -> list[sp.Rational]:
    """For each q the least number of turns after which all angles of the rows have made full turns; 0 if none."""
    found: list[sp.Rational] = []
    for k in range(S.cols):
        column = {i: sp.Rational(S[i, k]) for i in turning if S[i, k] != 0}
        free = len(column) == sum(S[i, k] != 0 for i in range(S.rows))
        # the least t > 0 for which every column[i] t is whole
        ratios = [(int(abs(value.p)), int(value.q)) for value in column.values()]
        found.append(sp.Rational(lcm(*(q for _, q in ratios)), gcd(*(p for p, _ in ratios))) if free else sp.S.Zero)
    return found


def _turns_until_alike(rows: sp.Matrix, step: sp.Matrix, turning: list[int], turns: list[sp.Rational]) -> int:
    """Number of additions of ``step`` to q after which the pose of every row, and q up to full periods, repeat.

    ``step`` (n,) changes q in turns, and with it the rows by ``rows``, of which those in ``turning`` are angles;
    ``turns`` are the periods of q (:func:`_full_turns`).
    """
    ratios = [rows[i] for i in turning]
    ratios += [value / period for value, period in zip(step, turns, strict=True) if period]
    return lcm(*(int(sp.Rational(ratio).q) for ratio in ratios))
