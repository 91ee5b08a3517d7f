"""The kinds of measurements for calibration, with their residuals and the derivatives of these.

- pose: position (m) and orientation of the tip in the world frame;
- point: position only;
- distance: ``|p|`` of the tip from the origin of the world frame, the anchor of a ball bar or a draw wire;
- height: ``n . p`` of the tip along a known unit vector n, z of the world frame where none is given;
- plane, contact, wire: with a fixture of unknown place (:mod:`rrrgen.lab.calibrate.fixtures`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.calibrate.fixtures import KEYS, Fixture, FixtureKind, directions, fitted
from rrrgen.lab.calibrate.geometry import Entry, Geometry, rotation_vectors

Kind = Literal["pose", "point", "distance", "height", "plane", "contact", "wire"]
COUNT = {"pose": 6, "point": 3, "contact": 3, "distance": 1, "height": 1, "plane": 1, "wire": 1}
"""Number of components of one measurement, by its kind."""
Numbers = NDArray[np.int64]
FIXTURES: tuple[FixtureKind, ...] = get_args(FixtureKind)


@dataclass(frozen=True)
class Measurements:
    """Measurements of one ``kind`` at the joint positions ``q`` (N, n), rad or m.

    ``values`` are poses (N, 4, 4), points (N, 3), or lengths (N,); for contacts they are unused. ``sigma`` (m) and
    ``sigma_angle`` (rad) are the standard deviations of one component. ``normals`` (N, 3) are the directions of
    heights. ``fixture`` (N,) is the number of the fixture touched, of those called ``names``.
    """

    kind: Kind
    q: Array
    values: Array
    sigma: float
    sigma_angle: float
    normals: Array | None = None
    fixture: Numbers | None = None
    names: tuple[str, ...] = ()

    @property
    def weights(self) -> Array:
        """The weight of each component of one measurement: 1 over its standard deviation."""
        lengths = np.full(min(COUNT[self.kind], 3), 1.0 / self.sigma)
        return np.concatenate([lengths, np.full(3, 1.0 / self.sigma_angle)]) if self.kind == "pose" else lengths

    def of(self, rows: Numbers, q: Array) -> Measurements:
        """The measurements number ``rows`` (from 0), as if made at the joint positions ``q``."""
        normals = None if self.normals is None else self.normals[rows]
        fixture = None if self.fixture is None else self.fixture[rows]
        return replace(self, q=q, values=self.values[rows], normals=normals, fixture=fixture)

    def with_fixtures(self, geometry: Geometry) -> Geometry:
        """Add the unknown fixtures to ``geometry``, fitted to the positions that it computes."""
        if self.fixture is None:
            return geometry
        p = geometry.forward(self.q)[:, :3, 3]
        found = []
        for kind in (each for each in FIXTURES if each == self.kind):
            for k, name in enumerate(self.names):
                i = self.fixture == k
                found.append(fitted(kind, name, p[i], self.values[i]))
        return replace(geometry, fixtures=tuple(found))

    def residuals(self, geometry: Geometry) -> Array:
        """Measured minus computed, (N, components), in m and rad."""
        T = geometry.forward(self.q)
        p = T[:, :3, 3]
        if self.kind == "pose":
            turned = self.values[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
            return np.concatenate([self.values[:, :3, 3] - p, rotation_vectors(turned)], axis=1)
        if self.kind == "point":
            return np.asarray(self.values - p)
        if self.kind in FIXTURES:
            found = np.zeros((len(p), COUNT[self.kind]))
            for each, i in self._touched(geometry):
                found[i] = (0.0 if self.kind == "contact" else self.values[i, None]) - each.computed(p[i])
            return found
        computed = np.linalg.norm(p, axis=1) if self.kind == "distance" else np.sum(self._up(p)[:, 0] * p, axis=1)
        return np.asarray((self.values - computed)[:, None])

    def observed(self, geometry: Geometry, J: Array) -> Array:
        """Convert the derivative J (N, 6, p) of the tip to that of the measurements (N, components, p)."""
        if self.kind == "pose":
            return J
        if self.kind == "point":
            return np.asarray(J[:, :3])
        p = geometry.forward(self.q)[:, :3, 3]
        if self.kind in FIXTURES:
            by: Array = np.zeros((len(p), COUNT[self.kind], 3))
            for each, i in self._touched(geometry):
                by[i] = each.by_position(p[i])
        else:
            by = np.asarray(directions(p) if self.kind == "distance" else self._up(p))
        return np.asarray(by @ J[:, :3])

    def jacobian(self, geometry: Geometry, entries: Sequence[Entry]) -> Array:
        """Derivative (N, components, p) of the computed measurements by the parameters ``entries``, in m and rad."""
        J = self.observed(geometry, geometry.jacobian(self.q, entries))
        places = {(e.row, e.key): k for k, e in enumerate(entries) if e.place == "fixture"}
        if places:
            p = geometry.forward(self.q)[:, :3, 3]
            for number, (each, i) in enumerate(self._touched(geometry)):
                by = each.by_parameters(p[i])
                for k, key in enumerate(KEYS[each.kind]):
                    if (number, key) in places:
                        J[i, :, places[number, key]] = by[:, :, k]
        return J

    def _up(self, p: Array) -> Array:
        """The directions (N, 1, 3) of heights."""
        up = np.array([[0.0, 0.0, 1.0]]) if self.normals is None else self.normals
        return np.broadcast_to(up[:, None], (len(p), 1, 3))

    def _touched(self, geometry: Geometry) -> list[tuple[Fixture, Numbers]]:
        """Every fixture with the indices of the measurements that touched it."""
        return [(each, np.flatnonzero(self.fixture == k)) for k, each in enumerate(geometry.fixtures)]
