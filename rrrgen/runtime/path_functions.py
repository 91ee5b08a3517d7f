"""Methods of a model for given paths: dynamics along them and time-optimal timing; compiled when first called."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.base.errors import BuildError, InputError
from rrrgen.runtime.functions.friction import FrictionFunctions

if TYPE_CHECKING:
    from rrrgen.emit import Real
    from rrrgen.runtime.path import Path
    from rrrgen.runtime.path_kernel import TimingKernel
    from rrrgen.runtime.timed_path import TimedPath

EXCESS = 0.02
"""Share by which torques may exceed their limits between the points of a path, and by which a motion may be stretched
for speeds and accelerations there, before a warning advises more points."""


class PathFunctions(FrictionFunctions):
    """Methods for motion along a given path q(s): dynamics in terms of s, and time-optimal timing."""

    _timing: TimingKernel | None = None

    def time_path(
        self,
        path: Path,
        *,
        tau_max: ArrayLike | None = None,
        dq_max: ArrayLike | None = None,
        ddq_max: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        start: float = 0.0,
        end: float = 0.0,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> TimedPath:
        """The fastest motion along a path within limits of torque, speed and acceleration.

        At the points all limits are kept. So that speeds and accelerations keep theirs between the points, too, the
        motion is slowed down as a whole by a certified bound of them; torques are checked there.

        Args:
            path: the path, from :func:`rrrgen.spline_path` or a :class:`rrrgen.Path` of own samples.
            tau_max: largest torques, friction included, (n,), N m or N; by default the limits of the robot file.
            dq_max: largest speeds, (n,), rad/s or m/s; by default the limits of the robot file.
            ddq_max: largest accelerations, (n,), rad/s^2 or m/s^2; by default the limits of the robot file.
            friction: friction parameters, (k,), SI units; by default those of the robot file.
            start: ds/dt at the first point; 0 starts at rest. It is divided by the stretch of the motion.
            end: ds/dt at the last point; 0 ends at rest. Likewise.
            beta: base parameters, (b,), SI units; by default those of the robot file.
            Ia: drive inertias, (n,), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,), m/s^2; by default the file's.

        Returns:
            The timed path: ``duration``, ``ds_dt`` and ``t`` at the points, and ``sample(times)``. A warning says where
            more points would make it faster by more than 2 %, or where torques between the points exceed their limits.

        Raises:
            InputError: the path or the limits are unusable, or no motion keeps them; the message says where.
            BuildError: the model has no compiler (backend="numpy").
        """
        from rrrgen.runtime.timed_path import TimedPath

        if gravity is not None and not self.spec.gravity_input:
            self._check_beta("time_path", beta)
            return self.any_gravity.time_path(
                path, tau_max=tau_max, dq_max=dq_max, ddq_max=ddq_max, friction=friction, start=start, end=end,
                beta=beta, Ia=Ia, gravity=gravity,
            )  # fmt: skip
        if path.q.shape[1] != self.n:
            raise InputError(f"time_path: the path has {path.q.shape[1]} joints, {self.spec.name} has {self.n}")
        kernel = self._timing_kernel()
        given = {"tau_max": tau_max, "dq_max": dq_max, "ddq_max": ddq_max}
        limits = {name: self._bound(name, value) for name, value in given.items()}
        chosen = self.nominal_gravity if gravity is None else gravity
        values = self._parameters_for(kernel, {"beta": self._with_drives("time_path", beta, Ia), "gravity": chosen})
        losses = self._friction_for(friction)
        status, where, ds_dt, t, stretch = kernel.time(path, limits, losses, (start, end), values)
        if status:
            heavy = self._heavy(path.q[where], limits["tau_max"], values)
            raise InputError(f"time_path: {kernel.text(status)}: point {where}, s = {path.s[where]:.6g}{heavy}")
        shares = kernel.check(path, limits, losses, values, ds_dt)
        between = f"time_path: between the {len(path.s)} points of the path"
        if shares[0] > 1.0 + EXCESS:
            text = f"the torques exceed their limits by up to {100.0 * (shares[0] - 1.0):.0f} %: take more points"
            warnings.warn(f"{between} {text}", stacklevel=2)
        if stretch > 1.0 + EXCESS:
            text = f"the whole motion takes {100.0 * (stretch - 1.0):.0f} % longer: take more points"
            warnings.warn(f"{between} speeds or accelerations are largest, and {text}", stacklevel=2)
        return TimedPath(path, ds_dt, t, kernel.sample, stretch, shares)

    def _heavy(self, q: Any, tau_max: Any, values: dict[str, Any]) -> str:
        """Text for an error message: the joints whose torque limits cannot hold the arm at ``q`` against gravity."""
        g = self._evaluate("gravity", (q,), self._of_links(values["beta"]), gravity=values.get("gravity"))[0]
        each = zip(self.spec.joints, np.abs(g), tau_max, strict=True)
        found = [f"{joint.name} needs {need:.3g} and has {limit:.3g}" for joint, need, limit in each if need > limit]
        return f"; to hold the arm against gravity {', '.join(found)} N m (N)" if found else ""

    def _timing_kernel(self) -> TimingKernel:
        """The compiled kernel, built when it is first asked for."""
        if self._timing is None:
            from rrrgen.runtime.path_kernel import TimingKernel

            if self.engine.name != "c":
                raise BuildError("time_path runs compiled C, and this model was made with backend='numpy'")
            program = self._with("path_dynamics").derived.programs["path_dynamics"]
            friction = self._with("friction_with").derived.programs["friction_with"]
            real: Real = "double" if self.engine.dtype == np.float64 else "float"
            self._timing = TimingKernel(self.spec.name, program, friction, real)
        return self._timing

    def _bound(self, name: str, value: Any) -> Any:
        """Limits (n,) of the quantity ``name``: ``value``, or those of the robot file if it is None."""
        key = {"tau_max": "torque", "dq_max": "velocity", "ddq_max": "acceleration"}[name]
        if value is None:
            stated = [getattr(joint.limits, key) for joint in self.spec.joints]
            value = [np.inf if limit is None else limit for limit in stated]
        return self._vector(name, value, self.n)

    def _friction_for(self, friction: ArrayLike | None) -> Any:
        """Friction parameters (k,): ``friction``, or those of the robot file if it is None; None without friction."""
        values = self.friction_parameters if friction is None else friction
        checked = self._vector("friction", values, self.friction_parameters.size)
        return checked if np.any(checked) else None

    def _parameters_for(self, kernel: TimingKernel, given: dict[str, Any]) -> dict[str, Any]:
        """Check the ``given`` parameters; returns those that the path dynamics take."""
        program = self._with("path_dynamics").derived.programs["path_dynamics"]
        sizes = {port.name: port.size for port in program.inputs}
        return {name: self._vector(name, given[name], sizes[name]) for name in kernel.further}

    @staticmethod
    def _vector(name: str, value: Any, size: int) -> Any:
        array = np.asarray(value, dtype=float)
        if array.shape != (size,) or np.any(np.isnan(array)):
            raise ValueError(f"time_path: {name} must be {size} numbers, ({size},), not {array.shape}")
        return array
