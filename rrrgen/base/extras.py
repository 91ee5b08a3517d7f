"""Optional packages: the extra of rrrgen that installs each, and the error that names it when one is missing."""

from __future__ import annotations

from importlib.util import find_spec

from rrrgen.base.errors import MissingExtraError

EXTRAS = {
    "casadi": "identify",
    "scipy": "identify",
    "matplotlib": "plot",
    "joblib": "identify",
    "cvxpy": "identify",
    "clarabel": "identify",
    "h5py": "logs",
    "pyarrow": "logs",
    "rosbags": "logs",
    "dask": "cluster",
    "distributed": "cluster",
    "control": "response",
    "nfoursid": "response",
    "pandas": "response",
    "ziglang": "cross",
}
"""The extra of pyproject.toml that installs each optional top-level module."""


USES = {
    "plot": "Model.plot and Model.animate",
    "identify": "excite, identify, validate, reconstruct, friction and case-study, with figures; CasADi functions",
    "logs": "recordings in HDF5, Parquet and ROS bags",
    "cluster": "excite on the machines of a Dask cluster",
    "cross": "export: wheels and FMUs for other platforms",
    "response": "response-model: export to python-control, subspace identification",
}
"""What each extra lets a user do, in a few words."""


def require(purpose: str, *modules: str) -> None:
    """Raise MissingExtraError unless all ``modules`` are installed; none of them is imported.

    Call it before any work is done. ``purpose`` says in the message what needs them.
    """
    missing = [module for module in modules if not installed(module)]
    if missing:
        raise MissingExtraError(purpose, ", ".join(missing), EXTRAS[missing[0]])


def installed(module: str) -> bool:
    """Whether a top-level module is installed, as far as can be determined without importing it."""
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def missing_extra(error: BaseException | None) -> MissingExtraError | None:
    """The MissingExtraError for a failed import, or for an error caused by one; None if no extra would help."""
    while error is not None:
        if isinstance(error, ImportError):
            package = (error.name or "").partition(".")[0]
            if package in EXTRAS:
                return MissingExtraError("this", package, EXTRAS[package])
        error = error.__cause__
    return None
