"""The same loop on one process, on the cores of this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from rrrgen.errors import InputError

T = TypeVar("T")
R = TypeVar("R")


def ordered_map(
    function: Callable[[T], R], items: Iterable[T], jobs: int = 1, cluster: str | None = None
) -> Iterator[R]:
    """``function`` of every item, in the order of the items, a few items at a time.

    ``jobs`` processes of this machine (-1: all cores), or the Dask scheduler at ``cluster`` ("tcp://host:port"), whose
    workers must be able to import rrrgen; a task whose worker dies is done again by another one.
    """
    if jobs == 1 and cluster is None:
        yield from map(function, items)
        return
    try:
        import joblib
    except ImportError as error:
        raise InputError("several processes need the extra 'identify': pip install rrrgen[identify]") from error
    with worker_pool(jobs, cluster):
        parallel = joblib.Parallel(return_as="generator", pre_dispatch="2*n_jobs", batch_size=1)
        yield from parallel(joblib.delayed(function)(item) for item in items)


@contextmanager
def worker_pool(jobs: int, cluster: str | None) -> Iterator[Any]:
    """joblib's own processes, or the workers of a Dask cluster."""
    import joblib

    if cluster is None:
        with joblib.parallel_config(backend="loky", n_jobs=jobs, inner_max_num_threads=1):
            yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("a cluster needs the extra 'cluster': pip install rrrgen[cluster]") from error
    try:
        client = Client(cluster, timeout="15s", set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {cluster}: {error}") from error
    with client, joblib.parallel_config(backend="dask", client=client, n_jobs=-1):
        yield client
