"""Joints that follow others: displacements ``y = S q`` of all joints from the positions q, in exact numbers.

The angle of a block of parallel axes, a sum of displacements, is a sum of multiples of the q. Sines and cosines of
multiples of one angle are not independent; :class:`UnitAngles` writes them over angles that are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import sympy as sp

from rrrgen.robot.model import RobotModel

Turning = tuple[tuple[int, sp.Expr], ...]
"""A sum of multiples of joint positions: (index of q, factor) of every term."""

LARGEST_MULTIPLE = 24
"""Largest multiple of an angle whose sine and cosine are written as polynomials in those of the angle itself.

Those of a higher multiple are treated as independent variables. That is exact for dynamics, where polynomials in the
sine and cosine of a block have at most degree 4: too low for a relation between such a multiple and the angle.
"""


def block_turnings(model: RobotModel) -> list[Turning]:
    """Angle through which each joint has turned about the common direction of its block, as a linear function of q.

    A block is a run of joints with parallel axes, so the angles of its revolute joints add up. Returns for each joint
    the pairs (index k, factor of q_k) of that sum.
    """
    turnings: list[Turning] = []
    for i, joint in enumerate(model.joints):
        before = turnings[joint.parent] if joint.parallel else ()
        turnings.append(_sum(before, displacement(model, i)) if joint.revolute else before)
    return turnings


def displacement(model: RobotModel, i: int) -> Turning:
    """The displacement of joint i, row i of ``y = S q``, as pairs (index k, factor of q_k)."""
    if model.coupling is None:
        return ((i, sp.S.One),)
    return tuple((k, factor) for k, factor in enumerate(model.coupling[i]) if factor != 0)


def _sum(x: Turning, y: Turning) -> Turning:
    total: dict[int, sp.Expr] = dict(x)
    for k, factor in y:
        total[k] = total.get(k, sp.S.Zero) + factor
    return tuple((k, factor) for k, factor in total.items() if factor != 0)


class UnitAngles:
    """The angles of the blocks of ``model`` as whole multiples of independent angles; ``count`` is their number."""

    def __init__(self, model: RobotModel) -> None:
        self._units: dict[int, list[tuple[Fraction, int]]] = {k: [] for k in range(model.n)}  # not of closed loops
        if model.coupling is None:
            self.count = model.n
            return
        self.count = 0
        factors = {(k, _fraction(f)) for turning in block_turnings(model) for k, f in turning if k < model.n}
        for k, factor in sorted(factors, key=lambda pair: (pair[0], pair[1].denominator, abs(pair[1]), pair[1])):
            units = self._units[k]
            for j, (unit, place) in enumerate(units):
                ratio = factor / unit
                finer = unit / ratio.denominator
                if max(abs(other / finer) for other in (factor, *self._over(k, place, factors))) <= LARGEST_MULTIPLE:
                    units[j] = (finer, place)
                    break
            else:
                units.append((factor, self.count))
                self.count += 1

    def _over(self, k: int, place: int, factors: set[tuple[int, Fraction]]) -> list[Fraction]:
        """Select the factors f for which f q_k is a whole multiple of the independent angle number ``place``.

        ``factors`` holds pairs (index k, factor of q_k).
        """
        unit = next(unit for unit, number in self._units[k] if number == place)
        return [f for j, f in factors if j == k and (f / unit).denominator == 1 and abs(f / unit) <= LARGEST_MULTIPLE]

    def angle(self, turning: Turning, unit: Callable[[int], tuple[Any, Any]]) -> tuple[Any, Any]:
        """Cosine and sine of the angle ``turning``, a sum of multiples of joint positions.

        ``unit(i)`` gives the cosine and sine of the independent angle i.
        """
        c: Any = 1
        s: Any = 0
        for k, factor in turning:
            place, times = self._multiple(k, factor)
            ck, sk = multiple_angle(*unit(place), times)
            c, s = c * ck - s * sk, s * ck + c * sk
        return c, s

    def _multiple(self, k: int, factor: sp.Expr) -> tuple[int, int]:
        if not self._units[k]:
            return k, 1
        value = _fraction(factor)
        for unit, place in self._units[k]:
            ratio = value / unit
            if ratio.denominator == 1 and abs(ratio) <= LARGEST_MULTIPLE:
                return place, int(ratio)
        raise AssertionError(f"no unit for {factor} of q{k + 1}")


def _fraction(factor: sp.Expr) -> Fraction:
    return Fraction(int(factor.p), int(factor.q))


def multiple_angle(c: Any, s: Any, times: int) -> tuple[Any, Any]:
    """Cosine and sine of ``times`` times an angle."""
    if times < 0:
        return multiple_angle(c, -s, -times)
    total: tuple[Any, Any] = (1, 0)
    for _ in range(times):
        total = (total[0] * c - total[1] * s, total[1] * c + total[0] * s)
    return total


def over_joints(coupling: Sequence[Sequence[Any]] | None, rates: Sequence[Any]) -> Sequence[Any]:
    """``S rates``: the rates of all joints from the rates of q (n,); S is ``coupling``."""
    if coupling is None:
        return rates
    return [_dot(row, rates) for row in coupling]


def over_coordinates(coupling: Sequence[Sequence[Any]] | None, forces: Sequence[Any]) -> list[Any]:
    """``S' forces``: the generalized forces on q (n,) from those on all joints; S is ``coupling``."""
    if coupling is None:
        return list(forces)
    return [_dot([row[k] for row in coupling], forces) for k in range(len(coupling[0]))]


def _dot(weights: Sequence[Any], values: Sequence[Any]) -> Any:
    """The scalar product of ``weights`` and ``values``, without multiplications by the numbers 0 and 1."""
    total: Any = 0
    for weight, value in zip(weights, values, strict=True):
        if _is(weight, 0) or _is(value, 0):
            continue
        total = total + (value if _is(weight, 1) else weight * value)
    return total


def _is(value: Any, number: int) -> bool:
    return isinstance(value, (int, Fraction)) and value == number
