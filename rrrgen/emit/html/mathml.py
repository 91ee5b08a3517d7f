"""Printing of expressions and equations as presentation MathML, which browsers display without scripts or fonts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import sympy as sp
from markupsafe import Markup

from rrrgen.base.errors import BackendError, DerivationError
from rrrgen.emit.latex.equations import Form, PrintedEquation, break_sum, lay_out
from rrrgen.emit.latex.formulas import GREEK, Notation, QuantityNotation, Walk, notation

if TYPE_CHECKING:
    from rrrgen.emit.latex.inverse_kinematics import SolverForm
    from rrrgen.robot.spec import RobotSpec


_BOLD_CAPITALS, _BOLD_SMALL, _BOLD_GREEK = 0x1D468, 0x1D482, 0x1D736
_DOTS = {1: "˙", 2: "¨"}
LINE = 84


class MathmlMarkup:
    """The markup of formulas as presentation MathML."""

    def symbol(self, parts: Notation) -> str:
        """The MathML of a letter with dots and subscript."""
        return _with_subscript(_letter_with_dots(GREEK.get(parts.base, parts.base), parts.dots), parts.subscript)

    def number(self, text: str) -> str:
        """The MathML of an unsigned number."""
        mantissa, _, exponent = text.partition("e")
        if not exponent:
            return f"<mn>{mantissa}</mn>"
        power = self.power("<mn>10</mn>", _integer_markup(int(exponent)))
        return f"<mn>{mantissa}</mn><mo>·</mo>{power}"

    def total(self, terms: Sequence[tuple[bool, str]]) -> str:
        """The MathML of a sum."""
        return f"<mrow>{sum_of(terms)}</mrow>"

    def product(self, factors: Sequence[str]) -> str:
        """The MathML of a product: juxtaposed factors, with a dot before a number."""
        text = factors[0]
        for factor in factors[1:]:
            text += ("<mo>·</mo>" if factor.startswith("<mn>") else "<mo>⁢</mo>") + factor
        return f"<mrow>{text}</mrow>"

    def fraction(self, numerator: str, denominator: str) -> str:
        """The MathML of a quotient."""
        return f"<mfrac><mrow>{numerator}</mrow><mrow>{denominator}</mrow></mfrac>"

    def power(self, base: str, exponent: str) -> str:
        """The MathML of a power."""
        return f"<msup><mrow>{base}</mrow><mrow>{exponent}</mrow></msup>"

    def root(self, argument: str) -> str:
        """The MathML of a square root."""
        return f"<msqrt>{argument}</msqrt>"

    def function(self, name: str, argument: str, exponent: str) -> str:
        """The MathML of ``name(argument)``; a non-empty exponent stands between name and argument."""
        head = f"<mi>{name}</mi>"
        head = f"<msup>{head}<mrow>{exponent}</mrow></msup>" if exponent else head
        return f"<mrow>{head}<mo>⁡</mo>{self.group(argument)}</mrow>"

    def argument_list(self, arguments: Sequence[str]) -> str:
        """The MathML of the arguments of a function, separated by commas."""
        return "<mo>,</mo>".join(f"<mrow>{argument}</mrow>" for argument in arguments)

    def group(self, content: str) -> str:
        """The MathML of an expression in parentheses."""
        return f"<mrow><mo>(</mo>{content}<mo>)</mo></mrow>"


def _integer_markup(value: int) -> str:
    return f"<mo>−</mo><mn>{-value}</mn>" if value < 0 else f"<mn>{value}</mn>"


def _letter_with_dots(letter: str, dots: int) -> str:
    text = f"<mi>{escape(letter)}</mi>"
    return f'<mover accent="true">{text}<mo>{_DOTS[dots]}</mo></mover>' if dots else text


def _with_subscript(base: str, parts: Sequence[str]) -> str:
    if not parts:
        return base
    below = "<mo>,</mo>".join(f"<mn>{p}</mn>" if p.isdigit() else f"<mi>{escape(p)}</mi>" for p in parts)
    return f"<msub>{base}<mrow>{below}</mrow></msub>"


def sum_of(terms: Sequence[tuple[bool, str]], within: bool = False) -> str:
    """The MathML elements of a sum such as ``a - b + c``, one after the other, without an enclosing element.

    ``within`` says that it continues a sum, so that its first term has a sign with space on both sides.
    """
    text = ""
    for negative, term in terms:
        sign = "−" if negative else "+"
        if within and not text:
            text += f'<mo form="infix">{sign}</mo>'
        elif text or negative:
            text += f"<mo>{sign}</mo>"
        text += term
    return text or "<mn>0</mn>"


def bold(letter: str) -> str:
    """Convert a letter, or the name of a Greek letter, to the bold italic character for a vector or matrix."""
    letter = GREEK.get(letter, letter)
    if len(letter) != 1:
        return f"<mi>{escape(letter)}</mi>"
    for first, start in (("A", _BOLD_CAPITALS), ("a", _BOLD_SMALL), ("α", _BOLD_GREEK)):
        if 0 <= ord(letter) - ord(first) < 26:
            return f"<mi>{chr(start + ord(letter) - ord(first))}</mi>"
    return f"<mi>{escape(letter)}</mi>"


def inline(expression: sp.Expr, walk: Walk) -> str:
    """Print an expression as inline MathML, for use within text."""
    return f"<math>{walk.write(expression)}</math>"


def folding(expression: sp.Expr, walk: Walk, width: int = 1) -> str:
    """A sum as inline MathML with one element for each term, so that a browser can break the line between terms.

    Terms of more than ``width`` plain characters are multiplied out where they can be.
    """
    terms = [term for row in break_sum(expression, walk, width) for term in row]
    return "<wbr/>".join(f"<math>{sum_of([term], within=k > 0)}</math>" for k, term in enumerate(terms))


Line = tuple[str, str, str]
"""One equation: the MathML of its left-hand side, that of its right-hand side in elements, and a remark behind it."""


def display(lines: Sequence[Line]) -> str:
    """A table of equations, aligned at the equals sign, that folds at the edge of the page and between its lines."""
    rows = "".join(
        f"<tr><td><math>{left}</math></td><td><math><mo>=</mo></math></td>"
        f"<td>{right}{f' <span>({escape(note)})</span>' if note else ''}</td></tr>"
        for left, right, note in lines
    )
    return f'<table class="equations"><tbody>{rows}</tbody></table>'


def definition(symbol: sp.Symbol, value: sp.Expr, walk: Walk) -> Line:
    """The line that defines a named subexpression."""
    return walk.markup.symbol(notation(str(symbol))), folding(value, walk, LINE), ""


def step(symbol: sp.Expr, value: sp.Expr, either: sp.Expr | None, note: str, walk: Walk) -> Line:
    """The line ``symbol = value``, or with two roots ``symbol = value ± either``, and its remark."""
    if either is None:
        return walk.write(symbol), _folding_angle(value, walk), note
    root = _folding_angle(either, walk, f'<mo form="{"infix" if value else "prefix"}">±</mo>')
    return walk.write(symbol), f"{_folding_angle(value, walk)}<wbr/>{root}" if value else root, note


def _folding_angle(value: sp.Expr, walk: Walk, sign: str = "") -> str:
    """The MathML of ``value``; if it is an arctangent of two arguments, a browser can break the line within them.

    ``sign`` stands before it.
    """
    angle = -value if isinstance(-value, sp.atan2) else value
    if not isinstance(angle, sp.atan2):
        return f"<math>{sign}{walk.write(value)}</math>" if sign else folding(value, walk, LINE)
    head = sign + ("" if angle is value else "<mo>−</mo>")
    y, x = (folding(argument, walk, LINE) for argument in angle.args)
    joined = "\u2060"  # no line break here
    return (
        f"<math>{head}<mi>atan2</mi><mo>(</mo></math>{joined}{y}{joined}<math><mo>,</mo></math><wbr/>"
        f"{x}{joined}<math><mo>)</mo></math>"
    )


def equation(about: QuantityNotation, written: PrintedEquation, walk: Walk) -> Line:
    """The line of one equation of a closed form."""
    left = _left_side(about, written)
    if isinstance(written.value, sp.MatrixBase):
        return left, f"<math>{matrix(written.value, walk)}</math>", ""
    return left, folding(written.value, walk, LINE), ""


def matrix(value: sp.MatrixBase, walk: Walk) -> str:
    """The MathML of a matrix in brackets."""
    rows = "".join(
        "<mtr>" + "".join(f"<mtd>{walk.write(entry)}</mtd>" for entry in value.row(r)) + "</mtr>"
        for r in range(value.rows)
    )
    return f'<mtable class="matrix">{rows}</mtable>'


def _left_side(about: QuantityNotation, equation: PrintedEquation) -> str:
    parts = notation(equation.letter)
    letter = bold(parts.base)
    below = (*parts.subscript, *(str(index) for index in equation.indices))
    if equation.indices or not about.arguments:
        return _with_subscript(letter, below)
    arguments = "<mo>,</mo>".join(_letter_with_dots(chr(_BOLD_SMALL + 16), len(a) - 1) for a in about.arguments)
    return f"{_with_subscript(letter, below)}<mo>(</mo>{arguments}<mo>)</mo>"


# ------------------------------------------------------------------------------------------------------------------
# The sections of the report that hold equations: closed forms of the model functions, and the inverse kinematics.
# ------------------------------------------------------------------------------------------------------------------


def closed_forms(forms: Mapping[str, Form], walk: Walk) -> list[dict[str, object]]:
    """The template variables of every quantity of the closed forms: name, meaning, equations and remarks."""
    shown: list[dict[str, object]] = []
    for item in lay_out(forms):
        lines = [definition(symbol, value, walk) for symbol, value in item.definitions]
        lines += [equation(item.quantity, printed_equation, walk) for printed_equation in item.equations]
        shown.append(
            {
                "name": item.name,
                "meaning": item.quantity.meaning,
                "equations": Markup(display(lines)),
                "remarks": item.remarks,
            }
        )
    return shown


def inverse_kinematics(spec: RobotSpec) -> dict[str, object]:
    """The template variables of the inverse kinematics, or ``reason`` why there is none.

    ``title`` names the method; ``remarks`` are clauses, ``lengths`` and ``singular`` pairs, ``equations`` the closed
    form, empty where it is long.
    """
    from rrrgen.emit.latex.inverse_kinematics import closed_form, summary
    from rrrgen.ik.classify import plan

    solver_plan = plan(spec)
    if not solver_plan.solvable:
        return {"reason": solver_plan.reason}
    try:
        form = closed_form(spec)
        lines = _steps(form)
    except (BackendError, DerivationError):  # an equation that has no notation in mathematics
        form, lines = summary(solver_plan), []
    walk = Walk(MathmlMarkup(), short_trig=False)
    singular = [
        (Markup(inline(singularity.expression, walk)) if singularity.expression is not None else "", singularity.words)
        for singularity in form.singularities
    ]
    return {
        "reason": "",
        "title": form.plan.title,
        "remarks": form.remarks(),
        "singular": singular,
        "lengths": [(Markup(inline(symbol, walk)), Markup(inline(value, walk))) for symbol, value in form.values],
        "equations": Markup(display(lines)) if lines else "",
    }


def _steps(form: SolverForm) -> list[Line]:
    walk = Walk(MathmlMarkup(), short_trig=False)
    return [step(line.symbol, line.expression, line.either, line.note, walk) for line in form.steps]
