"""Exact linear dependencies between columns of the regressor.

The columns are evaluated at random rational states in a finite field. Gaussian elimination from the left finds the
columns that depend on earlier ones. The coefficients of each relation are then computed exactly, as rational functions
of the constants of the geometry, and checked at independent states.

A coefficient may divide by a constant that is nearly zero, such as the cosine of an angle beside pi/2. It would magnify
round-off, so the two columns that it relates change places: the earlier one is removed instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from random import Random
from typing import Any

import sympy as sp
from sympy.polys.matrices import DomainMatrix

from rrrgen.base.errors import InternalError
from rrrgen.derive.recursions.following_joints import Turning, UnitAngles
from rrrgen.derive.recursions.link_frames import (
    Chain,
    ResidueConstants,
    build_chain,
    quarter_turns,
    residue_chain,
    rotate_quarters,
)
from rrrgen.derive.recursions.regressor import Parameter, regressor
from rrrgen.program.finite_field import PRIME, Residue, row_echelon
from rrrgen.program.polynomials import Polynomial, PolynomialRing, to_expression
from rrrgen.robot.model import RobotModel, cosine_sine

STATES = 10
"""Number of sampled states: each gives the first k links k rows for at most 7 k columns, so 7 would be enough."""

CHECK_STATES = 3

ROUNDS = 30
"""Largest number of attempts, each with :data:`STATES` states, to find rows that are independent and simple; usually
the first succeeds."""


LARGEST_FACTOR = 1e3
"""Largest coefficient of a relation, SI: three of sixteen digits. Those of lengths and angles of ordinary robots are
below 100; an angle of 1.5708 instead of pi/2 gives 3e5."""


@dataclass(frozen=True)
class Dependency:
    """A linear relation: the regressor column of ``parameter`` is a combination of other columns.

    ``combination`` maps the other parameters to their factors; it is empty if the column is zero.
    """

    parameter: Parameter
    combination: dict[Parameter, sp.Expr]


def sampled_rows(model: RobotModel, parameters: list[Parameter], seed: int, states: int) -> list[list[int]]:
    """The rows of the regressor for ``parameters`` at ``states`` random rational states, in the finite field."""
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
    """Find the candidates whose column of the regressor depends linearly on the columns before it, with the relation.

    A column changes places with a later one that contains it more than :data:`LARGEST_FACTOR` times at the nominal
    geometry. Raises InternalError if a relation fails at independent states.
    """
    if not candidates:
        return []
    dependencies = _from_the_left(model, ring, candidates, seed)
    # an exchange multiplies the volume that the remaining columns span by its factor, so none comes back
    while exchange := _largest_factor(model, dependencies):
        keeper, removed = exchange
        gone = {d.parameter for d in dependencies} - {removed} | {keeper}
        order = [c for c in candidates if c not in gone] + [c for c in candidates if c in gone]
        dependencies = _from_the_left(model, ring, order, seed)
    _check(model, ring, candidates, dependencies, seed + 1)
    return dependencies


def _from_the_left(model: RobotModel, ring: PolynomialRing, order: list[Parameter], seed: int) -> list[Dependency]:
    """The relations of the columns that depend on others before them in ``order``."""
    echelon, pivots = row_echelon(sampled_rows(model, order, seed, STATES))
    dependencies = []
    for column, parameter in enumerate(order):
        if column in pivots:
            continue
        support = [order[p] for row, p in zip(echelon, pivots, strict=True) if row[column]]
        dependencies.append(Dependency(parameter, _solve(model, ring, parameter, support, seed)))
    return dependencies


def _largest_factor(model: RobotModel, dependencies: list[Dependency]) -> tuple[Parameter, Parameter] | None:
    """The kept and the removed parameter with the largest factor above :data:`LARGEST_FACTOR`; None if there is none.

    A factor that divides by a named parameter whose nominal value is zero is infinite; one with a parameter that has no
    nominal value counts as small.
    """
    sizes = {}
    for dependency in dependencies:
        for keeper, factor in dependency.combination.items():
            value = model.nominal(factor).doit()
            sizes[keeper, dependency.parameter] = float(abs(value.evalf())) if value.is_number else 0.0
    excessive = [pair for pair, size in sizes.items() if size > LARGEST_FACTOR]
    return max(excessive, key=sizes.__getitem__, default=None)


def _solve(
    model: RobotModel, ring: PolynomialRing, parameter: Parameter, support: list[Parameter], seed: int
) -> dict[Parameter, sp.Expr]:
    """The exact factors with which the columns of ``support`` sum to the column of ``parameter``."""
    if not support:
        return {}
    field = ring.ring.to_field()
    rows = _plain_rows(model, ring, [*support, parameter], seed)
    elements = [[field(_poly(ring, v)) for v in row] for row in rows]
    A = DomainMatrix([r[:-1] for r in elements], (len(rows), len(support)), field.to_domain())
    b = DomainMatrix([r[-1:] for r in elements], (len(rows), 1), field.to_domain())
    solution = A.lu_solve(b).to_list_flat()
    return {keeper: _canonical(ring, value) for keeper, value in zip(support, solution, strict=True)}


def _plain_rows(model: RobotModel, ring: PolynomialRing, columns: list[Parameter], seed: int) -> list[list[Any]]:
    """Rows of the regressor that are independent in all ``columns`` but the last, chosen as simple as possible.

    Simple rows (numbers rather than polynomials in the constants) keep needless denominators out of the factors.
    Independence is decided on images in the finite field, since different polynomials in the sine and cosine of one
    constant angle may be the same number.
    """
    random, constants = Random(seed), ResidueConstants(seed)
    images = [Residue.of(constants(generator)) for generator in ring.generators]
    pool: list[list[Any]] = []
    for _ in range(ROUNDS):
        for _ in range(STATES):
            chain, dq, ddq = _rational_state(model, ring, random, 1 + max(i for i, _ in columns))
            pool += [row for row in regressor(chain, dq, ddq, columns) if any(row[:-1])]
        pool.sort(key=_terms)
        mapped = [[_image(v, images).value for v in row[:-1]] for row in pool]
        _, chosen = row_echelon([list(column) for column in zip(*mapped, strict=True)])
        if len(chosen) == len(columns) - 1:
            return [pool[k] for k in chosen]
    raise InternalError(f"no states found at which the columns {columns[:-1]} are independent")


def _terms(row: list[Any]) -> tuple[int, int]:
    """Sort key of a row: number of polynomial terms in all entries but the last, then in the last."""
    counts = [len(v.poly) if isinstance(v, Polynomial) else 0 for v in row]
    return sum(counts[:-1]), counts[-1]


def _image(value: Any, images: list[Residue]) -> Residue:
    """Evaluate ``value`` (a polynomial or a number) in the finite field, at the values ``images`` of its generators."""
    if not isinstance(value, Polynomial):
        return Residue.of(value)
    total = 0
    for powers, coefficient in value.poly.terms():
        term = Residue.of(Fraction(int(coefficient.numerator), int(coefficient.denominator))).value
        for image, power in zip(images, powers, strict=False):
            term = term * pow(image.value, power, PRIME) % PRIME
        total += term
    return Residue(total)


def _canonical(ring: PolynomialRing, value: Any) -> sp.Expr:
    """Simplify the quotient ``value``: lowest terms, and a denominator without sines and square roots.

    Numerator and denominator are multiplied by the conjugates of the denominator to make it rational.
    """
    numerator, denominator = ring.element(value.numer), ring.element(value.denom)
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


def _poly(ring: PolynomialRing, value: Any) -> Any:
    if isinstance(value, Polynomial):
        return value.poly
    value = Fraction(value)
    return ring.ring(sp.QQ(value.numerator, value.denominator))


def _rational_state(
    model: RobotModel, ring: PolynomialRing, random: Random, joints: int
) -> tuple[Chain, list[Any], list[Any]]:
    """A random state of the first ``joints`` joints, with small rational sines and cosines: chain, dq and ddq.

    Half of all angles, slides, rates and accelerations are zero, which gives simple rows.
    """
    part = replace(model, joints=model.joints[:joints], link_frames=model.link_frames[:joints])
    units, points = UnitAngles(part), []
    for _ in range(joints if model.coupling is None else units.count):
        t = Fraction(random.choice((0, 1)) * random.randint(1, 9), random.randint(1, 9))
        points.append(((1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)))

    def trig(turning: Turning, angle: sp.Expr) -> tuple[Any, Any]:
        c, s = units.angle(turning, points.__getitem__)
        if model.coupling is None:
            return c, s
        quarters, rest = quarter_turns(angle)
        cosine, sine = (ring.convert(value) for value in cosine_sine(rest))
        return rotate_quarters(quarters, c * cosine - s * sine, s * cosine + c * sine)

    length = joints if model.coupling is None else model.n

    def numbers(count: int = length) -> list[Fraction]:
        return [Fraction(random.choice((0, 1)) * random.randint(-9, 9)) for _ in range(count)]

    q, gravity = numbers(), numbers(3) if model.spec.gravity_input else None
    return build_chain(part, ring.convert, trig, q, gravity), numbers(), numbers()


def _check(
    model: RobotModel,
    ring: PolynomialRing,
    candidates: list[Parameter],
    dependencies: list[Dependency],
    seed: int,
) -> None:
    """Raise InternalError unless every relation holds at states that were not used to find it."""
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
