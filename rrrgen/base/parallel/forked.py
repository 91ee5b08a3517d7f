"""The tasks of a parallel map in forked processes, which share everything computed so far and send back results."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, NoReturn, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

INDEX_BYTES = 2
"""Bytes of a task index in the queue, which is a pipe; its buffer of 64 KiB holds 32768 indices."""


def forked_map(
    function: Callable[[Task], Result], tasks: Sequence[Task], others: int, tell: Callable[[int], None] | None
) -> dict[int, Result]:
    """Results by task index, computed by this process and ``others``; those of processes that failed are missing.

    ``tell(k)`` is called in the process that did the k-th task to be done, counted from 1.
    """
    if tell is not None:
        function = _telling(function, len(tasks), tell)
    queue = _queue(len(tasks))
    children: list[_ChildProcess] = []
    try:
        with contextlib.suppress(OSError):  # no more processes allowed
            for _ in range(others):
                children.append(_ChildProcess(function, tasks, queue))
        done = _work(function, tasks, queue)
        for child in children:
            done |= child.results()
    finally:
        os.close(queue)
        for child in children:
            child.end()
    return done


def _telling(function: Callable[[Task], Result], total: int, tell: Callable[[int], None]) -> Callable[[Task], Result]:
    """Wrap ``function`` so that each call reports progress: the number of calls that have ended in all processes."""
    numbers = _queue(total)

    def told(task: Task) -> Result:
        result = function(task)
        if number := os.read(numbers, INDEX_BYTES):
            tell(int.from_bytes(number, "little") + 1)
        return result

    return told


def _queue(count: int) -> int:
    """The reading end of a pipe that holds the task indices 0, 1, ..., count - 1; a free process reads the next."""
    reading, writing = os.pipe()
    os.write(writing, b"".join(k.to_bytes(INDEX_BYTES, "little") for k in range(count)))
    os.close(writing)
    return reading


def _work(function: Callable[[Task], Result], tasks: Sequence[Task], queue: int) -> dict[int, Result]:
    """Compute tasks from the queue until it is empty; results by task index."""
    done: dict[int, Result] = {}
    while index := os.read(queue, INDEX_BYTES):
        k = int.from_bytes(index, "little")
        done[k] = function(tasks[k])
    return done


class _ChildProcess:
    """A forked process that computes tasks from the queue."""

    def __init__(self, function: Callable[[Task], Result], tasks: Sequence[Task], queue: int) -> None:
        reading, writing = os.pipe()
        self._process: int | None = os.fork()
        if not self._process:
            os.close(reading)
            _run_child(lambda: _work(function, tasks, queue), os.fdopen(writing, "wb"))
        os.close(writing)
        self._stream = os.fdopen(reading, "rb")

    def results(self) -> dict[int, Any]:
        """Wait for the process; its results by task index, empty if it failed."""
        data = self._stream.read()
        assert self._process
        _, status = os.waitpid(self._process, 0)
        self._process = None
        return pickle.loads(data) if status == 0 else {}

    def end(self) -> None:
        """Kill the process if it is still running."""
        self._stream.close()
        if self._process:
            os.kill(self._process, signal.SIGKILL)
            os.waitpid(self._process, 0)
            self._process = None


def _run_child(compute: Callable[[], object], stream: BinaryIO) -> NoReturn:
    """Child entry point: write the pickled result to ``stream``; exits with os._exit, skipping atexit handlers."""
    status = 1
    try:
        with stream:
            pickle.dump(compute(), stream, pickle.HIGHEST_PROTOCOL)
        status = 0
    finally:
        os._exit(status)
