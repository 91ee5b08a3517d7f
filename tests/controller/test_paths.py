"""Paths: checked, and splines through their waypoints with continuous curvature."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError


def test_paths_are_checked():
    s, q = np.linspace(0, 1, 5), np.zeros((5, 2))
    for wrong, text in ((s[::-1], "rising"), (s * np.nan, "not finite"), (s[:1], "rising")):
        with pytest.raises(InputError, match=text):
            rrrgen.Path(wrong, q, q, q)
    with pytest.raises(InputError, match=r"q_s must have shape \(N, n\) with N = 5"):
        rrrgen.Path(s, q, q[:4], q)
    with pytest.raises(InputError, match="waypoints 1 and 2"):
        rrrgen.spline_path([[0, 0], [1, 1], [1, 1]])
    with pytest.raises(InputError, match="at least two"):
        rrrgen.spline_path([[0, 0]])


def test_spline_goes_through_its_waypoints_with_continuous_curvature():
    from scipy.interpolate import CubicSpline

    w = np.random.default_rng(5).normal(size=(5, 3))
    path = rrrgen.spline_path(w, 801)
    steps = np.sqrt(np.linalg.norm(np.diff(w, axis=0), axis=1))
    knots = np.concatenate([[0], np.cumsum(steps)]) / np.sum(steps)
    spline = CubicSpline(knots, w, bc_type="natural")
    for found, order in ((path.q, 0), (path.q_s, 1), (path.q_ss, 2)):
        np.testing.assert_allclose(found, spline(path.s, order), atol=1e-9)
