"""The minimal set of base parameters, the inertial parameters on which the dynamics depend, as exact expressions.

Two regrouping rules follow from the type of a joint. They are applied from the last link to the first, to the
pseudo-inertia (14.9) in canonical frames:

* revolute joint: the rotation leaves the entries Jzz, hz and m, mass distributed along the joint axis, unchanged. They
  move to the link before: ``J_{i-1} += X_i [Jzz, hz, m] X_i'``. Seven entries stay with the link.
* prismatic joint: the link does not rotate relative to the link before. Its second moments move to that link:
  ``S_{i-1} += R_i S_i R_i'``. Mass and first moments stay.

Parameters that the first joints cannot excite (an axis parallel to gravity, parallel axes, translation without
rotation) show as linearly dependent columns of the regressor. These are found exactly, at random rational states in a
finite field, and removed in a fixed order: parameters of links nearer to the base are kept, within a link in the order
of :data:`CANDIDATES`. The number is certified in both directions: the remaining columns have a non-zero minor, so none
is superfluous, and every removed column satisfies its relation at independent states, so none is missing.

(14.9) is from Kostic, de Jager and Steinbuch, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import sympy as sp

from rrrgen.derive.parameters.dependencies import Dependency, find_dependencies
from rrrgen.derive.recursions.link_frames import Placement, exact_constants
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia, from_standard
from rrrgen.derive.recursions.regressor import Parameter
from rrrgen.program.polynomials import PolynomialRing, to_expression
from rrrgen.robot.model import RigidTransform, RobotModel
from rrrgen.robot.model.inertial_parameters import STANDARD

CANDIDATES = {
    True: ("Jxx", "Jyy", "Jxy", "Jxz", "Jyz", "hx", "hy"),
    False: ("m", "hx", "hy", "hz"),
}
"""Entries that stay with a link behind a revolute (True) or prismatic (False) joint, in order of preference."""

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
    return sp.Add(*(factored(c) * s for c, s in zip(row, symbols, strict=True) if c != 0))


@lru_cache(maxsize=4096)  # lists of parameters factor each coefficient several times
def factored(coefficient: sp.Expr) -> sp.Expr:
    """The factored form of ``coefficient``."""
    return sp.factor(coefficient)


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
    """The name of a base parameter: entry, link, and R for regrouped, as in Khalil and Dombre's ``ZZ1R``.

    The R distinguishes it from the standard parameter of the same entry and link.
    """
    i, entry = parameter
    twin = removed.get((i, "Jyy"))
    if entry == "Jxx" and twin is not None and twin.combination == {parameter: 1}:
        return f"Izz{i + 1}R"  # only Jxx + Jyy = Izz acts
    return f"{entry}{i + 1}R"


def _unit_row(width: int, position: int) -> list[Any]:
    return [int(k == position) for k in range(width)]


class _Linear:
    """A linear form in the 10 n standard parameters, with addition and multiplication by a constant."""

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
    """Express every candidate as coefficients (10 n,) of the standard parameters, after both regrouping rules."""
    width = 10 * model.links
    phi = [[_Linear(_unit_row(width, 10 * i + k)) for k in range(10)] for i in range(model.links)]
    values = regroup(model, partial(exact_placement, ring), phi)
    return {c: value.row if isinstance(value, _Linear) else [0] * width for c, value in values.items()}


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
        J = from_standard(list(phi[i])).moved(placement(model.link_frames[i])).plus(carried.get(i, PseudoInertia()))
        values |= {(i, entry): getattr(J, entry) for entry in CANDIDATES[joint.revolute]}
        X = placement(joint.before)
        if joint.revolute:
            moved = PseudoInertia(Jzz=J.Jzz, hz=J.hz, m=J.m).moved(X)
        else:
            second = PseudoInertia(Jxx=J.Jxx, Jxy=J.Jxy, Jxz=J.Jxz, Jyy=J.Jyy, Jyz=J.Jyz, Jzz=J.Jzz)
            moved = second.moved(Placement(X.R, [0, 0, 0]))
        carried[joint.parent] = moved if joint.parent not in carried else carried[joint.parent].plus(moved)
    return values


def _lift(model: RobotModel, ring: PolynomialRing, kept: list[Parameter]) -> tuple[tuple[Any, ...], ...]:
    """The matrix (10 n, b) whose column k holds the standard parameters of a robot with only the entry ``kept[k]``."""
    columns = []
    for i, entry in kept:
        X = exact_placement(ring, model.link_frames[i])
        Rt = [[X.R[c][r] for c in range(3)] for r in range(3)]
        back = [sum((-Rt[r][c] * X.p[c] for c in range(3)), 0) for r in range(3)]
        J = PseudoInertia(**{entry: 1}).moved(Placement(Rt, back))
        phi = [
            J.m, J.hx, J.hy, J.hz, J.Jyy + J.Jzz, -J.Jxy, J.Jxx + J.Jzz, -J.Jxz, -J.Jyz, J.Jxx + J.Jyy,
        ]  # fmt: skip
        columns.append([0] * (10 * i) + phi + [0] * (10 * (model.links - i - 1)))
    return tuple(zip(*columns, strict=True)) if columns else tuple(() for _ in range(10 * model.links))
