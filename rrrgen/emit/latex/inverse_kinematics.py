"""Printing of the inverse kinematics as formulas, in text and LaTeX, with symbols for the lengths of the DH table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.derive.closed_forms import decimal_text
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.mechanism import solved_chain
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, dot
from rrrgen.ik.plan import Singularity, SolverPlan, record_exactly
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between
from rrrgen.ik.result_layout import most_rows
from rrrgen.ik.singularities import number_chain, singular_sets, symbolic_chain
from rrrgen.robot.model.mechanism import chain_to_tip

if TYPE_CHECKING:
    from rrrgen.ik.geometry.mechanism import Coupling
    from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class FormLine:
    """One line of the closed form: ``symbol = expression``, or ``symbol = expression +- either`` for two roots.

    ``note`` is a remark printed behind the equation, if not empty.
    """

    symbol: sp.Symbol
    expression: sp.Expr
    either: sp.Expr | None = None
    note: str = ""

    def text(self) -> str:
        """The equation of this step as plain text."""
        line = f"{self.symbol} = {_plain(self.expression, self.either)}"
        return f"{line}    ({self.note})" if self.note else line

    def latex(self) -> str:
        """The equation of this step as LaTeX mathematics, without delimiters."""
        right = sp.latex(self.expression)
        if self.either is not None:
            right = rf"\pm {sp.latex(self.either)}" if self.expression == 0 else rf"{right} \pm {sp.latex(self.either)}"
        note = rf"\quad\text{{({self.note})}}" if self.note else ""
        return f"{sp.latex(self.symbol)} = {right}{note}"


def _plain(expression: sp.Expr, either: sp.Expr | None) -> str:
    if either is None:
        return str(expression)
    return f"+-{either}" if expression == 0 else f"{expression} +- {either}"


@dataclass(frozen=True)
class SolverForm:
    """The inverse kinematics of one robot, ready to be printed: ``steps`` are its equations, in order.

    ``values`` pairs the symbols of lengths and angles in them with their numbers.
    """

    plan: SolverPlan
    singularities: tuple[Singularity, ...]
    values: tuple[tuple[sp.Symbol, sp.Expr], ...]
    steps: tuple[FormLine, ...]

    def text(self) -> str:
        """The whole closed form as plain text."""
        head = [f"inverse kinematics: {self.plan.title}", *self.remarks()]
        head += [f"singular: {_singularity_text(singularity)}" for singularity in self.singularities]
        if self.values:
            head.append("with " + ", ".join(f"{symbol} = {_number(value)}" for symbol, value in self.values))
        return "\n".join([*head, *(f"  {step.text()}" for step in self.steps)])

    def remarks(self) -> list[str]:
        """Clauses with the number of solutions, the meaning of symbols, and what the closed form leaves out."""
        most = most_rows(self.plan) if self.plan.coupling else self.plan.max_solutions
        said = ["at most one solution" if most == 1 else f"at most {most} solutions"]
        if self.plan.coupling:
            slides = "" if self.plan.chain.types.count("P") < 1 else " (slides of a telescope count as one)"
            said.append(f"y_i: the displacement of row i between base and tip{slides}; q_k: joint position k")
        if self.plan.redundancy:
            said.append(f"redundancy parameter: {self.plan.redundancy}")
        if self.plan.incomplete:
            said.append(f"incomplete: {self.plan.incomplete}")
        return [*said, self.plan.approach] if self.plan.approach else said

    def latex(self) -> str:
        """The steps as one LaTeX ``align*`` environment."""
        lines = [step.latex().replace(" = ", " &= ", 1) for step in self.steps]
        if not lines:
            raise DerivationError(f"{self.plan.title}: there are no closed-form steps to print")
        return "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}"


def _number(value: sp.Expr) -> str:
    """Print a length or angle as decimals, as robot files do, or as it is where it has none."""
    return (decimal_text(value) if value.is_Rational else None) or str(value)


def _singularity_text(singularity: Singularity) -> str:
    if singularity.expression is None:
        return singularity.words
    return f"{singularity.expression} = 0 ({singularity.words})"


def closed_form(spec: RobotSpec, redundancy: int | None = None) -> SolverForm:
    """Derive the inverse kinematics of ``spec`` as printable formulas; DerivationError for a robot that has none."""
    plan = make_plan(spec, redundancy)
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: {plan.reason}")
    if plan.general:
        return summary(plan)
    rows, (joined, coupling) = chain_to_tip(spec), solved_chain(spec)
    telescopes = joined.n < rows.n  # their sums have no row of the table with symbols
    chain, values = (plan.solving, ()) if telescopes else symbolic_chain(rows, plan)
    solver = record_exactly(plan, chain)
    if solver is None:  # write the numbers
        numbers = plan.solving if telescopes else number_chain(rows, plan)
        solver, values = record_exactly(plan, numbers) or plan.equations, ()
    builder = TextBuilder(chain.n, position=plan.task == "position", letter="q" if plan.coupling is None else "y")
    solver.play(builder)
    if plan.coupling is not None:
        steps = (*_drop_unneeded(builder.steps, "y_"), *_coupling_lines(coupling, plan.coupling))
        return SolverForm(plan, plan.singularities, values, steps)
    return SolverForm(plan, singular_sets(spec, plan), values, _drop_unneeded(builder.steps, "q_"))


def _coupling_lines(S: sp.Matrix, coupling: Coupling) -> list[FormLine]:
    """The joint positions of a mechanism from the displacements y of its rows, and the rows that must fit."""
    rows, n = list(coupling.pivots), coupling.n
    y = [sp.Symbol(f"y_{i + 1}", real=True) for i in range(S.rows)]
    q = [sp.Symbol(f"q_{k + 1}", real=True) for k in range(n)]
    ranges = {
        sp.Symbol(f"z_{p + 1}", integer=True): f"z_{p + 1} = 0 to {count - 1}"
        for p, count in zip(rows, coupling.counts, strict=True)
        if count > 1
    }
    full = {symbol.name: 2 * sp.pi * symbol for symbol in ranges}
    leading = S.extract(rows, list(range(n))).inv() * sp.Matrix([y[p] + full.get(f"z_{p + 1}", 0) for p in rows])
    following = S * sp.Matrix(q)
    lines = []
    for symbol, value in zip(q, leading, strict=True):
        note = ", ".join(text for turn, text in ranges.items() if value.has(turn))
        lines.append(FormLine(symbol, sp.expand(value), None, note))
    must = "up to full turns; otherwise no solution"
    return lines + [FormLine(y[i], following[i], None, must) for i in range(S.rows) if i not in rows]


def summary(plan: SolverPlan) -> SolverForm:
    """A closed form without steps: family, number of solutions, redundancy, singularities in words."""
    return SolverForm(plan, plan.singularities, (), ())


def _drop_unneeded(steps: list[FormLine], joints: str) -> tuple[FormLine, ...]:
    """Drop the steps that define intermediate values on which no joint value depends.

    ``joints`` is the letter with which the symbols of the joint values begin.
    """
    wanted: set[sp.Symbol] = set()
    kept: list[FormLine] = []
    for step in reversed(steps):
        if step.symbol in wanted or not isinstance(step.symbol, sp.Symbol) or step.symbol.name.startswith(joints):
            kept.append(step)
            wanted |= step.expression.free_symbols | (step.either.free_symbols if step.either is not None else set())
    return tuple(reversed(kept))


class TextBuilder:
    """Interprets a recorded derivation over SymPy and writes its steps as equations."""

    def __init__(self, n: int, *, position: bool, letter: str = "q") -> None:
        self.steps: list[FormLine] = []
        self._letter = letter
        self._position, self._n = position, n
        self._names = {"x", "y", "z"} if position else {"p_x", "p_y", "p_z"}

    def pose(self) -> Rigid:
        """The symbols of the target pose: r_ij for the rotation, p_x, p_y, p_z for the position."""
        rows = [[_target(f"r_{i}{j}") for j in (1, 2, 3)] for i in (1, 2, 3)]
        x, y, z = ((row[0], row[1], row[2]) for row in rows)
        return Rigid((x, y, z), self._point("p"))

    def point(self) -> Vector:
        """The symbols of the target position: x, y, z, or p_x, p_y, p_z if the target is a pose."""
        return (_target("x"), _target("y"), _target("z")) if self._position else self._point("p")

    def tool(self) -> Vector:
        """The symbols of the position of the tool, where it is an input."""
        return self._point("t")

    def _point(self, letter: str) -> Vector:
        return (_target(f"{letter}_x"), _target(f"{letter}_y"), _target(f"{letter}_z"))

    def name(self, hint: str, x: S) -> S:
        """Write the definition of a name on a line of its own, unless the value is short."""
        value = _tidy(x)
        if value.is_number or value.is_symbol or (-value).is_symbol:
            return value
        part = len(hint) > 1 and hint[-1] in "xyz" and "_" not in hint
        symbol = self._fresh(f"{hint[:-1]}_{hint[-1]}" if part else hint)
        self.steps.append(FormLine(symbol, value))
        return symbol

    def names(self, hint: str, v: Vector) -> Vector:
        """Name the three coordinates of a vector."""
        return (self.name(f"{hint}_x", v[0]), self.name(f"{hint}_y", v[1]), self.name(f"{hint}_z", v[2]))

    def sqrt(self, x: S) -> S:
        """The square root of ``x`` as a SymPy expression."""
        return sp.sqrt(x)

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Write both angles of ``A cos(x) + B sin(x) = C``: ``atan2(B, A) +- atan2(sqrt(A^2 + B^2 - C^2), C)``."""
        A, B, C = _tidy(A), _tidy(B), _tidy(C)
        if B == 0 and not _carries_target(A):
            A, C = sp.Integer(1), _tidy(C / A)
        if sp.count_ops(C) > 3:
            C = self.name(f"k_{joint.index + 1}", C)
        w2 = _tidy(A**2 + B**2 - C**2)
        middle = sp.Integer(0) if (A == 1 and B == 0) else sp.atan2(B, A)
        return self._angle(joint, middle, sp.atan2(sp.sqrt(w2), C), label.name)

    def _angle(self, joint: Joint, value: sp.Expr, either: sp.Expr | None, note: str) -> Turn:
        offset, sign = _tidy(joint.offset), joint.sign
        q = sp.Symbol(f"{self._letter}_{joint.index + 1}", real=True)
        # raw = sign q + offset
        self.steps.append(FormLine(q, _tidy(sign * (value - offset)), either, note))
        raw = sign * q + offset
        return Turn(sp.cos(raw), sp.sin(raw))

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """Write ``+- sqrt(radicand)`` as an equation."""
        symbol = self._fresh(f"{hint[0]}_{hint[1:]}" if len(hint) > 1 else hint)
        self.steps.append(FormLine(symbol, sp.Integer(0), sp.sqrt(_tidy(radicand)), label.name))
        return symbol

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Write the quartic equation itself, because its roots have no readable formula."""
        q = sp.Symbol(f"{self._letter}_{joint.index + 1}", real=True)
        x = joint.sign * q + _tidy(joint.offset)
        terms = (1, sp.cos(x), sp.sin(x), sp.cos(2 * x), sp.sin(2 * x))
        total = sum(sp.Mul(_tidy(value), term, evaluate=True) for value, term in zip(k, terms, strict=True))
        self.steps.append(FormLine(sp.Integer(0), total, None, f"up to four roots {q}, {label.name}"))
        return Turn(sp.cos(x), sp.sin(x))

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """Write the linear or quadratic formula of a displacement as equations."""
        if len(k) == 2:
            return self.slide(joint, -k[0] / k[1])
        q = sp.Symbol(f"{self._letter}_{joint.index + 1}", real=True)
        raw = joint.sign * q + _tidy(joint.offset)
        if len(k) > 3:
            total = sum(value * raw**i for i, value in enumerate(k))
            self.steps.append(FormLine(sp.Integer(0), total, None, f"up to four roots {q}, {label.name}"))
            return raw
        root = sp.sqrt(_tidy(k[1] ** 2 - 4 * k[0] * k[2])) / (2 * k[2])
        middle = _tidy(joint.sign * (-k[1] / (2 * k[2]) - _tidy(joint.offset)))
        self.steps.append(FormLine(q, middle, root, label.name))
        return raw

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """Write the angle ``atan2(s, c)`` of a joint as an equation."""
        return self._angle(joint, sp.atan2(_tidy(s), _tidy(c)), None, "")

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """Write the angle that rotates ``v`` about z to the direction of ``u``: ``atan2(v x u, v . u)``."""
        c, s = between(v, u)
        return self.turn(joint, s, c)

    def slide(self, joint: Joint, x: S) -> S:
        """Write the equation of a prismatic joint, or of a joint whose angle depends on others."""
        q = sp.Symbol(f"{self._letter}_{joint.index + 1}", real=True)
        self.steps.append(FormLine(q, _tidy(joint.sign * (x - joint.offset))))
        return joint.sign * q + _tidy(joint.offset)

    def redundancy_parameter(self, joint: Joint) -> Turn | S:
        """The symbol of the joint that the caller prescribes, or of the arm angle psi."""
        prescribed = sp.Symbol("psi" if joint.index >= self._n else f"{self._letter}_{joint.index + 1}", real=True)
        raw = joint.sign * prescribed + _tidy(joint.offset)
        return Turn(sp.cos(raw), sp.sin(raw)) if joint.revolute else raw

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Write the equations of both solutions of an orthogonal wrist."""
        e4, e5 = signs
        mxz, myz, mzz = (_tidy(M[i][2]) for i in range(3))
        middle = self._angle(joints[1], sp.Integer(0), sp.atan2(sp.sqrt(mxz**2 + myz**2), -e4 * e5 * mzz), "wrist")
        sign = e5 * sp.sign(middle.s)
        first = self._angle(joints[0], sp.atan2(sign * myz, sign * mxz), None, "")
        mx = (M[0][0], M[1][0], M[2][0])
        s6 = dot((e4 * e5 * first.s, -e4 * e5 * first.c, 0), mx)
        c6 = dot((first.c * middle.c, first.s * middle.c, e4 * middle.s), mx)
        last = self._angle(joints[2], sp.atan2(_tidy(s6), _tidy(c6)), None, "")
        return first, middle, last

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Write nothing: checks of candidates are not part of the printed formula."""

    def _fresh(self, hint: str) -> sp.Symbol:
        name, serial = hint, 1
        while name in self._names:
            serial += 1
            name = f"{hint}{serial}" if "_" not in hint else f"{hint.split('_')[0]}{serial}_{hint.split('_')[1]}"
        self._names.add(name)
        return sp.Symbol(name, real=True)


def _target(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)


def _carries_target(x: sp.Expr) -> bool:
    return any(symbol.name[0] in "xyzpr" for symbol in x.free_symbols)


def _tidy(x: Any) -> sp.Expr:
    """Simplify ``x`` for printing: exact numbers, and the expanded form unless it is longer."""
    value = (
        x if isinstance(x, sp.Basic) else (sp.Rational(repr(float(x))) if float(x) != int(x) else sp.Integer(int(x)))
    )
    if value.is_Atom:
        return value
    expanded = sp.expand(value)
    return expanded if sp.count_ops(expanded) <= sp.count_ops(value) else value
