"""Entry point of the command line: finds the command and turns errors into messages and exit codes."""

from __future__ import annotations

import difflib
import gc
import io
import os
import signal
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from rrrgen.base.errors import (
    InputError,
    InternalError,
    RrrgenError,
    StorageError,
    missing_extra,
    options_written,
    storage_error,
)
from rrrgen.base.version import VERSION
from rrrgen.cli.arguments import flag_here
from rrrgen.cli.commands import COMMANDS, FURTHER, GROUPS, RENAMED, further_commands, load_command, load_further_command
from rrrgen.cli.terminal import Context, fault_text, mark_failed, preference, say_error, usage_text

INTERRUPTED = 130

FIRST = """\b
ROBOT: a file, a bundled name, or -. Example: rrrgen generate rrr -o model
Also: export, certify, robots, playground, schema, doctor; all: --help-all.
"""

EVERYTHING = """\b
Examples:
  rrrgen generate rrr -o rrr_model     C and CasADi code of a bundled robot
  rrrgen verify rrr                    compare it with independent dynamics
  rrrgen new elbow3                    start a robot file of your own

\b
Exit codes: 0 ok, 1 a check failed, 2 usage, 3 bad input file, 4 no closed
form or not identifiable, 5 toolchain or extra missing, disk or memory full,
output not writable, 70 fault of rrrgen, 130 interrupted.

\b
Equation numbers such as (14.23) are those of D. Kostic, B. de Jager,
M. Steinbuch, Modeling and Identification for Robot Motion Control, chapter 14
of the Robotics and Automation Handbook, CRC Press 2005.

\b
Shell completion:
  bash:  eval "$(_RRRGEN_COMPLETE=bash_source rrrgen)"      (in ~/.bashrc)
  zsh:   eval "$(_RRRGEN_COMPLETE=zsh_source rrrgen)"       (in ~/.zshrc)
  fish:  _RRRGEN_COMPLETE=fish_source rrrgen | source
"""


