"""Sampled control and instruments of the virtual robot, and the record it leaves."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.plant.controllers import PD, BackwardDifference, ComputedTorque, DeviationFilter, pd_gains
from rrrgen.lab.plant.experiment import Instruments, VirtualRobot
from rrrgen.lab.plant.friction import Friction
from rrrgen.lab.plant.plant import RigidBody, make_plant
from rrrgen.lab.plant.recording_files import write_recording
from rrrgen.robot.friction.models import coulomb_viscous

TS = 1e-3
FRICTION = coulomb_viscous([2.0, 0.8, 0.3], [4.0, 1.5, 0.7])


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("rrr")


@pytest.fixture(scope="module")
def motion() -> FourierTrajectory:
    rng = np.random.default_rng(0)
    return FourierTrajectory(rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), 0.5)


def gains(model) -> PD:
    return pd_gains(np.diag(model.mass_matrix(np.zeros(3))), 4.0)


def observer() -> DeviationFilter:
    m = kalman_matrices(TS, 1e-10 / 12, 30.0**2)
    return DeviationFilter(m.E, m.k)


def run(model, motion, instruments=None, seed=1, duration=0.4, **options):
    robot = VirtualRobot(make_plant(model, friction=Friction(FRICTION)), instruments or Instruments())
    return robot.run(motion.evaluate, duration, gains(model), observer(), seed=seed, **options)


def test_the_recorded_torque_is_the_torque_that_moved_the_robot(model, motion) -> None:
    """Inverse dynamics of the true motion, second differences for the acceleration, explains the record."""
    rec = run(model, motion)
    inner = slice(1, -1)
    ddq = (rec.true_q[2:] - 2 * rec.true_q[1:-1] + rec.true_q[:-2]) / TS**2
    rigid = model.inverse_dynamics(rec.true_q[inner], rec.true_dq[inner], ddq)
    residual = rec.tau[inner] - rigid - FRICTION.torque(rec.true_dq[inner])
    same_sign = np.all(rec.true_dq[:-2] * rec.true_dq[2:] > 0, axis=1)  # at rest friction is whatever holds the joint
    assert same_sign.mean() > 0.8
    assert np.abs(residual[same_sign]).max() < 2e-3 * np.abs(rec.tau).max()
    # recorded at the begin of the sample it would be half a sample off, several times as much
    late = run(model, motion, Instruments(torque_record="command"))
    shifted = late.tau[inner] - rigid - FRICTION.torque(rec.true_dq[inner])
    assert np.std(shifted[same_sign]) > 3 * np.std(residual[same_sign])


def test_the_same_seed_gives_the_same_recording(model, motion) -> None:
    noisy = Instruments(torque_noise=(0.1, 0.1, 0.1), disturbance=(0.05, 0.05, 0.05), encoder_resolution=(1e-5,) * 3)
    first, again, other = (run(model, motion, noisy, seed, 0.05) for seed in (7, 7, 8))
    for name in ("q", "tau", "true_q", "true_tau"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.tau, other.tau)
    assert not np.array_equal(first.true_q, other.true_q)


def test_instruments_quantise_saturate_and_add_the_noise_they_state(model, motion) -> None:
    instruments = Instruments(
        encoder_resolution=(1e-3, 1e-3, 2e-3),
        torque_limit=(9.0, 12.0, 5.0),
        torque_resolution=(0.5, 0.5, 0.25),
        torque_noise=(0.3, 0.2, 0.1),
        torque_record="command",
    )
    rec = run(model, motion, instruments)
    counts = rec.q / np.array([1e-3, 1e-3, 2e-3])
    assert np.abs(counts - np.round(counts)).max() < 1e-6
    assert np.abs(rec.q - rec.true_q).max() <= 1e-3 * (1 + 1e-9)
    steps = rec.true_tau / np.array([0.5, 0.5, 0.25])
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    assert rec.saturated.any()
    assert np.all(np.abs(rec.true_tau) <= instruments.torque_limit)
    assert np.all(
        np.abs(rec.true_tau)[rec.saturated] == np.broadcast_to(instruments.torque_limit, rec.q.shape)[rec.saturated]
    )
    noise = rec.tau - rec.true_tau
    # 400 samples: the standard deviation is known to 3.5 %
    assert noise.std(axis=0) == pytest.approx([0.3, 0.2, 0.1], rel=0.15)


def test_computed_torque_with_the_true_model_tracks_where_pd_lags(model, motion) -> None:
    """(14.34): nothing is left but the delay of the hold; PD alone lags by the whole load over kp."""
    robot = VirtualRobot(make_plant(model, friction=Friction(FRICTION)))
    stiff = (2 * np.pi * 4.0) ** 2
    for along in (False, True):
        controller = ComputedTorque(
            RigidBody(model), (stiff,) * 3, (2 * np.sqrt(stiff),) * 3, friction=FRICTION, along_reference=along
        )
        rec = robot.run(motion.evaluate, 0.4, controller, observer())
        assert np.abs(rec.true_q - rec.reference).max() < 2e-3
    lagging = robot.run(motion.evaluate, 0.4, gains(model), observer())
    assert np.abs(lagging.true_q - lagging.reference).max() > 2e-2


def test_backward_difference_is_half_a_sample_late(model, motion) -> None:
    difference = BackwardDifference(TS)
    from rrrgen.lab.plant.controllers import ReferenceMotion

    t = np.arange(50) * TS
    q, dq, ddq = motion.evaluate(t)
    difference.start(q[0], ReferenceMotion(q[0], dq[0], ddq[0]))
    seen = np.array([difference.update(q[k], ReferenceMotion(q[k], dq[k], ddq[k]))[1] for k in range(50)])
    expected = motion.derivative(t - TS / 2, 1)
    assert np.abs(seen[1:] - expected[1:]).max() < 1e-5 * np.abs(expected).max()


def test_the_filter_reproduces_a_deviation_without_noise() -> None:
    """Constant acceleration of the deviation is inside the model: the filter converges to it exactly."""
    from rrrgen.lab.plant.controllers import ReferenceMotion

    m = kalman_matrices(TS, 1e-6, 1e4)
    watcher = DeviationFilter(m.E, m.k)
    zero = ReferenceMotion(np.zeros(2), np.zeros(2), np.zeros(2))
    t = np.arange(4000) * TS
    e = np.column_stack([0.1 + 0.5 * t**2, -0.2 * t])
    watcher.start(e[0], zero)
    seen = [watcher.update(row, zero) for row in e]
    assert np.abs(seen[-1][0] - e[-1]).max() < 1e-9
    assert np.abs(seen[-1][1] - [t[-1], -0.2]).max() < 1e-6


def test_injected_excitation_and_another_start(model, motion) -> None:
    shake = np.zeros((50, 3))
    shake[:, 2] = 0.5
    plain, shaken = (run(model, motion, duration=0.05, excitation=x) for x in (np.zeros((50, 3)), shake))
    assert (shaken.true_tau - plain.true_tau)[5, 2] > 0.2
    rec = run(model, motion, duration=0.01, start=(np.ones(3), np.zeros(3)))
    assert np.array_equal(rec.true_q[0], np.ones(3))


def test_a_runaway_and_an_empty_experiment_are_said_to_be_so(model, motion) -> None:
    wild = PD((1e9,) * 3, (0.0,) * 3)
    with pytest.raises(DerivationError, match="ran away"), np.errstate(all="ignore"):
        VirtualRobot(make_plant(model)).run(motion.evaluate, 2.0, wild, observer())
    with pytest.raises(InputError, match="fewer than two samples"):
        run(model, motion, duration=1e-3)


def test_progress_is_reported(model, motion) -> None:
    seen = []
    run(model, motion, duration=1.0, progress=lambda done, total, message: seen.append((done, total)))
    assert seen == [(500, 1000), (1000, 1000)]


def test_recordings_read_back_through_the_front_door(model, motion, tmp_path) -> None:
    from rrrgen.lab.data.recordings import read_log

    instruments = Instruments(torque_limit=(60.0, 30.0, 15.0))
    rec = run(model, motion, instruments, duration=0.2)
    names = [joint.name for joint in model.spec.joints]
    log, mapping = write_recording(tmp_path, "excitation", rec, joints=names, instruments=instruments)
    for source in (log, mapping):
        read = read_log(source)
        assert read.joints == tuple(names)
        assert np.array_equal(read.q, rec.q)
        assert np.array_equal(read.tau, rec.tau)
        assert read.period == pytest.approx(TS, rel=1e-9)
    again = tmp_path / "again"
    assert write_recording(again, "excitation", rec, joints=names)[0].read_bytes() == log.read_bytes()
    with pytest.raises(InputError, match="3 names"):
        write_recording(tmp_path, "x", rec, joints=["a"])
