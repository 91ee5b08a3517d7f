"""Online estimators from Python: recursive least squares and the gradient method, one sample at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError
from rrrgen.emit import Real
from rrrgen.emit.controller.online_estimators import (
    NEGLIGIBLE,
    EstimatorSettings,
    EstimatorTuning,
    Kind,
    Regression,
    estimator_files,
    regression,
)
from rrrgen.program import evaluate
from rrrgen.runtime.model import Model

# ------------------------------------------------------------------------------------------------------------------
# The recursions of the online estimators, one sample at a time: the emitted C, or the same recursion in NumPy.
# ------------------------------------------------------------------------------------------------------------------

Array = NDArray[Any]


class Core(Protocol):
    """Interface of an online estimator of p parameters with its state; ``dtype`` is the type of its numbers."""

    dtype: Any

    def parameters(self) -> Any:
        """The present estimate (p,) of the parameters."""
        ...

    def covariance(self) -> Any:
        """Covariance (p, p) of the parameters; None for the gradient method, which has none."""
        ...

    def update(self, q: Array, dq: Array, ddq: Array, tau: Array, e: Array) -> int:
        """Update the estimate with one sample, (n,) each; writes the torque errors before the update to ``e`` (n,).

        Returns the status of the C function ``<robot>_<kind>_update``.
        """
        ...


class CompiledCore:
    """Online estimator that calls the emitted C through cffi and holds its state."""

    def __init__(self, setting: Regression, kind: Kind, settings: EstimatorSettings, real: Real) -> None:
        from rrrgen.runtime.build import build_extension

        name, self.p = f"{setting.robot}_{kind}", len(setting.names)
        self.dtype = np.float64 if real == "double" else np.float32
        vectors = ", ".join([f"const {real} *"] * 4)
        declared = (
            f"typedef struct {{ {real} p[{self.p}]; ...; }} {name}_state;"
            f"void {name}_start({name}_state *);"
            f"int {name}_update({name}_state *, {vectors}, {real} *);"
        )
        if kind == "rls":
            declared += f"void {name}_covariance(const {name}_state *, {real} *);"
        self.ffi, lib = build_extension(estimator_files(setting, kind, settings, real), declared, name)
        self.state = self.ffi.new(f"{name}_state *")
        getattr(lib, f"{name}_start")(self.state)
        self._update = getattr(lib, f"{name}_update")
        self._covariance = getattr(lib, f"{name}_covariance", None)
        self._vector = f"{real}[]"

    def parameters(self) -> Any:
        """The present estimate (p,) of the parameters."""
        return list(self.state.p)

    def covariance(self) -> Any:
        """Covariance (p, p) of the parameters."""
        assert self._covariance is not None
        P = np.empty((self.p, self.p), self.dtype)
        self._covariance(self.state, self.ffi.from_buffer(self._vector, P))
        return P

    def update(self, q: Array, dq: Array, ddq: Array, tau: Array, e: Array) -> int:
        """Update the estimate with one sample by the C function ``<robot>_<kind>_update``; returns its status."""
        pointers = [self.ffi.from_buffer(self._vector, array) for array in (q, dq, ddq, tau, e)]
        return int(self._update(self.state, *pointers))


class NumpyLeastSquares:
    """Recursive least squares in NumPy, with the covariance matrix itself instead of its factors as in the C code."""

    dtype = np.float64

    def __init__(self, setting: Regression, settings: EstimatorTuning) -> None:
        self.rows, self.settings = setting.rows, settings
        self.p = np.array(settings.start, dtype=float)
        self.P = np.diag(np.square(np.array(settings.spread, dtype=float)))
        self.noise = np.array(settings.noise, dtype=float)

    def parameters(self) -> Any:
        """The present estimate (p,) of the parameters."""
        return self.p

    def covariance(self) -> Any:
        """Covariance (p, p) of the parameters."""
        return self.P

    def update(self, q: Array, dq: Array, ddq: Array, tau: Array, e: Array) -> int:
        """Update the estimate with one sample, (n,) each; writes the torque errors before it to ``e`` (n,).

        Returns the number of joints used.
        """
        Y, y, moves = evaluate(self.rows, q, dq, ddq, tau, self.settings.rest)
        e[:] = y - Y @ self.p
        if not np.all(np.isfinite(e)):
            e[:] = 0.0
            return 0
        use = moves > 0.0
        L = np.linalg.cholesky(self.noise[np.ix_(use, use)])
        count = 0
        for r, target in zip(np.linalg.solve(L, Y[use]), np.linalg.solve(L, y[use]), strict=True):
            count += self._learn(r, target)
        return count

    def _learn(self, r: Array, y: float) -> bool:
        """Update the estimate with one scalar equation ``y = r p`` whose noise has variance 1.

        Returns False if the equation was skipped, because it tells nothing new about the parameters.
        """
        Pr = self.P @ r
        a = float(r @ Pr)
        if not a > NEGLIGIBLE["double"]:
            return False
        m = max(self.settings.forgetting, 1.0 - a)
        self.p = self.p + Pr * ((y - r @ self.p) / (m + a))
        P = self.P - np.outer(Pr, Pr) * ((1.0 - (1.0 - m) / a) / (m + a))
        self.P = 0.5 * (P + P.T)
        return True


class NumpyGradient:
    """The gradient method in NumPy, by evaluation of the program from which the C code is printed."""

    dtype = np.float64

    def __init__(self, setting: Regression, settings: EstimatorTuning) -> None:
        self.program, self.settings = setting.gradient, settings
        self.p = np.array(settings.start, dtype=float)

    def parameters(self) -> Any:
        """The present estimate (p,) of the parameters."""
        return self.p

    def covariance(self) -> Any:
        """None: the gradient method has no covariance."""
        return None

    def update(self, q: Array, dq: Array, ddq: Array, tau: Array, e: Array) -> int:
        """Update the estimate with one sample, (n,) each; errors go to ``e`` (n,).

        Returns 1 if the step was shortened to stay stable, -1 if the sample is not finite, otherwise 0.
        """
        following, errors, shortened = evaluate(
            self.program, q, dq, ddq, tau, self.p, self.settings.gain, self.settings.rest
        )
        e[:] = errors
        if not np.all(np.isfinite(following)) or not np.all(np.isfinite(e)):
            e[:] = 0.0
            return -1
        self.p = following
        return int(shortened)


# ------------------------------------------------------------------------------------------------------------------
# Online estimators in Python: the emitted C with its state, or the same recursions in NumPy without a compiler.
#
# Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
# Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
# ------------------------------------------------------------------------------------------------------------------


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
        settings: gains, noise and starting values, of both kinds; the gradient needs its gain.
        fixed: known parameters, by name, with their values in SI units; the others are estimated.

    Raises:
        InputError: the kind is unknown, or the settings are impossible.
        DerivationError: Newton's method finds the positions of the robot's closed loops.
    """
    if kind not in get_args(Kind):
        raise InputError(f"there is no online estimator {kind!r}; there are {' and '.join(get_args(Kind))}")
    setting = regression(model.derived, fixed)
    given = settings or EstimatorSettings()
    chosen = given.fill_defaults(setting)
    if kind == "gradient" and chosen.gain is None:
        raise InputError("the gradient estimator needs a gain: alpha Ts of (14.23)")
    core: Core
    if model.engine.name == "c":
        core = CompiledCore(setting, kind, given, "double" if model.engine.dtype == np.float64 else "float")
    else:
        core = NumpyLeastSquares(setting, chosen) if kind == "rls" else NumpyGradient(setting, chosen)
    return OnlineEstimator(setting, kind, core)
