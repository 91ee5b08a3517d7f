"""Linear dependencies between the columns of the regressor of a robot with closed loops.

Positions in a loop contain square roots of functions of q, so that the factors of the relations are not computed over
polynomials. Which columns depend on which is found by the echelon form over the finite field, exactly. The factors are
computed in numbers of 60 digits. If such a number is a fraction of few digits, or one times a square root of the
geometry, and its image in the field is that of the echelon form, then the factor is exactly this one; other factors, of
cosines of arbitrary constant angles, are written with 40 digits. Named parameters have their nominal values. Every
relation is confirmed at independent states in the field or, for decimals, in numbers of 60 digits.

Both signs of a root belong to one irreducible equation, so the relations hold for both ways to assemble a loop. A
parallelogram, whose equation is reducible, is refused where the robot file is read.

Loops that Newton's method solves have no positions in the field. Their relations are numerical: rank and factors are
those of the regressor in numbers of 60 digits, at states along a random walk from the start of the robot file. Factors
that are fractions of few digits there are written as such, others with 40 digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import partial
from itertools import combinations
from random import Random
from typing import Any

import mpmath
import sympy as sp

from rrrgen.base.errors import DerivationError, InternalError
from rrrgen.derive.recursions.link_frames import PRECISE, Chain, ResidueConstants, exact_constants, precise_chain
from rrrgen.derive.recursions.loop_positions import LoopClosure, parts_of
from rrrgen.derive.recursions.loops import NewtonLoops
from rrrgen.derive.recursions.regressor import Dependency, Parameter, regressor
from rrrgen.program.finite_field import PRIME, Residue, row_echelon
from rrrgen.robot.model import RobotModel

FURTHER_STATES = 3
"""States beyond one for each column: while columns are missing, a further state at random adds to the rank."""

DRAWS = 500
"""Largest number of random positions among which one must be found at which all loops can be assembled."""

REACH = 3.2
"""Positions without limits are drawn between minus and plus this, rad or m."""

CLEAR = 1e-3
"""Least square of the sine between two bars at the positions that are drawn."""

LARGEST_DENOMINATOR = 10**20
"""Largest denominator of a factor that counts as a fraction: one random number in 10^10 is that near to one."""

SAME = mpmath.mpf(10) ** -35
"""Largest relative error of a relation in numbers of 60 digits, away from dead points."""

DIGITS = 40
"""Digits of factors that are no fractions."""


DEPENDENT = mpmath.mpf(10) ** -30
"""Part of a column, relative to its length, that is no combination of others if it is larger: in numbers of 60 digits
dependent columns leave 1e-45 and less."""

SMALL_DENOMINATOR = 10**12
"""Largest denominator of a factor in numbers of 60 digits that counts as a fraction: one random number in 10^20 is
that near to one."""

STROLL = 0.4
"""Longest step, rad or m, of the random walk over the states of loops that Newton's method solves."""


Rows = Callable[[list[Parameter], int, int], list[list[int]]]
"""(columns, seed, number of states) -> rows of the regressor in the finite field."""


def loop_dependencies(model: RobotModel, candidates: list[Parameter], rows: Rows, seed: int) -> list[Dependency]:
    """Find the parameters among ``candidates`` that the torques cannot tell, since loops make their columns dependent.

    A column of the regressor is dependent if it is a linear combination of the columns before it; the combination is
    returned with it.

    Raises DerivationError if a loop cannot be assembled anywhere.
    """
    states = len(candidates) + FURTHER_STATES
    echelon, pivots = row_echelon(rows(candidates, seed, states))
    kept = [candidates[p] for p in pivots]
    dependent = [column for column in range(len(candidates)) if column not in pivots]
    with mpmath.workdps(PRECISE):
        random = Random(seed)
        values = _solve_for_factors(model, kept, [candidates[column] for column in dependent], random)
        roots = list(_roots(model))
        dependencies, decimal = [], []
        for column, coefficients in zip(dependent, values, strict=True):
            images = [row[column] for row in echelon]
            factors = {
                k: _factor(value, image, roots)
                for k, value, image in zip(kept, coefficients, images, strict=True)
                if image
            }
            dependencies.append(Dependency(candidates[column], {k: factor for k, (factor, _) in factors.items()}))
            if not all(exact for _, exact in factors.values()):
                decimal.append(dependencies[-1])
        _confirm_decimals(candidates, decimal, partial(_regressor, model, random))
    exact = [dependency for dependency in dependencies if dependency not in decimal]
    _confirm_exactly(candidates, exact, rows(candidates, seed + 1, FURTHER_STATES))
    return dependencies


