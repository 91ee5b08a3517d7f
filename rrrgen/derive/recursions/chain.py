"""The robot's geometry in scalars of one kind: what every derivation takes as its input.

The same derivations run over recorded program scalars (to print code), over polynomials (to get closed forms), and
over a finite field (to certify ranks). A :class:`Chain` holds the constants and the joint angles in the chosen kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import sympy as sp

from rrrgen.derive.algebra.finite_field import PRIME, Residue, square_root
from rrrgen.derive.algebra.polynomials import root_factors
from rrrgen.derive.algebra.vectors import Matrix, Vector
from rrrgen.errors import DerivationError
from rrrgen.model import RobotModel, cosine_sine
from rrrgen.program import Builder, Port, Role, Value
from rrrgen.program.builder import Number, plain

HALF_PI = sp.pi / 2


@dataclass(frozen=True)
class Placement:
    """A constant rotation and translation in scalars of the chain."""

    R: Matrix
    p: Vector


@dataclass(frozen=True)
class ChainJoint:
    """Joint i: constant placement before it, then a turn or a slide along z.

    ``c, s`` are the cosine and sine of the *absolute* angle within the block of parallel axes; ``slide`` is q of a
    prismatic joint (0 for a revolute one).
    """

    revolute: bool
    parallel: bool
    R: Matrix
    p: Vector
    c: Any
    s: Any
    slide: Any


@dataclass(frozen=True)
class Chain:
    """All joints, the tip, the user's link frames, and gravity in the base frame."""

    joints: tuple[ChainJoint, ...]
    tip: Placement
    link_frames: tuple[Placement, ...]
    gravity: Vector

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)


Trig = Callable[[tuple[int, ...], sp.Expr], tuple[Any, Any]]
"""(joints whose angles add up, constant angle) -> (cosine, sine)."""


def build_chain(model: RobotModel, constant: Callable[[sp.Expr], Any], trig: Trig, q: Sequence[Any]) -> Chain:
    """The chain of ``model`` with constants, angles and slides in one kind of scalar."""

    def placement(R: sp.MatrixBase, p: sp.MatrixBase) -> Placement:
        return Placement([[constant(R[r, c]) for c in range(3)] for r in range(3)], [constant(v) for v in p])

    joints = []
    turning: tuple[int, ...] = ()
    angle: sp.Expr = sp.S.Zero
    for i, joint in enumerate(model.joints):
        if not joint.parallel:
            turning, angle = (), sp.S.Zero
        if joint.revolute:
            turning, angle = (*turning, i), angle + joint.theta
        c, s = trig(turning, angle) if turning else (1, 0)
        X = placement(joint.before.R, joint.before.p)
        joints.append(ChainJoint(joint.revolute, joint.parallel, X.R, X.p, c, s, 0 if joint.revolute else q[i]))
    return Chain(
        joints=tuple(joints),
        tip=placement(model.tip.R, model.tip.p),
        link_frames=tuple(placement(frame.R, frame.p) for frame in model.link_frames),
        gravity=[constant(g) for g in model.spec.gravity],
    )


def quarter_turns(angle: sp.Expr) -> tuple[int, sp.Expr]:
    """``angle`` as whole quarter turns plus a rest; the rest is zero for exact multiples of pi/2."""
    quotient = angle / HALF_PI
    if quotient.is_Integer:
        return int(quotient) % 4, sp.S.Zero
    return 0, angle


def rotate_quarters(quarters: int, c: Any, s: Any) -> tuple[Any, Any]:
    """Cosine and sine after ``quarters`` quarter turns, exactly."""
    for _ in range(quarters):
        c, s = -s, c
    return c, s


# -- program scalars -------------------------------------------------------------------------------------------------


