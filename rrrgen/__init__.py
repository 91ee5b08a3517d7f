"""rrrgen, a code-generating symbolic modelling compiler for serial robots.

>>> import rrrgen
>>> m = rrrgen.compile("rrr")  # a bundled robot, or the path of a robot file
>>> tau = m.inverse_dynamics(q, dq, ddq)  # doctest: +SKIP

Everything is imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rrrgen.base.version import VERSION

__version__ = VERSION

if TYPE_CHECKING:
    from rrrgen.base.errors import (
        BackendError,
        BuildError,
        DerivationError,
        InputError,
        InternalError,
        RobotFileWarning,
        RrrgenError,
    )
    from rrrgen.lab.studies.calibrate import CalibrateOptions, calibrate
    from rrrgen.lab.studies.contact_thresholds import ContactOptions, contact_thresholds
    from rrrgen.lab.studies.estimate_drive_gains import DriveGainsOptions, estimate_drive_gains
    from rrrgen.lab.studies.estimate_elastic_joints import ElasticJointsOptions, estimate_elastic_joints
    from rrrgen.lab.studies.estimate_friction import FrictionOptions, estimate_friction
    from rrrgen.lab.studies.estimate_payload import PayloadOptions, estimate_payload
    from rrrgen.lab.studies.excite import ExciteOptions, excite
    from rrrgen.lab.studies.fit_response import FitResponseOptions, fit_response
    from rrrgen.lab.studies.frequency_response import FrequencyResponseOptions, frequency_response
    from rrrgen.lab.studies.identify import IdentifyOptions, identify
    from rrrgen.lab.studies.matrix_response import MatrixResponseOptions, matrix_response
    from rrrgen.lab.studies.options import MotionOptions
    from rrrgen.lab.studies.reconstruct import reconstruct
    from rrrgen.lab.studies.simulate import SimulateOptions, simulate
    from rrrgen.lab.studies.validate import ValidateOptions, validate
    from rrrgen.robot.file import bundled_names, load_spec, loads_spec
    from rrrgen.robot.importers.robotics_toolbox import from_toolbox
    from rrrgen.runtime.load import compile
    from rrrgen.runtime.model import Model
    from rrrgen.runtime.online_estimators import online_estimator
    from rrrgen.runtime.paths import Path, spline_path

_STUDIES = {
    "calibrate": "CalibrateOptions",
    "contact_thresholds": "ContactOptions",
    "estimate_drive_gains": "DriveGainsOptions",
    "estimate_elastic_joints": "ElasticJointsOptions",
    "estimate_friction": "FrictionOptions",
    "estimate_payload": "PayloadOptions",
    "excite": "ExciteOptions",
    "fit_response": "FitResponseOptions",
    "frequency_response": "FrequencyResponseOptions",
    "identify": "IdentifyOptions",
    "matrix_response": "MatrixResponseOptions",
    "reconstruct": "MotionOptions",
    "simulate": "SimulateOptions",
    "validate": "ValidateOptions",
}
"""The studies of the laboratory, each in a module of its name, and their options."""

_HOMES = {
    "compile": "rrrgen.runtime.load",
    "load_spec": "rrrgen.robot.file",
    "loads_spec": "rrrgen.robot.file",
    "bundled_names": "rrrgen.robot.file",
    "from_toolbox": "rrrgen.robot.importers.robotics_toolbox",
    "Model": "rrrgen.runtime.model",
    "Path": "rrrgen.runtime.paths",
    "spline_path": "rrrgen.runtime.paths",
    "online_estimator": "rrrgen.runtime.online_estimators",
    "RrrgenError": "rrrgen.base.errors",
    "InputError": "rrrgen.base.errors",
    "DerivationError": "rrrgen.base.errors",
    "BackendError": "rrrgen.base.errors",
    "BuildError": "rrrgen.base.errors",
    "InternalError": "rrrgen.base.errors",
    "RobotFileWarning": "rrrgen.base.errors",
} | {name: f"rrrgen.lab.studies.{study}" for study, options in _STUDIES.items() for name in (study, options)}

__all__ = [
    "BackendError",
    "BuildError",
    "CalibrateOptions",
    "ContactOptions",
    "DerivationError",
    "DriveGainsOptions",
    "ElasticJointsOptions",
    "ExciteOptions",
    "FitResponseOptions",
    "FrequencyResponseOptions",
    "FrictionOptions",
    "IdentifyOptions",
    "InputError",
    "InternalError",
    "MatrixResponseOptions",
    "Model",
    "MotionOptions",
    "Path",
    "PayloadOptions",
    "RobotFileWarning",
    "RrrgenError",
    "SimulateOptions",
    "ValidateOptions",
    "__version__",
    "bundled_names",
    "calibrate",
    "compile",
    "contact_thresholds",
    "estimate_drive_gains",
    "estimate_elastic_joints",
    "estimate_friction",
    "estimate_payload",
    "excite",
    "fit_response",
    "frequency_response",
    "from_toolbox",
    "identify",
    "load_spec",
    "loads_spec",
    "matrix_response",
    "online_estimator",
    "reconstruct",
    "simulate",
    "spline_path",
    "validate",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'rrrgen' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return sorted(__all__)
