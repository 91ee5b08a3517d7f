"""Exact linear dependencies between columns of the regressor.

The columns are evaluated at random rational states in a finite field. Elimination from the left finds which columns
depend on those before them; the coefficients of each relation are then solved for exactly, over the polynomials in the
constants of the geometry, and checked at independent states.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import sympy as sp
from sympy.polys.matrices import DomainMatrix

from rrrgen.derive.chain import Chain, ResidueConstants, build_chain, residue_chain
from rrrgen.derive.finite_field import PRIME, Residue, row_echelon
from rrrgen.derive.polynomials import Polynomial, PolynomialRing, to_expression
from rrrgen.derive.regressor import Parameter, regressor
from rrrgen.errors import InternalError
from rrrgen.model import RobotModel

STATES = 10
"""States sampled. The columns of the first k links have at least k rows per state and at most 7 k columns."""

CHECK_STATES = 3


@dataclass(frozen=True)
class Dependency:
    """Column ``parameter`` equals the sum of factor times the columns of ``combination``; empty: no effect at all."""

    parameter: Parameter
    combination: dict[Parameter, sp.Expr]


def sampled_rows(model: RobotModel, parameters: list[Parameter], seed: int, states: int) -> list[list[int]]:
    """Rows of the regressor at ``states`` random rational states, in the finite field."""
    constants = ResidueConstants(seed)
    rows: list[list[int]] = []
    for _ in range(states):
        chain, _slides = residue_chain(model, constants)
        dq = [constants.draw() for _ in range(model.n)]
        ddq = [constants.draw() for _ in range(model.n)]
        rows += [[Residue.of(v).value for v in row] for row in regressor(chain, dq, ddq, parameters)]
    return rows


def find_dependencies(
    model: RobotModel, ring: PolynomialRing, candidates: list[Parameter], seed: int
) -> list[Dependency]:
    """Relations of every candidate column that depends on the columns before it."""
    if not candidates:
        return []
    echelon, pivots = row_echelon(sampled_rows(model, candidates, seed, STATES))
    dependencies = []
    for column, parameter in enumerate(candidates):
        if column in pivots:
            continue
        support = [candidates[p] for row, p in zip(echelon, pivots, strict=True) if row[column]]
        dependencies.append(Dependency(parameter, _solve(model, ring, parameter, support, seed)))
    _check(model, ring, candidates, dependencies, seed + 1)
    return dependencies


def _solve(
    model: RobotModel, ring: PolynomialRing, parameter: Parameter, support: list[Parameter], seed: int
) -> dict[Parameter, sp.Expr]:
    """Exact factors of the relation between ``parameter`` and the columns of its ``support``."""
    if not support:
        return {}
    random = Random(seed)
    field = ring.ring.to_field()
    rows: list[list[Any]] = []
    while len(rows) < len(support):
        chain, dq, ddq = _rational_state(model, ring, random)
        for row in regressor(chain, dq, ddq, [*support, parameter]):
            trial = [*rows, [field(_poly(ring, v)) for v in row]]
            if any(trial[-1]) and _independent([r[:-1] for r in trial], field):
                rows = trial
            if len(rows) == len(support):
                break
    A = DomainMatrix([r[:-1] for r in rows], (len(rows), len(support)), field.to_domain())
    b = DomainMatrix([[r[-1]] for r in rows], (len(rows), 1), field.to_domain())
    solution = A.lu_solve(b).to_list_flat()
    return {keeper: _canonical(ring, value) for keeper, value in zip(support, solution, strict=True)}


def _canonical(ring: PolynomialRing, value: Any) -> sp.Expr:
    """A quotient of polynomials with a denominator free of sines and roots (times its conjugates), in lowest terms."""
    numerator: Any = Polynomial(ring, value.numer) * 1
    denominator: Any = Polynomial(ring, value.denom) * 1
    for conjugate in ring.conjugations():
        if isinstance(denominator, Polynomial):
            other = conjugate(denominator)
            if other != denominator:
                numerator, denominator = numerator * other, denominator * other
    if not isinstance(denominator, Polynomial):
        return to_expression(numerator / denominator)
    field = ring.ring.to_field()
    lowest = field(_poly(ring, numerator)) / field(denominator.poly)
    return to_expression(Polynomial(ring, lowest.numer)) / to_expression(Polynomial(ring, lowest.denom))


def _independent(rows: list[list[Any]], field: Any) -> bool:
    return int(DomainMatrix(rows, (len(rows), len(rows[0])), field.to_domain()).rank()) == len(rows)


def _poly(ring: PolynomialRing, value: Any) -> Any:
    if isinstance(value, Polynomial):
        return value.poly
    value = Fraction(value)
    return ring.ring(sp.QQ(value.numerator, value.denominator))


def _rational_state(model: RobotModel, ring: PolynomialRing, random: Random) -> tuple[Chain, list[Any], list[Any]]:
    """A state with small rational sines and cosines, and the exact geometry."""
    n = model.n
    points = []
    for _ in range(n):
        t = Fraction(random.randint(1, 9), random.randint(1, 9))
        points.append(((1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)))

    def trig(turning: tuple[int, ...], angle: sp.Expr) -> tuple[Any, Any]:
        c, s = Fraction(1), Fraction(0)
        for i in turning:
            c, s = c * points[i][0] - s * points[i][1], s * points[i][0] + c * points[i][1]
        return c, s

    numbers = [[Fraction(random.randint(-9, 9) or 1) for _ in range(n)] for _ in range(3)]
    return build_chain(model, ring.convert, trig, numbers[0]), numbers[1], numbers[2]


def _check(
    model: RobotModel,
    ring: PolynomialRing,
    candidates: list[Parameter],
    dependencies: list[Dependency],
    seed: int,
) -> None:
    """Every relation must hold at states that were not used to find it."""
    if not dependencies:
        return
    position = {parameter: k for k, parameter in enumerate(candidates)}
    constants = ResidueConstants(seed)
    images = [
        (
            position[d.parameter],
            {position[k]: Residue.of(constants(v)) for k, v in d.combination.items()},
        )
        for d in dependencies
    ]
    for _ in range(CHECK_STATES):
        chain, _slides = residue_chain(model, constants)
        dq = [constants.draw() for _ in range(model.n)]
        ddq = [constants.draw() for _ in range(model.n)]
        for row in regressor(chain, dq, ddq, candidates):
            for column, factors in images:
                rest = Residue.of(row[column]) - sum((f * row[k] for k, f in factors.items()), Residue(0))
                if rest.value % PRIME:
                    raise InternalError(f"a relation found for {candidates[column]} does not hold in general")
