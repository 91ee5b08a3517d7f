"""Packages that are not always installed: which extra of rrrgen brings them, and the error that says so."""

from __future__ import annotations

from importlib.util import find_spec

from rrrgen.errors import MissingExtraError

EXTRAS = {
    "casadi": "identify",
    "scipy": "identify",
    "matplotlib": "identify",
    "joblib": "identify",
    "cvxpy": "identify",
    "clarabel": "identify",
    "h5py": "logs",
    "pyarrow": "logs",
    "rosbags": "logs",
    "dask": "cluster",
    "distributed": "cluster",
}
"""Top-level module -> extra, as in pyproject.toml."""


def require(purpose: str, *modules: str) -> None:
    """Raise MissingExtraError unless ``modules`` are installed, before any work is done; none of them is imported."""
    missing = [module for module in modules if not installed(module)]
    if missing:
        raise MissingExtraError(purpose, ", ".join(missing), EXTRAS[missing[0]])


def installed(module: str) -> bool:
    """Whether a top-level module can be imported, as far as can be told without doing so."""
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def missing_extra(error: BaseException | None) -> MissingExtraError | None:
    """The error to report for a failed import, or for what it caused; None where it is about no extra."""
    while error is not None:
        if isinstance(error, ImportError):
            package = (error.name or "").partition(".")[0]
            if package in EXTRAS:
                return MissingExtraError("this", package, EXTRAS[package])
        error = error.__cause__
    return None
