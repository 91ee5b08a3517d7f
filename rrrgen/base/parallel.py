"""One parallel map: in this process, in several processes of this machine, or on a Dask cluster.

Deriving and printing are plain Python, which uses one core per process. Where it is safe, the processes are forked:
they share everything computed so far, and start at once. That is so in a process known to have a single thread
(Linux), since no other one may hold a lock then. Elsewhere (Windows, macOS, a notebook, next to a threaded BLAS) joblib
starts new processes; they do not run the main module of the program again, so that a script needs no
``if __name__ == "__main__"``, and they are kept for the next map.
"""

from __future__ import annotations

import contextlib
import gc
import os
import re
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar

from rrrgen.base.errors import InputError, MissingExtraError

Task = TypeVar("Task")
Result = TypeVar("Result")

MAX_JOBS = 6
"""Largest number of processes; more do not shorten the generation of a robot, whose longest task takes a third of the
total time."""

QUEUED_PER_WORKER = 2
"""Tasks of a stream that are handed out in advance: bounds the memory and keeps the workers busy."""

CLUSTER_TIMEOUT = "15s"
"""Longest time to wait for an answer of a Dask scheduler."""

CLUSTER = ("dask", "distributed")
"""The optional packages that a cluster needs."""

Tell = Callable[[int, int, str], None]
"""A function ``tell(done, total, message)`` that reports progress: ``done`` of ``total`` tasks of the kind
``message``."""


def usual_jobs() -> int:
    """Default number of processes: the cores available to this process, at most :data:`MAX_JOBS`."""
    return min(MAX_JOBS, len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1)


def parallel_map(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    jobs: int,
    tell: Tell | None = None,
    message: str = "",
) -> list[Result]:
    """``[function(task) for task in tasks]``, computed by up to ``jobs`` processes; see :func:`as_computed`.

    ``tell(done, total, message)`` is called after every task.
    """
    results: dict[int, Result] = {}
    for k, result in as_computed(function, tasks, jobs):
        results[k] = result
        if tell is not None:
            tell(len(results), len(tasks), message)
    return [results[k] for k in range(len(tasks))]


def ordered_map(
    function: Callable[[Task], Result], tasks: Iterable[Task], jobs: int = 1, cluster: str | None = None
) -> Iterator[Result]:
    """Yield ``function(task)`` in the order of the tasks; takes the arguments of :func:`as_computed`."""
    ahead: dict[int, Result] = {}  # results that are there before their turn
    turn = 0
    for k, result in as_computed(function, tasks, jobs, cluster=cluster):
        ahead[k] = result
        while turn in ahead:
            yield ahead.pop(turn)
            turn += 1


def as_computed(
    function: Callable[..., Result],
    tasks: Iterable[Task],
    jobs: int = 1,
    *,
    cluster: str | None = None,
    shared: Sequence[Any] = (),
) -> Iterator[tuple[int, Result]]:
    """Yield ``(index, function(*shared, task))`` of every task, the first to be finished first.

    Args:
        function: computes a task. New processes and clusters receive it by pickling, forked ones share it.
        tasks: started in this order. A sequence is handed out as a whole, any other iterable a few tasks ahead.
        jobs: number of processes on this machine; -1 means one per core.
        cluster: address of a Dask scheduler, "tcp://host:port", used instead; its workers must be able to import
            rrrgen. The task of a worker that dies is computed by another one.
        shared: arguments of every task, sent to a cluster only once.

    The tasks of a process that the system kills, mostly for its memory, are computed in this one. Raises what a task
    raises, :class:`MissingExtraError` if distributed is not installed, :class:`InputError` if no scheduler answers.
    """
    few = isinstance(tasks, Sequence) and len(tasks) < 2
    if cluster is None and (jobs == 1 or few or not sys.executable):  # no executable: Python inside another program
        for k, task in enumerate(tasks):
            yield k, function(*shared, task)
        return
    from concurrent.futures import BrokenExecutor

    pending: dict[int, Task] = {}

    def number_tasks() -> Iterator[tuple[int, Task]]:
        for k, task in enumerate(tasks):
            pending[k] = task
            yield k, task

    def compute(task: Task) -> Result:
        return function(*shared, task)

    if cluster is None and isinstance(tasks, Sequence) and may_fork():
        results = _compute_in_forks(compute, dict(number_tasks()), jobs)
    else:
        ahead = "all" if isinstance(tasks, Sequence) else f"{QUEUED_PER_WORKER}*n_jobs"
        results = _by_joblib(function, number_tasks(), jobs, cluster, shared, ahead)
    try:
        for k, result in results:
            del pending[k]
            yield k, result
    except BrokenExecutor:
        for k, task in pending.items():
            yield k, compute(task)


