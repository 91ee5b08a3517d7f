"""The base parameters of the robot file: checked to be a basis, and related exactly to the compiler's set.

Let ``beta = K phi`` be the compiler's set and L its right inverse (``K L = 1``). The user's parameters ``pi = U phi``
are determined by the dynamics if and only if ``U = (U L) K``, and they are a basis if and only if ``S = U L`` is square
and invertible. Then ``beta = S^-1 pi``, and the regressor of the user's parameters is ``Y S^-1``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy.polys.matrices import DomainMatrix

from rrrgen.base.errors import Fault, InputError
from rrrgen.derive.parameters.base_parameters import BaseSet, linear_expression, standard_symbols
from rrrgen.derive.recursions.linear_algebra import dot
from rrrgen.derive.recursions.link_frames import ResidueConstants
from rrrgen.program.finite_field import Residue, row_echelon
from rrrgen.program.polynomials import Polynomial, PolynomialRing, to_expression
from rrrgen.robot.spec import STANDARD, BasisSpec, RobotSpec

INERTIA_SIGN = {"Ixy": -1, "Ixz": -1, "Iyz": -1}


def with_signs(expression: sp.Expr, basis: BasisSpec) -> sp.Expr:
    """Convert ``expression`` between the sign convention of ``basis`` for products of inertia and the tensor's.

    The conversion is its own inverse.
    """
    if basis.products == "tensor":
        return expression
    negative = [s for s in expression.free_symbols if s.name.rstrip("0123456789") in INERTIA_SIGN]
    return expression.xreplace({s: -s for s in negative})


@dataclass(frozen=True)
class BasisChange:
    """The exact change between the user's base parameters and the compiler's: ``compiler = inverse @ user``.

    ``inverse`` and its inverse ``forward`` have shape (b, b). ``names``, ``expressions`` and ``units`` are those of the
    user's parameters; products of inertia have the signs of the tensor, whichever convention the file uses.
    """

    names: tuple[str, ...]
    expressions: tuple[sp.Expr, ...]
    units: tuple[str, ...]
    forward: tuple[tuple[Any, ...], ...]
    inverse: tuple[tuple[sp.Expr, ...], ...]


def change_basis(spec: RobotSpec, compiler_set: BaseSet) -> BasisChange:
    """Compute the exact relation between the robot file's base parameters and the compiler's, ``compiler_set``.

    Raises InputError with every fault if it is no basis: a parameter that is nonlinear, dependent on others or without
    effect on the dynamics, or a direction that is not covered.
    """
    basis = spec.basis
    assert basis is not None
    faults: list[Fault] = []
    rows: list[list[Any]] = []
    for k, expression in enumerate(basis.expressions):
        try:
            rows.append(_linear_row(expression, basis, len(spec.rows), compiler_set.ring))
        except ValueError as problem:
            faults.append(_fault(spec, basis, k, str(problem)))
            rows.append([0] * (10 * len(spec.rows)))
    if faults:
        raise InputError(faults)
    S = [[dot(row, column) for column in zip(*compiler_set.lift, strict=True)] for row in rows]
    faults = _foreign(spec, basis, compiler_set, rows, S)
    if not faults:
        faults = _rank_faults(spec, basis, compiler_set, S)
    if faults:
        raise InputError(faults)
    return BasisChange(
        names=basis.names,
        expressions=tuple(with_signs(expression, basis) for expression in basis.expressions),
        units=tuple(_unit(row) for row in rows),
        forward=tuple(tuple(row) for row in S),
        inverse=_inverse(compiler_set.ring, S),
    )


def _linear_row(expression: sp.Expr, basis: BasisSpec, n: int, ring: PolynomialRing) -> list[Any]:
    """The coefficients (10 n,) of ``expression`` over the standard parameters; ``m1*x1`` counts as ``mx1``.

    Raises ValueError for a term that is not linear in the link parameters.
    """
    row: list[Any] = [0] * (10 * n)
    names = {str(s): k for k, s in enumerate(standard_symbols(n))}
    for term in sp.Add.make_args(sp.expand(expression)):
        coefficient, inertial = sp.S.One, []
        for factor in sp.Mul.make_args(term):
            is_link = factor.is_Symbol and _is_link_symbol(str(factor), n)
            if is_link:
                inertial.append(str(factor))
            elif any(_is_link_symbol(str(s), n) for s in factor.free_symbols):
                raise ValueError(f"{factor} is not linear in the parameters of a link")
            else:
                coefficient *= factor
        name = _standard_name(inertial)
        if name is None or name not in names:
            raise ValueError(f"the term {term} is not a multiple of one inertial parameter")
        if basis.products == "positive":
            coefficient *= INERTIA_SIGN.get(name[:3], 1)
        try:
            row[names[name]] = row[names[name]] + ring.convert(sp.expand(coefficient))
        except KeyError as unknown:
            raise ValueError(f"{unknown.args[0]} does not occur in the geometry of this robot") from None
    return row


def _is_link_symbol(name: str, n: int) -> bool:
    stem = name.rstrip("0123456789")
    digits = name[len(stem) :]
    return stem in (*STANDARD, "x", "y", "z") and digits.isdigit() and 1 <= int(digits) <= n


def _standard_name(factors: list[str]) -> str | None:
    """The standard parameter equal to a product of link symbols (``m1 * x1`` is mx1); None if there is none."""
    if len(factors) == 1:
        return factors[0] if factors[0][0] not in "xyz" else None
    if len(factors) == 2:
        mass, place = sorted(factors, key=lambda f: f[0] in "xyz")
        if mass[0] == "m" and place[0] in "xyz" and mass[1:] == place[1:]:
            return f"m{place}"
    return None


def _fault(spec: RobotSpec, basis: BasisSpec, k: int, message: str) -> Fault:
    line, column = basis.places[k] if k < len(basis.places) else (0, 0)
    return Fault(spec.file or "robot", line, column, f"basis: {basis.names[k]}: {message}")


def _foreign(
    spec: RobotSpec, basis: BasisSpec, compiler_set: BaseSet, rows: list[list[Any]], S: list[list[Any]]
) -> list[Fault]:
    """Faults of user parameters that contain a part without effect on the dynamics.

    ``rows`` are the parameters as coefficients (10 n,) of the standard ones, ``S`` the matrix U L of the module.
    """
    faults = []
    symbols = standard_symbols(len(spec.rows))
    for k, (row, s) in enumerate(zip(rows, S, strict=True)):
        factors = [to_expression(v) for v in s]
        rebuilt = [dot(factors, column) for column in zip(*compiler_set.projection, strict=True)]
        rest = [_vanishing(to_expression(x) - y) for x, y in zip(row, rebuilt, strict=True)]
        if any(rest):
            extra = with_signs(linear_expression(rest, symbols), basis)
            faults.append(_fault(spec, basis, k, f"its part {extra} has no effect on the dynamics; leave it out"))
    return faults


def _vanishing(expression: sp.Expr) -> sp.Expr:
    """Simplify ``expression`` far enough that an expression equal to zero becomes the number 0."""
    expanded = sp.expand(expression)
    return expanded if expanded == 0 else sp.cancel(sp.trigsimp(expanded))


def _rank_faults(spec: RobotSpec, basis: BasisSpec, compiler_set: BaseSet, S: list[list[Any]]) -> list[Fault]:
    """Faults of linearly dependent user parameters, and of directions that none of them covers.

    ``S`` is the matrix U L of the module, one row per parameter of the user.
    """
    constants = ResidueConstants(seed=7)
    image = [[Residue.of(constants(to_expression(v))).value for v in row] for row in S]
    b, count = len(compiler_set.parameters), len(S)
    faults = []
    by_parameter = [[image[r][c] for r in range(count)] for c in range(b)]
    echelon, pivots = row_echelon([list(row) for row in by_parameter])
    for k in range(count):
        if k not in pivots:
            others = [basis.names[p] for row, p in zip(echelon, pivots, strict=True) if row[k]]
            text = f"depends linearly on {', '.join(others)}" if others else "has no effect on the dynamics"
            faults.append(_fault(spec, basis, k, text))
    _, covered = row_echelon([list(row) for row in image])
    for c in range(b):
        if c not in covered:
            message = (
                f"basis: incomplete ({len(pivots)} of {b} directions): nothing covers {compiler_set.names[c]} = "
                f"{with_signs(compiler_set.expressions()[c], basis)}"
            )
            faults.append(Fault(spec.file or "robot", 0, 0, message))
    return faults


def _inverse(ring: PolynomialRing, S: list[list[Any]]) -> tuple[tuple[sp.Expr, ...], ...]:
    """The exact inverse of S. Purely rational matrices are inverted over Q: rational functions are far slower."""
    if not any(isinstance(v, Polynomial) for row in S for v in row):
        numbers = [[sp.QQ.from_sympy(to_expression(v)) for v in row] for row in S]
        rational = DomainMatrix(numbers, (len(S), len(S)), sp.QQ).inv().to_Matrix()
        return tuple(tuple(rational.row(r)) for r in range(len(S)))
    field = ring.ring.to_field()
    matrix = [[field(v.poly) if isinstance(v, Polynomial) else field(sp.QQ.from_sympy(to_expression(v))) for v in row]
              for row in S]  # fmt: skip
    inverse = DomainMatrix(matrix, (len(S), len(S)), field.to_domain()).inv().to_Matrix()
    back = dict(zip(ring.ring.symbols, ring.generators, strict=False))
    return tuple(tuple(sp.expand(inverse[r, c].subs(back)) for c in range(len(S))) for r in range(len(S)))


def _unit(row: list[Any]) -> str:
    """The unit of a base parameter of the robot file, from its coefficients ``row`` over the standard parameters.

    It is the unit of the first standard parameter whose coefficient is a number.
    """
    for k, value in enumerate(row):
        if value and not isinstance(value, Polynomial):
            name = STANDARD[k % 10]
            return "kg" if name == "m" else ("kg m" if name.startswith("m") else "kg m^2")
    return ""
