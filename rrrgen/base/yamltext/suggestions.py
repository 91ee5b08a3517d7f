"""Suggested corrections of misspelt numbers; each is built from the text of the file, sign and unit included."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping

from rrrgen.base.yamltext.document import MappingNode, Node, ScalarNode

TYPOGRAPHIC = {
    **dict.fromkeys("\N{MINUS SIGN}\N{HYPHEN}\N{NON-BREAKING HYPHEN}\N{EN DASH}\N{EM DASH}", ("minus sign", "-")),
    **dict.fromkeys("\N{MULTIPLICATION SIGN}\N{DOT OPERATOR}\N{MIDDLE DOT}\N{ASTERISK OPERATOR}", ("times sign", "*")),
    **dict.fromkeys("\N{DIVISION SIGN}\N{DIVISION SLASH}\N{FRACTION SLASH}", ("division sign", "/")),
    **dict.fromkeys("\N{NO-BREAK SPACE}\N{THIN SPACE}\N{NARROW NO-BREAK SPACE}", ("blank", " ")),
}
"""Characters of word processors and web pages: what each is called, and the plain character for it."""

_PI = "\N{GREEK SMALL LETTER PI}\N{MATHEMATICAL ITALIC SMALL PI}"

_WITH_COMMA = re.compile(r"(?<![\w.,])\d[\d.,]*,\d[\d.,]*(?![\w.,]*[A-Za-z_]\()")
_PLAIN = re.compile(r"[+-]?\s*(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?\d+")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}(\s*[A-Za-zµμ°].*)?")
_DIGITS = re.compile(r"\d+([eE][+-]?\d+)?(\s*[A-Za-zµμ°][\w/^²]*)?")


def with_point(text: str) -> str:
    """Rewrite decimal commas as points: ``-0,35 mm`` -> ``-0.35 mm``, ``1.234,5`` -> ``1234.5``, ``1,234,5`` ->
    ``12345``.

    If a number has several separators, the last one is the decimal sign; several commas without a point are taken to
    group thousands.
    """

    def rewritten(match: re.Match[str]) -> str:
        number = match.group()
        if number.count(",") > 1 and "." not in number:
            return number.replace(",", "")
        last = max(number.rfind(","), number.rfind("."))
        return re.sub("[.,]", "", number[:last]) + "." + number[last + 1 :]

    return _WITH_COMMA.sub(rewritten, text.strip())


def comma_advice(number: str) -> str:
    """Hint for a number with a comma; ``number`` is the number already written with a point.

    Where exactly three digits follow the point, the hint also offers the reading as thousands: ``1.234`` or ``1234``.
    """
    advice = f"decimal comma? write {number}"
    if _THOUSANDS.fullmatch(number):
        advice += f"; if the comma groups thousands, {number.replace('.', '')}"
    return advice


def plain_advice(character: str, text: str) -> str:
    """Hint for a typographic ``character`` in ``text``, with the text as it must be written; empty for any other."""
    plain = "".join("pi" if c in _PI else TYPOGRAPHIC[c][1] if c in TYPOGRAPHIC else c for c in text.strip())
    if character in _PI:
        return f"'{character}' is a Greek letter; write {plain}"
    if character in TYPOGRAPHIC:
        return f"'{character}' is a typographic {TYPOGRAPHIC[character][0]}; write {plain}"
    return ""


def with_unit(text: str, unit: str) -> str:
    """Append ``unit`` to ``text``; an expression is put in parentheses first: ``a + 2`` -> ``(a + 2) mm``."""
    text = text.strip()
    return f"{text} {unit}" if _PLAIN.fullmatch(text) else f"({text}) {unit}"


def without_leading_zeros(text: str) -> str:
    """Remove leading zeros from every number in ``text``: ``-010`` -> ``-10``."""
    return re.sub(r"(?<![\w.])0+(?=\d)", "", text.strip())


def added_number(text: str) -> str | None:
    """The only plain number among the terms of a sum, ``30`` in ``a2 + 30``; None if there is none or more than one."""
    terms = re.findall(r"(?:^|[+-])\s*([\w.*/()]+)\s*(?=[+-]|$)", text.strip())
    numbers = [term for term in terms if _PLAIN.fullmatch(term)]
    return numbers[0] if len(numbers) == 1 else None


def number_cut_by_comma(whole: Node, rest: Node) -> str | None:
    """Rejoin two neighbouring entries that YAML split at a decimal comma: ``-0`` and ``010`` -> ``-0.010``.

    ``whole`` and ``rest`` are neighbours in a flow list or mapping; returns None unless both look like halves of one
    number.
    """
    if not (isinstance(whole, ScalarNode) and isinstance(rest, ScalarNode)):
        return None
    if not _WHOLE.fullmatch(whole.text.strip()) or not _DIGITS.fullmatch(rest.text.strip()):
        return None
    return f"{whole.text.strip()}.{rest.text.strip()}"


def key_cut_by_comma(mapping: MappingNode, place: int) -> str | None:
    """The number whose decimals YAML read as the key at index ``place``: ``{a: 2,5}`` is read as ``{a: 2, 5: }``.

    Returns ``2.5`` in that example, None for an ordinary key.
    """
    key, value = mapping.entries[place]
    if place == 0 or not (isinstance(value, ScalarNode) and value.is_null):
        return None
    return number_cut_by_comma(mapping.entries[place - 1][1], key)


# ------------------------------------------------------------------------------------------------------------------
# Spelling suggestions: the allowed word nearest to a misspelt one.
# ------------------------------------------------------------------------------------------------------------------


def did_you_mean(word: str, allowed: Iterable[str], also: Mapping[str, str] | None = None) -> str:
    """The sentence ``did you mean 'x'?`` for the allowed word nearest to ``word``; empty if none is near.

    ``also`` maps synonyms from other tools to allowed words, for example ``twist`` to ``alpha``.
    """
    meant = nearest(word, allowed, also)
    return f"did you mean '{meant}'?" if meant else ""


def nearest(word: str, allowed: Iterable[str], also: Mapping[str, str] | None = None) -> str | None:
    """The allowed word nearest to ``word`` in spelling or by the synonyms ``also``; None if none is near."""
    known = {key.lower(): value for key, value in (also or {}).items()}
    known |= {key.lower(): key for key in allowed}
    close = difflib.get_close_matches(word[:60].lower(), known, n=1, cutoff=0.6)
    return known[close[0]] if close else None
