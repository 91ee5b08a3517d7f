"""The geometry of a robot in one kind of scalar, the input of every recursion.

The same recursions run over recorded program scalars (for code), over polynomials (for closed forms), and over a finite
field (for exact ranks). A :class:`Chain` holds the constants and the joint angles in the chosen kind.

A chain may branch: every joint names the joint before it, whose link carries it. Where joints follow others, their
displacements are ``y = S q`` with a constant matrix S. Rates and forces are those of q everywhere outside a recursion:
``dy = S dq``, ``tau = S' tau_y``, ``M = S' M_y S``, ``J = J_y S``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from random import Random
from typing import Any

import mpmath
import sympy as sp

from rrrgen.base.errors import DerivationError, InternalError
from rrrgen.derive.recursions.following_joints import (
    Turning,
    UnitAngles,
    block_turnings,
    multiple_angle,
    over_coordinates,
    over_joints,
)
from rrrgen.derive.recursions.linear_algebra import Matrix, Vector
from rrrgen.derive.recursions.loops import Arithmetic, NewtonLoops, SolvedLoops
from rrrgen.program import Builder, Port, Role, Value
from rrrgen.program.builder import Number, plain
from rrrgen.program.finite_field import PRIME, Residue, square_root
from rrrgen.program.polynomials import root_factors
from rrrgen.robot.model import RobotModel, cosine_sine
from rrrgen.robot.model.loops import Form

HALF_PI = sp.pi / 2


@dataclass(frozen=True)
class Placement:
    """A constant pose: rotation ``R`` and translation ``p`` (m) in scalars of the chain."""

    R: Matrix
    p: Vector


@dataclass(frozen=True)
class ChainJoint:
    """Joint i: the constant pose ``R, p`` before it, then a rotation about z or a translation along z.

    ``c, s`` are the cosine and sine of the *absolute* angle within the block of parallel axes, i.e. of the sum of the
    joint angles of the block up to this joint; ``slide`` is q of a prismatic joint (0 for a revolute one).
    """

    revolute: bool
    parallel: bool
    R: Matrix
    p: Vector
    c: Any
    s: Any
    slide: Any
    parent: int
    """The number of the joint before, -1 for the base."""


@dataclass(frozen=True)
class BaseMotion:
    """Motion of a floating base, (3,) each, in base axes: angular velocity ``omega`` and acceleration ``alpha``.

    ``a`` is the acceleration of its origin, of the moving point itself, minus gravity: what an accelerometer measures.
    """

    omega: Vector
    alpha: Vector
    a: Vector


@dataclass(frozen=True)
class Chain:
    """All joints, the tip, the user's link frames, and gravity in the base frame.

    ``tip_link`` carries the tip; ``coupling`` is S of ``y = S q``, None where the displacements y of the joints are q.
    With closed ``loops``, ``y = S x`` with the coordinates x = (q, those of the loops), whose rates are ``[1; W] dq``.
    ``base`` is the motion of a floating base, whose body is the first link; None for a base at rest.
    """

    joints: tuple[ChainJoint, ...]
    tip: Placement
    link_frames: tuple[Placement, ...]
    gravity: Vector
    tip_link: int
    coupling: Matrix | None = None
    base: BaseMotion | None = None
    loops: SolvedLoops | None = None

    @property
    def n(self) -> int:
        """Number of joints and links; q is shorter where joints follow others."""
        return len(self.joints)

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """For each joint, those that its link carries."""
        return tuple(tuple(k for k, other in enumerate(self.joints) if other.parent == i) for i in range(self.n))

    @cached_property
    def paths(self) -> tuple[tuple[int, ...], ...]:
        """For each link, the joints that move it, from the base to its own."""
        paths: list[tuple[int, ...]] = []
        for i, joint in enumerate(self.joints):
            paths.append((*(paths[joint.parent] if joint.parent >= 0 else ()), i))
        return tuple(paths)

    def joint_rates(self, rates: Sequence[Any]) -> Sequence[Any]:
        """``S rates``: the rates of all joints (n,) from the rates of q."""
        return over_joints(self.coupling, rates if self.loops is None else self.loops.rates(rates))

    def joint_accelerations(self, dq: Sequence[Any], ddq: Sequence[Any]) -> Sequence[Any]:
        """The accelerations of all joints (n,) from rates and accelerations of q; loops add ``S [0; dW/dt dq]``."""
        if self.loops is None:
            return over_joints(self.coupling, ddq)
        both = zip(self.loops.rates(ddq), self.loops.second(dq, dq), strict=True)
        return over_joints(self.coupling, [linear + quadratic for linear, quadratic in both])

    def joint_second_rates(self, dq: Sequence[Any], rates: Sequence[Any]) -> Sequence[Any]:
        """``S [0; dW/dt rates]`` (n,), with the derivative of W along ``dq``; of a robot with closed loops."""
        assert self.loops is not None
        return over_joints(self.coupling, self.loops.second(dq, rates))

    def forces(self, forces: Sequence[Any]) -> list[Any]:
        """``S' forces``: the generalized forces on q from those on all joints (n,)."""
        on_coordinates = over_coordinates(self.coupling, forces)
        return on_coordinates if self.loops is None else self.loops.forces(on_coordinates)

    def form(self, matrix: Matrix) -> Matrix:
        """``S' matrix S``: the matrix of a quadratic form, such as M, converted from the rates of all joints to dq."""
        if self.coupling is None:
            return matrix
        rows = [self.forces(row) for row in matrix]
        columns = [self.forces(column) for column in zip(*rows, strict=True)]
        return [list(row) for row in zip(*columns, strict=True)]


