"""Singular configurations of an arm, in words and, where three joints move a point, as factors of det(dp/dq).

At a singular configuration two solutions become one (the solver sets the flag MULTIPLE), or the target leaves a joint
undetermined (flag FREE). Closed forms are printed from chains with symbols or exact numbers in place of floats.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import sympy as sp

from rrrgen.ik.geometry.chain import KinematicChain, exact_chain, multiply
from rrrgen.ik.geometry.nearly_special import exact_like
from rrrgen.ik.plan import Singularity, SolverPlan
from rrrgen.robot.spec import parameter_symbol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rrrgen.ik.recording.steps import Stage
    from rrrgen.robot.spec import RobotSpec


def symbolic_chain(spec: RobotSpec, plan: SolverPlan) -> tuple[KinematicChain, tuple[tuple[sp.Symbol, sp.Expr], ...]]:
    """The chain with symbols for its DH values, and the table (symbol, value).

    Special values, such as 0 and multiples of 90 degrees, stay numbers, because the closed form was chosen for them.
    """
    values: list[tuple[sp.Symbol, sp.Expr]] = []
    signed = {
        parameter_symbol(name): sp.Symbol(name, positive=True) if value > 0 else sp.Symbol(name, real=True)
        for name, value in spec.parameters.items()
    }

    def symbol(letter: str, i: int, value: sp.Expr) -> sp.Expr:
        nominal = spec.nominal(value)
        angle = letter in ("alpha", "theta")
        if nominal.is_zero or (angle and (2 * nominal / sp.pi).is_integer):
            return nominal
        sign = {"positive": True} if nominal > 0 else {"negative": True}
        name = sp.Symbol(f"{letter}_{i}", **sign) if value.is_number else value.xreplace(signed)
        if value.is_number:
            values.append((name, nominal))
        return name

    joints = tuple(
        replace(
            joint,
            alpha=symbol("alpha", i, joint.alpha),
            a=symbol("a", i, joint.a),
            d=symbol("d", i, joint.d),
            theta=symbol("theta", i, joint.theta),
        )
        for i, joint in enumerate(spec.joints, start=1)
    )
    exact = exact_chain(replace(spec, joints=joints), nominal=False)
    if plan.solving.n != exact.n:  # virtual joints have numbers only
        return plan.solving, ()
    return exact_like(exact, plan.solving), tuple(values)


def number_chain(spec: RobotSpec, plan: SolverPlan) -> KinematicChain:
    """The chain that ``plan`` solves, in exact numbers; in floats where it has virtual joints."""
    exact = exact_chain(spec)
    return plan.solving if plan.solving.n != exact.n else exact_like(exact, plan.solving)


TERMS = 8
"""Largest number of terms of a factor that is rewritten with sums of angles, as in cos(q2 + q3). That search takes
long; longer factors stay polynomials in sines and cosines."""

FACTORED = 60
"""Largest number of terms of a determinant that is factored.

