"""Parser of the text of one value into an exact SymPy expression; only what a whitelist names is allowed.

Allowed are decimal numbers, ``pi``, the declared names, ``+ - * / **``, ``sqrt``, ``sin``, ``cos``, parentheses and
one unit at the end. The text is parsed with :mod:`ast` and walked node by node; nothing is ever evaluated by Python
or by SymPy's own parser. Numbers are read from their source text: ``0.35`` is 7/20.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext.suggestions import (
    added_number,
    comma_advice,
    did_you_mean,
    plain_advice,
    with_point,
    without_leading_zeros,
)
from rrrgen.base.yamltext.units import ANGLE, UNITS, Dimension, Unit, find_unit, quantity_name

MAX_LENGTH = 4000  # characters of one value
MAX_DEPTH = 100  # nesting of one value
MAX_NUMBER_LENGTH = 400
MAX_DECIMAL_EXPONENT = 330  # covers the range of doubles, 5e-324 to 1.8e308
MAX_BITS = 4096  # numerator and denominator of every intermediate number
MAX_POWER = 16  # one exponent
MAX_DEGREE = 64  # product of nested exponents

ALLOWED = "numbers, pi, declared parameters, + - * / **, sqrt(), sin(), cos() and parentheses"
FUNCTIONS = {"sqrt": sp.sqrt, "sin": sp.sin, "cos": sp.cos}

_NUMBER = re.compile(r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_ILLEGAL = re.compile(r"[^A-Za-z0-9_ .+\-*/()^,\t\n]")
_SIGNS = re.compile(rf"([+-]\s*){{{MAX_DEPTH // 2},}}")  # Python 3.13 would parse any number of them
_UNIT_START = re.compile(r"(?<=[\s\d.)])(?=[A-Za-z°µμ])")


class ExpressionError(InputError):
    """The text of a value is not a valid expression.

    ``offset`` is the position of the fault in the text, counted from 0; ``unknown_name`` is the undeclared name if
    that is the fault, otherwise empty.
    """

    def __init__(self, message: str, text: str = "", offset: int = 0, hint: str = "", unknown_name: str = "") -> None:
        self.message, self.offset, self.hint, self.unknown_name = message, offset, hint, unknown_name
        super().__init__([Fault("value", 1, offset + 1, message, text, hint)])


@dataclass(frozen=True)
class Name:
    """A declared parameter: its expression and its dimension.

    ``dimension`` is None if the parameter was declared as a bare number: it may then stand for a plain number, an angle
    or a length.
    """

    expr: sp.Expr
    dimension: Dimension | None = None


@dataclass(frozen=True)
class ParsedValue:
    """A parsed value, before its unit is applied.

    - ``expr``: the exact expression, without ``unit``.
    - ``dimension``: the dimension implied by the parameters in it; None if there is none, then the file's default unit
      applies.
    - ``open_names``: parameters declared as bare numbers, whose unknown dimension leaves that of the value open.
    - ``names``: all parameters used.
    - ``adds_bare_number``: a bare number is added to a parameter that has a dimension.
    - ``bare_trigonometry``: a sine or cosine is taken of something that is not evidently an angle in rad.
    - ``decimals``: digits after the decimal point if the text is one plain number.
    """

    expr: sp.Expr
    unit: Unit | None = None
    dimension: Dimension | None = None
    open_names: frozenset[str] = frozenset()
    names: frozenset[str] = frozenset()
    uses_pi: bool = False
    adds_bare_number: bool = False
    bare_trigonometry: bool = False
    decimals: int | None = None


def parse_expression(text: str, names: Mapping[str, Name] | None = None, units: bool = True) -> ParsedValue:
    """Parse one value: an expression in the declared ``names``, followed by at most one unit (none if ``units`` is
    False).

    Raises :class:`ExpressionError` with the offset of the first fault and what is allowed.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the value is longer than {MAX_LENGTH} characters", text)
    body, unit = _split_unit(text, units)
    _check_characters(body, text[len(body) :])
    walker = _Walker(body, names or {})
    tree = _parse(body, text[len(body) :]).body
    term = walker.walk(tree, 0)
    if unit is not None:
        _check_unit_reach(text, body, unit, tree, walker)
    plain = re.fullmatch(r"\s*[+-]?\s*" + _NUMBER.pattern + r"\s*", body)
    return ParsedValue(
        expr=term.expr,
        unit=unit,
        dimension=term.dimension,
        open_names=term.open_names,
        names=frozenset(walker.names),
        uses_pi=walker.uses_pi,
        adds_bare_number=walker.adds_bare_number,
        bare_trigonometry=walker.bare_trigonometry,
        decimals=_decimals(plain) if plain else None,
    )