Trig = Callable[[Turning, sp.Expr], tuple[Any, Any]]
"""(joint positions that add up, with their factors; constant angle) -> (cosine, sine) of the total angle."""


def build_chain(
    model: RobotModel,
    constant: Callable[[sp.Expr], Any],
    trig: Trig,
    q: Sequence[Any],
    gravity: Sequence[Any] | None = None,
    arithmetic: Arithmetic | None = None,
) -> Chain:
    """The chain of ``model`` in one kind of scalar.

    ``constant`` converts exact constants, ``trig`` gives the cosine and sine of block angles, ``q`` (n,) the
    displacements of prismatic joints (m), ``gravity`` (3,) the acceleration of gravity (m/s^2) in the base frame, by
    default the constant of the robot file. ``arithmetic`` solves closed loops, if there are any. Where Newton's method
    solves them, the positions of the passive joints stand behind those in ``q``, also for ``trig``.
    """

    def placement(R: sp.MatrixBase, p: sp.MatrixBase) -> Placement:
        entries = [constant(v) for v in R.flat()]
        return Placement([entries[0:3], entries[3:6], entries[6:9]], [constant(v) for v in p])

    coupling = None
    if model.coupling is not None:
        coupling = [[constant(factor) for factor in row] for row in model.coupling[: len(model.joints)]]
    loops: SolvedLoops | None = None
    if model.closures:
        if arithmetic is None:
            raise InternalError("closed loops are solved in numbers that have square roots")
        if model.spec.newton:
            loops = newton_loops(model, trig, q, arithmetic)
        else:
            loops = SolvedLoops(model.closures, q, partial(_through_loops, trig), arithmetic)
    slides = over_joints(coupling, loops.positions if loops else q)
    joints = []
    for i, (joint, turning, angle) in enumerate(
        zip(model.joints, block_turnings(model), block_angles(model), strict=True)
    ):
        if loops is not None and not model.spec.newton:
            c, s = _through_loops(
                trig, loops, tuple(dict(turning).get(k, sp.S.Zero) for k in range(model.coordinates)), angle
            )
        else:
            c, s = trig(turning, angle) if turning or angle != 0 else (1, 0)
        X = placement(joint.before.R, joint.before.p)
        slide = 0 if joint.revolute else slides[i]
        joints.append(ChainJoint(joint.revolute, joint.parallel, X.R, X.p, c, s, slide, joint.parent))
    return Chain(
        joints=tuple(joints),
        tip=placement(model.tip.R, model.tip.p),
        link_frames=tuple(placement(frame.R, frame.p) for frame in model.link_frames),
        gravity=[constant(g) for g in model.spec.gravity] if gravity is None else list(gravity),
        tip_link=model.tip_link,
        coupling=coupling,
        loops=loops,
    )


