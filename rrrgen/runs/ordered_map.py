"""The same loop on one process, on the cores of this machine, or on a Dask cluster."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from rrrgen.errors import InputError, MissingExtraError

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 2  # items per worker that wait for their turn: bounds the memory, keeps the workers busy


def ordered_map(
    function: Callable[[T], R], items: Iterable[T], jobs: int = 1, cluster: str | None = None
) -> Iterator[R]:
    """``function`` of every item, in the order of the items, a few items at a time.

    ``jobs`` processes of this machine (-1: all cores), or the Dask scheduler at ``cluster`` ("tcp://host:port"), whose
    workers must be able to import rrrgen; an item whose worker dies is done again by another one.
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
        parallel = joblib.Parallel(return_as="generator", pre_dispatch=f"{AHEAD}*n_jobs", batch_size=1)
        yield from parallel(joblib.delayed(function)(item) for item in items)


def _on_cluster(function: Callable[[T], R], items: Iterable[T], cluster: str) -> Iterator[R]:
    """Items travel inside their tasks, so that nothing is lost with a worker."""
    with cluster_client(cluster) as client:
        waiting: deque[Any] = deque()
        run = uuid.uuid4().hex
        for number, item in enumerate(items):
            waiting.append(client.submit(function, item, key=f"rrrgen-{run}-{number}"))
            if len(waiting) >= AHEAD * max(1, len(client.ncores())):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


@contextmanager
def cluster_client(cluster: str) -> Iterator[Any]:
    """A client of the Dask scheduler at an address; :class:`InputError` where none answers."""
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
