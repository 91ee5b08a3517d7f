"""Printing of tables as text with aligned columns; cells are folded where a line would be too long."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

NARROWEST = 8
"""Fewest characters that a column is folded to, unless it is narrower by itself."""

GAP = "  "


def text_table(
    rows: Sequence[Sequence[str]], width: int | None = None, indent: str = "  ", rule: bool = False
) -> list[str]:
    """Print a table as lines: columns as wide as their widest cell, two blanks between them.

    Args:
        rows: cells, the same number in every row.
        width: the longest line in characters; the widest columns are folded at blanks until the lines fit, as far as
            their longest words allow. None: lines of any length.
        indent: stands at the beginning of every line.
        rule: draw a line of dashes below the first row.
    """
    if not rows:
        return []
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    if width is not None:
        widths = _folded(rows, widths, width - len(indent) - len(GAP) * (len(widths) - 1))
    first, *others = ([indent + line for line in _lines(row, widths)] for row in rows)
    below = [indent + GAP.join("-" * each for each in widths)] if rule else []
    return [*first, *below, *(line for lines in others for line in lines)]


def folded(text: str, width: int | None) -> str:
    """``text`` with its lines broken at blanks to ``width`` characters, continued two blanks deeper; None: as it is."""
    if width is None:
        return text
    lines = []
    for line in text.splitlines():
        deeper = " " * (len(line) - len(line.lstrip()) + 2)
        lines += textwrap.wrap(
            line, width, subsequent_indent=deeper, break_long_words=False, break_on_hyphens=False
        ) or [""]
    return "\n".join(lines)


def _folded(rows: Sequence[Sequence[str]], widths: list[int], room: int) -> list[int]:
    """Widths that sum up to ``room``, the widest columns narrowed first; no column narrower than its longest word."""
    widths = list(widths)
    columns = [[len(word) for cell in column for word in cell.split()] for column in zip(*rows, strict=True)]
    least = [min(natural, max(words, default=0)) for natural, words in zip(widths, columns, strict=True)]
    least = [min(natural, max(longest, NARROWEST)) for natural, longest in zip(widths, least, strict=True)]
    while sum(widths) > room:
        widest = max((k for k in range(len(widths)) if widths[k] > least[k]), key=lambda k: widths[k], default=None)
        if widest is None:
            break
        others = [w for k, w in enumerate(widths) if w < widths[widest] and w > least[k]]
        target = max(least[widest], widths[widest] - (sum(widths) - room), max(others, default=0))
        widths[widest] = min(widths[widest] - 1, target)
    return widths


def _lines(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """The lines of one row; cells that are longer than their column continue below."""
    cells = [_wrapped(cell, width) for cell, width in zip(row, widths, strict=True)]
    height = max(len(lines) for lines in cells)
    padded = [[*lines, *[""] * (height - len(lines))] for lines in cells]
    return [
        GAP.join(line.ljust(width) for line, width in zip(lines, widths, strict=True)).rstrip()
        for lines in zip(*padded, strict=True)
    ]


def _wrapped(cell: str, width: int) -> list[str]:
    if len(cell) <= width:
        return [cell]
    return textwrap.wrap(cell, width, break_long_words=False, break_on_hyphens=False)
