"""The kinds of measurements for calibration, with their residuals and the derivatives of these:

- pose: position (m) and orientation of the tip in the world frame;
- point: position only;
- distance: ``|p|`` of the tip from the origin of the world frame, the anchor of a ball bar or a draw wire;
- height: ``z`` of the tip over the plane z = 0 of the world frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rrrgen.arrays import Array
from rrrgen.calibrate.geometry import Geometry, rotation_vectors

Kind = Literal["pose", "point", "distance", "height"]
KINDS: tuple[Kind, ...] = ("pose", "point", "distance", "height")
COUNT = {"pose": 6, "point": 3, "distance": 1, "height": 1}
"""Number of components of one measurement, by its kind."""


@dataclass(frozen=True)
class Measurements:
    """Measurements of one ``kind`` at the joint positions ``q`` (N, n), rad or m.

    ``values`` are poses (N, 4, 4), points (N, 3), or distances or heights (N,). ``sigma`` (m) and ``sigma_angle`` (rad)
    are the standard deviations of one component.
    """

    kind: Kind
    q: Array
    values: Array
    sigma: float
    sigma_angle: float

    @property
    def weights(self) -> Array:
        """The weight of each component of one measurement: 1 over its standard deviation."""
        lengths = np.full(min(COUNT[self.kind], 3), 1.0 / self.sigma)
        return np.concatenate([lengths, np.full(3, 1.0 / self.sigma_angle)]) if self.kind == "pose" else lengths

    def residuals(self, geometry: Geometry) -> Array:
        """Measured minus computed, (N, components), in m and rad."""
        T = geometry.forward(self.q)
        p = T[:, :3, 3]
        if self.kind == "pose":
            turned = self.values[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
            return np.concatenate([self.values[:, :3, 3] - p, rotation_vectors(turned)], axis=1)
        if self.kind == "point":
            return np.asarray(self.values - p)
        computed = np.linalg.norm(p, axis=1) if self.kind == "distance" else p[:, 2]
        return np.asarray((self.values - computed)[:, None])


def observed(kind: Kind, geometry: Geometry, q: Array, J: Array) -> Array:
    """Convert the derivative J (N, 6, p) of the tip by p parameters to that of the measurements (N, components, p)."""
    if kind == "pose":
        return J
    if kind == "point":
        return np.asarray(J[:, :3])
    if kind == "height":
        return np.asarray(J[:, 2:3])
    p = geometry.forward(q)[:, :3, 3]
    direction = p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-12)
    return np.asarray(np.einsum("ni,nip->np", direction, J[:, :3])[:, None])
