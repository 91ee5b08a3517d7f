"""The minimal set of base parameters, the inertial parameters on which the dynamics depend, as exact expressions.

Two regrouping rules follow from the type of a joint. They are applied from the last link to the first, to the
pseudo-inertia (14.9) in canonical frames:

* revolute joint: the rotation leaves the entries Jzz, hz and m, mass distributed along the joint axis, unchanged. They
  move to the link before: ``J_{i-1} += X_i [Jzz, hz, m] X_i'``. Seven entries stay with the link.
* prismatic joint: the link does not rotate relative to the link before. Its second moments move to that link:
  ``S_{i-1} += R_i S_i R_i'``. Mass and first moments stay.

Parameters that the first joints cannot excite (an axis parallel to gravity, parallel axes, translation without
rotation) show up as linearly dependent columns of the regressor. These are found exactly, at random rational states in
a finite field, and removed in a fixed order: parameters of links nearer the base are kept, within a link in the order
of :data:`CANDIDATES`. The number is certified in both directions: the remaining columns have a non-zero minor, so none
is superfluous, and every removed column satisfies its relation at independent states, so none is missing.

(14.9) is from Kostic, de Jager and Steinbuch, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache, partial
from random import Random
from typing import Any

import sympy as sp
from sympy.polys.matrices import DomainMatrix

from rrrgen.base.errors import InternalError
from rrrgen.derive.recursions.following_joints import Turning, UnitAngles
from rrrgen.derive.recursions.link_frames import (
    Chain,
    Placement,
    ResidueConstants,
    build_chain,
    exact_constants,
    moving,
    quarter_turns,
    residue_chain,
    rotate_quarters,
)
from rrrgen.derive.recursions.pseudo_inertia import ENTRIES, PseudoInertia, from_standard
from rrrgen.derive.recursions.regressor import Dependency, Parameter, regressor
from rrrgen.program.finite_field import PRIME, Residue, row_echelon
from rrrgen.program.polynomials import Polynomial, PolynomialRing, to_expression
from rrrgen.robot.model import RigidTransform, RobotModel, cosine_sine
from rrrgen.robot.spec import STANDARD

# ------------------------------------------------------------------------------------------------------------------
# Exact linear dependencies between columns of the regressor.
#
# The columns are evaluated at random rational states in a finite field. Gaussian elimination from the left finds the
# columns that depend on earlier ones. The coefficients of each relation are then computed exactly, as rational
# functions of the constants of the geometry, and checked at independent states.
#
# A coefficient may divide by a constant that is nearly zero, such as the cosine of an angle beside pi/2. It would
# magnify round-off, so the two columns that it relates change places: the earlier one is removed instead.
# ------------------------------------------------------------------------------------------------------------------

SAMPLED_STATES = 8
"""Number of sampled states: each gives the first k links k rows for at most 7 k columns, so 7 would be enough."""

CHECK_STATES = 2
"""Number of independent states at which relations are checked. A wrong one holds at a random state with a probability
of its degree over the prime, about 1e-16, so that one would be enough."""

PLAIN_STATES = 10
"""Number of states with small rational sines and cosines of one attempt to find simple rows."""

MOST_PRODUCT_TERMS = 2000
"""Terms of a product with a conjugate, before like ones are added. No bundled robot or example has a denominator with a
sine; for a slide on a turning arm behind six odd angles the products took minutes."""

ROUNDS = 30
"""Largest number of attempts, each with :data:`PLAIN_STATES` states, to find rows that are independent and simple;
usually the first succeeds."""


LARGEST_FACTOR = 1e3
"""Largest coefficient of a relation, SI: three of sixteen digits. Those of lengths and angles of ordinary robots are
below 100; an angle of 1.5708 instead of pi/2 gives 3e5."""


def sampled_rows(model: RobotModel, parameters: list[Parameter], seed: int, states: int) -> list[list[int]]:
    """The rows of the regressor at ``states`` random states, a column for each of ``parameters``.

    All numbers are residues modulo a prime: states, and with them the rows, are rational and computed without rounding.
    """
    constants = ResidueConstants(seed, model.nominal if model.closures else None)
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
    if model.spec.newton:
        from rrrgen.derive.parameters.loop_dependencies import numerical_dependencies

        return numerical_dependencies(model, candidates, seed)
    if model.closures:
        from rrrgen.derive.parameters.loop_dependencies import loop_dependencies

        return loop_dependencies(model, candidates, partial(sampled_rows, model), seed)
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
    echelon, pivots = row_echelon(sampled_rows(model, order, seed, SAMPLED_STATES))
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
        for _ in range(PLAIN_STATES):
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

    Numerator and denominator are multiplied by the conjugates of the denominator to make it rational. A denominator
    that has the sines of many odd angles keeps them: its terms would multiply with every conjugate.
    """
    numerator, denominator = ring.element(value.numer), ring.element(value.denom)
    for conjugate in ring.conjugations():
        if isinstance(denominator, Polynomial):
            other = conjugate(denominator)
            if other != denominator:
                if len(denominator.poly) ** 2 > MOST_PRODUCT_TERMS:
                    return to_expression(ring.element(value.numer)) / to_expression(ring.element(value.denom))
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
    chain = build_chain(part, ring.convert, trig, q, gravity)
    if model.spec.floating_base:
        chain = moving(chain, lambda: numbers(1)[0])
    return chain, numbers(), numbers()


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