def newton_loops(model: RobotModel, trig: Trig, positions: Sequence[Any], arithmetic: Arithmetic) -> NewtonLoops:
    """The loops of ``model`` at the ``positions`` (n + p,) of its drives and passive joints, which need not close them.

    ``trig`` and ``arithmetic`` are those of :func:`build_chain`.
    """

    def of_form(form: Form, angle: sp.Expr) -> tuple[Any, Any]:
        turning = tuple((k, factor) for k, factor in enumerate(form) if factor != 0)
        return trig(turning, angle) if turning or angle != 0 else (1, 0)

    return NewtonLoops(model.closures, positions, model.n, of_form, arithmetic)


def _through_loops(trig: Trig, loops: SolvedLoops, form: Form, angle: sp.Expr) -> tuple[Any, Any]:
    """Cosine and sine of the angle ``form . x + angle``, x the coordinates of a robot with closed ``loops``.

    ``trig`` knows the angles of q, ``loops`` those of the loops that are solved.
    """
    known = tuple((k, factor) for k, factor in enumerate(form[: loops.n]) if factor != 0)
    c, s = trig(known, angle) if known or angle != 0 else (1, 0)
    for k, factor in enumerate(form[loops.n :], loops.n):
        if factor != 0:
            ck, sk = multiple_angle(*loops.angles[k], int(factor))
            c, s = c * ck - s * sk, s * ck + c * sk
    return c, s


def moving(chain: Chain, draw: Callable[[], Any]) -> Chain:
    """The ``chain`` on a base that moves at random: ``draw`` gives the components of its motion one by one."""
    return replace(chain, base=BaseMotion(*([draw() for _ in range(3)] for _ in range(3))))


def quarter_turns(angle: sp.Expr) -> tuple[int, sp.Expr]:
    """Recognize quarter turns: ``(k, 0)`` if ``angle`` is k pi/2 modulo 2 pi, k from 0 to 3, else ``(0, angle)``."""
    quotient = angle / HALF_PI
    if quotient.is_Integer:
        return int(quotient) % 4, sp.S.Zero
    return 0, angle


def rotate_quarters(quarters: int, c: Any, s: Any) -> tuple[Any, Any]:
    """Cosine and sine of the angle increased by ``quarters`` quarter turns, exactly."""
    for _ in range(quarters):
        c, s = -s, c
    return c, s


_IN_NAMES = str.maketrans({"-": "m", "/": "d", ".": "p"})  # a factor as a part of the name of a sine


# -- program scalars -------------------------------------------------------------------------------------------------


@lru_cache(maxsize=4096)
def rational(expression: sp.Expr, digits: int = 40) -> Number:
    """An exact constant as an int or Fraction; irrational ones rounded to ``digits`` decimal digits.

    Raises DerivationError if the expression contains a named parameter without a nominal value.
    """
    if expression.is_Rational:
        return plain(Fraction(int(expression.p), int(expression.q)))
    value = expression.doit().evalf(digits + 10)
    if not value.is_Float:
        raise DerivationError(f"{expression} has no numerical value: give every named parameter a nominal value")
    return Fraction(str(sp.Float(value, digits)))


def rational_float(value: float | None) -> Fraction:
    """Convert a number of the robot file to the exact decimal fraction that the file states; None becomes zero."""
    return Fraction(0) if value is None else Fraction(str(value))


def nominal_constant(model: RobotModel) -> Callable[[sp.Expr], Number]:
    """Converts constants of the geometry to exact numbers, with named parameters at their nominal values."""

    known: dict[sp.Expr, Number] = {}

    def constant(expression: sp.Expr) -> Number:
        if expression not in known:
            known[expression] = rational(model.nominal(expression))
        return known[expression]

    return constant


