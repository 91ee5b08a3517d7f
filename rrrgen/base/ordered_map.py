"""A parallel ``map`` that keeps the order: in this process, on the cores of this machine, or on a Dask cluster."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from rrrgen.base.errors import InputError, MissingExtraError

T = TypeVar("T")
R = TypeVar("R")

QUEUED_PER_WORKER = 2  # items handed out in advance: bounds the memory and keeps the workers busy


def ordered_map(
    function: Callable[[T], R], items: Iterable[T], jobs: int = 1, cluster: str | None = None
) -> Iterator[R]:
    """Apply ``function`` to every item in parallel and yield the results in the order of the items.

    ``jobs`` is the number of processes on this machine (-1: all cores). ``cluster`` ("tcp://host:port") instead names a
    Dask scheduler, whose workers must be able to import rrrgen; the item of a worker that dies is computed by another
    one. Items are taken from the iterator a few at a time. Raises :class:`MissingExtraError` if joblib or distributed
    is not installed, :class:`InputError` if no scheduler answers.
    """
    if cluster is not None:
        yield from _on_cluster(function, items, cluster)
    elif jobs == 1:
        yield from map(function, items)
    else:
        yield from _on_cores(function, items, jobs)


def _on_cores(function: Callable[[T], R], items: Iterable[T], jobs: int) -> Iterator[R]:
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("work by several processes", "joblib", "identify") from None
    with joblib.parallel_config(backend="loky", n_jobs=jobs, inner_max_num_threads=1):
        parallel = joblib.Parallel(return_as="generator", pre_dispatch=f"{QUEUED_PER_WORKER}*n_jobs", batch_size=1)
        yield from parallel(joblib.delayed(function)(item) for item in items)


def _on_cluster(function: Callable[[T], R], items: Iterable[T], cluster: str) -> Iterator[R]:
    """Apply ``function`` to every item on a Dask cluster and yield the results in order.

    Each item is submitted inside its task, not as scattered data, so that no item is lost with a worker.
    """
    with cluster_client(cluster) as client:
        waiting: deque[Any] = deque()
        run = uuid.uuid4().hex
        for number, item in enumerate(items):
            waiting.append(client.submit(function, item, key=f"rrrgen-{run}-{number}"))
            if len(waiting) >= QUEUED_PER_WORKER * max(1, len(client.ncores())):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


@contextmanager
def cluster_client(cluster: str) -> Iterator[Any]:
    """A client of the Dask scheduler at the address ``cluster``; raises :class:`InputError` if none answers."""
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("a cluster", "distributed", "cluster") from None
    try:
        client = Client(cluster, timeout="15s", set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {cluster}: {error}") from error
    with client:
        yield client
