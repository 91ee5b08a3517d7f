"""Formulas as LaTeX, plain text or MathML: notation of names, markup of operations, and the walk over expressions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import sympy as sp

from rrrgen.base.errors import BackendError
from rrrgen.derive.closed_forms import decimal_text, with_decimals_inside

# ------------------------------------------------------------------------------------------------------------------
# The mathematical notation of names: ``ddq2`` is q with two dots and the subscript 2, ``Ixx3`` is I_{xx,3}.
#
# Cosines and sines of a sum of joint angles have the short form of the literature, c_{23} = cos(q_2 + q_3), whenever
# the sum has no offset, no factors and single-digit joints; :func:`short_angle` recognises it.
# ------------------------------------------------------------------------------------------------------------------

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip

_JOINT = re.compile(r"(d{0,2})q_?(\d+)")
_INERTIAL = re.compile(r"([IJ]|h|m)([xyz]{1,2})_?(\d+R?)")
_DRIVE = re.compile(r"(I|f)([avco])_?(\d+)")
_NUMBERED = re.compile(r"([A-Za-z]+?)_?(\d+R?)")
_WORDED = re.compile(r"([A-Za-z]+)(\d*)_(\w+)")


@dataclass(frozen=True)
class Notation:
    """``base`` with ``dots`` above and ``subscript`` parts below, separated by commas."""

    base: str
    subscript: tuple[str, ...] = ()
    dots: int = 0


def notation(name: str) -> Notation:
    """Split the name of a symbol into letter, dots and subscript, as in ``ddq2`` -> q, two dots, 2."""
    if match := _JOINT.fullmatch(name):
        return Notation("q", (match[2],), len(match[1]))
    if match := _INERTIAL.fullmatch(name):
        kind, axes, link = match.groups()
        if kind == "m":
            return Notation(f"m{axes}", (link,))
        return Notation(kind, (axes, link))
    if match := _DRIVE.fullmatch(name):
        return Notation(match[1], (match[2], match[3]))
    if match := _NUMBERED.fullmatch(name):
        return Notation(match[1], (match[2],))
    if match := _WORDED.fullmatch(name):
        return Notation(match[1], (match[2], match[3]) if match[2] else (match[3],))
    return Notation(name)


def short_angle(angle: sp.Expr) -> str | None:
    """The subscript that abbreviates a sum of joint angles: ``"23"`` for q2 + q3; None where it would be ambiguous."""
    joints = []
    for term in sp.Add.make_args(angle):
        match = re.fullmatch(r"q([1-9])", str(term)) if term.is_Symbol else None
        if match is None:
            return None
        joints.append(match[1])
    return "".join(sorted(joints))


@dataclass(frozen=True)
class QuantityNotation:
    """The notation of a model function: letter, arguments and meaning."""

    letter: str
    arguments: tuple[str, ...]
    meaning: str


QUANTITIES = {
    "forward_kinematics": QuantityNotation("T", ("q",), "pose of the tip in the base frame"),
    "jacobian": QuantityNotation("J", ("q",), "geometric Jacobian, linear rows first"),
    "kinematics.T": QuantityNotation("T", ("q",), "pose of the tip in the base frame"),
    "kinematics.J": QuantityNotation("J", ("q",), "geometric Jacobian, linear rows first"),
    "mass_matrix": QuantityNotation("M", ("q",), "mass matrix"),
    "coriolis_matrix": QuantityNotation("C", ("q", "dq"), "Coriolis matrix"),
    "coriolis": QuantityNotation("c", ("q", "dq"), "Coriolis and centrifugal torques"),
    "gravity": QuantityNotation("g", ("q",), "gravity torques"),
    "dynamics_terms.M": QuantityNotation("M", ("q",), "mass matrix"),
    "dynamics_terms.c": QuantityNotation("c", ("q", "dq"), "Coriolis and centrifugal torques"),
    "dynamics_terms.g": QuantityNotation("g", ("q",), "gravity torques"),
    "inverse_dynamics": QuantityNotation("tau", ("q", "dq", "ddq"), "joint torques"),
    "inverse_dynamics_derivatives.tau": QuantityNotation("tau", ("q", "dq", "ddq"), "joint torques"),
    "inverse_dynamics_derivatives.dtau_dq": QuantityNotation(
        "D_q", ("q", "dq", "ddq"), "derivatives of the torques by q"
    ),
    "inverse_dynamics_derivatives.dtau_dv": QuantityNotation("D_v", ("q", "dq"), "derivatives of the torques by dq"),
    "inverse_dynamics_derivatives.M": QuantityNotation("M", ("q",), "mass matrix"),
    "regressor": QuantityNotation("Y", ("q", "dq", "ddq"), "regressor of the base parameters"),
    "standard_regressor": QuantityNotation(
        "Y", ("q", "dq", "ddq"), "regressor of the standard parameters, Ixy = -integral of x*y dm"
    ),
    "energy.kinetic": QuantityNotation("T", ("q", "dq"), "kinetic energy"),
    "energy.potential": QuantityNotation("U", ("q",), "potential energy"),
    "friction": QuantityNotation("tau_f", ("dq",), "friction torques"),
    "base_parameters": QuantityNotation("beta", (), "base parameters"),
}


def quantity(name: str) -> QuantityNotation:
    """The notation of a model function; an unknown name is its own letter."""
    return QUANTITIES.get(name, QuantityNotation(name, (), name.replace("_", " ")))


# ------------------------------------------------------------------------------------------------------------------
# LaTeX and plain text as markup languages for formulas.
# ------------------------------------------------------------------------------------------------------------------

_LATEX_GREEK = {"epsilon": r"\varepsilon", "phi": r"\varphi"}
_KNOWN = frozenset({"sin", "cos", "tan", "exp", "tanh"})


class LatexMarkup:
    """Formulas for a display in amsmath."""

    def symbol(self, parts: Notation) -> str:
        """The markup of a letter with dots and subscript."""
        base = self._letter(parts.base)
        if parts.dots:
            base = rf"\{'d' * parts.dots}ot{{{base}}}"
        if not parts.subscript:
            return base
        return f"{base}_{{{','.join(self._subscript(part) for part in parts.subscript)}}}"

    def _letter(self, name: str) -> str:
        if name in GREEK:
            return _LATEX_GREEK.get(name, rf"\{name}")
        return name if len(name) == 1 else rf"\mathit{{{self._escape(name)}}}"

    def _subscript(self, part: str) -> str:
        return part if part.removesuffix("R").isdigit() or len(part) <= 2 else rf"\mathrm{{{self._escape(part)}}}"

    def _escape(self, text: str) -> str:
        return text.replace("_", r"\_")

    def number(self, text: str) -> str:
        """The markup of an unsigned number."""
        mantissa, _, exponent = text.partition("e")
        return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else text

    def total(self, terms: Sequence[tuple[bool, str]]) -> str:
        """The markup of a sum."""
        return join_terms(terms)

    def product(self, factors: Sequence[str]) -> str:
        r"""A product: factors separated by spaces, with \cdot before a number."""
        text = factors[0]
        for factor in factors[1:]:
            text += (r" \cdot " if factor[0].isdigit() else " ") + factor
        return text

    def fraction(self, numerator: str, denominator: str) -> str:
        """The markup of a quotient."""
        return rf"\frac{{{numerator}}}{{{denominator}}}"

    def power(self, base: str, exponent: str) -> str:
        """The markup of a power."""
        return f"{base}^{{{exponent}}}"

    def root(self, argument: str) -> str:
        """The markup of a square root."""
        return rf"\sqrt{{{argument}}}"

    def function(self, name: str, argument: str, exponent: str) -> str:
        """The markup of ``name(argument)``; a non-empty exponent stands between name and argument."""
        command = rf"\{name}" if name in _KNOWN else rf"\operatorname{{{name}}}"
        raised = f"^{{{exponent}}}" if exponent else ""
        return rf"{command}{raised}\left({argument}\right)"

    def argument_list(self, arguments: Sequence[str]) -> str:
        """The markup of the arguments of a function, separated by commas."""
        return ", ".join(arguments)

    def group(self, content: str) -> str:
        """The markup of an expression in parentheses."""
        return rf"\left({content}\right)"


class TextMarkup:
    """Formulas in plain text that a terminal shows and a program could read: ``ddq1*c23^2``."""

    def symbol(self, parts: Notation) -> str:
        """The name of a symbol as one word."""
        last = parts.subscript[-1] if parts.subscript else ""
        word = len(last) > 1 or len(parts.subscript) > 1
        joint = "_" if word and not last.removesuffix("R").isdigit() else ""
        return "d" * parts.dots + parts.base + "".join(parts.subscript[:-1]) + joint + last

    def number(self, text: str) -> str:
        """The markup of an unsigned number."""
        return text

    def total(self, terms: Sequence[tuple[bool, str]]) -> str:
        """The markup of a sum."""
        return join_terms(terms)

    def product(self, factors: Sequence[str]) -> str:
        """The markup of a product."""
        return "*".join(factors)

    def fraction(self, numerator: str, denominator: str) -> str:
        """The markup of a quotient."""
        return f"{_enclose(numerator, ' ')}/{_enclose(denominator, ' */')}"

    def power(self, base: str, exponent: str) -> str:
        """The markup of a power."""
        return f"{base}^{_enclose(exponent, ' */-')}"

    def root(self, argument: str) -> str:
        """The markup of a square root."""
        return f"sqrt({argument})"

    def function(self, name: str, argument: str, exponent: str) -> str:
        """The text of ``name(argument)``, followed by ``^exponent`` unless that is empty."""
        return f"{name}({argument})" + (f"^{_enclose(exponent, ' */-')}" if exponent else "")

    def argument_list(self, arguments: Sequence[str]) -> str:
        """The markup of the arguments of a function, separated by commas."""
        return ", ".join(arguments)

    def group(self, content: str) -> str:
        """The markup of an expression in parentheses."""
        return f"({content})"


def join_terms(terms: Sequence[tuple[bool, str]]) -> str:
    """The sum of signed terms, such as ``a - b + c``."""
    text = ""
    for negative, term in terms:
        if text:
            text += " - " if negative else " + "
        elif negative:
            text += "-"
        text += term
    return text or "0"


def _enclose(text: str, separators: str) -> str:
    """Put ``text`` in parentheses if one of the ``separators`` occurs in it outside of parentheses."""
    depth = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if depth == 0 and character in separators:
            return f"({text})"
    return text


# ------------------------------------------------------------------------------------------------------------------
# Writes an exact expression as LaTeX, plain text or MathML: visits its parts and joins the markup of each.
# ------------------------------------------------------------------------------------------------------------------

_SUM, _PRODUCT, _POWER, _ATOM = range(4)

_ARGUMENTS = dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "sign", "Abs", "exp", "tanh"), 1) | {
    "atan2": 2
}
"""Number of arguments of every function that has a notation."""


class Markup(Protocol):
    """The interface of a markup language: one method per kind of formula, given the text of its parts."""

    def symbol(self, parts: Notation) -> str:
        """The markup of a letter with dots and subscript."""
        ...

    def number(self, text: str) -> str:
        """The markup of an unsigned number."""
        ...

    def total(self, terms: Sequence[tuple[bool, str]]) -> str:
        """The markup of a sum, given its terms as (whether negative, text without sign)."""
        ...

    def product(self, factors: Sequence[str]) -> str:
        """The markup of a product."""
        ...

    def fraction(self, numerator: str, denominator: str) -> str:
        """The markup of a quotient."""
        ...

    def power(self, base: str, exponent: str) -> str:
        """The markup of a power."""
        ...

    def root(self, argument: str) -> str:
        """The markup of a square root."""
        ...

    def function(self, name: str, argument: str, exponent: str) -> str:
        """The markup of ``name(argument)``, to the power ``exponent`` unless that is empty."""
        ...

    def argument_list(self, arguments: Sequence[str]) -> str:
        """The markup of the arguments of a function, separated by commas."""
        ...

    def group(self, content: str) -> str:
        """The markup of an expression in parentheses."""
        ...


def _by_parameters(term: sp.Expr) -> list[tuple[str, int]]:
    """The sort key of a term: groups terms with the same parameters, with p9 before p10."""
    names = [str(symbol) for symbol in term.free_symbols]
    numbered = [re.fullmatch(r"(.*?)(\d*)", name) for name in names if not re.fullmatch(r"d{0,2}q\d+", name)]
    return sorted(((match[1], int(match[2] or 0)) for match in numbered if match), reverse=True)


class Walk:
    """Writes expressions in one markup; with ``short_trig``, cos(q2 + q3) becomes c_{23} and its sine s_{23}."""

    def __init__(self, markup: Markup, short_trig: bool = True) -> None:
        self.markup = markup
        self.short_trig = short_trig

    def write(self, expression: sp.Expr) -> str:
        """The markup of ``expression``. Raises :class:`BackendError` for what a closed form cannot contain."""
        return self._write(expression, _SUM)

    def terms(self, expression: sp.Expr) -> list[tuple[bool, str]]:
        """The terms of a sum in printing order, each as (whether negative, text without sign)."""
        return [self._split_sign(term) for term in self.sort_terms(expression)]

    def sort_terms(self, expression: sp.Expr) -> list[sp.Expr]:
        """The terms of a sum in printing order."""
        return sorted(expression.as_ordered_terms(), key=_by_parameters)

    def _split_sign(self, term: sp.Expr) -> tuple[bool, str]:
        negative = bool(term.could_extract_minus_sign()) and not term.is_Add
        return negative, self._write(-term if negative else term, _PRODUCT)

    def _write(self, expression: sp.Expr, needed: int) -> str:
        text, strength = self._node(expression)
        return text if strength >= needed else self.markup.group(text)

    def _node(self, e: sp.Expr) -> tuple[str, int]:
        markup = self.markup
        if e.is_Symbol:
            return markup.symbol(notation(str(e))), _ATOM
        if e is sp.pi:
            return markup.symbol(Notation("pi")), _ATOM
        if e.is_Add:
            return markup.total(self.terms(e)), _SUM
        if e.is_number and (e.is_Rational or e.is_Float):
            return self._number(e)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        if e.is_Function:
            return self._function(e, ""), _ATOM
        raise BackendError(f"no notation for {type(e).__name__} in a closed form")

    def _number(self, value: sp.Expr) -> tuple[str, int]:
        if value < 0:
            return self.markup.total([(True, self._write(-value, _PRODUCT))]), _SUM
        text = f"{float(value):.6g}" if value.is_Float else decimal_text(value)
        if text is not None:
            return self.markup.number(text), _ATOM
        return self.markup.fraction(self.markup.number(str(value.p)), self.markup.number(str(value.q))), _PRODUCT

    def _product(self, e: sp.Expr) -> tuple[str, int]:
        if e.could_extract_minus_sign():
            return self.markup.total([(True, self._write(-e, _PRODUCT))]), _SUM
        e = with_decimals_inside(e)
        if not e.is_Mul:
            return self._node(e)
        above, below = [], []
        for factor in e.as_ordered_factors():
            if factor.is_Rational and decimal_text(factor) is not None:
                above += [factor] if factor != 1 else []
            elif factor.is_Rational:
                above += [sp.Integer(factor.p)] if factor.p != 1 else []
                below += [sp.Integer(factor.q)] if factor.q != 1 else []
            elif factor.is_Pow and factor.exp.is_number and factor.exp.is_negative:
                below.append(factor.base ** (-factor.exp))
            else:
                above.append(factor)
        if not below:
            return self._times(above), _PRODUCT
        return self.markup.fraction(self._times(above, alone=True), self._times(below, alone=True)), _PRODUCT

    def _times(self, factors: Sequence[sp.Expr], alone: bool = False) -> str:
        if len(factors) == 1 and alone:
            return self._write(factors[0], _SUM)
        if not factors:
            return self.markup.number("1")
        return self.markup.product([self._write(factor, _POWER) for factor in factors])

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> tuple[str, int]:
        if exponent == sp.Rational(1, 2):
            return self.markup.root(self._write(base, _SUM)), _ATOM
        if exponent.is_number and exponent.is_negative:
            return self.markup.fraction(self.markup.number("1"), self._write(base**-exponent, _SUM)), _PRODUCT
        raised = self._write(exponent, _SUM)
        if base.is_Function:
            return self._function(base, raised), _POWER
        return self.markup.power(self._write(base, _ATOM), raised), _POWER

    def _function(self, e: sp.Expr, exponent: str) -> str:
        name = e.func.__name__
        if len(e.args) != _ARGUMENTS.get(name, 0):
            raise BackendError(f"no notation for the function {name} in a closed form")
        arguments = [sp.expand(argument) for argument in e.args]
        short = short_angle(arguments[0]) if self.short_trig and name in ("sin", "cos") else None
        if short is None:
            text = self.markup.argument_list([self.write(argument) for argument in arguments])
            return self.markup.function({"sign": "sgn", "Abs": "abs"}.get(name, name), text, exponent)
        letter = self.markup.symbol(Notation(name[0], (short,)))
        return self.markup.power(letter, exponent) if exponent else letter
