"""The checks of a model: functions that raise, answer nonsense or are not there fail, and none is left out."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rrrgen.verify import verify
from verify.distorted import DERIVATIVES, Broken, Without


def test_a_model_that_raises_or_answers_nonsense_fails_without_ending_the_run(complete):
    def refuse(_):
        raise ArithmeticError("M is singular")

    refusing = verify(Broken(complete, "forward_dynamics", refuse), samples=2, libraries=False)
    assert "M is singular" in refusing.to_text()
    assert len(refusing.rows) == len(verify(complete, samples=2, libraries=False).rows)
    shape = verify(Broken(complete, "gravity", lambda g: g[..., :2]), samples=2, libraries=False)
    assert "shape (2, 2) instead of (2, 3)" in shape.to_text()
    undefined = verify(Broken(complete, "jacobian", lambda J: J * np.nan), samples=2, libraries=False)
    assert [row.function for row in undefined.failures] == ["jacobian"]
    row = next(r for r in json.loads(undefined.to_json())["rows"] if r["verdict"] == "fail")
    assert row["max_relative_difference"] is None
    silent = verify(Broken(complete, "mass_matrix", refuse), samples=2, libraries=False)
    assert {"mass_matrix", "identities"} <= {row.function for row in silent.failures}
    assert [name for name, _ in silent.skipped] == ["inverse_kinematics"]


SOME = ["forward_kinematics", "kinematics", "mass_matrix", "regressor", "energy", "friction", *DERIVATIVES]


@pytest.mark.parametrize("name", SOME)
def test_a_function_that_is_not_there_fails_and_nothing_of_ours_is_left_out(complete, whole, name):
    """A check of our own that cannot be made is a failure; only libraries may be left out."""
    report = verify(Without(complete, name), samples=1, libraries=False)
    assert not report.ok
    assert any(name in row.function for row in report.failures), report.to_text()
    assert f"no function {name}" in report.to_text()
    assert [name for name, _ in report.skipped] == ["inverse_kinematics"]  # the oracle solves none
    assert {row.function for row in whole.rows if row.reference != "identity"} <= {row.function for row in report.rows}
