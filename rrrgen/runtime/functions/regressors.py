"""The regressor of a model as identification uses it: torques as a matrix times base parameters and drive terms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rrrgen.robot.model.drives import DriveTerm, drive_terms
from rrrgen.runtime.functions.calls import Array
from rrrgen.runtime.functions.table_functions import TableFunctions
from rrrgen.runtime.regressor_columns import drive_columns

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.runtime.engines import Engine


class RegressorFunctions(TableFunctions):
    """The regressor as identification uses it, with the columns of the drives.

    Args:
        derived: the programs of the robot's functions, with its base parameters and their nominal values.
        engine: evaluates a program by its name, compiled or with NumPy.
    """

    def __init__(self, derived: DerivedModel, engine: Engine) -> None:
        super().__init__(derived, engine)
        self.base_parameter_names: tuple[str, ...] = tuple(p.name for p in derived.base_parameters)
        self._terms: tuple[DriveTerm, ...] = drive_terms(derived.spec)

    def identification_regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Base regressor followed by the columns of the drive inertia, friction and offset that the robot file states.

        ``tau = Y beta + Ia ddq + fv dq + fc sgn(dq) + offset``. These are the columns that `rrrgen identify` fits:
        sgn(dq) is 0 at speeds up to :data:`rrrgen.runtime.regressor_columns.STANDSTILL`, where reconstructed speeds
        have no reliable sign.

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
