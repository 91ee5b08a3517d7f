"""Independent tasks side by side, in forked processes: deriving and printing is plain Python, one core to a process.

A forked process knows all that was computed so far and hands back its results only. Forking is safe where no other
thread may hold a lock, so it is done by processes with a single thread only, and where that can be told (Linux).
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, NoReturn, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

INDEX_BYTES = 2
"""Of a task's place in the queue, which is a pipe: 32768 places fit in."""


MOST = 6
"""More processes do not shorten a robot's generation: its longest task takes a third of the time of all."""


def usual_jobs() -> int:
    """As many as the cores that this process may run on, but not more than :data:`MOST`."""
    return min(MOST, len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1)


def side_by_side(function: Callable[[Task], Result], tasks: Sequence[Task], jobs: int) -> list[Result]:
    """``[function(task) for task in tasks]``, by up to ``jobs`` processes that take the tasks in the order given.

    What a process did not hand back, because it failed or was ended, is done here, where errors are seen.
    """
    others = min(jobs, len(tasks)) - 1
    if others < 1 or not _has_one_thread():
        return [function(task) for task in tasks]
    queue = _queue(len(tasks))
    helpers: list[_Helper] = []
    try:
        with contextlib.suppress(OSError):  # no more processes allowed
            for _ in range(others):
                helpers.append(_Helper(function, tasks, queue))
        done = _work(function, tasks, queue)
        for helper in helpers:
            done |= helper.results()
    finally:
        os.close(queue)
        for helper in helpers:
            helper.end()
    return [done[k] if k in done else function(task) for k, task in enumerate(tasks)]


def _has_one_thread() -> bool:
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


def _queue(count: int) -> int:
    """The reading end of a pipe that holds the places 0, 1, ..., count - 1: whoever is free reads the next."""
    reading, writing = os.pipe()
    os.write(writing, b"".join(k.to_bytes(INDEX_BYTES, "little") for k in range(count)))
    os.close(writing)
    return reading


def _work(function: Callable[[Task], Result], tasks: Sequence[Task], queue: int) -> dict[int, Result]:
    """Take tasks from the queue until it is empty."""
    done: dict[int, Result] = {}
    while place := os.read(queue, INDEX_BYTES):
        k = int.from_bytes(place, "little")
        done[k] = function(tasks[k])
    return done


class _Helper:
    """A forked process at work on the queue."""

    def __init__(self, function: Callable[[Task], Result], tasks: Sequence[Task], queue: int) -> None:
        reading, writing = os.pipe()
        self._process: int | None = os.fork()
        if not self._process:
            os.close(reading)
            _hand_back(lambda: _work(function, tasks, queue), os.fdopen(writing, "wb"))
        os.close(writing)
        self._stream = os.fdopen(reading, "rb")

    def results(self) -> dict[int, Any]:
        """What it has done, by place; nothing if it failed."""
        data = self._stream.read()
        assert self._process
        _, status = os.waitpid(self._process, 0)
        self._process = None
        return pickle.loads(data) if status == 0 else {}

    def end(self) -> None:
        """Stop it if it is still running."""
        self._stream.close()
        if self._process:
            os.kill(self._process, signal.SIGKILL)
            os.waitpid(self._process, 0)
            self._process = None


def _hand_back(compute: Callable[[], object], stream: BinaryIO) -> NoReturn:
    """The life of a forked process: it leaves without a word, and skips what only the first may do at exit."""
    status = 1
    try:
        with stream:
            pickle.dump(compute(), stream, pickle.HIGHEST_PROTOCOL)
        status = 0
    finally:
        os._exit(status)
