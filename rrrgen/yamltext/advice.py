"""What to write instead: every piece of advice is made from the text that was written, sign and unit included."""

from __future__ import annotations

import re

from rrrgen.yamltext.document import Mapping, Node, Scalar

_WITH_COMMA = re.compile(r"(?<![\w.,])\d[\d.,]*,\d[\d.,]*(?![\w.,]*[A-Za-z_]\()")
_PLAIN = re.compile(r"[+-]?\s*(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?\d+")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}(\s*[A-Za-zµμ°].*)?")
_DIGITS = re.compile(r"\d+([eE][+-]?\d+)?(\s*[A-Za-zµμ°][\w/^²]*)?")


def with_point(text: str) -> str:
    """``text`` with decimal points: ``-0,35 mm`` -> ``-0.35 mm``, ``1.234,5`` -> ``1234.5``, ``1,234,5`` -> ``12345``.

    Of several separators in one number the last is the decimal sign, unless they are all the same: then they group
    thousands.
    """

    def rewritten(match: re.Match[str]) -> str:
        number = match.group()
        if number.count(",") > 1 and "." not in number:
            return number.replace(",", "")
        last = max(number.rfind(","), number.rfind("."))
        return re.sub("[.,]", "", number[:last]) + "." + number[last + 1 :]

    return _WITH_COMMA.sub(rewritten, text.strip())


def comma_advice(number: str) -> str:
    """What to write for ``number``, which has its decimal point already; three digits behind it may be thousands."""
    advice = f"decimal comma? write {number}"
    if _THOUSANDS.fullmatch(number):
        advice += f"; if the comma groups thousands, {number.replace('.', '')}"
    return advice


def with_unit(text: str, unit: str) -> str:
    """``text`` followed by ``unit``, in parentheses where it is more than one number."""
    text = text.strip()
    return f"{text} {unit}" if _PLAIN.fullmatch(text) else f"({text}) {unit}"


def without_leading_zeros(text: str) -> str:
    """``-010`` -> ``-10``."""
    return re.sub(r"(?<![\w.])0+(?=\d)", "", text.strip())


def added_number(text: str) -> str | None:
    """The bare number that a sum adds to something else, ``30`` of ``a2 + 30``; None where it is not so simple."""
    terms = re.findall(r"(?:^|[+-])\s*([\w.*/()]+)\s*(?=[+-]|$)", text.strip())
    numbers = [term for term in terms if _PLAIN.fullmatch(term)]
    return numbers[0] if len(numbers) == 1 else None


def number_cut_by_comma(whole: Node, rest: Node) -> str | None:
    """``-0.010`` of ``-0`` and ``010``: two neighbours in a list or mapping that may be one number with a comma."""
    if not (isinstance(whole, Scalar) and isinstance(rest, Scalar)):
        return None
    if not _WHOLE.fullmatch(whole.text.strip()) or not _DIGITS.fullmatch(rest.text.strip()):
        return None
    return f"{whole.text.strip()}.{rest.text.strip()}"


def key_cut_by_comma(mapping: Mapping, place: int) -> str | None:
    """The number that the key at ``place`` is the end of, as ``{a: 2,5}`` reads as ``{a: 2, 5: }``; else None."""
    key, value = mapping.entries[place]
    if place == 0 or not (isinstance(value, Scalar) and value.is_null):
        return None
    return number_cut_by_comma(mapping.entries[place - 1][1], key)