def may_fork() -> bool:
    """Whether this process has a single thread, as far as the system says so."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


def _compute_in_forks(
    compute: Callable[[Task], Result], tasks: dict[int, Task], jobs: int
) -> Iterator[tuple[int, Result]]:
    """Compute the tasks in this process and in forked ones, which inherit them: only results are pickled.

    This process takes tasks from the end, so that what it learns is shared with the processes of the next map.
    """
    import multiprocessing
    from concurrent.futures import Future, ProcessPoolExecutor

    others = set(multiprocessing.active_children())
    count = min(len(tasks), jobs if jobs > 0 else os.cpu_count() or 1) - 1
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("fork"), _inherit, (compute, tasks))
    waiting, finished = deque(tasks), SimpleQueue[Future[tuple[int, Result]]]()

    def submit() -> None:
        with contextlib.suppress(IndexError):
            pool.submit(_compute_inherited, waiting.popleft()).add_done_callback(keep)

    def keep(future: Future[tuple[int, Result]]) -> None:
        finished.put(future)
        if future.exception() is None:  # else the pool may be broken, which holds its lock while it says so
            submit()

    try:
        for _ in range(count):
            submit()
        for _ in range(len(tasks)):
            try:
                k = waiting.pop()
            except IndexError:
                yield finished.get().result()
            else:
                yield k, compute(tasks[k])
    except BaseException:  # an error or an interrupt does not wait for the tasks that are being computed
        waiting.clear()
        for child in set(multiprocessing.active_children()) - others:
            child.kill()
        raise
    finally:
        pool.shutdown()


_inheritance: tuple[Callable[[Any], Any], dict[int, Any]]
"""What a forked process computes, and all tasks by their index."""


def _inherit(compute: Callable[[Any], Any], tasks: dict[int, Any]) -> None:
    """Initialize a forked process, which gets its arguments without pickling."""
    global _inheritance
    _inheritance = compute, tasks
    gc.disable()  # programs hold no reference cycles, and the search takes a tenth of the time


def _compute_inherited(index: int) -> tuple[int, Any]:
    """Compute a task of a forked process."""
    compute, tasks = _inheritance
    return index, compute(tasks[index])


def _by_joblib(
    function: Callable[..., Result],
    tasks: Iterable[tuple[int, Task]],
    jobs: int,
    cluster: str | None,
    shared: Sequence[Any],
    ahead: str,
) -> Iterator[tuple[int, Result]]:
    """Compute the tasks in new processes of this machine, or on a Dask cluster."""
    import joblib

    with _backend(jobs, cluster, shared):
        parallel = joblib.Parallel(return_as="generator_unordered", pre_dispatch=ahead, batch_size=1)
        yield from parallel(joblib.delayed(_compute_numbered)(function, k, *shared, task) for k, task in tasks)


def _compute_numbered(function: Callable[..., Result], index: int, *arguments: Any) -> tuple[int, Result]:
    return index, function(*arguments)


@contextmanager
def _backend(jobs: int, cluster: str | None, shared: Sequence[Any]) -> Iterator[None]:
    """Select joblib's processes of this machine, each with one thread, or the workers of a Dask cluster."""
    import joblib

    if cluster is None:
        with joblib.parallel_config(backend="loky", n_jobs=jobs, inner_max_num_threads=1):
            yield
        return
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("a cluster", "distributed", "cluster") from None
    if not re.fullmatch(r"([\w.+-]+://)?[^/]+:\d+", cluster):  # a client of another word would try on in its thread
        raise InputError(f"{cluster} is no address of a Dask scheduler; it is written as tcp://host:port")
    try:
        client = Client(cluster, timeout=CLUSTER_TIMEOUT, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {cluster}: {error}") from error
    with client, joblib.parallel_config(backend="dask", client=client, n_jobs=-1, scatter=list(shared) or None):
        yield


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
