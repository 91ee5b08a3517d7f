"""Standard deviations of the closed-loop estimate hold, fitted shapes of friction laws included."""

from __future__ import annotations

import numpy as np
import pytest

from lab.closed_loop.coverage import covered, deviations
from rrrgen.lab.closed_loop.output_error import OutputErrorProblem
from samples.disturbed_arm import DisturbedArm


def test_the_intervals_hold_the_truth():
    """Few recordings, so that the test is quick: `python tests/lab/closed_loop/coverage.py` makes many."""
    names, errors = deviations(DisturbedArm("exponential"), range(5), 4.0)
    assert "decay_speed1" in names
    assert covered(errors) >= 0.85
    assert 0.6 < np.sqrt(np.mean(errors**2)) < 1.4


def test_deviations_grow_where_a_shape_is_fitted_too(monkeypatch):
    """A shape with the correlation 0.8 of sensitivities leaves the fraction 1 - 0.8^2 of the information."""
    H = np.array([[4.0, 1.6, 0.0], [1.6, 1.0, 0.0], [0.0, 0.0, 9.0]])[np.ix_([0, 2, 1], [0, 2, 1])]
    monkeypatch.setattr(OutputErrorProblem, "_curvature_and_scatter", lambda self, fit: (H, H))
    work = OutputErrorProblem.__new__(OutputErrorProblem)
    assert work.spread_by_shapes(None, 2) == pytest.approx([1.0 / np.sqrt(1.0 - 0.8**2), 1.0])