# ------------------------------------------------------------------------------------------------------------------
# The minimal set of base parameters, the inertial parameters on which the dynamics depend, as exact expressions
# ------------------------------------------------------------------------------------------------------------------

CANDIDATES = {
    True: ("Jxx", "Jyy", "Jxy", "Jxz", "Jyz", "hx", "hy"),
    False: ("m", "hx", "hy", "hz"),
}
"""Entries that stay with a link behind a revolute (True) or prismatic (False) joint, in order of preference."""


def candidate_entries(model: RobotModel, link: int) -> tuple[str, ...]:
    """The entries that stay with ``link``: of the body of a floating base all ten, since no joint carries it."""
    joint = model.joints[link]
    if joint.parent < 0 and model.spec.floating_base:
        return ENTRIES
    return CANDIDATES[joint.revolute]


UNITS = {"J": "kg m^2", "I": "kg m^2", "h": "kg m", "m": "kg"}


@dataclass(frozen=True)
class BaseParameter:
    """One base parameter: its name, its unit, and its expression in the standard parameters of the links.

    The expression may contain named parameters of the geometry. Products of inertia are entries of the inertia tensor,
    ``Ixy = -integral of x y dm``.
    """

    name: str
    expression: sp.Expr
    unit: str


@dataclass(frozen=True)
class Regrouping:
    """How the standard ``parameter`` enters the base parameters: a ``formula`` and the ``reason`` for it, as text."""

    parameter: str
    formula: str
    reason: str