def _check_unit_reach(text: str, body: str, unit: Unit, tree: ast.expr, walker: _Walker) -> None:
    """Refuse a unit after a parameter or after a sum, where it is ambiguous what it applies to."""
    behind = len(body)
    if walker.names:
        message = f"the unit {unit.name} stands behind the parameter '{min(walker.names)}', which has its own unit"
        number = added_number(body) or "..."
        hint = f"declare the number as a parameter too, e.g. offset: {number} {unit.name}, and drop the unit here"
        raise ExpressionError(message, text, behind, hint)
    start = len(body) - len(body.lstrip())
    is_sum = isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub)
    if is_sum and walker.offset(tree.lineno, tree.col_offset) == start:
        hint = f"write ({body.strip()}) {unit.name}, if the unit belongs to the whole sum"
        raise ExpressionError(f"the unit {unit.name} stands behind a sum", text, behind, hint)


def exact_number(text: str) -> sp.Rational:
    """Convert the unsigned decimal number ``text`` to an exact rational: ``0.35`` -> 7/20, ``1e-3`` -> 1/1000.

    Raises :class:`ExpressionError` for other text and for more digits or a larger exponent than allowed.
    """
    match = _NUMBER.fullmatch(text)
    if match is None:
        hint = f"write {text.replace('_', '')}" if "_" in text else "write numbers as 12, 0.35 or 1e-3"
        raise ExpressionError(f"'{text[:40]}' is not a decimal number", text, 0, hint)
    exponent = match.group(2)
    if len(match.group(1)) > MAX_NUMBER_LENGTH or (exponent and len(exponent) > 5):
        raise ExpressionError("the number has too many digits", text, 0, f"at most {MAX_NUMBER_LENGTH} digits")
    if exponent and abs(int(exponent[1:])) > MAX_DECIMAL_EXPONENT:
        raise ExpressionError(
            f"the exponent of {text[:40]} is out of range", text, 0, f"at most 1e{MAX_DECIMAL_EXPONENT}"
        )
    value = Fraction(text)
    return sp.Rational(value.numerator, value.denominator)


def _decimals(plain: re.Match[str]) -> int:
    digits = len(plain.group(1).partition(".")[2])
    return digits - int(plain.group(2)[1:]) if plain.group(2) else digits


def _split_unit(text: str, units: bool) -> tuple[str, Unit | None]:
    """Split the unit off the end of ``text``: the longest suffix naming a unit that follows a digit, blank or ``)``."""
    if not units:
        return text, None
    for match in _UNIT_START.finditer(text):
        start = match.start()
        unit = find_unit(text[start:])
        if unit is not None and text[:start].strip() and text[:start].rstrip()[-1] not in "+-*/(,^":
            return text[:start], unit
    unknown = re.fullmatch(r"(.*[\w.)])\s+([A-Za-z°µμ][\w*/^ ·²]*)", text, re.DOTALL)
    if unknown and re.search(r"[\d.)]\s*$|^\s*\w+\s*$", unknown.group(1)):
        spelling = unknown.group(2).strip()
        hint = did_you_mean(spelling, UNITS, {"degree": "deg"}) or f"units are {', '.join(UNITS)}"
        raise ExpressionError(f"unknown unit '{_shorten(spelling, 40)}'", text, unknown.start(2), hint)
    return text, None


def _check_characters(body: str, unit: str) -> None:
    """Refuse text that must not reach Python's parser; ``unit`` is the unit split off, repeated in suggestions."""
    if not body.strip():
        raise ExpressionError("a value is missing", body, 0, f"allowed are {ALLOWED}")
    lowered = body.strip().lower().lstrip("+-.")
    if lowered in ("nan", "inf", "infinity"):
        raise ExpressionError(f"'{body.strip()}' is not a finite number", body, 0, "write a finite number")
    comma = re.search(r"\d,\d", body)
    if comma and "(" not in body:
        meant = with_point(body + unit)
        raise ExpressionError("a comma inside a number", body, comma.start() + 1, comma_advice(meant))
    if "^" in body:
        meant = _shorten((body + unit).replace("^", "**"))
        raise ExpressionError("'^' is not allowed", body, body.index("^"), f"a power is written with **: {meant}")
    illegal = _ILLEGAL.search(body)
    if illegal:
        raise ExpressionError(
            f"the character {illegal.group()!r} is not allowed in a value",
            body,
            illegal.start(),
            plain_advice(illegal.group(), body + unit) or f"allowed are {ALLOWED}",
        )
    signs = _SIGNS.search(body)
    if signs:
        raise ExpressionError(
            f"'{_shorten(body)}' is not an expression", body, signs.start(), "too many signs in a row"
        )
    depth = 0
    for offset, character in enumerate(body):
        depth += (character == "(") - (character == ")")
        if depth > MAX_DEPTH // 2:
            raise ExpressionError("too many nested parentheses", body, offset, f"at most {MAX_DEPTH // 2}")