def rational(expression: sp.Expr, digits: int = 40) -> Number:
    """An exact number as an integer or a fraction; irrational ones to ``digits`` decimal digits."""
    if expression.is_Rational:
        return plain(Fraction(int(expression.p), int(expression.q)))
    value = expression.doit().evalf(digits + 10)
    if not value.is_Float:
        raise DerivationError(f"{expression} has no numerical value: give every named parameter a nominal value")
    return Fraction(str(sp.Float(value, digits)))


def rational_float(value: float | None) -> Fraction:
    """A number of the file as the decimal fraction it was written as; None is zero."""
    return Fraction(0) if value is None else Fraction(str(value))


def nominal_constant(model: RobotModel) -> Callable[[sp.Expr], Number]:
    """Constants of the geometry as exact numbers, named parameters at their nominal values."""

    known: dict[sp.Expr, Number] = {}

    def constant(expression: sp.Expr) -> Number:
        if expression not in known:
            known[expression] = rational(model.nominal(expression))
        return known[expression]

    return constant


def symbolic_constant(builder: Builder, generators: Sequence[sp.Expr]) -> Callable[[sp.Expr], Value]:
    """Constants of the geometry as inputs of the program, one for each of ``generators``."""
    port = Port("constants", (len(generators),), "", "", ", ".join(map(str, generators)), Role.GEOMETRY)
    inputs: dict[sp.Expr, Value] = dict(zip(generators, builder.input(port), strict=True))

    def constant(expression: sp.Expr) -> Value:
        if expression.is_Rational:
            return plain(Fraction(int(expression.p), int(expression.q)))
        if expression in inputs:
            return inputs[expression]
        if expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
            return builder.mul(constant(expression.base), constant(expression.base ** (expression.exp - 1)))
        parts = root_factors(expression) or expression.args
        total: Value = 0 if expression.is_Add else 1
        for part in parts:
            total = builder.add(total, constant(part)) if expression.is_Add else builder.mul(total, constant(part))
        return total

    return constant


def program_chain(model: RobotModel, builder: Builder, constant: Callable[[sp.Expr], Value], q: Sequence[Any]) -> Chain:
    """The chain over recorded scalars."""

    def trig(turning: tuple[int, ...], angle: sp.Expr) -> tuple[Any, Any]:
        total: Any = 0
        for i in turning:
            total = total + q[i]
        quarters, rest = quarter_turns(angle)
        total = total + constant(rest)
        label = "".join(str(i + 1) for i in turning)
        c = builder.label(builder.cos(total), f"c{label}")
        s = builder.label(builder.sin(total), f"s{label}")
        return rotate_quarters(quarters, c, s)

    return build_chain(model, constant, trig, q)


# -- finite field ----------------------------------------------------------------------------------------------------


class ResidueConstants:
    """Images of exact constants in the finite field.

    Rationals and square roots (where one exists) map exactly; a named parameter stands for a generic length and any
    other irrational number for a generic value, both drawn at random but always the same for the same symbol.
    """

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        self._known: dict[sp.Expr, Residue] = {}

    def draw(self) -> Residue:
        """A random element."""
        return Residue(self._random.randrange(1, PRIME))

    def draw_angle(self) -> tuple[Residue, Residue]:
        """The image of a random rational point of the unit circle."""
        t = self.draw()
        one, square = Residue(1), Residue.of(t * t)
        return (one - square) / (one + square), (t + t) / (one + square)

    def __call__(self, expression: sp.Expr) -> Residue | int:
        """The image of ``expression``."""
        if expression.is_Rational:
            value = plain(Fraction(int(expression.p), int(expression.q)))
            return value if type(value) is int else Residue.of(value)
        if expression in self._known:
            return self._known[expression]
        if expression.is_Add or expression.is_Mul:
            total: Any = 0 if expression.is_Add else 1
            for part in expression.args:
                total = total + self(part) if expression.is_Add else total * self(part)
            return total  # type: ignore[no-any-return]
        if expression.is_Pow and expression.exp.is_Integer:
            power = Residue.of(self(expression.base))
            exponent = int(expression.exp) % (PRIME - 1)
            return Residue(pow(power.value, exponent, PRIME))
        if expression.is_Pow and expression.exp == sp.Rational(1, 2) and expression.base.is_Rational:
            root = square_root(Residue.of(self(expression.base)).value)
            if root is not None:
                self._known[expression] = Residue(root)
                return self._known[expression]
        if isinstance(expression, (sp.cos, sp.sin)):
            argument = expression.args[0]
            cosine, sine = self.draw_angle()
            self._known[sp.cos(argument)], self._known[sp.sin(argument)] = cosine, sine
            return self._known[expression]
        self._known[expression] = self.draw()
        return self._known[expression]