def symbolic_constant(builder: Builder, generators: Sequence[sp.Expr]) -> Callable[[sp.Expr], Value]:
    """Converts constants of the geometry to expressions in a new input port with one element per generator."""
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


def program_chain(
    model: RobotModel,
    builder: Builder,
    constant: Callable[[sp.Expr], Value],
    q: Sequence[Any],
    gravity: Sequence[Any] | None = None,
) -> Chain:
    """The chain in scalars recorded into ``builder``, at the joint positions ``q`` (n,), rad or m.

    ``constant`` converts exact constants; ``gravity`` (3,), m/s^2, replaces that of the robot file.
    """

    trig, arithmetic = _recording_arithmetic(builder, constant, q)
    return build_chain(model, constant, trig, q, gravity, arithmetic)


def program_loops(
    model: RobotModel, builder: Builder, constant: Callable[[sp.Expr], Value], positions: Sequence[Any]
) -> NewtonLoops:
    """The loops that Newton's method solves, recorded into ``builder`` at ``positions`` (n + p,)."""
    trig, arithmetic = _recording_arithmetic(builder, constant, positions)
    return newton_loops(model, trig, positions, arithmetic)


def _recording_arithmetic(
    builder: Builder, constant: Callable[[sp.Expr], Value], q: Sequence[Any]
) -> tuple[Trig, Arithmetic]:
    """Sines of sums of the positions ``q``, and what loops need, recorded into ``builder``."""

    def trig(turning: Turning, angle: sp.Expr) -> tuple[Any, Any]:
        total: Any = 0
        for k, factor in turning:
            total = total + (q[k] if factor == 1 else constant(factor) * q[k])
        quarters, rest = quarter_turns(angle)
        if not turning:  # the coupling of the joints makes the angles of this block add up to a constant
            return rotate_quarters(quarters, *(constant(value) for value in cosine_sine(rest)))
        total = total + constant(rest)
        label = "".join(f"{'' if factor == 1 else f'_{factor}_'.translate(_IN_NAMES)}{k + 1}" for k, factor in turning)
        c = builder.label(builder.cos(total), f"c{label}")
        s = builder.label(builder.sin(total), f"s{label}")
        return rotate_quarters(quarters, c, s)

    def at_least(x: Any, y: Any) -> Any:
        return builder.neg(builder.min(builder.neg(x), builder.neg(y)))

    return trig, Arithmetic(constant, builder.sqrt, at_least)


# -- finite field ----------------------------------------------------------------------------------------------------


class ResidueConstants:
    """Maps exact constants to the finite field.

    Rationals, and square roots that exist in the field, map exactly. A named parameter or another irrational number
    maps to a random element, always the same one: it stands for a generic value. ``nominal`` replaces named parameters
    by numbers before.
    """

    def __init__(self, seed: int, nominal: Callable[[sp.Expr], sp.Expr] | None = None) -> None:
        self._random = Random(seed)
        self._nominal = nominal
        self._known: dict[sp.Expr, Residue] = {}

    def draw(self) -> Residue:
        """A random non-zero element of the field."""
        return Residue(self._random.randrange(1, PRIME))

    def draw_angle(self) -> tuple[Residue, Residue]:
        """The cosine and sine of a random angle: the image of a rational point of the unit circle."""
        t = self.draw()
        one, square = Residue(1), Residue.of(t * t)
        return (one - square) / (one + square), (t + t) / (one + square)

    def __call__(self, expression: sp.Expr) -> Residue | int:
        """The element of the finite field that represents ``expression``."""
        if self._nominal is not None and expression.free_symbols:
            expression = self._nominal(expression)
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


PRECISE = 60
"""Digits of :func:`precise_chain`."""