@dataclass(frozen=True)
class BaseSet:
    """The minimal set of base parameters that the compiler chooses.

    ``parameters`` are the entries kept, in canonical frames. ``projection`` (b, 10 n) is the exact K of
    ``beta = K phi``. ``lift`` (10 n, b) is a right inverse, ``K lift = 1``: column k holds the standard parameters of a
    robot whose only non-zero entry is ``parameters[k]``. ``dependencies`` are the linear relations of the regressor's
    columns by which entries were removed, ``ring`` holds the constants of the geometry.
    """

    parameters: tuple[Parameter, ...]
    names: tuple[str, ...]
    projection: tuple[tuple[sp.Expr, ...], ...]
    lift: tuple[tuple[Any, ...], ...]
    dependencies: tuple[Dependency, ...]
    ring: PolynomialRing

    def expressions(self) -> list[sp.Expr]:
        """The base parameters as linear combinations of the symbols of the standard parameters."""
        symbols = standard_symbols(len(self.lift) // 10)
        return [linear_expression(row, symbols) for row in self.projection]

    @property
    def units(self) -> list[str]:
        """Unit of each base parameter."""
        return [UNITS[entry[0]] for _, entry in self.parameters]


def standard_symbols(n: int) -> list[sp.Symbol]:
    """The symbols of the standard parameters of n links: ``m1, mx1, ..., Izz1, m2, ...``."""
    return [sp.Symbol(f"{name}{i + 1}", real=True) for i in range(n) for name in STANDARD]


def linear_expression(row: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> sp.Expr:
    """The linear expression ``sum of row[k] * symbols[k]``, with factored coefficients."""
    return sp.Add(*(factor_coefficient(c) * s for c, s in zip(row, symbols, strict=True) if c != 0))


MOST_FACTORED_TERMS = 40
"""Terms of a sum up to which it is factored. Longer ones, of many odd angles, fill pages factored or not, and factoring
them took two thirds of the time for the list of base parameters of a tree of eight joints with two slides. No bundled
robot has sums of more than three."""


@lru_cache(maxsize=4096)  # lists of parameters factor each coefficient several times
def factor_coefficient(coefficient: sp.Expr) -> sp.Expr:
    """The factored form of ``coefficient``; a sum of more than :data:`MOST_FACTORED_TERMS` terms stays as it is."""
    return coefficient if coefficient.is_Add and len(coefficient.args) > MOST_FACTORED_TERMS else sp.factor(coefficient)


def constants_ring(model: RobotModel) -> PolynomialRing:
    """The ring of polynomials in the constants of the geometry."""
    return PolynomialRing(*exact_constants(model))


def exact_placement(ring: PolynomialRing, X: RigidTransform) -> Placement:
    """Convert the entries of the transform ``X`` to elements of ``ring``."""
    return Placement([[ring.convert(X.R[r, c]) for c in range(3)] for r in range(3)], [ring.convert(v) for v in X.p])


def base_set(model: RobotModel, seed: int = 1990) -> BaseSet:
    """The minimal base parameter set of ``model``; ``seed`` selects the random states of the rank computation."""
    ring = constants_ring(model)
    rows = _regroup(model, ring)
    candidates = [(i, entry) for i in range(model.links) for entry in candidate_entries(model, i)]
    dependencies = find_dependencies(model, ring, candidates, seed)
    removed = {d.parameter: d for d in dependencies}
    kept = [c for c in candidates if c not in removed]
    projection = {c: [to_expression(v) for v in rows[c]] for c in kept}
    for dependency in dependencies:
        row = [to_expression(v) for v in rows[dependency.parameter]]
        for keeper, factor in dependency.combination.items():
            projection[keeper] = [x + factor * y for x, y in zip(projection[keeper], row, strict=True)]
    lift = _lift(model, ring, kept)
    return BaseSet(
        parameters=tuple(kept),
        names=tuple(_name(parameter, removed) for parameter in kept),
        projection=tuple(tuple(projection[c]) for c in kept),
        lift=lift,
        dependencies=tuple(dependencies),
        ring=ring,
    )


def _name(parameter: Parameter, removed: dict[Parameter, Dependency]) -> str:
    """The name of a base parameter: entry, link, and R for regrouped, as in Khalil and Dombre's ``ZZ1R``.

    The R distinguishes it from the standard parameter of the same entry and link.
    """
    i, entry = parameter
    twin = removed.get((i, "Jyy"))
    if entry == "Jxx" and twin is not None and twin.combination == {parameter: 1}:
        return f"Izz{i + 1}R"  # only Jxx + Jyy = Izz acts
    return f"{entry}{i + 1}R"


class _LinearForm:
    """A linear form in the standard parameters: its coefficients that are not zero, by the number of the parameter."""

    __slots__ = ("coefficients",)

    def __init__(self, coefficients: dict[int, Any]) -> None:
        self.coefficients = coefficients

    def __add__(self, other: Any) -> _LinearForm:
        if not isinstance(other, _LinearForm):
            return self  # a structural zero
        total = dict(self.coefficients)
        for k, x in other.coefficients.items():
            total[k] = total[k] + x if k in total else x
        return _LinearForm({k: x for k, x in total.items() if x})

    __radd__ = __add__

    def __sub__(self, other: Any) -> _LinearForm:
        return self + (-other if isinstance(other, _LinearForm) else 0)

    def __neg__(self) -> _LinearForm:
        return _LinearForm({k: -x for k, x in self.coefficients.items()})

    def __mul__(self, factor: Any) -> Any:
        return _LinearForm({k: factor * x for k, x in self.coefficients.items()}) if factor else 0

    __rmul__ = __mul__

    def row(self, width: int) -> list[Any]:
        """All ``width`` coefficients."""
        return [self.coefficients.get(k, 0) for k in range(width)]


def _regroup(model: RobotModel, ring: PolynomialRing) -> dict[Parameter, list[Any]]:
    """Express every candidate as coefficients (10 n,) of the standard parameters, after both regrouping rules."""
    width = 10 * model.links
    phi = [[_LinearForm({10 * i + k: 1}) for k in range(10)] for i in range(model.links)]
    values = regroup(model, partial(exact_placement, ring), phi)
    return {c: value.row(width) if isinstance(value, _LinearForm) else [0] * width for c, value in values.items()}


def regroup(
    model: RobotModel, placement: Callable[[RigidTransform], Placement], phi: Sequence[Sequence[Any]]
) -> dict[Parameter, Any]:
    """Compute the value of every candidate for the standard parameters ``phi`` (n, 10), after both regrouping rules.

    The numbers may be of any kind (floats, polynomials, recorded scalars); ``placement`` converts constant transforms
    to that kind.
    """
    values: dict[Parameter, Any] = {}
    carried: dict[int, PseudoInertia] = {}
    for i in reversed(range(model.links)):
        joint = model.joints[i]
        J = from_standard(list(phi[i])).transform(placement(model.link_frames[i])).plus(carried.get(i, PseudoInertia()))
        values |= {(i, entry): getattr(J, entry) for entry in candidate_entries(model, i)}
        if joint.parent < 0 and model.spec.floating_base:
            continue
        X = placement(joint.before)
        if joint.revolute:
            moved = PseudoInertia(Jzz=J.Jzz, hz=J.hz, m=J.m).transform(X)
        else:
            second = PseudoInertia(Jxx=J.Jxx, Jxy=J.Jxy, Jxz=J.Jxz, Jyy=J.Jyy, Jyz=J.Jyz, Jzz=J.Jzz)
            moved = second.transform(Placement(X.R, [0, 0, 0]))
        carried[joint.parent] = moved if joint.parent not in carried else carried[joint.parent].plus(moved)
    return values


def _lift(model: RobotModel, ring: PolynomialRing, kept: list[Parameter]) -> tuple[tuple[Any, ...], ...]:
    """The matrix (10 n, b) whose column k holds the standard parameters of a robot with only the entry ``kept[k]``."""
    columns = []
    for i, entry in kept:
        X = exact_placement(ring, model.link_frames[i])
        Rt = [[X.R[c][r] for c in range(3)] for r in range(3)]
        back = [sum((-Rt[r][c] * X.p[c] for c in range(3)), 0) for r in range(3)]
        J = PseudoInertia(**{entry: 1}).transform(Placement(Rt, back))
        phi = [
            J.m, J.hx, J.hy, J.hz, J.Jyy + J.Jzz, -J.Jxy, J.Jxx + J.Jzz, -J.Jxz, -J.Jyz, J.Jxx + J.Jyy,
        ]  # fmt: skip
        columns.append([0] * (10 * i) + phi + [0] * (10 * (model.links - i - 1)))
    return tuple(zip(*columns, strict=True)) if columns else tuple(() for _ in range(10 * model.links))


# ------------------------------------------------------------------------------------------------------------------
# The regrouping table: whether each standard parameter is kept, regrouped with others or without effect, and why.
# ------------------------------------------------------------------------------------------------------------------


def regroupings(
    model: RobotModel, compiler_set: BaseSet, names: Sequence[str], projection: Sequence[Sequence[sp.Expr]]
) -> list[Regrouping]:
    """Tell of every standard parameter, link by link, whether it is kept, regrouped with others or has no effect.

    ``compiler_set`` are the base parameters as sums of standard ones, ``names`` (b) their names and ``projection``
    (b, 10 n) their coefficients over the standard parameters.
    """
    entries = []
    for j, symbol in enumerate(standard_symbols(model.links)):
        factors = [(name, row[j]) for name, row in zip(names, projection, strict=True) if row[j] != 0]
        link, kind = j // len(STANDARD), STANDARD[j % len(STANDARD)]
        if not factors:
            entries.append(Regrouping(str(symbol), "no effect", _why_without_effect(model, link, kind)))
        elif len(factors) == 1 and _alone(factors[0][0], names, projection, j):
            entries.append(Regrouping(str(symbol), f"{factors[0][0]} = {_times(factors[0][1], symbol)}", "alone"))
        else:
            formula = ", ".join(f"{name} += {_times(factor, symbol)}" for name, factor in factors)
            entries.append(Regrouping(str(symbol), formula, _why_regrouped(model, compiler_set, link, kind)))
    return entries


def _alone(name: str, names: Sequence[str], projection: Sequence[Sequence[sp.Expr]], j: int) -> bool:
    row = projection[list(names).index(name)]
    return all(value == 0 for k, value in enumerate(row) if k != j)


def _times(factor: sp.Expr, symbol: sp.Symbol) -> str:
    return str((factor_coefficient(factor) if factor.is_Add else factor) * symbol)


def _leading_parallel(model: RobotModel, link: int) -> bool:
    """Whether the links up to ``link`` on its branch rotate only about axes parallel to the first (shifts allowed)."""
    axis = None
    direction = sp.Matrix([0, 0, 1])
    R = sp.eye(3)
    branch = [model.joints[i] for i in model.path(link)]
    for k, joint in enumerate(branch):
        R = R * joint.before.R
        if joint.revolute:
            current = R * direction
            if axis is not None and sp.Matrix(axis).cross(current) != sp.zeros(3, 1):
                return False
            axis = current
            if any(not j.parallel for j in branch[k + 1 :] if j.revolute):
                return False
    return True


def _why_without_effect(model: RobotModel, link: int, kind: str) -> str:
    if not any(model.joints[i].revolute for i in model.path(link)):
        what = "its first moments and inertia have" if kind != "m" else "its mass has"
        return f"link {link + 1} does not rotate, so {what} no effect"
    if _leading_parallel(model, link):
        if kind in ("mx", "my", "m", "mz"):
            return (
                f"link {link + 1} rotates about one fixed direction only; with gravity along it, or with the origin at "
                "rest, this parameter has no effect"
            )
        return (
            f"link {link + 1} rotates about one fixed direction only; of its inertia, only the moment about that "
            "axis has an effect"
        )
    return f"the motion of link {link + 1} never excites it"


def _why_regrouped(model: RobotModel, compiler_set: BaseSet, link: int, kind: str) -> str:
    joint = model.joints[link]
    carrier = joint.parent + 1  # number of the link, 0 for the base
    extra = any(d.parameter[0] == link and d.combination for d in compiler_set.dependencies)
    if not joint.revolute:
        reason = f"joint {link + 1} is prismatic: link {link + 1} does not rotate relative to link {carrier}"
    else:
        reason = (
            f"mass along the axis of joint {link + 1} is regrouped to link {carrier}: "
            f"J{carrier} += X{link + 1} [Jzz, hz, m] X{link + 1}'"
            if carrier
            else f"joint {link + 1} rotates about a fixed axis"
        )
    if extra and _leading_parallel(model, link):
        reason += "; further axes parallel to the first one excite no more parameters"
    return reason
