"""Text for comments in emitted files: escaped, wrapped, aligned in columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

WIDTH = 112


def plain(text: str) -> str:
    """Make ``text`` safe for a comment: on one line, without comment marks, line continuations and trigraphs."""
    flat = " ".join(text.split())
    printable = "".join(c if c.isprintable() else "?" for c in flat)
    return printable.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").rstrip("\\")


def mathematics(expression: object) -> str:
    """Print an expression for a comment, with ^ for powers, since ** is no operator of C or Rust."""
    return plain(str(expression).replace("**", "^"))


def wrapped(text: str) -> list[str]:
    """Break ``text`` into lines of a comment."""
    return textwrap.wrap(plain(text), WIDTH, break_long_words=False)


def columns(rows: Iterable[Sequence[str]], indent: str = "  ", gap: str = "  ") -> list[str]:
    """Format ``rows`` as lines of left-aligned columns without trailing blanks; a long last column is wrapped."""
    table = [[plain(cell) for cell in row] for row in rows]
    if not table:
        return []
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    lines = []
    for row in table:
        head = indent + "".join(cell.ljust(width) + gap for cell, width in zip(row[:-1], widths, strict=False))
        last = textwrap.wrap(row[-1], max(30, WIDTH - len(head)), break_long_words=False) or [""]
        lines += [(head + last[0]).rstrip(), *(" " * len(head) + more for more in last[1:])]
    return lines
