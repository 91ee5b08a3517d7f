"""Parallel map over processes, since deriving and printing are plain Python, which uses one core per process.

Where it is safe, the other processes are forked: they share everything computed so far. That is so while no other
thread may hold a lock, in a process known to have a single one (Linux). Elsewhere (Windows, macOS, a notebook) they are
new ones that receive the function and its tasks by pickling. They do not run the main module of the program again, so
that a script needs no ``if __name__ == "__main__"``. What cannot be pickled is computed in this process.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

MAX_JOBS = 6
"""Largest number of processes; more do not shorten the generation of a robot, whose longest task takes a third of the
total time."""


def usual_jobs() -> int:
    """Default number of processes: the cores available to this process, at most :data:`MAX_JOBS`."""
    return min(MAX_JOBS, len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1)


Tell = Callable[[int, int, str], None]
"""A function ``tell(done, total, message)`` that reports progress: ``done`` of ``total`` tasks of the kind
``message``."""


def parallel_map(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    jobs: int,
    tell: Tell | None = None,
    message: str = "",
) -> list[Result]:
    """``[function(task) for task in tasks]``, computed by up to ``jobs`` processes that start tasks in the given order.

    Results must pickle. A task whose process failed or was killed is repeated in this process, so that its error
    reaches the caller. ``tell(done, total, message)`` is called after every task; with forked processes, in the one
    that did it.
    """
    others = min(jobs, len(tasks)) - 1
    total = len(tasks)
    done: dict[int, Result] = {}
    if others > 0 and may_fork():
        from rrrgen.base.parallel.forked import forked_map

        done = forked_map(function, tasks, others, None if tell is None else lambda k: tell(k, total, message))
    elif others > 0:
        from rrrgen.base.parallel.fresh import fresh_map

        done = fresh_map(function, tasks, others, None if tell is None else lambda k: tell(k, total, message))
    results = []
    for k, task in enumerate(tasks):
        results.append(done[k] if k in done else function(task))
        if tell is not None and k not in done:
            tell(k + 1, total, message)
    return results


def may_fork() -> bool:
    """Whether this process has a single thread, as far as the system says so."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


@contextmanager
def without_collection() -> Iterator[None]:
    """Pause cyclic garbage collection: programs hold no reference cycles, and the search takes a tenth of the time."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