def precise_chain(model: RobotModel, q: Sequence[Any]) -> Chain:
    """The chain at the positions ``q`` (n,) in floating-point numbers of many digits, at nominal parameters.

    The precision of mpmath is that of the caller, which sets it to :data:`PRECISE`.
    """
    known: dict[sp.Expr, Any] = {}

    def constant(expression: sp.Expr) -> Any:
        if expression not in known:
            value = model.nominal(expression).doit()
            known[expression] = int(value) if value.is_Integer else mpmath.mpf(value.evalf(PRECISE))
        return known[expression]

    def trig(turning: Turning, angle: sp.Expr) -> tuple[Any, Any]:
        total = sum((constant(factor) * q[k] for k, factor in turning), constant(angle))
        return mpmath.cos(total), mpmath.sin(total)

    def at_least(x: Any, y: Any) -> Any:
        return max(x * mpmath.mpf(1), y * mpmath.mpf(1))  # a constant may be a fraction, which is not compared

    return build_chain(model, constant, trig, q, None, Arithmetic(constant, mpmath.sqrt, at_least))


class NoRootError(ArithmeticError):
    """An element of the finite field has no square root: half of them have none."""


def _residue_root(x: Any) -> Residue:
    root = square_root(Residue.of(x).value)
    if root is None:
        raise NoRootError
    return Residue(root)


def residue_chain(model: RobotModel, constants: ResidueConstants) -> tuple[Chain, list[Residue]]:
    """The chain at a random configuration in the finite field, and the joint displacements of that configuration.

    Gravity is random too where it is an input of the functions. Configurations at which a closed loop has no position
    in the field are drawn again.
    """
    while True:
        try:
            return _residue_chain(model, constants)
        except NoRootError:
            continue


def _residue_chain(model: RobotModel, constants: ResidueConstants) -> tuple[Chain, list[Residue]]:
    q = [constants.draw() for _ in range(model.n)]
    angles: dict[int, tuple[Residue, Residue]] = {}
    units = UnitAngles(model)

    def unit(i: int) -> tuple[Residue, Residue]:
        if i not in angles:
            angles[i] = constants.draw_angle()
        return angles[i]

    def trig(turning: Turning, angle: sp.Expr) -> tuple[Any, Any]:
        c, s = units.angle(turning, unit)
        if model.coupling is None:
            return c, s  # a constant offset is irrelevant: the angle is random
        quarters, rest = quarter_turns(angle)
        cosine, sine = (constants(value) for value in cosine_sine(rest))
        return rotate_quarters(quarters, c * cosine - s * sine, s * cosine + c * sine)

    gravity = [constants.draw() for _ in range(3)] if model.spec.gravity_input else None
    chain = build_chain(model, constants, trig, q, gravity, Arithmetic(constants, _residue_root, lambda x, y: x))
    return (moving(chain, constants.draw) if model.spec.floating_base else chain), q


# -- exact constants -------------------------------------------------------------------------------------------------


def exact_constants(
    model: RobotModel, further: Sequence[sp.Expr] = ()
) -> tuple[list[sp.Expr], list[tuple[sp.Expr, sp.Expr]], list[sp.Expr]]:
    """Find the generators of a polynomial ring that contains the constants of ``model`` and the ``further`` ones.

    Returns free symbols, (cosine, sine) pairs of constant angles, and square roots of primes.
    """
    expressions: list[sp.Expr] = [*further]
    if not model.spec.gravity_input:
        expressions += model.spec.gravity
    for X in [joint.before for joint in model.joints] + [model.tip, *model.link_frames]:
        expressions += [*X.R, *X.p]
    for joint, angle in zip(model.joints, block_angles(model), strict=True):
        rest = quarter_turns(angle)[1]
        if joint.revolute and rest != 0:
            expressions += [rest, *cosine_sine(rest)]
    for row in model.coupling or ():
        expressions += row
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
    """For each joint, the constant part of its absolute angle within the block (rad)."""
    angles: list[sp.Expr] = []
    for joint in model.joints:
        angles.append(joint.theta + angles[joint.parent] if joint.parallel else joint.theta)
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
    """The symbols ``q1 .. qn``, or with another ``prefix`` dq1, ddq1, ..."""
    return [sp.Symbol(f"{prefix}{i + 1}", real=True) for i in range(n)]
