"""The width of the terminal, and text that is folded to it."""

from __future__ import annotations

import os
import shutil
import sys

import click

from rrrgen.base.tables import folded

NARROWEST = 40
"""Fewest columns to which text is folded; a narrower terminal breaks the lines itself."""


def terminal_width() -> int | None:
    """The number of columns to which text is folded: those of the terminal, or COLUMNS; None for files and pipes."""
    if not sys.stdout.isatty() and not os.environ.get("COLUMNS", "").isdigit():
        return None
    return max(shutil.get_terminal_size().columns, NARROWEST)


def say(*texts: str) -> None:
    """Print lines or paragraphs on stdout, folded to the width of the terminal."""
    for text in texts:
        click.echo(folded(text, terminal_width()))
