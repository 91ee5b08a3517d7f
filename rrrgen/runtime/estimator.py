"""Online estimators in Python: the emitted C with its state, or the same recursions in NumPy without a compiler.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError
from rrrgen.emit.controller.programs import Regression, regression
from rrrgen.emit.controller.sources import EstimatorSettings, Kind
from rrrgen.runtime.cores import CompiledCore, Core, NumpyGradient, NumpyLeastSquares
from rrrgen.runtime.model import Model

Array = NDArray[Any]


class OnlineEstimator:
    """Estimates the parameters of a robot sample by sample, (14.21)-(14.23).

    ``names`` (p,) are the names of the parameters. The gradient estimator has no covariance.
    """

    def __init__(self, setting: Regression, kind: Kind, core: Core) -> None:
        self.kind, self.names, self._core, self._joints = kind, setting.names, core, setting.joints

    @property
    def parameters(self) -> Array:
        """The present estimate (p,) of the parameters, SI units, in the order of ``names``."""
        return np.array(self._core.parameters(), dtype=float)

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the parameters due to torque noise; only recursive least squares has one."""
        if self.kind != "rls":
            raise ValueError("the gradient estimator has no covariance; use recursive least squares ('rls')")
        return np.array(self._core.covariance(), dtype=float)

    def update(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, tau: ArrayLike) -> Array:
        """Take one sample (n,), or many in the order of time (N, n); returns the torque errors before each update.

        ``tau`` are the measured torques less friction that is compensated with known parameters, N m (N). The errors
        are measured minus model torque for recursive least squares, model minus measured for the gradient, (14.22).
        Raises ValueError for wrong shapes.
        """
        arrays = [np.ascontiguousarray(value, dtype=self._core.dtype) for value in (q, dq, ddq, tau)]
        if len({array.shape for array in arrays}) > 1 or arrays[0].ndim not in (1, 2):
            shapes = ", ".join(str(array.shape) for array in arrays)
            raise ValueError(f"q, dq, ddq and tau are all (n,) or all (N, n), not {shapes}")
        if arrays[0].shape[-1] != self._joints:
            raise ValueError(f"the robot has {self._joints} joints, the samples have {arrays[0].shape[-1]}")
        rows = [array.reshape(-1, self._joints) for array in arrays]
        errors = np.empty_like(rows[0])
        for k in range(len(errors)):
            q_k, dq_k, ddq_k, tau_k = (row[k] for row in rows)
            self._core.update(q_k, dq_k, ddq_k, tau_k, errors[k])
        return errors.reshape(arrays[0].shape)


def online_estimator(
    model: Model,
    kind: Kind = "rls",
    settings: EstimatorSettings | None = None,
    fixed: Mapping[str, float] | None = None,
) -> OnlineEstimator:
    """Create an online estimator of the dynamic parameters of a robot. Source: (14.21)-(14.23).

    It runs the C of `rrrgen generate --estimator`, in the precision of the model; with a model of the NumPy backend
    the same recursion in NumPy.

    Args:
        model: the robot, from :func:`rrrgen.compile`.
        kind: "rls", recursive least squares, or "gradient".
        settings: gains, noise and starting values; the gradient needs its gain.
        fixed: known parameters, by name, with their values in SI units; the others are estimated.

    Raises:
        InputError: the settings are impossible.
    """
    setting = regression(model.derived, fixed)
    given = settings or EstimatorSettings()
    chosen = given.completed(setting)
    if kind == "gradient" and chosen.gain is None:
        raise InputError("the gradient estimator needs a gain: alpha Ts of (14.23)")
    core: Core
    if model.engine.name == "c":
        core = CompiledCore(setting, kind, given, "double" if model.engine.dtype == np.float64 else "float")
    else:
        core = NumpyLeastSquares(setting, chosen) if kind == "rls" else NumpyGradient(setting, chosen)
    return OnlineEstimator(setting, kind, core)
