"""What commands show: the width of the terminal, text folded to it, colours, progress, and long help."""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click

from rrrgen.base.errors import Fault
from rrrgen.base.parallel import Tell
from rrrgen.base.tables import fold_lines

# ------------------------------------------------------------------------------------------------------------------
# Colours of faults, verdicts and headings on a terminal; a pipe or a file gets the same text without colours.
#
# ``NO_COLOR`` turns colour off, ``FORCE_COLOR`` turns it on for pipes too, and a terminal that calls itself dumb gets
# none. Texts are laid out before they are coloured, since the marks of a terminal have a length but no width.
# ------------------------------------------------------------------------------------------------------------------

SEVERITY = {"error": "red", "warning": "yellow"}


def preference() -> bool | None:
    """Whether the user wants colour; None: on every stream that is a terminal.

    An empty variable counts as not set. ``NO_COLOR`` wins over ``FORCE_COLOR``.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return False if os.environ.get("TERM") == "dumb" else None


def say_error(text: str) -> None:
    """Print an error on stderr; usable where no command is running any more, and click has forgotten the preference."""
    click.echo(text, err=True, color=preference())


def fault_text(fault: Fault) -> str:
    """The text of a fault, with its severity and the mark below its place in colour."""
    head, *others = str(fault).split("\n")
    colour = SEVERITY[fault.severity]
    said = f": {fault.severity}: "
    if fault.file and said in head:
        place, _, message = head.partition(said)
        head = f"{click.style(place, bold=True)}: {click.style(fault.severity + ':', fg=colour, bold=True)} {message}"
    if fault.source_line:
        others[1] = click.style(others[1], fg=colour, bold=True)
    return "\n".join([head, *others])


def usage_text(error: click.ClickException) -> str:
    """The text that click prints for wrong usage, with its "Error:" in colour."""
    shown = io.StringIO()
    error.show(file=shown)
    return shown.getvalue().rstrip("\n").replace("Error:", mark_failed("Error:"), 1)


def mark_passed(text: str) -> str:
    """Colour ``text`` green, as a passed check."""
    return click.style(text, fg="green")


def mark_failed(text: str) -> str:
    """Colour ``text`` red, as a failed check."""
    return click.style(text, fg="red", bold=True)


def doubtful(text: str) -> str:
    """Colour ``text`` yellow, the colour of results that the user should check."""
    return click.style(text, fg="yellow")


def verdict(text: str, ok: bool) -> str:
    """Colour ``text`` as a passed (``ok``) or failed check."""
    return mark_passed(text) if ok else mark_failed(text)


def with_headings(text: str) -> str:
    """Set the headings of ``text`` in bold: lines without indentation that are followed by indented ones."""
    return re.sub(r"^(?! )(.+)(?=\n )", lambda line: click.style(line[1], bold=True), text, flags=re.M)


def with_warning(text: str) -> str:
    """Colour the word "warning:" at the beginning of ``text``."""
    return re.sub("^warning:", lambda word: doubtful(word[0]), text)


def with_failures(text: str) -> str:
    """Colour every word FAIL in ``text`` red."""
    return re.sub(r"\bFAIL\b", lambda word: mark_failed(word[0]), text)


class Formatter(click.HelpFormatter):
    """Help texts with their headings in bold."""

    def write_heading(self, heading: str) -> None:
        """Write the heading of a section."""
        self.write(f"{'':>{self.current_indent}}{click.style(heading + ':', bold=True)}\n")


class Context(click.Context):
    """The context of every command: its help has headings in bold."""

    formatter_class = Formatter


# ------------------------------------------------------------------------------------------------------------------
# Progress of long computations: a bar on a terminal, nothing if stderr is redirected.
# ------------------------------------------------------------------------------------------------------------------

BAR = 30
"""Characters of a full bar."""

CLEAR = "\r\x1b[2K"
"""Empty the line of the cursor, which goes to its beginning."""


@contextmanager
def progress_bar() -> Iterator[Tell]:
    """Draw a progress bar on stderr; yields the function ``tell(done, total, message)`` that updates it.

    ``total`` is 0 where the end is not known. No thread draws it: a process with several of them cannot fork safely.
    """
    if not sys.stderr.isatty():
        yield lambda done, total, message: None
        return
    start = time.monotonic()

    def tell(done: int, total: int, message: str) -> None:
        full = round(BAR * done / total) if total else 0
        part = f"  {'#' * full:.<{BAR}} {done / total:4.0%}" if total else ""
        line = f"{message}{part}  {time.monotonic() - start:.0f} s"
        click.echo(CLEAR + line[: shutil.get_terminal_size().columns - 1], err=True, nl=False)

    try:
        yield tell
    finally:
        click.echo(CLEAR, err=True, nl=False)


@contextmanager
def working(message: str) -> Iterator[None]:
    """Show on a terminal that ``message`` is being done, for work of some seconds whose end is not known."""
    with progress_bar() as tell:
        tell(0, 0, message)
        yield


# ------------------------------------------------------------------------------------------------------------------
# The width of the terminal, and text that is folded to it
# ------------------------------------------------------------------------------------------------------------------

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
        click.echo(fold_lines(text, terminal_width()))


# ------------------------------------------------------------------------------------------------------------------
# Help of a command with many options: the usual ones by ``--help``, all of them by ``--help-all``.
# ------------------------------------------------------------------------------------------------------------------

ALL = "rrrgen.cli.terminal"
"""Key of the context's ``meta`` that is set while ``--help-all`` is printed."""


class LongHelpCommand(click.Command):
    """A command whose ``--help`` fits one screen.

    ``usual`` names the parameters that ``--help`` describes; the other options are listed by their flags alone.
    ``words`` are the heading and the values, with their meanings, of an option that takes a list of words.
    """

    def __init__(
        self, *args: Any, usual: tuple[str, ...], words: tuple[str, Mapping[str, str]] | None = None, **settings: Any
    ) -> None:
        super().__init__(*args, **settings)
        self.usual = usual
        self.words = words
        self.params.append(
            click.Option(
                ["--help-all"],
                is_flag=True,
                expose_value=False,
                is_eager=True,
                callback=_print_everything,
                help="Describe every option.",
            )
        )

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the usual options, or all, and the words of the option that takes some."""
        options = [option for option in self.get_params(ctx) if isinstance(option, click.Option)]
        shown = [option for option in options if self._is_usual(option) or ctx.meta.get(ALL)]
        with formatter.section("Options"):
            formatter.write_dl([record for option in shown if (record := option.get_help_record(ctx))])
        if self.words is not None:
            with formatter.section(self.words[0]):
                formatter.write_dl(list(self.words[1].items()))
        if len(shown) < len(options):
            flags = (max(option.opts, key=len) for option in options if option not in shown)
            with formatter.section("Further options, described by --help-all"):
                formatter.write_text(", ".join(flags))

    def _is_usual(self, option: click.Option) -> bool:
        return option.name in self.usual or "--help" in option.opts or "--help-all" in option.opts


def _print_everything(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        ctx.meta[ALL] = True
        click.echo(ctx.get_help())
        ctx.exit()
