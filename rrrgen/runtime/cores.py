"""The recursions of the online estimators, one sample at a time: the emitted C, or the same recursion in NumPy."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.emit import Real
from rrrgen.emit.controller.programs import Regression
from rrrgen.emit.controller.sources import NEGLIGIBLE, EstimatorSettings, Kind, Tuning, estimator_files
from rrrgen.program import evaluate

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

    def __init__(self, setting: Regression, settings: Tuning) -> None:
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

    def __init__(self, setting: Regression, settings: Tuning) -> None:
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