With twists and base angles such as 0.7 rad every irrational constant is one more indeterminate of the factorisation,
which then takes hours and finds nothing.
"""

_MEANING = {
    "shoulder": "the shoulder's two solutions for {joint} meet: the target point is as near to the first axis as the "
    "offsets allow",
    "elbow": "the elbow's two solutions for {joint} meet: the arm is stretched or folded",
    "wrist": "the wrist's two solutions for {joint} meet: two of its axes are aligned, and only the sum or difference "
    "of their angles is decided",
    "offset": "the two solutions for {joint} meet: the offset of the arm is used up",
    "side": "the two solutions for {joint} meet",
    "distance": "the two solutions for {joint} meet",
    "posture": "two of the up to four solutions for {joint} meet (a double root of the quartic)",
}


def describe_singularities(plan: SolverPlan, stages: Sequence[Stage]) -> SolverPlan:
    """Copy ``plan`` with its singularities described in words, one for each root selection in ``stages``."""
    names = {joint.index: joint.name or f"joint {joint.index + 1}" for joint in plan.solving.joints}
    singularities = []
    for stage in stages:
        joint = names.get(stage.joint, f"joint {stage.joint + 1}")
        singularities.append(
            Singularity(_MEANING.get(stage.label, "two solutions for {joint} meet").format(joint=joint))
        )
    return replace(plan, singularities=tuple(singularities))


def singular_sets(spec: RobotSpec, plan: SolverPlan) -> tuple[Singularity, ...]:
    """The singularities of ``plan`` as functions of the joints that are zero there, or in words where none is known.

    For a position task they are the factors of det(dp/dq). For six joints that end in a spherical wrist they are the
    factors of det(dp/dq) of the first three joints, with p the wrist centre, and the sine of the middle wrist joint.
    """
    chain, _ = symbolic_chain(spec, plan)
    arm: KinematicChain | None = None
    extra: list[Singularity] = []
    if plan.family == "position":
        arm = chain
    elif plan.family == "spherical" and plan.first == 3 and plan.virtual == 0 and plan.locked is None:
        centre = replace(chain.links[3], a=sp.S.Zero, ca=sp.S.One, sa=sp.S.Zero)
        arm = replace(
            chain,
            joints=chain.joints[:3],
            links=chain.links[:2],
            tip=multiply(chain.links[2].matrix(), centre.matrix()),
        )
        middle = chain.joints[4]
        angle = sp.Symbol("q_5", real=True) + middle.offset
        extra.append(Singularity("wrist: axes 4 and 6 are parallel", sp.sin(angle)))
    if arm is None:
        return plan.singularities
    factors = [
        Singularity("a factor of the arm's determinant vanishes", factor) for factor in _factors(determinant(arm))
    ]
    return (*factors, *extra)


def determinant(arm: KinematicChain) -> sp.Expr:
    """Determinant of the Jacobian dp/dq (3 x 3) of a three-joint chain, p the position of its tip, in factored form.

    The constant transform of the base is left out, because its rotation does not change the determinant. For the RRR
    arm of the examples the result is -a2 a3 sin(q3) (a2 cos q2 + a3 cos(q2 + q3)).
    """
    q = [sp.Symbol(f"q_{joint.index + 1}", real=True) for joint in arm.joints]
    shifts = {  # angles between quarter turns would double the terms: they are added when the result is simplified
        x: x + joint.sign * joint.offset
        for joint, x in zip(arm.joints, q, strict=True)
        if joint.revolute and not (2 * joint.offset / sp.pi).is_integer
    }
    moves = [
        _motion(joint.revolute, joint.sign * x + (0 if x in shifts else joint.offset))
        for joint, x in zip(arm.joints, q, strict=True)
    ]
    w = _matrix(arm.links[0].matrix()) * moves[1] * _matrix(arm.links[1].matrix()) * moves[2] * _matrix(arm.tip)
    point = w[:3, 3]
    axis = sp.Matrix([0, 0, arm.joints[0].sign])
    first = axis.cross(point) if arm.joints[0].revolute else axis
    value = sp.Matrix.hstack(first, point.diff(q[1]), point.diff(q[2])).det()
    return _simplify(sp.expand(value, trig=True), q[1:]).xreplace(shifts)


def _motion(revolute: bool, x: sp.Expr) -> sp.Matrix:
    M = sp.eye(4)
    if revolute:
        M[0, 0] = M[1, 1] = sp.cos(x)
        M[1, 0], M[0, 1] = sp.sin(x), -sp.sin(x)
    else:
        M[2, 3] = x
    return M


def _matrix(rows: object) -> sp.Matrix:
    return sp.Matrix([*(list(row) for row in rows), [0, 0, 0, 1]])  # type: ignore[attr-defined]


def _simplify(value: sp.Expr, angles: list[sp.Symbol]) -> sp.Expr:
    """Factor a trigonometric polynomial in two ``angles`` and collect sums of angles in each factor.

    Before factoring, sin^2 may be replaced by 1 - cos^2. A factorization is found only for some choices of the angles
    where that is done, so the first, the second, both and neither are tried, and the shortest result is returned.
    A polynomial of more than ``FACTORED`` terms is returned as it is.
    """
    cosines, sines = sp.symbols(f"c:{len(angles)}"), sp.symbols(f"s:{len(angles)}")
    there = {sp.cos(x): c for x, c in zip(angles, cosines, strict=True)}
    there |= {sp.sin(x): s for x, s in zip(angles, sines, strict=True)}
    back = {symbol: function for function, symbol in there.items()}
    polynomial = sp.expand(value.xreplace(there))
    if len(sp.Add.make_args(polynomial)) > FACTORED:
        return value
    pairs = list(zip(cosines, sines, strict=True))
    tried = []
    for chosen in (pairs[:1], pairs[1:], pairs, []):
        reduced = polynomial
        for c, s in chosen:
            reduced = sp.expand(sp.rem(reduced, s**2 + c**2 - 1, s)) if reduced.has(s) else reduced
        tried.append(sp.factor(reduced))
    best = min(tried, key=sp.count_ops)
    return sp.Mul(*(_collect_angle_sums(factor.xreplace(back)) for factor in sp.Mul.make_args(best)))


def _collect_angle_sums(factor: sp.Expr) -> sp.Expr:
    """Rewrite ``factor`` with sums of angles if that is shorter; more than ``TERMS`` terms are left as they are."""
    if len(sp.Add.make_args(factor)) > TERMS:
        return factor
    return min((factor, sp.trigsimp(factor)), key=sp.count_ops)


def _factors(value: sp.Expr) -> list[sp.Expr]:
    """The factors of ``value`` that depend on a joint, each to the power 1 and with a positive leading sign."""
    factors = []
    for factor in sp.Mul.make_args(value):
        base = factor.base if isinstance(factor, sp.Pow) else factor
        if any(symbol.name.startswith("q_") for symbol in base.free_symbols):
            factors.append(-base if base.could_extract_minus_sign() else base)
    return factors
