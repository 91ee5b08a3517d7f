"""The regressors of a model: torques as a matrix times the inertial parameters.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rrrgen.model.drive_columns import drive_columns
from rrrgen.model.drive_terms import DriveTerm, drive_terms
from rrrgen.runtime.functions.calls import Array, Calls

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.runtime.engines import Engine


class RegressorFunctions(Calls):
    """Regressors in base parameters, in standard parameters, and as identification uses them.

    Args:
        derived: the programs of the robot's functions, with its base parameters and their nominal values.
        engine: evaluates a program by its name, compiled or with NumPy.
    """

    def __init__(self, derived: DerivedModel, engine: Engine) -> None:
        super().__init__(derived, engine)
        self.base_parameter_names: tuple[str, ...] = tuple(p.name for p in derived.base_parameters)
        self._terms: tuple[DriveTerm, ...] = drive_terms(derived.spec)

    def regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Base regressor: ``tau = Y(q, dq, ddq) beta``, rigid body without drive inertia. Source: (14.10).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            Y, (..., n, b), in SI units; its columns belong to ``base_parameter_names``.
        """
        return self._of_links(self._evaluate("regressor", (q, dq, ddq), gravity=gravity)[0])

    def regressor_transpose(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        e: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Transposed base regressor times a vector, ``r = Y' e``, without forming Y: for adaptation. Source: (14.23).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            e: the vector, (..., n), in any unit, such as a tracking error.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            r, (..., b), in SI units times the unit of ``e``.
        """
        return self._of_links(self._evaluate("regressor_transpose", (q, dq, ddq, e), gravity=gravity)[0])

    def standard_regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Regressor of the standard parameters of all links: ``tau = Y(q, dq, ddq) phi``.

        phi lists, link by link, m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz: mass (kg), first moments (kg m) and
        inertia tensor (kg m^2, Ixy = -integral of x y dm) about the origin of the link frame, in its axes.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            Y, (..., n, 10 n), in SI units.
        """
        return self._of_links(self._evaluate("standard_regressor", (q, dq, ddq), gravity=gravity)[0])

    def identification_regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Base regressor followed by the columns of the drive inertia, friction and offset that the robot file states.

        ``tau = Y beta + Ia ddq + fv dq + fc sgn(dq) + offset``. These are the columns that `rrrgen identify` fits:
        sgn(dq) is 0 at speeds up to :data:`rrrgen.model.drive_columns.STANDSTILL`, where reconstructed speeds have no
        reliable sign.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.

        Returns:
            The wide regressor, (..., n, b + extra), in SI units; its columns belong to
            ``identification_parameter_names``.
        """
        Y = self.regressor(q, dq, ddq)
        drives = drive_columns(self._terms, np.asarray(dq, dtype=float), np.asarray(ddq, dtype=float))
        wide = np.broadcast_to(drives, (*Y.shape[:-1], len(self._terms)))
        return np.concatenate([Y, wide.astype(Y.dtype)], axis=-1)

    @property
    def identification_parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of :meth:`identification_regressor`: base parameters, then terms of the drives."""
        return (*self.base_parameter_names, *(term.name for term in self._terms))

    @property
    def identification_parameters(self) -> Array | None:
        """Nominal values of :attr:`identification_parameter_names` in SI units; None if the file has no links."""
        return None if self.beta is None else np.concatenate([self.beta, [term.value for term in self._terms]])
