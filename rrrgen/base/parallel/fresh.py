"""Parallel map by new Python processes, for systems and programs in which forking is not safe."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

WORKER = "import sys; sys.path[:] = {path!r}; from rrrgen.base.parallel.worker import serve; serve()"
"""The Python code that a new process runs; it gets the module search path of this process."""

POLL = 0.1
"""Time limit (s) of a join of a thread, which is repeated: without a limit it cannot be interrupted on Windows."""


def fresh_map(
    function: Callable[[Task], Result], tasks: Sequence[Task], others: int, tell: Callable[[int], None] | None
) -> dict[int, Result]:
    """Compute the results of all tasks, by index, in this process and in ``others`` new ones.

    Results of processes that failed are missing; there are none at all if function and tasks cannot be pickled.
    ``tell(k)`` is called in this process when k tasks are done.
    """
    payload = _pickled((function, tasks))
    if payload is None or not sys.executable:  # Python inside another program
        return {}
    results = _Results(len(tasks), tell)
    workers: list[_Worker] = []
    threads: list[threading.Thread] = []
    try:
        with contextlib.suppress(OSError):  # no more processes allowed
            for _ in range(others):
                workers.append(_idle.pop() if _idle else _Worker())
        for worker in workers:
            thread = threading.Thread(target=_feed, args=(worker, payload, results), daemon=True)
            thread.start()
            threads.append(thread)
        while (k := results.next()) is not None:
            results.keep(k, function(tasks[k]))
        for thread in threads:
            while thread.is_alive():
                thread.join(POLL)
        _idle.extend(worker for worker in workers if worker.answered)
    finally:
        for worker in workers:
            if worker not in _idle:
                worker.end()
    return results.done


def _pickled(content: object) -> bytes | None:
    try:
        return pickle.dumps(content, pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError):  # a lambda, a local function, a lock
        return None


class _Results:
    """The indices of the tasks still to be done and the results so far; threads may share it."""

    def __init__(self, total: int, tell: Callable[[int], None] | None) -> None:
        self.done: dict[int, Any] = {}
        self._tell = tell
        self._lock = threading.Lock()
        self._waiting: SimpleQueue[int] = SimpleQueue()
        for k in range(total):
            self._waiting.put(k)

    def next(self) -> int | None:
        """The index of the next task; None if there is none left."""
        try:
            return self._waiting.get_nowait()
        except Empty:
            return None

    def keep(self, index: int, result: object) -> None:
        """Store the result of a task and report progress."""
        with self._lock:
            self.done[index] = result
            if self._tell is not None:
                self._tell(len(self.done))


def _feed(worker: _Worker, payload: bytes, results: _Results) -> None:
    """Send tasks to ``worker`` until none is left, or until it fails; the result of its last task is then missing."""
    with contextlib.suppress(OSError, EOFError, ValueError, pickle.UnpicklingError):
        worker.begin(payload)
        while (k := results.next()) is not None:
            results.keep(k, worker.result(k))
        worker.answered = True


class _Worker:
    """A new process that computes tasks by their index.

    ``answered`` is true while it has not failed and no result is awaited.
    """

    def __init__(self) -> None:
        self.answered = False
        command = [sys.executable, "-c", WORKER.format(path=[str(place) for place in sys.path])]
        self._popen = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )

    def begin(self, payload: bytes) -> None:
        """Send the function and all tasks, pickled. Raises OSError if the process has ended."""
        self.answered = False
        assert self._popen.stdin is not None
        self._popen.stdin.write(payload)
        self._popen.stdin.flush()

    def result(self, index: int) -> Any:
        """Let the process compute the task ``index``; returns the result. Raises EOFError or OSError if it failed."""
        assert self._popen.stdin is not None
        assert self._popen.stdout is not None
        pickle.dump(index, self._popen.stdin)
        self._popen.stdin.flush()
        return pickle.load(self._popen.stdout)

    def end(self) -> None:
        """Kill the process if it is still running."""
        self._popen.kill()
        self._popen.wait()
        for stream in (self._popen.stdin, self._popen.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()


_idle: list[_Worker] = []
"""Processes that wait for the next parallel map, so that each imports its modules only once; they end with this
process."""