def numerical_dependencies(model: RobotModel, candidates: list[Parameter], seed: int) -> list[Dependency]:
    """The ``candidates`` whose column depends on those before it, for loops that Newton's method solves.

    Raises DerivationError where the loops cannot be assembled at their start.
    """
    with mpmath.workdps(PRECISE):
        walk = _DriveWalk(model, Random(seed))
        rows: list[list[Any]] = []
        for _ in range(len(candidates) + FURTHER_STATES):
            rows += walk.rows(candidates)
        basis: list[tuple[int, list[Any]]] = []  # the independent columns, orthogonal to those before them
        dependent = []
        for column in range(len(candidates)):
            whole = [row[column] for row in rows]
            rest, size = whole, mpmath.sqrt(mpmath.fdot(whole, whole))
            for _ in range(2):  # the second time against the round-off of the first
                for _, unit in basis:
                    along = mpmath.fdot(unit, rest)
                    rest = [x - along * y for x, y in zip(rest, unit, strict=True)]
            length = mpmath.sqrt(mpmath.fdot(rest, rest))
            if length > DEPENDENT * size:
                basis.append((column, [x / length for x in rest]))
            else:
                dependent.append(column)
        places = [column for column, _ in basis]
        kept = [candidates[column] for column in places]
        A = mpmath.matrix([[row[column] for column in places] for row in rows])
        inverse = mpmath.inverse(A.T * A) if kept else None
        dependencies = []
        for column in dependent:
            factors: dict[Parameter, sp.Expr] = {}
            if inverse is not None:
                solution = inverse * (A.T * mpmath.matrix([row[column] for row in rows]))
                factors = {k: _round_to_rational(v) for k, v in zip(kept, solution, strict=True) if abs(v) > DEPENDENT}
            dependencies.append(Dependency(candidates[column], factors))
        _confirm_decimals(candidates, dependencies, walk.rows)
    return dependencies


def _round_to_rational(value: Any) -> sp.Expr:
    """The fraction of few digits that ``value`` is, or its first 40 digits."""
    fraction = _exact(value).limit_denominator(SMALL_DENOMINATOR)
    if abs(value - mpmath.mpf(fraction.numerator) / fraction.denominator) < SAME * (1 + abs(value)):
        return sp.Rational(fraction.numerator, fraction.denominator)
    return sp.Rational(mpmath.nstr(value, DIGITS))


