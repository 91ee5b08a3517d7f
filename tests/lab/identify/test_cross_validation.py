"""Blocked cross-validation: the error of each part predicted by the others."""

from __future__ import annotations

import numpy as np
import pytest

from lab.identify.held_out_recording import LOGGED, TERMS, recording
from rrrgen.base.errors import InputError
from rrrgen.lab.identify.cross_validation import cross_validate
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options
from rrrgen.lab.identify.regressor import FullRegressor


def test_cross_validation_is_the_error_of_each_part_predicted_by_the_others(planar):
    """Against least squares by hand on the rows of the other parts; a fault in the last part shows there alone."""
    log = recording(planar, wrong=2.0)
    result = cross_validate(
        planar, [log], LOGGED, Options(method="ordinary", terms=TERMS, consistent=False, guard=0.0), 5
    )
    W = FullRegressor(planar, TERMS)(log.q, log.dq, log.ddq)
    start, duration = log.span
    for k, (score,) in enumerate(result.parts):
        out = Split("fold", k + 1.0, parts=5).is_scored(log.t, start, duration)
        x = np.linalg.lstsq(W[~out].reshape(-1, W.shape[-1]), log.tau[~out].ravel(), rcond=None)[0]
        error = log.tau[out] - W[out] @ x
        assert score.relative_error == pytest.approx(np.linalg.norm(error) / np.linalg.norm(log.tau[out]), rel=1e-6)
        assert score.joint_rms == pytest.approx(np.sqrt(np.mean(error**2, axis=0)), rel=1e-6)
    errors = [score.joint_rms[1] for (score,) in result.parts]
    assert errors[4] > 2 * max(errors[:4])
    total, joints = result.pooled_errors(0)
    assert total == pytest.approx(
        np.sqrt(np.sum((joints * np.linalg.norm(log.tau, axis=0)) ** 2)) / np.linalg.norm(log.tau)
    )
    *table, note = result.lines()
    assert len(table) == 2 + 5 + 1 + 2
    assert note.startswith("note: noise does not explain the held-out torque errors of cross-validation of q2 (")
    with pytest.raises(InputError, match="leave the split"):
        cross_validate(planar, [log], LOGGED, Options(split=Split.parse("first:0.5")), 5)
