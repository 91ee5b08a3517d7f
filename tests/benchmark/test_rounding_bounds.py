"""The count of states at which compiled code keeps its bounds: its table, and its exit status if a bound is wrong."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from bench.measurements import rounding_bounds as measurement
from rrrgen.verify.report import Row


@pytest.mark.parametrize(("share", "status"), [(0.9, 0), (1.1, 1)])
def test_an_error_beyond_its_bound_fails(share, status, monkeypatch):
    rows = [Row(name, "proven rounding bound", "box of limits", 50, share, 1.001, "a note") for name in ("f", "g")]
    monkeypatch.setattr(measurement.load, "compile", lambda *given: None)  # tests/evidence compare compiled code
    monkeypatch.setattr(measurement, "rounding_rows", lambda *given: (rows, [("h", "a reason")]))
    done = CliRunner().invoke(measurement.rounding_bounds, ["pendulum", "--states", "50"], standalone_mode=False)
    assert done.return_value == status
    assert f"50 states: {2 - 2 * status} of 2 functions within their bounds" in done.output
    assert "1 without a bound" in done.output