class _DriveWalk:
    """A random walk of the drives within their limits, at which the loops are assembled and away from dead points."""

    def __init__(self, model: RobotModel, random: Random) -> None:
        self._model, self._random, self._loops = model, random, LoopClosure(model)
        self._at, self._passive = list(self._loops.drives), self._loops.start
        limits = [joint.limits for joint in model.spec.joints]
        self._ends = [
            (-REACH if limit.lower is None else limit.lower, REACH if limit.upper is None else limit.upper)
            for limit in limits
        ]

    def rows(self, columns: list[Parameter]) -> list[list[Any]]:
        """Rows of the regressor, in numbers of 60 digits, at the next state."""
        self._step()
        positions = [mpmath.mpf(v) for v in (*self._at, *self._passive)]
        for _ in range(PRECISE // 8):  # digits double with every step
            chain = precise_chain(self._model, positions)
            assert isinstance(chain.loops, NewtonLoops)
            if max(map(abs, chain.loops.gaps)) < mpmath.mpf(10) ** (4 - PRECISE) * mpmath.sqrt(chain.loops.scale):
                break
            positions = [*positions[: self._model.n], *chain.loops.step()]
        dq, ddq = ([mpmath.mpf(self._random.uniform(-1, 1)) for _ in range(self._model.n)] for _ in range(2))
        return regressor(chain, dq, ddq, columns)

    def _step(self) -> None:
        for _ in range(DRAWS):
            moved = [x + self._random.uniform(-STROLL, STROLL) for x in self._at]
            target = [min(max(x, low), high) for x, (low, high) in zip(moved, self._ends, strict=True)]
            parts = parts_of(max(abs(x - y) for x, y in zip(target, self._at, strict=True)))
            passive = self._loops.follow(target, self._passive, self._at, parts)
            loops = self._loops.loops([*target, *passive])
            same_side = loops.sine * self._loops.loops([*self._at, *self._passive]).sine > 0
            if same_side and loops.sine**2 > CLEAR and self._loops.gap(target, passive) < 1e-9:
                self._at, self._passive = target, passive
                return
        names = ", ".join(loop.name for loop in self._model.spec.loops)
        raise DerivationError(f"{self._model.spec.name}: {names} cannot leave their start without passing a dead point")


def _solve_for_factors(
    model: RobotModel, kept: list[Parameter], dependent: list[Parameter], random: Random
) -> list[list[Any]]:
    """For each of the columns ``dependent`` the factors of the columns ``kept``, from states at random."""
    count = len(kept)
    if not count:
        return [[] for _ in dependent]
    rows: list[list[Any]] = []
    for _ in range(count + FURTHER_STATES):
        rows += _regressor(model, random, [*kept, *dependent])
    A = mpmath.matrix([row[:count] for row in rows])
    inverse = mpmath.inverse(A.T * A)
    return [list(inverse * (A.T * mpmath.matrix([row[count + k] for row in rows]))) for k in range(len(dependent))]


def _regressor(model: RobotModel, random: Random, columns: list[Parameter]) -> list[list[Any]]:
    """Rows of the regressor at a random state at which all loops are assembled, away from their dead points."""
    chain = _assemble_at_random(model, random)
    dq, ddq = ([mpmath.mpf(random.uniform(-1, 1)) for _ in range(model.n)] for _ in range(2))
    return regressor(chain, dq, ddq, columns)


def _roots(model: RobotModel) -> Iterator[tuple[sp.Expr, Any, int]]:
    """The number 1, the square roots in the geometry and their products in pairs, each with value and image."""
    _, _, roots = exact_constants(
        model, [v for c in model.closures for s in c.segments for v in (*s.place, *s.direction)]
    )
    constants = ResidueConstants(0)
    pairs = [x * y for x, y in combinations(roots, 2)]
    for root in (sp.S.One, *roots, *pairs):
        yield root, mpmath.mpf(root.evalf(PRECISE)), Residue.of(constants(root)).value


def _factor(value: Any, image: int, roots: Sequence[tuple[sp.Expr, Any, int]]) -> tuple[sp.Expr, bool]:
    """The factor with this ``value``, and whether it is exact: ``image`` is that of the exact one in the field."""
    for root, size, its_image in roots:
        fraction = _exact(value / size).limit_denominator(LARGEST_DENOMINATOR)
        if Residue.of(fraction).value * its_image % PRIME == image:
            return sp.Rational(fraction.numerator, fraction.denominator) * root, True
    return sp.Rational(mpmath.nstr(value, DIGITS)), False


def _exact(value: Any) -> Fraction:
    """The binary number ``value`` as a fraction."""
    sign, mantissa, exponent, _ = value._mpf_
    return Fraction(-int(mantissa) if sign else int(mantissa)) * Fraction(2) ** int(exponent)


def _confirm_exactly(candidates: list[Parameter], dependencies: list[Dependency], rows: list[list[int]]) -> None:
    """Raise InternalError unless every relation in ``dependencies`` also holds at states that were not used to find it.

    ``rows`` are those of the regressor at such states in the finite field, with a column for each of ``candidates``.
    """
    constants = ResidueConstants(0)
    place = {parameter: k for k, parameter in enumerate(candidates)}
    for dependency in dependencies:
        images = {place[k]: Residue.of(constants(v)) for k, v in dependency.combination.items()}
        for row in rows:
            rest = Residue(row[place[dependency.parameter]]) - sum((f * row[k] for k, f in images.items()), Residue(0))
            if rest.value:
                raise InternalError(f"a relation found for {dependency.parameter} does not hold in general")


def _confirm_decimals(
    candidates: list[Parameter], dependencies: list[Dependency], rows: Callable[[list[Parameter]], list[list[Any]]]
) -> None:
    """Raise InternalError unless every relation holds at states that were not used to find it, in 60 digits.

    ``rows`` gives those of some columns of the regressor at a further state.
    """
    place = {parameter: k for k, parameter in enumerate(candidates)}
    for _ in range(FURTHER_STATES if dependencies else 0):
        for row in rows(candidates):
            for dependency in dependencies:
                factors = {place[k]: mpmath.mpf(v.evalf(PRECISE)) for k, v in dependency.combination.items()}
                rest = row[place[dependency.parameter]] - sum(row[k] * v for k, v in factors.items())
                if abs(rest) > SAME * (1 + max(map(abs, row))):
                    raise InternalError(f"a relation found for {dependency.parameter} does not hold in general")


def _assemble_at_random(model: RobotModel, random: Random) -> Chain:
    """The chain at random positions at which all loops are assembled, away from their dead points."""
    lower, upper = ([getattr(joint.limits, end) for joint in model.spec.joints] for end in ("lower", "upper"))
    ends = [(-REACH if a is None else a, REACH if b is None else b) for a, b in zip(lower, upper, strict=True)]
    for _ in range(DRAWS):
        chain = precise_chain(model, [mpmath.mpf(random.uniform(*interval)) for interval in ends])
        if chain.loops is not None and all(dyad.margin > dyad.whole * CLEAR for dyad in chain.loops.dyads):
            return chain
    names = ", ".join(loop.name for loop in model.spec.loops)
    raise DerivationError(f"{model.spec.name}: no positions within the limits at which {names} can be assembled")
