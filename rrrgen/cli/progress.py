"""Progress of long computations: a bar on a terminal, nothing if stderr is redirected."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rrrgen.base.parallel import Tell


@contextmanager
def progress_bar(in_processes: bool = False) -> Iterator[Tell]:
    """Draw a progress bar on stderr; yields the function ``tell(done, total, message)`` that updates it.

    ``total`` is 0 where the end is not known. With ``in_processes`` the bar is drawn by ``tell`` alone, which forked
    processes may call; otherwise a thread keeps it moving, and a process with several threads cannot fork safely.
    """
    if not sys.stderr.isatty():
        yield lambda done, total, message: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    kept = not sys.stdout.isatty()  # what is written to a file or a pipe goes there, not above the bar
    with Progress(
        *columns, console=console, transient=True, auto_refresh=not in_processes, redirect_stdout=not kept
    ) as bar:
        task = bar.add_task("", total=None)

        def tell(done: int, total: int, message: str) -> None:
            bar.update(task, description=message, completed=done, total=total or None)
            if in_processes:
                bar.refresh()

        yield tell


@contextmanager
def working(message: str) -> Iterator[None]:
    """Show on a terminal that ``message`` is being done, for work of some seconds whose end is not known."""
    with progress_bar() as tell:
        tell(0, 0, message)
        yield