def residue_chain(model: RobotModel, constants: ResidueConstants) -> tuple[Chain, list[Residue]]:
    """The chain at one random rational configuration, and that configuration's slides."""
    q = [constants.draw() for _ in range(model.n)]
    angles: dict[int, tuple[Residue, Residue]] = {}

    def trig(turning: tuple[int, ...], angle: sp.Expr) -> tuple[Any, Any]:
        c: Any = Residue(1)
        s: Any = Residue(0)
        for i in turning:
            if i not in angles:
                angles[i] = constants.draw_angle()
            ci, si = angles[i]
            c, s = c * ci - s * si, s * ci + c * si
        return c, s  # the constant part of an angle does not change what is generic

    return build_chain(model, constants, trig, q), q


# -- exact constants -------------------------------------------------------------------------------------------------


def exact_constants(
    model: RobotModel, further: Sequence[sp.Expr] = ()
) -> tuple[list[sp.Expr], list[tuple[sp.Expr, sp.Expr]], list[sp.Expr]]:
    """The generators that the constants of ``model`` (and ``further`` ones) need: symbols, trig pairs, square roots."""
    expressions: list[sp.Expr] = [*model.spec.gravity, *further]
    for X in [joint.before for joint in model.joints] + [model.tip, *model.link_frames]:
        expressions += [*X.R, *X.p]
    for joint, angle in zip(model.joints, block_angles(model), strict=True):
        rest = quarter_turns(angle)[1]
        if joint.revolute and rest != 0:
            expressions += [rest, *cosine_sine(rest)]
    symbols: set[sp.Expr] = set()
    angles: set[sp.Expr] = set()
    roots: set[sp.Expr] = set()
    others: set[sp.Expr] = set()
    for expression in expressions:
        _collect(expression, symbols, angles, roots, others)
    key = sp.default_sort_key
    pairs = [(sp.cos(a), sp.sin(a)) for a in sorted(angles, key=key)]
    return sorted(symbols | others, key=key), pairs, sorted(roots, key=key)


def block_angles(model: RobotModel) -> list[sp.Expr]:
    """The constant part of each joint's absolute angle in its block."""
    angles: list[sp.Expr] = []
    for joint in model.joints:
        angles.append(joint.theta + angles[-1] if joint.parallel else joint.theta)
    return angles


def _collect(
    expression: sp.Expr, symbols: set[sp.Expr], angles: set[sp.Expr], roots: set[sp.Expr], others: set[sp.Expr]
) -> None:
    if expression.is_Rational:
        return
    if expression.is_Symbol:
        symbols.add(expression)
    elif expression.is_Add or expression.is_Mul:
        for part in expression.args:
            _collect(part, symbols, angles, roots, others)
    elif expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
        _collect(expression.base, symbols, angles, roots, others)
    elif isinstance(expression, (sp.cos, sp.sin)):
        angles.add(expression.args[0])
    elif factors := root_factors(expression):
        roots.update(factors)
    else:
        others.add(expression)


def joint_symbols(n: int, prefix: str = "q") -> list[sp.Symbol]:
    """``q1 .. qn`` (or dq1, ddq1, ...)."""
    return [sp.Symbol(f"{prefix}{i + 1}", real=True) for i in range(n)]
