"""Sampled joint paths q(s), and cubic splines through waypoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Path:
    """A path q(s) in joint space, sampled at N points of the path parameter s.

    ``s`` (N,) rises, in any unit; ``q`` (N, n) are the joint positions, rad or m, ``q_s`` and ``q_ss`` (N, n) their
    first and second derivatives by s. Raises :class:`rrrgen.base.errors.InputError` for arrays that do not fit
    together.
    """

    s: Array
    q: Array
    q_s: Array
    q_ss: Array

    def __post_init__(self) -> None:
        for name in ("s", "q", "q_s", "q_ss"):
            values = np.array(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if not np.all(np.isfinite(values)):
                raise InputError(f"path: {name} has numbers that are not finite")
        if self.s.ndim != 1 or len(self.s) < 2 or not np.all(np.diff(self.s) > 0.0):
            raise InputError("path: s must be at least two rising numbers, (N,)")
        for name in ("q", "q_s", "q_ss"):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape != (len(self.s), *self.q.shape[1:]):
                raise InputError(f"path: {name} must have shape (N, n) with N = {len(self.s)} points, not {shape}")


def spline_path(waypoints: ArrayLike, points: int = 1000) -> Path:
    """The cubic spline through waypoints, with continuous curvature, as a path.

    The parameter s is 0 at the first waypoint and 1 at the last, between them in proportion to the square root of the
    distances of the waypoints, which avoids loops. At the ends the curvature q'' is zero.

    Args:
        waypoints: joint positions, (k, n), rad or m, k at least 2; neighbours must differ.
        points: N, the number of points of the path, at least 2.

    Returns:
        The path, with N points equally spaced in s.

    Raises:
        InputError: fewer than two waypoints, or neighbours that are equal.
    """
    w = np.asarray(waypoints, dtype=float)
    if w.ndim != 2 or len(w) < 2 or not np.all(np.isfinite(w)):
        raise InputError(f"waypoints must be at least two rows of finite joint positions, (k, n), not {w.shape}")
    if points < 2:
        raise InputError(f"a path has at least two points, not {points}")
    steps = np.sqrt(np.linalg.norm(np.diff(w, axis=0), axis=1))
    if not np.all(steps > 0.0):
        raise InputError(f"waypoints {int(np.argmin(steps))} and {int(np.argmin(steps)) + 1} (from 0) are equal")
    knots = np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps)
    curve, h = _curvatures(knots, w), np.diff(knots)[:, None]
    s = np.linspace(0.0, 1.0, points)
    k = np.minimum(np.searchsorted(knots, s, side="right") - 1, len(h) - 1)
    after = (s - knots[k])[:, None]
    before, h = h[k] - after, h[k]
    left, right = curve[k] / (6.0 * h), curve[k + 1] / (6.0 * h)
    start, end = w[k] / h - left * h**2, w[k + 1] / h - right * h**2
    q = left * before**3 + right * after**3 + start * before + end * after
    q_s = 3.0 * (right * after**2 - left * before**2) + end - start
    return Path(s, q, q_s, 6.0 * (left * before + right * after))


def _curvatures(knots: Array, values: Array) -> Array:
    """Second derivatives (k, n) at the ``knots`` (k,) of the natural cubic spline through ``values`` (k, n)."""
    h = np.diff(knots)
    A = np.eye(len(knots))
    slopes = np.diff(values, axis=0) / h[:, None]
    right = np.zeros_like(values)
    for i in range(1, len(knots) - 1):
        A[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = 6.0 * (slopes[i] - slopes[i - 1])
    return np.linalg.solve(A, right)
