"""Observations: parts for the fit and the score, known friction subtracted, filters that are tuned."""

import numpy as np
import pytest

import rrrgen
from lab.identify.streams import PERIOD, PROCESSINGS, recording
from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log, read_log
from rrrgen.lab.estimate.regression import weighted_least_squares
from rrrgen.lab.identify.bandwidth import motion_bandwidth, tune
from rrrgen.lab.identify.factoring import factor_recordings
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Observations, RowMaker
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion


def test_splits_share_out_the_instants():
    t = 3.0 + 0.01 * np.arange(1000)
    assert np.sum(Split.parse("first:0.6").is_fitted(t, 3.0, 10.0)) == 600
    blocks = Split.parse("blocks:0.5").is_fitted(t, 3.0, 10.0)
    # instants within round-off of a border may fall on either side
    assert np.sum(blocks) == pytest.approx(500, abs=10)
    assert blocks[:49].all()
    assert not blocks[51:99].any()
    assert Split.parse("none").is_fitted(t, 3.0, 10.0).all()
    assert "same data" in str(Split())
    for text in ("first", "first:1.5", "blocks:0", "blocks:-1", "half", "none:3", "first:x", "first:1e"):
        with pytest.raises(InputError):
            Split.parse(text)


def test_known_friction_is_subtracted(tmp_path):
    path, regressor, x = recording(tmp_path)
    b = len(regressor.model.base_parameter_names)
    rigid = FullRegressor(regressor.model, DriveTerms())

    def friction(motion):
        return regressor(motion.q, motion.dq, motion.ddq)[..., b:] @ x[b:]

    maker = RowMaker(rigid, PROCESSINGS[1], b, known=friction)
    found = weighted_least_squares(factor_recordings(Observations((read_log(path),), maker)).fit, rigid.names)
    assert np.max(np.abs(found.x - x[:b]) / found.std) < 5


@pytest.mark.parametrize("method", [Processing("butterworth", cutoff=10.0, decimate=5), Processing("kalman")])
def test_rows_are_exact_from_the_first_to_the_last(method):
    """A motion that neither begins nor ends at rest: at its ends the filters know one side of it only."""
    model = rrrgen.compile("planar2r", backend="numpy")
    t = 0.01 * np.arange(3000)
    q, dq, ddq = fourier_motion(t, 2, 2, base=0.1, harmonics=5, size=0.5)
    log = Log(("a", "b"), t, np.round(q, 7), model.inverse_dynamics(q, dq, ddq), period=0.01)
    regressor = FullRegressor(model, DriveTerms())
    rows = list(Observations((log,), RowMaker(regressor, tune(method, [log]).processing, len(regressor.names))))
    error, tau = (np.concatenate(each) for each in ([r.tau - r.W @ model.beta for r in rows], [r.tau for r in rows]))
    instants = np.concatenate([r.t for r in rows])
    assert instants[0] < 0.5
    assert instants[-1] > 29.5
    assert np.max(np.abs(error)) < 5e-3 * np.sqrt(np.mean(tau**2))


def test_the_kalman_filter_is_tuned_when_nothing_is_said(tmp_path):
    path, regressor, x = recording(tmp_path)
    log = read_log(path)
    processing = tune(Processing("kalman"), [log]).processing
    assert len(processing.var_eta) == len(processing.var_xi) == 2
    again = tune(processing, [log])
    assert again.processing is processing
    assert again.by_rule == ()
    maker = RowMaker(regressor, processing, len(regressor.names))
    found = weighted_least_squares(factor_recordings(Observations((log,), maker)).fit, regressor.names)
    assert np.max(np.abs(found.x - x) / found.std) < 5


def test_the_decimation_follows_the_motion_when_nothing_is_said(tmp_path):
    path, _, _ = recording(tmp_path)
    log = read_log(path)
    found = tune(Processing(), [log]).processing
    rate = 1.0 / (PERIOD * found.decimate)
    assert 8 * motion_bandwidth(log.q, PERIOD) < rate < 25 * motion_bandwidth(log.q, PERIOD)
    assert tune(Processing("butterworth", cutoff=20.0, decimate=3), [log]).processing.decimate == 3
