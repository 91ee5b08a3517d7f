"""Instrumental variables from another period of the motion: bias found where there is one, silence elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.bias import check_bias
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion

TERMS = DriveTerms.everywhere(2, "viscous", "coulomb")
FRICTION = [0.8, 0.4, 1.5, 0.6]
PERIOD = 5.0


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile("planar2r", backend="numpy")


def checked(arm, position_noise, processing, seed=0, seconds=40.0, period=PERIOD):
    t = 0.01 * np.arange(round(seconds / 0.01))
    q, dq, ddq = fourier_motion(t, 2, 5, base=1 / PERIOD)
    rng = np.random.default_rng(seed)
    tau = FullRegressor(arm, TERMS)(q, dq, ddq) @ np.concatenate([arm.beta, FRICTION])
    log = Log(("q1", "q2"), t, q + position_noise * rng.normal(size=q.shape), tau + 0.1 * rng.normal(size=q.shape))
    found = identify(arm, [log], processing, Options(terms=TERMS, consistent=False, poses=2))
    truth = found.structure.G @ np.concatenate([arm.beta, FRICTION])
    return found, check_bias(found, [log], period), truth


def test_bias_from_noisy_accelerations_is_found_and_undone(arm):
    """Unfiltered differences of noisy positions: least squares shrinks the inertia, the instruments do not."""
    found, check, truth = checked(arm, 3e-4, Processing("differences", decimate=1))
    wrong, right = found.estimate.x - truth, found.estimate.x + check.difference - truth
    i = found.names.index(next(name for name in found.names if name.startswith("Izz")))
    assert abs(wrong[i]) > 0.05 * truth[i]
    assert abs(right[i]) < 0.2 * abs(wrong[i])
    assert i in check.significant
    assert "noise in the motion biases" in check.lines()[0]


def test_bias_where_accelerations_are_all_noise_is_found(arm):
    """The accelerations differ by far more than their size from period to period; the positions do not."""
    found, check, truth = checked(arm, 3e-3, Processing("differences", decimate=1))
    i = found.names.index(next(name for name in found.names if name.startswith("Izz")))
    assert abs(found.estimate.x[i] - truth[i]) > 0.5 * truth[i]
    assert check.significant


def test_a_bias_within_the_deviations_of_the_estimate_is_not_told(arm):
    _, check, _ = checked(arm, 3e-4, Processing("differences", decimate=1))
    assert check.significant
    assert not replace(check, scatter=2.0 * np.abs(check.difference)).significant


def test_sound_estimates_pass(arm):
    flagged = 0
    for seed in range(3):
        _, check, _ = checked(arm, 1e-5, Processing(), seed)
        flagged += len(check.significant)
        assert check.torque < 0.01
    assert flagged <= 1
    assert "no sign of bias" in check.lines()[0] or check.significant


def test_what_cannot_be_checked_is_refused(arm):
    with pytest.raises(InputError, match="no two periods of 30 s"):
        checked(arm, 1e-5, Processing(), seconds=20.0, period=30.0)
    with pytest.raises(InputError, match=r"does not repeat after 1\.7 s"):
        checked(arm, 1e-5, Processing(), period=1.7)