def _parse(body: str, unit: str) -> ast.Expression:
    glued = re.search(r"(?<![\w.])\d+\.?\d*(?![eE][+-]?\d)(?=[A-Za-z_(])", body) or re.search(r"\)(?=\s*[\w(])", body)
    if glued:
        meant = _shorten(f"{body[: glued.end()]}*{body[glued.end() :].lstrip()}{unit}")
        raise ExpressionError("an operator is missing", body, glued.end(), f"write products with *: {meant}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # the parentheses let a value continue over several lines, as YAML does
            return ast.parse(f"({body}\n)", mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        offset = max(0, (getattr(error, "offset", None) or 2) - 2)
        if getattr(error, "lineno", 1) != 1 or offset > len(body):
            offset = len(body.rstrip())
        leading = re.search(r"(?<![\w.])0\d", body)
        hint = f"allowed are {ALLOWED}"
        if leading:
            hint = f"numbers have no leading zero: {_shorten(without_leading_zeros(body + unit))}"
        raise ExpressionError(f"'{_shorten(body)}' is not an expression", body, offset, hint) from None


def _shorten(text: str, width: int = 60) -> str:
    text = text.strip()
    return text if len(text) <= width else text[: width - 3] + "..."


@dataclass(frozen=True)
class _Term:
    expr: sp.Expr
    dimension: Dimension | None = None
    open_names: frozenset[str] = frozenset()
    degree: int = 1


class _Walker:
    """Turns the syntax tree of one value into a SymPy expression, bounded in depth, power and size."""

    def __init__(self, body: str, declared: Mapping[str, Name]) -> None:
        self.body, self.declared = body, declared
        self.lines = [0]  # offset of each line of the body
        for line in body.splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(line))
        self.names: set[str] = set()
        self.uses_pi = self.adds_bare_number = self.bare_trigonometry = False

    def fail(self, message: str, node: ast.expr, hint: str = "", unknown_name: str = "") -> ExpressionError:
        return ExpressionError(message, self.body, self.offset(node.lineno, node.col_offset), hint, unknown_name)

    def offset(self, line: int, column: int) -> int:
        # one parenthesis was put before the first line; the body is ASCII, so bytes are characters
        return max(0, self.lines[min(line, len(self.lines)) - 1] + column - (line == 1))

    def walk(self, node: ast.expr, depth: int) -> _Term:
        if depth > MAX_DEPTH:
            raise self.fail("the value is nested too deeply", node, f"at most {MAX_DEPTH} levels")
        match node:
            case ast.Constant():
                term = self.number(node)
            case ast.Name():
                term = self.name(node)
            case ast.UnaryOp(op=ast.USub() | ast.UAdd()):
                inner = self.walk(node.operand, depth + 1)
                sign = -1 if isinstance(node.op, ast.USub) else 1
                term = _Term(sign * inner.expr, inner.dimension, inner.open_names, inner.degree)
            case ast.BinOp():
                return self.chain(node, depth)
            case ast.Call():
                term = self.call(node, depth)
            case _:
                raise self.fail("this is not an arithmetic expression", node, f"allowed are {ALLOWED}")
        self.check_size(term, node)
        return term

    def chain(self, node: ast.BinOp, depth: int) -> _Term:
        """A left-associative chain such as ``a + b - c``, evaluated in a loop: a long sum needs no deep recursion."""
        steps, first = [node], node.left
        while isinstance(first, ast.BinOp):
            steps.append(first)
            first = first.left
        term = self.walk(first, depth + 1)
        for step in reversed(steps):
            term = self.binary(step, term, self.walk(step.right, depth + 1))
            self.check_size(term, step)
        return term

    def check_size(self, term: _Term, node: ast.expr) -> None:
        if term.degree > MAX_DEGREE:
            raise self.fail("the powers are too high", node, f"at most degree {MAX_DEGREE} altogether")
        number = term.expr
        if number.is_Rational and max(int(number.p).bit_length(), int(number.q).bit_length()) > MAX_BITS:
            raise self.fail("the number has too many digits", node)
        if number.has(sp.zoo, sp.nan, sp.oo, -sp.oo):
            raise self.fail("division by zero", node)
        if number.has(sp.I):
            raise self.fail("the value is not real", node, "a root of a negative number?")

    def number(self, node: ast.Constant) -> _Term:
        start = self.offset(node.lineno, node.col_offset)
        text = self.body[start : self.offset(node.end_lineno or node.lineno, node.end_col_offset or 0)]
        try:
            return _Term(exact_number(text))
        except ExpressionError as error:
            raise self.fail(error.message, node, error.hint) from None

    def name(self, node: ast.Name) -> _Term:
        if node.id == "pi":
            self.uses_pi = True
            return _Term(sp.pi)
        if node.id in self.declared:
            self.names.add(node.id)
            name = self.declared[node.id]
            known = name.dimension if name.dimension is None or any(name.dimension) else None
            return _Term(name.expr, known, frozenset((node.id,) if name.dimension is None else ()))
        if node.id in FUNCTIONS:
            raise self.fail(f"'{node.id}' needs an argument", node, f"write {node.id}(...)")
        known_names = ", ".join(list(self.declared)[:30]) or "none are declared"
        hint = did_you_mean(node.id, [*self.declared, "pi", *FUNCTIONS])
        hint = hint or f"allowed are {ALLOWED}; parameters: {known_names}"
        raise self.fail(f"unknown name '{_shorten(node.id, 40)}'", node, hint, node.id)

    def call(self, node: ast.Call, depth: int) -> _Term:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS:
            hint = did_you_mean(name, FUNCTIONS) or "functions are " + ", ".join(FUNCTIONS)
            raise self.fail(f"unknown function '{_shorten(name, 40)}'" if name else "this cannot be called", node, hint)
        if len(node.args) != 1 or node.keywords:
            raise self.fail(f"{name} takes one argument", node, f"write {name}(x)")
        inner = self.walk(node.args[0], depth + 1)
        if name == "sqrt":
            if inner.expr.is_negative:
                raise self.fail("the root of a negative number", node)
            half = tuple(e / 2 for e in inner.dimension) if inner.dimension else None
            return _Term(sp.sqrt(inner.expr), half, inner.open_names, inner.degree)
        if inner.dimension not in (None, ANGLE):
            raise self.fail(f"{name} of {quantity_name(inner.dimension or ())}", node, f"{name} takes an angle")
        pure_angle = inner.dimension == ANGLE or inner.expr.has(sp.pi) or inner.expr.is_zero
        self.bare_trigonometry |= not pure_angle
        return _Term(FUNCTIONS[name](inner.expr), None, frozenset(), inner.degree)

    def binary(self, node: ast.BinOp, left: _Term, right: _Term) -> _Term:
        names = left.open_names | right.open_names
        match node.op:
            case ast.Add() | ast.Sub():
                sign = 1 if isinstance(node.op, ast.Add) else -1
                dimension = self.common(node, left, right)
                return _Term(left.expr + sign * right.expr, dimension, names, max(left.degree, right.degree))
            case ast.Mult():
                dimension = _product(left.dimension, right.dimension, 1)
                return _Term(left.expr * right.expr, dimension, names, left.degree + right.degree - 1)
            case ast.Div():
                if right.expr.is_zero:
                    raise self.fail("division by zero", node)
                dimension = _product(left.dimension, right.dimension, -1)
                return _Term(left.expr / right.expr, dimension, names, left.degree + right.degree - 1)
            case ast.Pow():
                return self.power(node, left, right)
            case _:
                raise self.fail("this operator is not allowed", node, f"allowed are {ALLOWED}")

    def common(self, node: ast.BinOp, left: _Term, right: _Term) -> Dimension | None:
        """The common dimension of the two terms of a sum; a fault if they differ."""
        if left.dimension and right.dimension and left.dimension != right.dimension:
            what = f"{quantity_name(left.dimension)} and {quantity_name(right.dimension)}"
            raise self.fail(f"{what} cannot be added", node)
        for one, other in ((left, right), (right, left)):
            if (other.dimension or other.open_names) and one.dimension is None and not one.open_names:
                self.adds_bare_number |= not one.expr.is_zero
        return left.dimension or right.dimension

    def power(self, node: ast.BinOp, base: _Term, exponent: _Term) -> _Term:
        size = exponent.expr
        if not size.is_Rational or size.q not in (1, 2) or abs(size) > MAX_POWER:
            hint = f"exponents are whole or half numbers from -{MAX_POWER} to {MAX_POWER}"
            raise self.fail("this power is not allowed", node.right, hint)
        if base.expr.is_zero and size <= 0:
            raise self.fail("division by zero", node)
        if size.q == 2 and base.expr.is_negative:
            raise self.fail("the root of a negative number", node)
        if base.expr.is_Rational and abs(size) * max(base.expr.p.bit_length(), base.expr.q.bit_length()) > MAX_BITS:
            raise self.fail("the number has too many digits", node)
        scaled = tuple(e * Fraction(int(size.p), int(size.q)) for e in base.dimension or ())
        degree = max(1, base.degree * int(sp.ceiling(abs(size))))
        return _Term(base.expr**size, scaled if any(scaled) else None, base.open_names, degree)


def _product(left: Dimension | None, right: Dimension | None, sign: int) -> Dimension | None:
    """Dimension of a product (``sign`` 1) or quotient (``sign`` -1); None is a plain number, in and out."""
    zero = (Fraction(0),) * 5
    result = tuple(a + sign * b for a, b in zip(left or zero, right or zero, strict=True))
    return result if any(result) else None
