"""Scores, labels and verdicts of a validation on data with known errors."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import Decimator, Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.validation import (
    Thresholds,
    column_model,
    joint_scores,
    noise_gain,
    plot_torques,
    robot_model,
    validate,
    validate_recordings,
)

NAMES = ("shoulder", "elbow")


def case(error: float = 0.0, noise: float = 0.0, seed: int = 0, N: int = 4000):
    """Torques 3 q and 2 dq + ddq; the model is off by the factor 1 + error, the measurement by noise."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, N, 2))
    motion = SimpleNamespace(t=np.arange(N) * 1e-3, q=q, dq=dq, ddq=ddq)
    truth = np.column_stack([3 * q[:, 0], 2 * dq[:, 1] + ddq[:, 1]])
    measured = truth + noise * rng.normal(size=truth.shape)
    model = lambda q, dq, ddq: (1 + error) * np.column_stack([3 * q[:, 0], 2 * dq[:, 1] + ddq[:, 1]])  # noqa: E731
    return model, motion, measured


def test_a_perfect_model_scores_zero_and_passes() -> None:
    result = validate(*case(), joints=NAMES)
    assert result.relative_error < 1e-15
    assert result.passed
    assert [s.joint for s in result.joints] == list(NAMES)
    assert result.joints[0].samples == 4000


def test_known_errors_are_measured() -> None:
    model, motion, measured = case(error=0.02)
    result = validate(model, motion, measured, joints=NAMES)
    assert result.relative_error == pytest.approx(0.02, rel=1e-9)
    for i, score in enumerate(result.joints):
        assert score.relative_error == pytest.approx(0.02, rel=1e-9)
        assert score.rms_torque == pytest.approx(np.sqrt(np.mean(measured[:, i] ** 2)), rel=1e-12)
        assert score.max_error == pytest.approx(0.02 * np.abs(measured[:, i]).max(), rel=1e-9)
        assert score.beyond_noise is None
    _, _, elbow = joint_scores(result, ["N m", "N m"])
    assert elbow.split()[0] == "elbow"
    assert "2 %" in elbow


def test_what_noise_explains_is_taken_off() -> None:
    model, motion, measured = case(error=0.03, noise=0.5, N=200_000)
    score = validate(model, motion, measured, joints=NAMES, noise=[0.5, 0.5]).joints[0]
    assert score.relative_error > 0.1
    assert score.beyond_noise == pytest.approx(0.03, rel=0.1)  # 200 000 samples of noise know its variance to 0.3 %
    perfect = validate(*case(noise=0.5), joints=NAMES, noise=[0.6, 0.6])
    assert all(s.beyond_noise == 0.0 for s in perfect.joints)


def test_samples_can_be_left_out_joint_by_joint() -> None:
    model, motion, measured = case()
    measured = measured.copy()
    measured[:100, 1] += 50.0
    used = np.ones(measured.shape, bool)
    used[:100, 1] = False
    assert validate(model, motion, measured, joints=NAMES, used=used).relative_error < 1e-15
    assert not validate(model, motion, measured, joints=NAMES).passed
    with pytest.raises(InputError, match="elbow"):
        validate(model, motion, measured, joints=NAMES, used=np.column_stack([used[:, 0], np.zeros(4000, bool)]))


def test_what_is_left_out_is_told() -> None:
    model, motion, measured = case()
    measured[:1000, 0] += 5.0
    used = np.ones(measured.shape, bool)
    used[:1000, 0] = False
    first, second = validate(model, motion, measured, joints=NAMES, used=used).joints
    assert (first.share, second.share) == (0.75, 1.0)
    assert first.relative_error < 1e-15
    assert first.relative_error_all == pytest.approx(5 * np.sqrt(1000) / np.linalg.norm(measured[:, 0]))
    assert second.relative_error_all < 1e-15