class LazyGroup(click.Group):
    """A group that imports a command only when it is called; one-line helps and sub-groups come from the table.

    ``prefix`` is the word of a sub-group, "" for the whole command line.
    """

    context_class = Context

    def __init__(self, *args: Any, prefix: str = "", **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.prefix = prefix

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The words that may follow, in the order of the table, a group at the place of its first command."""
        paths = [path.split() for path in COMMANDS]
        if self.prefix:
            return [words[1] for words in paths if words[0] == self.prefix]
        return list(dict.fromkeys(words[0] for words in paths))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command ``cmd_name``; None if there is none of that name."""
        path = f"{self.prefix} {cmd_name}".strip()
        if path in GROUPS:
            return LazyGroup(path, prefix=path, help=GROUPS[path])
        if path not in COMMANDS:
            added = None if self.prefix else further_commands().get(path)
            if added is None:
                return None
            command = load_further_command(added)
        else:
            command = load_command(path)
        command.context_class = Context
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; an unknown name is a usage error with the closest match as a hint.

        The name of a command before it was put into a group still calls it, with the present words on stderr.
        """
        word = args[0]
        if not self.prefix and word in RENAMED:
            group, name = RENAMED[word].split()
            say_error(f"rrrgen {word} is now called: rrrgen {group} {name}")
            return word, LazyGroup(prefix=group).get_command(ctx, name), args[1:]
        known = self.list_commands(ctx)
        if word not in known and not word.startswith("-") and (self.prefix or word not in further_commands()):
            everywhere = {word: word for word in known} | ({} if self.prefix else RENAMED)
            close = [command for command in everywhere if command.startswith(word)]
            close = close if len(close) == 1 else difflib.get_close_matches(word, everywhere, n=1)
            hint = f" Did you mean '{everywhere[close[0]]}'?" if close else ""
            ctx.fail(f"No such command '{word}'.{hint}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a reader that closes the pipe early, such as head, is no failure."""
        try:
            with options_written(flag_here):
                return super().invoke(ctx)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing any, the further ones left to ``--help-all``."""
        rows = []
        for word in self.list_commands(ctx):
            if self.prefix or word not in FURTHER:
                rows.append((word, GROUPS.get(word) or COMMANDS[f"{self.prefix} {word}".strip()][1]))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def _show_everything(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    """Print every command with its one-line help, the exit codes and the shell completion, and leave."""
    if not value:
        return
    formatter = ctx.make_formatter()
    formatter.write_usage(ctx.command_path, "[OPTIONS] COMMAND [ARGS]...")
    with formatter.section("Commands"):
        formatter.write_dl([(path, help_text) for path, (_, help_text) in COMMANDS.items()])
    if added := [(name, plugin.where) for name, plugin in further_commands().items()]:
        with formatter.section("Commands of other packages"):
            formatter.write_dl(added)
    formatter.write("\n" + EVERYTHING.replace("\b\n", ""))
    click.echo(formatter.getvalue().rstrip("\n"))
    ctx.exit()


@click.group(cls=LazyGroup, epilog=FIRST, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="rrrgen")
@click.option(
    "--help-all",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_show_everything,
    help="Show all commands, exit codes, shell completion.",
)
def cli() -> None:
    """Turn a robot's Denavit-Hartenberg table into verified C and CasADi models."""


def main(args: Sequence[str] | None = None, prog_name: str = "rrrgen", command: click.Command = cli) -> NoReturn:
    """Run the command line and exit; ``command`` may be another click command with the same error handling."""
    _unwind_when_terminated()
    _print_anything()
    code = run(args, prog_name, command)
    if "generate" in (sys.argv[1:] if args is None else args)[:1]:
        # Programs are many objects, and the garbage collection at exit takes 0.2 s. Not for other commands, which may
        # load libraries that report uncollected objects as leaks.
        gc.freeze()
    sys.exit(code)


def _unwind_when_terminated() -> None:
    """Turn SIGTERM into SystemExit, so that unfinished files are removed."""
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:  # not where it is ignored
        signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))


def _print_anything() -> None:
    """Make the outputs write escapes for characters that their encoding lacks; files on Windows need that."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def run(args: Sequence[str] | None = None, prog_name: str = "rrrgen", command: click.Command = cli) -> int:
    """Run the command line and return the exit code; errors are printed on stderr."""
    try:
        result = command.main(args=args, prog_name=prog_name, standalone_mode=False, color=preference())
        return result if isinstance(result, int) else 0
    except click.ClickException as error:
        say_error(usage_text(error))
        return error.exit_code
    except (KeyboardInterrupt, click.Abort):
        say_error("interrupted")
        return INTERRUPTED
    except InputError as error:
        for fault in error.faults:
            say_error(fault_text(fault) if fault.file else _message(str(fault)))
        return error.exit_code
    except RrrgenError as error:
        say_error(_message(str(error)))
        return error.exit_code
    except Exception as error:  # anything else is a fault of rrrgen, and says so
        known: RrrgenError | None = missing_extra(error)
        if isinstance(error, OSError):
            known = known or storage_error(error.filename or "the output", error)
        elif isinstance(error, MemoryError):
            what = str(error) or "an array could not be made"
            known = StorageError(f"the memory is too small: {what}. Ask for fewer samples, or a shorter time")
        if known:
            say_error(_message(str(known)))
            return known.exit_code
        return _internal(error)


def _message(text: str) -> str:
    return f"{mark_failed('rrrgen:')} {text}"


def _internal(error: Exception) -> int:
    import traceback

    if os.environ.get("RRRGEN_DEBUG"):
        traceback.print_exc()
    place = traceback.extract_tb(error.__traceback__)[-1]
    fault = InternalError(f"{type(error).__name__}: {error} (in {place.name}, {os.path.basename(place.filename)})")
    say_error(_message(f"{fault}\nSet RRRGEN_DEBUG=1 to see the whole traceback."))
    return fault.exit_code
