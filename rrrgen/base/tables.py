"""Printing of tables as text with aligned columns; a table that is too wide is folded, or printed in parts."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterator, Sequence
from itertools import zip_longest

NARROWEST = 8
"""Fewest characters that a column is folded to, unless it is narrower by itself."""

GAP = "  "

CLOSED = re.compile(r"\([^()]{1,22}\)")
"""Short text in parentheses, such as a value in a second unit, which stays on one line where there is room for it."""

MEASURE = re.compile(r"(?<=\d) (?=[A-Za-z])")
"""The blank between a number and its unit, where a line is never broken."""

WORD = re.compile(r" *[^ ]+")
"""What stays on one line: a word, after blanks."""

PART_OF_NAME = re.compile(r" *(?:[^ _]+_*|_+)")
"""The same where names may be broken after an underscore, such as inverse_dynamics."""

MARKS = re.compile(r"\x1b\[[\d;]*m")
"""Colours and bold type of a terminal, which have a length but no width."""

NO_BREAK = "\N{NO-BREAK SPACE}"

Rows = Sequence[Sequence[str]]


def text_table(
    rows: Rows, width: int | None = None, indent: str = "  ", rule: bool = False, right: Collection[int] = ()
) -> list[str]:
    """Print a table as lines: columns as wide as their widest cell, two blanks between them.

    Args:
        rows: cells, the same number in every row.
        width: the longest line in characters. The widest columns are folded at blanks, or else names after underscores,
            until the lines fit. Where that is not enough, the columns are printed in several tables, one below the
            other, each of them with the first column. A number is neither broken nor parted from its unit. None: lines
            of any length.
        indent: stands at the beginning of every line.
        rule: draw a line of dashes below the first row.
        right: the indices of columns that are aligned to the right, such as numbers.
    """
    if not rows:
        return []
    if width is None:
        return _table_lines([[[cell] for cell in row] for row in rows], indent, rule, right)
    room = width - len(indent)
    measures = [[MEASURE.sub(NO_BREAK, cell) for cell in row] for row in rows]
    closed = [[CLOSED.sub(lambda match: match[0].replace(" ", NO_BREAK), cell) for cell in row] for row in measures]
    for cells, unbroken in ((closed, WORD), (measures, WORD), (measures, PART_OF_NAME)):
        widths = _folded_widths(cells, room, unbroken)
        if _total(widths) <= room:
            return _table_lines(_wrap_cells(cells, widths, unbroken), indent, rule, right)
    lines: list[str] = []
    for columns in _parts(_least(closed, WORD), room):
        part = [[row[k] for k in columns] for row in closed]
        aligned = [place for place, k in enumerate(columns) if k in right]
        lines += [""] * bool(lines)
        lines += _table_lines(_wrap_cells(part, _folded_widths(part, room, WORD), WORD), indent, rule, aligned)
    return lines


def fold_lines(text: str, width: int | None) -> str:
    """``text`` with its lines broken at blanks to ``width`` characters, continued two blanks deeper; None: as it is."""
    if width is None:
        return text
    lines = []
    for line in text.split("\n"):
        if len(MARKS.sub("", line)) <= width:
            lines.append(line)
            continue
        deeper = " " * (len(line) - len(line.lstrip()) + 2)
        lines += textwrap.wrap(line, width, subsequent_indent=deeper, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines)


def _natural(rows: Rows) -> list[int]:
    """The width of each column that is not folded."""
    return [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]


def _least(rows: Rows, unbroken: re.Pattern[str]) -> list[int]:
    """The width to which each column may be folded: no column becomes narrower than what stays on one line."""
    longest = [
        max((len(piece.strip(" ")) for cell in column for piece in unbroken.findall(cell)), default=0)
        for column in zip(*rows, strict=True)
    ]
    return [min(natural, max(piece, NARROWEST)) for natural, piece in zip(_natural(rows), longest, strict=True)]


def _total(widths: Sequence[int]) -> int:
    """The length of a line of columns of these widths."""
    return sum(widths) + len(GAP) * (len(widths) - 1)


def _folded_widths(rows: Rows, room: int, unbroken: re.Pattern[str]) -> list[int]:
    """Widths of the columns in lines as long as ``room`` or as words allow; the widest columns are narrowed first."""
    widths, least = _natural(rows), _least(rows, unbroken)
    while (excess := _total(widths) - room) > 0:
        widest = max((k for k in range(len(widths)) if widths[k] > least[k]), key=lambda k: widths[k], default=None)
        if widest is None:
            break
        others = [w for k, w in enumerate(widths) if w < widths[widest] and w > least[k]]
        target = max(least[widest], widths[widest] - excess, max(others, default=0))
        widths[widest] = min(widths[widest] - 1, target)
    return widths


def _parts(least: Sequence[int], room: int) -> list[list[int]]:
    """The columns of each part of a table: as few parts as fit, the widest of them as narrow as possible."""
    fewest = len(_fill_parts(least, room))
    return next(parts for narrow in range(room + 1) if len(parts := _fill_parts(least, narrow)) == fewest)


def _fill_parts(least: Sequence[int], room: int) -> list[list[int]]:
    """Parts filled one after the other with as many columns as there is room for, at least one besides the first."""
    parts = [[0]]
    for k in range(1, len(least)):
        if len(parts[-1]) > 1 and _total([least[i] for i in (*parts[-1], k)]) > room:
            parts.append([0])
        parts[-1].append(k)
    return parts


def _wrap_cells(rows: Rows, widths: Sequence[int], unbroken: re.Pattern[str]) -> list[list[list[str]]]:
    """The lines of every cell of every row, wrapped to the widths of the columns."""
    return [[_cell(cell, width, unbroken) for cell, width in zip(row, widths, strict=True)] for row in rows]


def _cell(cell: str, width: int, unbroken: re.Pattern[str]) -> list[str]:
    """The lines of a cell that is wrapped to ``width``."""
    if len(cell) <= width:
        return [cell]
    lines = [""]
    for piece in unbroken.findall(cell):
        if lines[-1] and len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece if lines[-1] else piece.lstrip(" ")
    return lines


def _table_lines(wrapped: Sequence[list[list[str]]], indent: str, rule: bool, right: Collection[int]) -> list[str]:
    """All lines of a table of wrapped cells, with columns as wide as their longest line."""
    widths = [max(len(line) for cell in column for line in cell) for column in zip(*wrapped, strict=True)]
    first, *others = (_lines(cells, widths, indent, right) for cells in wrapped)
    below = [indent + GAP.join("-" * width for width in widths)] if rule else []
    return [*first, *below, *(line for lines in others for line in lines)]


def _lines(cells: Sequence[Sequence[str]], widths: Sequence[int], indent: str, right: Collection[int]) -> Iterator[str]:
    """The lines of one row, whose cells are wrapped."""
    for line in zip_longest(*cells, fillvalue=""):
        parts = (
            part.rjust(width) if k in right else part.ljust(width)
            for k, (part, width) in enumerate(zip(line, widths, strict=True))
        )
        yield (indent + GAP.join(parts)).replace(NO_BREAK, " ").rstrip()
