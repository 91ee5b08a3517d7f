"""The minimal set of inertial parameters that the dynamics depend on, as exact expressions.

Two regroupings follow from the geometry of a joint alone and are applied from the last link to the first, on the
pseudo-inertia (14.9) in canonical frames:

* revolute joint: mass spread along the joint axis (entries Jzz, hz, m) turns with the joint to no effect, so it moves
  like a part of the link before: ``J_{i-1} += X_i [Jzz, hz, m] X_i'``. Seven entries stay with the link.
* prismatic joint: the link never turns relative to the link before, so its second moments act as if they were part of
  that link: ``S_{i-1} += R_i S_i R_i'``. The mass and the first moments stay.

What the motion of the first links never excites (an axis that stays parallel to gravity, axes that stay parallel to
each other, sliding without turning) shows as dependent columns of the regressor. They are found exactly, at random
rational states in a finite field, and removed in a fixed order: parameters of links nearer to the base are kept, and
within a link the order of :data:`CANDIDATES`. The count is certified: the columns kept have a non-zero minor (so none
can be left out) and every column removed satisfies its relation at independent states (so none is missing).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from rrrgen.derive.algebra.polynomials import PolynomialRing, to_expression
from rrrgen.derive.parameters.dependencies import Dependency, find_dependencies
from rrrgen.derive.recursions.chain import Placement, exact_constants
from rrrgen.derive.recursions.inertia import PseudoInertia, from_standard
from rrrgen.derive.recursions.regressor import Parameter
from rrrgen.model import RigidTransform, RobotModel
from rrrgen.model.standard_parameters import STANDARD

CANDIDATES = {
    True: ("Jxx", "Jyy", "Jxy", "Jxz", "Jyz", "hx", "hy"),
    False: ("m", "hx", "hy", "hz"),
}
"""Entries that stay with a link behind a revolute (True) or prismatic (False) joint, in order of preference."""

UNITS = {"J": "kg m^2", "I": "kg m^2", "h": "kg m", "m": "kg"}


@dataclass(frozen=True)
class BaseParameter:
    """One base parameter: its name and its expression in link symbols (tensor signs) and named parameters."""

    name: str
    expression: sp.Expr
    unit: str


@dataclass(frozen=True)
class Regrouping:
    """What became of one standard parameter, and why."""

    parameter: str
    formula: str
    reason: str


@dataclass(frozen=True)
class BaseSet:
    """The compiler's own minimal set.

    ``parameters`` are the entries kept (canonical frames); ``projection[k][j]`` is the exact coefficient of standard
    parameter j in base parameter k (``beta = K phi``); ``lift[j][k]`` its right inverse: the standard parameters of a
    robot whose only non-zero entry is ``parameters[k]`` (``K lift = 1``).
    """

    parameters: tuple[Parameter, ...]
    names: tuple[str, ...]
    projection: tuple[tuple[sp.Expr, ...], ...]
    lift: tuple[tuple[Any, ...], ...]
    dependencies: tuple[Dependency, ...]
    ring: PolynomialRing

    def expressions(self) -> list[sp.Expr]:
        """The base parameters in link symbols."""
        symbols = standard_symbols(len(self.lift) // 10)
        return [linear_expression(row, symbols) for row in self.projection]

    @property
    def units(self) -> list[str]:
        """Unit of each base parameter."""
        return [UNITS[entry[0]] for _, entry in self.parameters]


def standard_symbols(n: int) -> list[sp.Symbol]:
    """``m1, mx1, ..., Izz1, m2, ...``: the standard parameters of all links."""
    return [sp.Symbol(f"{name}{i + 1}", real=True) for i in range(n) for name in STANDARD]


def linear_expression(row: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> sp.Expr:
    """``sum of coefficient * symbol`` with readable coefficients."""
    return sp.Add(*(sp.factor(c) * s for c, s in zip(row, symbols, strict=True) if c != 0))


def constants_ring(model: RobotModel) -> PolynomialRing:
    """Polynomials in the constants of the geometry."""
    return PolynomialRing(*exact_constants(model))


def exact_placement(ring: PolynomialRing, X: RigidTransform) -> Placement:
    """``X`` with entries in ``ring``."""
    return Placement([[ring.convert(X.R[r, c]) for c in range(3)] for r in range(3)], [ring.convert(v) for v in X.p])


def base_set(model: RobotModel, seed: int = 1990) -> BaseSet:
    """The minimal base parameter set of ``model``."""
    ring = constants_ring(model)
    rows = _regroup(model, ring)
    candidates = [(i, entry) for i, joint in enumerate(model.joints) for entry in CANDIDATES[joint.revolute]]
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
    """Entry, link, and R for regrouped, as ``ZZ1R`` in Khalil and Dombre; so no standard parameter has the name."""
    i, entry = parameter
    twin = removed.get((i, "Jyy"))
    if entry == "Jxx" and twin is not None and twin.combination == {parameter: 1}:
        return f"Izz{i + 1}R"  # only Jxx + Jyy = Izz acts
    return f"{entry}{i + 1}R"


def _unit_row(width: int, position: int) -> list[Any]:
    return [int(k == position) for k in range(width)]


class _Linear:
    """A linear form in the 10 n standard parameters, under + and multiplication by a constant."""

    __slots__ = ("row",)

    def __init__(self, row: list[Any]) -> None:
        self.row = row

    def __add__(self, other: Any) -> _Linear:
        if not isinstance(other, _Linear):
            return self  # a structural zero
        return _Linear([x + y for x, y in zip(self.row, other.row, strict=True)])

    __radd__ = __add__

    def __sub__(self, other: Any) -> _Linear:
        return self + (-other if isinstance(other, _Linear) else 0)

    def __neg__(self) -> _Linear:
        return _Linear([-x for x in self.row])

    def __mul__(self, factor: Any) -> Any:
        return _Linear([factor * x for x in self.row]) if factor else 0

    __rmul__ = __mul__


def _regroup(model: RobotModel, ring: PolynomialRing) -> dict[Parameter, list[Any]]:
    """Every candidate as a row of coefficients over the standard parameters."""
    n = model.n
    width = 10 * n
    rows: dict[Parameter, list[Any]] = {}
    carried = PseudoInertia()
    for i in reversed(range(n)):
        joint = model.joints[i]
        phi = [_Linear(_unit_row(width, 10 * i + k)) for k in range(10)]
        J = from_standard(phi).moved(exact_placement(ring, model.link_frames[i])).plus(carried)
        for entry in CANDIDATES[joint.revolute]:
            value = getattr(J, entry)
            rows[i, entry] = value.row if isinstance(value, _Linear) else [0] * width
        X = exact_placement(ring, joint.before)
        if joint.revolute:
            carried = PseudoInertia(Jzz=J.Jzz, hz=J.hz, m=J.m).moved(X)
        else:
            second = PseudoInertia(Jxx=J.Jxx, Jxy=J.Jxy, Jxz=J.Jxz, Jyy=J.Jyy, Jyz=J.Jyz, Jzz=J.Jzz)
            carried = second.moved(Placement(X.R, [0, 0, 0]))
    return rows


def _lift(model: RobotModel, ring: PolynomialRing, kept: list[Parameter]) -> tuple[tuple[Any, ...], ...]:
    """Standard parameters (rows, 10 n) that realise each kept entry alone (columns)."""
    columns = []
    for i, entry in kept:
        X = exact_placement(ring, model.link_frames[i])
        Rt = [[X.R[c][r] for c in range(3)] for r in range(3)]
        back = [sum((-Rt[r][c] * X.p[c] for c in range(3)), 0) for r in range(3)]
        J = PseudoInertia(**{entry: 1}).moved(Placement(Rt, back))
        phi = [
            J.m, J.hx, J.hy, J.hz, J.Jyy + J.Jzz, -J.Jxy, J.Jxx + J.Jzz, -J.Jxz, -J.Jyz, J.Jxx + J.Jyy,
        ]  # fmt: skip
        columns.append([0] * (10 * i) + phi + [0] * (10 * (model.n - i - 1)))
    return tuple(zip(*columns, strict=True)) if columns else tuple(() for _ in range(10 * model.n))