def test_every_threshold_can_fail_and_says_so() -> None:
    model, motion, measured = case(error=0.02)
    strict = Thresholds(
        relative_error=0.01,
        joint_relative_error=0.015,
        beyond_noise=0.001,
        indefinite_share=0.0,
        require_held_out=True,
    )
    result = validate(
        model,
        motion,
        measured,
        joints=NAMES,
        noise=[0.0, 0.0],
        label="its own data",
        indefinite=0.25,
        thresholds=strict,
    )
    assert not result.passed
    text = "\n".join(result.failures)
    for part in ("2 % exceeds 1 %", "shoulder: relative", "elbow: error beyond noise", "indefinite", "its own data"):
        assert part in text
    assert result.indefinite_share == 0.25
    data = result.to_json()
    assert data["passed"] is False
    assert data["scored_on"] == "its own data"
    assert len(data["joints"]) == 2


def test_nan_never_passes() -> None:
    model, motion, measured = case()
    bad = lambda q, dq, ddq: model(q, dq, ddq) * np.nan  # noqa: E731
    assert not validate(bad, motion, measured, joints=NAMES).passed


def test_only_data_known_to_be_held_out_pass_as_such() -> None:
    strict = Thresholds(require_held_out=True)
    assert validate(*case(), joints=NAMES, thresholds=strict, label="held-out data").passed
    for label in ("its own data", "partly its own data", "data of unknown origin"):
        failed = validate(*case(), joints=NAMES, thresholds=strict, label=label)
        assert failed.failures == (f"the model is scored on {label}",)
    assert validate(*case(), joints=NAMES).label == "data of unknown origin"


def test_shapes_that_do_not_match_are_faults() -> None:
    model, motion, measured = case()
    with pytest.raises(InputError, match="shape"):
        validate(model, motion, measured[:, :1], joints=NAMES[:1])


def test_recordings_are_scored_behind_the_filters_of_identification() -> None:
    """A smooth motion with noisy torque: the filter takes the noise it says it takes, and the model's error stays."""
    t = np.arange(20_000) * 1e-3
    q = np.column_stack([np.sin(3 * t), np.cos(2 * t)])
    dq, ddq = np.column_stack([3 * np.cos(3 * t), -2 * np.sin(2 * t)]), -q * np.array([9.0, 4.0])
    tau = 2.0 * ddq + 0.5 * dq + 0.4 * np.random.default_rng(0).normal(size=q.shape)
    recording = Log(NAMES, t, q, tau, dq, ddq, period=1e-3)
    model = lambda q, dq, ddq: 1.01 * (2.0 * ddq + 0.5 * dq)  # noqa: E731
    for decimate in (1, 10):
        processing = Processing(method="logged", decimate=decimate, low_speed=(0.1, 0.1))
        result = validate_recordings(model, [recording], processing, noise=[0.4, 0.4])
        assert len(result.t) == 20_000 // decimate
        assert 0.85 < result.used.mean() < 0.99
        if decimate == 10:
            # 2000 samples know the variance of the noise to 3 %, so 1 % of error shows within a tenth of itself
            assert [s.beyond_noise for s in result.joints] == pytest.approx([0.01, 0.01], rel=0.3)
    plain = np.random.default_rng(1).normal(size=(100_000, 1))
    assert Decimator(10)(plain)[50:-50].std() == pytest.approx(noise_gain(10), rel=0.03)
    assert noise_gain(1) == 1.0


def test_models_of_torque() -> None:
    import rrrgen

    model = rrrgen.compile("rrr")
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 5, 3))
    both = column_model(model.regressor, model.beta)(q, dq, ddq), robot_model(model)(q, dq, ddq)
    assert np.abs(both[0] - both[1]).max() < 1e-12 * np.abs(both[1]).max()


def test_figure_has_the_torque_and_the_residual_of_every_joint_in_panels_of_their_own() -> None:
    result = validate(*case(0.1), joints=NAMES)
    figure = plot_torques(result, units=("N m", "N"))
    assert [axis.get_ylabel() for axis in figure.axes] == [
        f"{NAMES[0]} [N m]",
        "residual\n[N m]",
        f"{NAMES[1]} [N]",
        "residual\n[N]",
    ]
    assert "elbow" in figure.axes[2].get_title(loc="left")
    drawn = figure.axes[1].lines[0].get_ydata()
    used = result.used[:, 0]
    np.testing.assert_allclose(drawn[used], (result.measured - result.predicted)[used, 0])
