"""rrrgen, a code-generating symbolic modelling compiler for serial robots.

>>> import rrrgen
>>> m = rrrgen.compile("rrr")  # a bundled robot, or the path of a robot file
>>> tau = m.inverse_dynamics(q, dq, ddq)  # doctest: +SKIP

Everything is imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rrrgen.version import VERSION

__version__ = VERSION

if TYPE_CHECKING:
    from rrrgen.control.path import Path, spline_path
    from rrrgen.errors import (
        BackendError,
        BuildError,
        DerivationError,
        InputError,
        InternalError,
        RrrgenError,
    )
    from rrrgen.pipeline import compile
    from rrrgen.robotfile import bundled_names, load_spec, loads_spec
    from rrrgen.robotfile.importers.toolbox import from_toolbox
    from rrrgen.runtime.model import Model
    from rrrgen.runtime.online.estimator import online_estimator

_HOMES = {
    "compile": "rrrgen.pipeline",
    "load_spec": "rrrgen.robotfile",
    "loads_spec": "rrrgen.robotfile",
    "bundled_names": "rrrgen.robotfile",
    "from_toolbox": "rrrgen.robotfile.importers.toolbox",
    "Model": "rrrgen.runtime.model",
    "Path": "rrrgen.control.path",
    "spline_path": "rrrgen.control.path",
    "online_estimator": "rrrgen.runtime.online.estimator",
    "RrrgenError": "rrrgen.errors",
    "InputError": "rrrgen.errors",
    "DerivationError": "rrrgen.errors",
    "BackendError": "rrrgen.errors",
    "BuildError": "rrrgen.errors",
    "InternalError": "rrrgen.errors",
}

__all__ = [
    "BackendError",
    "BuildError",
    "DerivationError",
    "InputError",
    "InternalError",
    "Model",
    "Path",
    "RrrgenError",
    "__version__",
    "bundled_names",
    "compile",
    "from_toolbox",
    "load_spec",
    "loads_spec",
    "online_estimator",
    "spline_path",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'rrrgen' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return sorted(__all__)
