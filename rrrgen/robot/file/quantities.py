"""Converts the scalars of a robot file to exact values in SI and radians, with the rules for bare numbers.

A bare number (without a unit) is in the units declared by the file in joint rows, base and tool, and in SI elsewhere.
Parameters carry their own unit; one declared without a unit is in SI, which is refused as ambiguous where the unit of
the file differs from SI. Everything else that could be read in two ways is refused too.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise

import sympy as sp

from rrrgen.base.yamltext.document import FaultList, Node, ScalarNode, describe
from rrrgen.base.yamltext.expressions import ExpressionError, Name, ParsedValue, parse_expression
from rrrgen.base.yamltext.fields import read_list
from rrrgen.base.yamltext.suggestions import added_number, comma_advice, number_cut_by_comma, with_unit
from rrrgen.base.yamltext.units import QUANTITIES, Dimension, FileUnits, Quantity, Unit, quantity_name
from rrrgen.robot.spec import parameter_symbol

LARGEST_BARE_LENGTH = 20.0  # m; beyond it a bare number in an m file is taken for mm
LARGEST_BARE_ANGLE = {"an angle": 6.3, "a joint angle": 25.2}  # rad, one and four turns; beyond it degrees were meant
LARGEST_VALUE = 1e15
SLOWEST = 10.0  # deg/s, mm/s and per s^2; joints of robots are faster, slower bare numbers were meant in SI
SLOW = {"deg/s": "rad/s", "deg/s^2": "rad/s^2", "mm/s": "m/s", "mm/s^2": "m/s^2"}
SUSPICIOUS_RIGHT_ANGLE = 1e-5  # rad; a decimal this near to a multiple of pi/2 was meant to be one
SUSPICIOUS_ZERO = 1e-9  # rad; below what a calibration can measure, so it is round-off of another program


@dataclass
class Scope:
    """Context in which the values of one file are read: faults, units, and the parameters declared so far.

    By name of a parameter: ``names`` are their symbols and dimensions, ``nominal`` their exact values in SI,
    ``declared_at`` their keys in the file, ``parameter_units`` the units they were declared in.
    """

    faults: FaultList
    units: FileUnits = field(default_factory=FileUnits)
    names: dict[str, Name] = field(default_factory=dict)
    nominal: dict[str, sp.Expr] = field(default_factory=dict)
    declared_at: dict[str, ScalarNode] = field(default_factory=dict)
    parameter_units: dict[str, str] = field(default_factory=dict)
    bare_lengths: list[float] = field(default_factory=list)  # m, of values without unit in a mm file
    undeclared: set[str] = field(default_factory=set)  # parameters declared further down in the file
    broken: set[str] = field(default_factory=set)  # parameters whose own fault is already reported

    def substitute(self, expr: sp.Expr) -> sp.Expr:
        """Replace every parameter in ``expr`` by its nominal value."""
        if not expr.free_symbols:
            return expr
        return expr.xreplace({parameter_symbol(name): value for name, value in self.nominal.items()})


def read_value(node: Node, what: str, quantity: str, scope: Scope, file_units: bool = False) -> sp.Expr | None:
    """Exact SI value of one scalar, with parameters as symbols; a fault and None if it cannot be read.

    ``what`` names the value in messages, ``quantity`` is a key of QUANTITIES; with ``file_units`` a bare number is in
    the units of the file, otherwise in SI.
    """
    value = parse_scalar(node, what, scope)
    if value is None or not isinstance(node, ScalarNode):
        return None
    target = QUANTITIES[quantity]
    unit = value.unit or (scope.units.of(target) if file_units else FileUnits().of(target))
    undecided = value.unit is None and file_units and not scope.units.covers(target)
    if value.unit is None and not undecided and _is_ambiguous(node, value, what, target, unit, scope):
        return None
    if value.unit is not None and value.unit.dimension != target.dimension:
        article = quantity_name(value.unit.dimension)
        scope.faults.error(node, f"{value.unit.name} measures {article}; {what} is {target.name}", _units_hint(target))
        return None
    scales = value.unit is not None or (value.dimension is None and not value.open_names)
    expr = value.expr * unit.si() if scales else value.expr
    number = nominal_number(node, what, expr, scope)
    if number is None or undecided:
        return None
    if value.unit is None and not value.names and (fault := _confusion(node, value, number, what, target, unit)):
        scope.faults.error(node, *fault)
        return None
    if value.unit is None and not value.names and unit.name in SLOW and 0 < abs(number / float(unit.si())) <= SLOWEST:
        written = node.text.strip()
        hint = f"a bare number is in the units of the file; write {with_unit(written, SLOW[unit.name])}"
        meant = with_unit(written, unit.name)
        scope.faults.warning(node, f"{what} is {meant}", f"{hint}, or {meant} if that is meant")
    if unit.name == "mm" and value.unit is None:
        scope.bare_lengths.append(abs(number))
    if target.name == "an angle" and unit.name == "rad" and not value.uses_pi and not value.names:
        _warn_about_right_angle(node, value, expr, what, scope)
    return expr


def read_number(node: Node, what: str, quantity: str, scope: Scope, file_units: bool = False) -> float | None:
    """SI value of one scalar as a float, with parameters at their nominal values; a fault and None if unreadable."""
    expr = read_value(node, what, quantity, scope, file_units)
    return None if expr is None else float(scope.substitute(expr))


def read_rational(node: Node, what: str, quantity: str, scope: Scope) -> sp.Rational | None:
    """SI value of one scalar as an exact rational, with parameters at their nominal values; a fault and None if not."""
    expr = read_value(node, what, quantity, scope)
    if expr is None:
        return None
    value = scope.substitute(expr)
    if not value.is_Rational:
        scope.faults.error(node, f"{what} is not a rational number", "write a decimal number")
        return None
    return value


def read_vector(node: Node, what: str, quantity: str, scope: Scope, file_units: bool = False) -> list[sp.Expr] | None:
    """Exact SI values of a list of three scalars; faults and None if one cannot be read."""
    items = read_list(node, what, 3, scope.faults)
    if items is None:
        return None
    _warn_about_commas(node, items, what, scope)
    labels = [f"entry {i} of {what}" for i in (1, 2, 3)]
    values = [read_value(item, label, quantity, scope, file_units) for item, label in zip(items, labels, strict=True)]
    present = [value for value in values if value is not None]
    return present if len(present) == 3 else None


def _warn_about_commas(node: Node, items: list[Node], what: str, scope: Scope) -> None:
    """Warn of a list such as ``[0, -9,81]``, in which a decimal comma has split a number into two entries."""
    scalars = [item for item in items if isinstance(item, ScalarNode)]
    pairs = list(pairwise(scalars))
    tight = [right.place.column - left.place.column - len(left.text) == 1 for left, right in pairs]
    if any(tight) and not all(tight):
        left, right = pairs[tight.index(True)]
        number = number_cut_by_comma(left, right)
        if number and right.text != "0":
            hint = f"{comma_advice(number)}; if these are two entries, put a blank between them"
            scope.faults.warning(right, f"{what} contains {left.text},{right.text}", hint)


def parse_scalar(node: Node, what: str, scope: Scope) -> ParsedValue | None:
    """Parse a scalar without applying its unit; a fault and None if it is not a valid expression."""
    if not isinstance(node, ScalarNode) or node.is_null:
        scope.faults.error(node, f"{what} is {describe(node)}, not a value", "write a number or an expression")
        return None
    try:
        value = parse_expression(node.text, scope.names)
    except ExpressionError as error:
        report_expression(error, node, what, scope)
        return None
    return value


def report_expression(error: ExpressionError, node: ScalarNode, what: str, scope: Scope, offset: int = 0) -> None:
    """Report an invalid expression, unless its only fault is a parameter whose own fault is already reported."""
    if error.unknown_name in scope.broken:
        return
    hint = error.hint
    if error.unknown_name in scope.undeclared:
        hint = f"'{error.unknown_name}' is declared further down; a parameter may use those above it"
    scope.faults.error(node, f"{what}: {error.message}", hint, offset + error.offset)


def nominal_number(node: Node, what: str, expr: sp.Expr, scope: Scope) -> float | None:
    """Evaluate ``expr`` at the nominal parameters as a float; a fault and None unless it is finite and real."""
    number = held_number(scope.substitute(expr))
    if number is None:
        words, hint = held_fault(scope.substitute(expr))
        scope.faults.error(node, f"{what} {words}", hint)
        return None
    if number.imag:
        scope.faults.error(node, f"{what} is not real at the nominal parameters", "the root of a negative number?")
        return None
    return number.real


def held_fault(expr: sp.Expr) -> tuple[str, str]:
    """Message and hint for a number that :func:`held_number` refuses, such as "is 1e+16"; its name comes before it."""
    if expr.free_symbols or not expr.is_finite:
        return "is not finite at the nominal parameters", "division by zero?"
    exponent = int(sp.floor(sp.log(abs(expr), 10).evalf()))
    size = f"{float(expr):.4g}" if exponent < 300 else f"about 1e+{exponent}"
    return f"is {size}", f"numbers are at most {LARGEST_VALUE:g} in size, in SI units"


def held_number(expr: sp.Expr) -> complex | None:
    """The value of an expression without names; None unless it is finite and a robot file can hold it."""
    try:
        number = complex(expr)
    except (TypeError, ValueError, OverflowError, ZeroDivisionError):
        return None
    return number if cmath.isfinite(number) and abs(number) <= LARGEST_VALUE else None


def _units_hint(target: Quantity) -> str:
    return f"units of {target.name}: {', '.join(target.units)}"


def _is_ambiguous(node: ScalarNode, value: ParsedValue, what: str, target: Quantity, unit: Unit, scope: Scope) -> bool:
    """Whether a value without a unit has the wrong dimension or two possible readings; if so, a fault is added."""
    faults = scope.faults
    if value.dimension is not None and not value.open_names and value.dimension != target.dimension:
        message = f"{what} is {target.name}, but this is {quantity_name(value.dimension)}"
        faults.error(node, message, _units_hint(target))
    elif unit.factor == 1 and not unit.pi_power:
        return False
    elif value.open_names and value.dimension != target.dimension:
        for name in sorted(value.open_names):
            message = f"the parameter '{name}' has no unit, and bare values of this file are in {unit.name}"
            number = f"{float(scope.nominal[name]):.12g}" if name in scope.nominal else "..."
            hint = f"declare it with its unit: {name}: {number} {unit.name}, or {name}: {number} one for a plain number"
            faults.error(scope.declared_at[name], message, hint)
    elif value.adds_bare_number:
        number = added_number(node.text) or "..."
        hint = f"declare the number as a parameter with its unit, e.g. offset: {number} {unit.name}"
        faults.error(node, f"{what} adds a bare number to a parameter", hint)
    elif value.dimension is None and value.uses_pi and target.dimension[3]:
        message = f"{what} uses pi, but bare values of this file are in {unit.name}"
        faults.error(node, message, f"write {_in_degrees(value.expr)}{with_unit(node.text, 'rad')}")
    elif value.bare_trigonometry and scope.units.angle == "deg":
        message = f"{what} takes the sine or cosine of a bare number in a file in deg"
        faults.error(node, message, "write its argument in radians with pi, as in cos(pi/6)")
    else:
        return False
    return True


def _confusion(
    node: ScalarNode, value: ParsedValue, number: float, what: str, target: Quantity, unit: Unit
) -> tuple[str, str] | None:
    """Message and hint where a bare number looks as if it were meant in another unit."""
    written = node.text.strip()
    largest = LARGEST_BARE_ANGLE.get(target.name, cmath.inf)
    if unit.name == "rad" and not value.uses_pi and abs(number) > largest:
        meant, literal = with_unit(written, "deg"), with_unit(written, "rad")
        return f"{what} is {written} rad", f"write {meant}; if it is meant in radians, {literal}"
    if target.name == "an angle" and unit.name == "deg":
        quarters = _right_angle(float(value.expr), value.decimals)
        meant, literal = with_unit(written, "rad"), with_unit(written, "deg")
        hint = f"write {meant} or {90 * quarters}; if it is meant in degrees, {literal}"
        return (f"{what} is {written} deg", hint) if quarters else None
    if target.name == "a length" and unit.name == "m" and abs(number) > LARGEST_BARE_LENGTH:
        meant, literal = with_unit(written, "mm"), with_unit(written, "m")
        return f"{what} is {written} m", f"write {meant}; if it is meant in metres, {literal}"
    return None


def _in_degrees(radians: sp.Expr) -> str:
    """Text such as ``"-45 or "`` for -pi/4; empty if the angle is not a short decimal number of degrees."""
    degrees = sp.nsimplify(radians * 180 / sp.pi)
    text = f"{float(degrees):.6g}" if degrees.is_Rational else ""
    return f"{text} or " if text and sp.Rational(text) == degrees else ""


def _right_angle(radians: float, decimals: int | None) -> int:
    """Recognize a right angle written as a decimal: k if ``radians`` is about k*pi/2, to ``decimals`` digits; or 0."""
    multiple = round(radians / (cmath.pi / 2))
    exact = abs(multiple) * cmath.pi / 2
    digits = 6 if decimals is None else decimals
    if digits < 2 or not multiple:
        return 0
    cut = int(exact * 10**digits) / 10**digits if digits < 15 else exact
    meant = min(abs(abs(radians) - value) for value in (round(exact, digits), cut, exact))
    return multiple if meant <= max(SUSPICIOUS_RIGHT_ANGLE if digits >= 5 else 0.0, 1e-12) else 0


def _warn_about_right_angle(node: ScalarNode, value: ParsedValue, angle: sp.Expr, what: str, scope: Scope) -> None:
    multiple = _right_angle(float(angle), value.decimals)
    if not multiple and not 0 < abs(float(angle)) < SUSPICIOUS_ZERO:
        return
    exact = str(sp.Rational(multiple, 2) * sp.pi)
    meant = exact if scope.units.angle == "rad" or not multiple else f"{90 * multiple} deg"
    distance = float(abs(angle - sp.Rational(multiple, 2) * sp.pi))
    message = f"{what} is {node.text.strip()}, which is {exact} only to {distance:.0e} rad"
    scope.faults.warning(node, message, f"write {meant}, so that sines and cosines vanish exactly")


def read_parameters(entries: dict[str, tuple[ScalarNode, Node]], scope: Scope) -> None:
    """Declare ``entries`` in order: exact nominal values in SI, expressions in earlier parameters allowed."""
    scope.undeclared = set(entries)
    for name, (key, item) in entries.items():
        value = parse_scalar(item, f"parameter {name}", scope)
        declared = _parameter_value(name, item, value, scope)
        scope.undeclared.discard(name)
        if declared is None:
            scope.broken.add(name)
            continue
        expr, dimension = declared
        scope.nominal[name] = expr
        scope.names[name] = Name(parameter_symbol(name), dimension)
        scope.declared_at[name] = key
        if dimension is not None:
            scope.parameter_units[name] = value.unit.name if value and value.unit else _si_unit(dimension)


def _si_unit(dimension: Dimension) -> str:
    """The SI unit of a value with this ``dimension``; empty if no known quantity has it."""
    return next((q.si_unit for q in QUANTITIES.values() if q.dimension == dimension), "")


def _parameter_value(
    name: str, item: Node, value: ParsedValue | None, scope: Scope
) -> tuple[sp.Expr, Dimension | None] | None:
    if value is None or not isinstance(item, ScalarNode):
        return None
    zero: Dimension = (Fraction(0),) * 5
    if value.unit is not None:
        expr, dimension = value.expr * value.unit.si(), value.unit.dimension
    elif value.names and not value.open_names:
        if value.adds_bare_number:
            scope.faults.error(
                item, f"parameter {name} adds a bare number to a parameter with a unit", "give it a unit"
            )
            return None
        expr, dimension = value.expr, value.dimension or zero
        if not _si_unit(dimension):
            scope.faults.error(item, f"parameter {name} is {quantity_name(dimension)}", "no unit measures that")
            return None
    else:
        expr, dimension = value.expr, None
    expr = scope.substitute(expr)
    if nominal_number(item, f"parameter {name}", expr, scope) is None:
        return None
    return expr, dimension
