"""Methods of a model around its parameters: base parameters and payloads, friction, the regressor of identification."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.program import Port, Role
from rrrgen.robot.model.drives import DriveTerm, drive_terms
from rrrgen.runtime.arguments import join_parameters, prepare, read_only
from rrrgen.runtime.functions.calls import Array, Calls
from rrrgen.runtime.functions.table_functions import TableFunctions
from rrrgen.runtime.regressor_columns import drive_columns

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.runtime.engines import Engine


ASYMMETRY = 1e-9
"""Largest difference between mirrored entries of an inertia tensor, relative to its largest entry."""


class ParameterFunctions(Calls):
    """Conversion of standard to base parameters, and payloads."""

    def base_parameters_of(self, phi: ArrayLike) -> Array:
        """Base parameters ``beta = K phi`` of given links; in C and CasADi ``base_parameters``.

        Args:
            phi: standard parameters of all links, (..., 10 links) or (links, 10): per link m, mx, my, mz, Ixx, Ixy,
                Iyy, Ixz, Iyz, Izz, kg, kg m and kg m^2, first moments and inertia tensor about the origin of the link
                frame, in its axes. A mechanism has a link for every row.

        Returns:
            beta, (..., b), in SI units.

        Raises:
            ValueError: phi has another shape.
        """
        values, links = np.asarray(phi), self.derived.links
        if values.shape == (links, 10) and links > 1:  # of one link: a batch of one
            values = values.reshape(-1)
        if values.shape[-1:] != (10 * links,):
            shapes = f"({links}, 10) or (..., {10 * links})"
            raise ValueError(f"base_parameters: phi has shape {values.shape}, expected {shapes}: ten values per link")
        if self.drive_inertia is None:
            return self._call("base_parameters", values)
        sizes = (10 * links, self.drive_inertia.size)
        return self._of_links(
            self._call(
                "base_parameters",
                join_parameters("base_parameters", self.engine.dtype, values, self.drive_inertia, sizes),
            )
        )

    def add_payload(
        self,
        mass: ArrayLike,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        *,
        beta: ArrayLike | None = None,
        tip: str | None = None,
    ) -> Array:
        """Base parameters of the robot with a body fixed to its last link, to be passed as ``beta`` to other methods.

        Further bodies are added one by one; a negative mass with the negative tensor removes a body again.

        Args:
            mass: mass of the body, (...), kg.
            com: its centre of mass, (..., 3), m, in the frame of the last link, ``link_frames(q)[-1]``, which is
                the one before the tool.
            inertia: its inertia tensor about that centre, (..., 3, 3), kg m^2, in the axes of the same frame; zero by
                default, a point mass.
            beta: base parameters without the body, (b,) or (..., b), SI units; by default those of the robot file.
            tip: a named tip of the robot file, whose link carries the body, in place of the unnamed one.

        Returns:
            beta_loaded, (..., b), in SI units.

        Raises:
            ValueError: the tensor is not symmetric, or the robot file has no links and ``beta`` is not given.
        """
        name = "add_payload" if tip is None else self._at_tip("add_payload", tip)
        return self._of_links(self._call(name, mass, com, *self._symmetric(inertia, beta, "add_payload")))

    def add_payload_at(
        self,
        mass: ArrayLike,
        com: ArrayLike,
        inertia: ArrayLike | None,
        frame: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        tip: str | None = None,
    ) -> Array:
        """Base parameters of the robot with a body fixed to its last link; the body is described in its own frame.

        Args:
            mass: mass of the body, (...), kg.
            com: its centre of mass, (..., 3), m, in its own frame.
            inertia: its inertia tensor about that centre, (..., 3, 3), kg m^2, in the axes of its own frame; None for a
                point mass.
            frame: pose of its frame in the last link, (..., 4, 4), translation in m.
            beta: base parameters without the body, (b,) or (..., b), SI units; by default those of the robot file.
            tip: a named tip of the robot file, whose link carries the body, in place of the unnamed one.

        Returns:
            beta_loaded, (..., b), in SI units.

        Raises:
            ValueError: as for :meth:`add_payload`.
            InputError: the frame is no rigid motion.
        """
        tensor, known = self._symmetric(inertia, beta, "add_payload_at")
        name = "add_payload_at" if tip is None else self._at_tip("add_payload_at", tip)
        return self._of_links(self._call(name, mass, com, tensor, self._rigid("frame", frame), known))

    def _symmetric(self, inertia: Any, beta: Any, function: str) -> tuple[Any, Any]:
        """Check the arguments of a payload ``function``: returns the inertia tensor (default zero) and beta.

        Raises ValueError if the tensor is not symmetric, or if neither ``beta`` nor links are given.
        """
        parameters = self._with_drives(function, beta)
        tensor = np.zeros((3, 3)) if inertia is None else np.asarray(inertia)
        if tensor.shape[-2:] != (3, 3):
            raise ValueError(f"{function}: inertia must be a tensor (3, 3) or (..., 3, 3), got shape {tensor.shape}")
        if np.max(np.abs(tensor - np.swapaxes(tensor, -1, -2))) > ASYMMETRY * np.max(np.abs(tensor)):
            raise ValueError(f"{function}: the inertia tensor is not symmetric")
        return tensor, parameters


# ------------------------------------------------------------------------------------------------------------------
# Friction as the robot file states it: torques, zero where it states none, and the parameters at run time.
# ------------------------------------------------------------------------------------------------------------------


class FrictionFunctions(TableFunctions):
    """Friction of the robot file, and its parameters."""

    def friction(self, dq: ArrayLike, tau_load: ArrayLike | None = None) -> Array:
        """Friction torques of the laws of the robot file, such as ``tau_f = fv dq + fc sgn(dq) + offset``.

        They add to the torques of the rigid body. Laws with a state are taken in steady sliding. Coupled motors add
        ``S^-T tau_fm(S^-1 dq)``, the laws at their shafts. Source: (14.11)-(14.14).

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            tau_load: torques without friction, (..., n), N m or N, as of :meth:`inverse_dynamics`; needed where a law
                depends on the load.

        Returns:
            tau_f, (..., n), N m or N; zero where the file states no friction.

        Raises:
            ValueError: a law depends on the load and ``tau_load`` is missing.
        """
        if "friction" in self.derived.programs:
            return self._call("friction", dq, *self._loads("friction", tau_load))
        port = Port("dq", (self.n,), meaning="joint velocities", role=Role.VELOCITY)
        return np.zeros_like(prepare("friction", [port], [dq], self.engine.dtype)[1][0])

    @property
    def friction_parameter_names(self) -> tuple[str, ...]:
        """Names of the friction parameters at run time, such as q1_viscous, q1_coulomb, q1_offset."""
        return tuple(name for name, _ in friction_parameters(self.spec))

    @cached_property
    def friction_parameters(self) -> Array:
        """Friction parameters (k,) of the robot file, SI units, in the order of their names; 0 if the file has none."""
        return read_only(np.array([float(value) for _, value in friction_parameters(self.spec)]))


# ------------------------------------------------------------------------------------------------------------------
# The regressor of a model as identification uses it: torques as a matrix times base parameters and drive terms.
# ------------------------------------------------------------------------------------------------------------------


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
