"""Methods of a model that compute base parameters: from link parameters, and with a payload."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.runtime.arguments import joined
from rrrgen.runtime.functions.calls import Array, Calls

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
                "base_parameters", joined("base_parameters", self.engine.dtype, values, self.drive_inertia, sizes)
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
        """
        tensor, known = self._symmetric(inertia, beta, "add_payload_at")
        name = "add_payload_at" if tip is None else self._at_tip("add_payload_at", tip)
        return self._of_links(self._call(name, mass, com, tensor, frame, known))

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
