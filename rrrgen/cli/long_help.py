"""Help of a command with many options: the usual ones by ``--help``, all of them by ``--help-all``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

ALL = "rrrgen.cli.long_help"
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
