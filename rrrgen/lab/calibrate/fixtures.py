"""Fixtures of unknown place that the tip touches, or to which a wire leads: their parameters and start values.

- plane: unit normal n (3,) and offset c, the height ``n . p - c`` of the tip p is measured (0 where it touches);
- contact: a point P (3,) that the tip touches, ``p = P``;
- wire: anchor A (3,) and zero z of a draw wire, whose length ``|p - A| + z`` is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rrrgen.base.arrays import Array

FixtureKind = Literal["plane", "contact", "wire"]
KEYS: dict[FixtureKind, tuple[str, ...]] = {
    "plane": ("tilt1", "tilt2", "offset"),
    "contact": ("x", "y", "z"),
    "wire": ("x", "y", "z", "zero"),
}
"""Names of the parameters of a fixture: the normal of a plane turns towards two directions in the plane."""

ROUNDED = 1e-12  # share of |P|^2 below which a sum of products is rounding error


@dataclass(frozen=True)
class Fixture:
    """A fixture called ``name``; ``vector`` (3,) is its normal, point or anchor, ``offset`` (m) its offset or zero."""

    kind: FixtureKind
    name: str
    vector: Array
    offset: float = 0.0

    def computed(self, p: Array) -> Array:
        """Values (N, components) that the measurements would have with the tip at the positions ``p`` (N, 3), in m."""
        if self.kind == "plane":
            return np.asarray((p @ self.vector - self.offset)[:, None])
        if self.kind == "contact":
            return np.asarray(p - self.vector)
        return np.asarray(np.linalg.norm(p - self.vector, axis=1)[:, None] + self.offset)

    def by_position(self, p: Array) -> Array:
        """Derivative (N, components, 3) of :meth:`computed` by the positions ``p`` (N, 3)."""
        if self.kind == "plane":
            return np.broadcast_to(self.vector, (len(p), 1, 3))
        if self.kind == "contact":
            return np.broadcast_to(np.eye(3), (len(p), 3, 3))
        return directions(p - self.vector)

    def by_parameters(self, p: Array) -> Array:
        """Derivative (N, components, parameters) of :meth:`computed` by the parameters in the order of ``KEYS``."""
        ones = np.ones((len(p), 1, 1))
        if self.kind == "plane":
            return np.concatenate([(p @ self._tangents().T)[:, None], -ones], axis=2)
        if self.kind == "contact":
            return -self.by_position(p)
        return np.concatenate([-self.by_position(p), ones], axis=2)

    def moved(self, step: Mapping[str, float]) -> Fixture:
        """Add changes, by the names in ``KEYS``, to the parameters."""
        if self.kind == "plane":
            tilt = np.array([step.get("tilt1", 0.0), step.get("tilt2", 0.0)])
            normal = self.vector + tilt @ self._tangents()
            return replace(self, vector=normal / np.linalg.norm(normal), offset=self.offset + step.get("offset", 0.0))
        shift = np.array([step.get(key, 0.0) for key in ("x", "y", "z")])
        return replace(self, vector=self.vector + shift, offset=self.offset + step.get("zero", 0.0))

    def change_from(self, start: Fixture) -> dict[str, float]:
        """Parameters minus those of ``start``, by the names in ``KEYS``: those of :meth:`moved`, to first order."""
        vector, offset = self.vector - start.vector, self.offset - start.offset
        if self.kind == "plane":
            tilt1, tilt2 = start._tangents() @ vector
            return {"tilt1": float(tilt1), "tilt2": float(tilt2), "offset": offset}
        return dict(zip(("x", "y", "z"), map(float, vector), strict=True)) | {"zero": offset}

    def _tangents(self) -> Array:
        """Two unit vectors (2, 3) in the plane, at right angles."""
        first = np.cross(self.vector, np.eye(3)[int(np.argmin(np.abs(self.vector)))])
        first /= np.linalg.norm(first)
        return np.array([first, np.cross(self.vector, first)])


def directions(p: Array) -> Array:
    """Unit vectors (N, 1, 3) along ``p`` (N, 3), the derivative of its length."""
    return np.asarray((p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-12))[:, None])


def fitted(kind: FixtureKind, name: str, p: Array, values: Array) -> Fixture:
    """Fit a fixture to tip positions ``p`` (N, 3) and measured ``values`` (N,), in m, where the estimation starts."""
    centre = p.mean(axis=0)
    if kind == "contact":
        return Fixture(kind, name, centre)
    if kind == "plane":
        normal = _unit_regression(p - centre, values - values.mean())
        return Fixture(kind, name, normal, float(normal @ centre - values.mean()))
    # |p - A| = l - z squared: 2 A.p - 2 z l + (z^2 - |A|^2) = |p|^2 - l^2, linear in A, z and the bracket
    system = np.column_stack([2 * p, -2 * values, np.ones(len(p))])
    *anchor, zero, _ = np.linalg.lstsq(system, np.sum(p * p, axis=1) - values**2, rcond=None)[0]
    return Fixture(kind, name, np.array(anchor), float(zero))


def _unit_regression(P: Array, h: Array) -> Array:
    """The unit vector n that minimizes ``|P n - h|``, for P (N, 3) and h (N,).

    It is ``(P'P + k)^-1 P'h`` with the k for which its length is one, found by bisection. Where h is constant, P'h is
    zero, and n is the direction in which P varies least; its sign makes its largest component positive.
    """
    squares, axes = np.linalg.eigh(P.T @ P)
    b = axes.T @ (P.T @ h)
    b[np.abs(b) < ROUNDED * squares[-1]] = 0.0
    low, high = -squares[0], float(np.linalg.norm(b))
    for _ in range(200):
        middle = (low + high) / 2
        length = np.linalg.norm(b / np.maximum(squares + middle, 1e-300))
        low, high = (middle, high) if length > 1 else (low, middle)
    n = b / np.maximum(squares + high, 1e-300)
    missing = 1 - float(n @ n)
    if missing > 1e-6:  # even the least k is too large: the rest lies along the direction of least variation
        sign = 1.0 if axes[int(np.argmax(np.abs(axes[:, 0]))), 0] > 0 else -1.0
        n[0] += sign * np.sqrt(missing)
    found = axes @ n
    return np.asarray(found / np.linalg.norm(found))
