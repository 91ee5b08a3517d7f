"""LaTeX and plain text as markup languages for formulas."""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.emit.latex.notation import GREEK, Notation

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
        return name if len(name) == 1 else rf"\mathit{{{self._escaped(name)}}}"

    def _subscript(self, part: str) -> str:
        return part if part.removesuffix("R").isdigit() or len(part) <= 2 else rf"\mathrm{{{self._escaped(part)}}}"

    def _escaped(self, text: str) -> str:
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

    def listed(self, arguments: Sequence[str]) -> str:
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
        return f"{_enclosed(numerator, ' ')}/{_enclosed(denominator, ' */')}"

    def power(self, base: str, exponent: str) -> str:
        """The markup of a power."""
        return f"{base}^{_enclosed(exponent, ' */-')}"

    def root(self, argument: str) -> str:
        """The markup of a square root."""
        return f"sqrt({argument})"

    def function(self, name: str, argument: str, exponent: str) -> str:
        """The text of ``name(argument)``, followed by ``^exponent`` unless that is empty."""
        return f"{name}({argument})" + (f"^{_enclosed(exponent, ' */-')}" if exponent else "")

    def listed(self, arguments: Sequence[str]) -> str:
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


def _enclosed(text: str, separators: str) -> str:
    """Put ``text`` in parentheses if one of the ``separators`` occurs in it outside of parentheses."""
    depth = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if depth == 0 and character in separators:
            return f"({text})"
    return text
