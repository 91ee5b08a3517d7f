"""Elastic joints of the virtual robot, whose truth is known: from encoders at the motors, and at the links too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import fftconvolve

import rrrgen
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.elastic_joints import identify_elastic_joints, kernels
from rrrgen.lab.plant.controllers import BackwardDifference, pd_gains
from rrrgen.lab.plant.experiment import Instruments, VirtualRobot
from rrrgen.lab.plant.friction import Friction
from rrrgen.lab.plant.plant import FlexibleJoints, make_plant
from rrrgen.robot.friction.models import coulomb_viscous
from samples.recordings import fourier_motion

PERIOD = 5e-4
FASTEST = 45.0  # Hz, of the multisine
STIFFNESS, DAMPING, ROTOR = (9000.0, 2500.0), (1.5, 0.3), (0.4, 0.06)
VISCOUS, COULOMB = (0.3, 0.1), (0.6, 0.2)


def recorded(
    seconds: float = 4.0, joints: FlexibleJoints | None = None, resolution: float = 5e-6, seed: int = 1
) -> Log:
    """planar2r under PD control through many postures, excited by a multisine: positions at the motors, torques."""
    model = rrrgen.compile("planar2r")
    plant = make_plant(model, joints=joints, friction=Friction(coulomb_viscous(VISCOUS, COULOMB)))
    rng = np.random.default_rng(seed)
    count = round(seconds / PERIOD)
    t = np.arange(count) * PERIOD
    tones = np.arange(1.0, FASTEST, 0.5)
    excitation = np.empty((count, 2))
    for column, size in zip(excitation.T, (6.0, 1.2), strict=True):
        column[:] = np.cos(2 * np.pi * np.outer(t, tones) + rng.uniform(0, 2 * np.pi, len(tones))).sum(axis=1)
        column *= size / column.std()
    robot = VirtualRobot(plant, Instruments(encoder_resolution=(resolution,) * 2), PERIOD)
    inertia = np.diag(model.mass_matrix([0.3, 0.8])) + ROTOR
    made = robot.run(
        lambda times: fourier_motion(times, 2, seed=4),
        seconds,
        pd_gains(inertia, 4.0),
        BackwardDifference(PERIOD),
        seed=seed,
        excitation=excitation,
    )
    return Log(("q1", "q2"), made.t, made.q, made.tau)


@pytest.fixture(scope="module")
def log() -> Log:
    return recorded(joints=FlexibleJoints(ROTOR, STIFFNESS, DAMPING))


@pytest.fixture(scope="module")
def found(log):
    return identify_elastic_joints(rrrgen.compile("planar2r"), [log], bandwidth=40.0)


def test_derivatives_of_the_filter_are_exact() -> None:
    t = np.arange(-2000, 2001) * 1e-3
    bank, w = kernels(20.0, 1e-3), 2 * np.pi * 6.0
    for order, kernel in enumerate(bank):
        passed = [np.convolve(wave(w * t), kernel, mode="valid") for wave in (np.cos, np.sin)]
        turned = (passed[0] + 1j * passed[1]) / np.exp(1j * w * t[len(kernel) // 2 : -(len(kernel) // 2)])
        gain = turned.mean()
        assert np.abs(turned - gain).max() < 1e-9 * abs(gain)
        if order == 0:
            flat = gain
            assert abs(flat - 1.0) < 2e-3  # far below the bandwidth
        np.testing.assert_allclose(gain, flat * (1j * w) ** order, rtol=1e-8)
    middle = np.convolve(np.cos(2 * np.pi * 20.0 * t), bank[0], mode="valid")
    assert np.abs(middle).max() == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_means_of_held_torques_are_those_that_act() -> None:
    """The mean over a sample of a torque that is held from sample to sample, against the one that moves the arm.

    The motion sees the integral of the steps; the lines beside it, around multiples of the rate, pass no filter.
    """
    rate, f, fine = 500.0, 60.0, 64
    k = np.arange(2000)
    held = np.exp(2j * np.pi * f * k / rate)
    recorded_mean = 0.5 * (held + np.roll(held, 1))
    acting = np.repeat(held, fine)
    t = np.arange(len(acting)) / (rate * fine) + 0.5 / (rate * fine)
    wave = np.mean(acting * np.exp(-2j * np.pi * f * t))  # of the same frequency within the steps
    kernel = kernels(60.0, 1.0 / rate, held=True)[0]
    passed = [np.convolve(part, kernel, mode="valid") for part in (recorded_mean.real, recorded_mean.imag)]
    at = k[len(kernel) // 2 : -(len(kernel) // 2)] / rate
    found = np.mean((passed[0] + 1j * passed[1])[1:] / np.exp(2j * np.pi * f * at[1:]))
    assert found == pytest.approx(wave * np.sqrt(0.5), rel=1e-3)


def test_the_truth_is_found_from_the_motors_alone(found) -> None:
    truth = np.column_stack([STIFFNESS, DAMPING, ROTOR, VISCOUS, COULOMB])
    got, std = found.values[:, :5], found.std[:, :5]
    np.testing.assert_allclose(got[:, [0, 2]], truth[:, [0, 2]], rtol=0.01)
    assert np.abs(got - truth)[:, [1, 3, 4]] == pytest.approx(0.0, abs=0.1 * truth[:, [1, 3, 4]].max())
    assert (std[:, 0] < 0.01 * got[:, 0]).all()
    assert (np.abs(got - truth)[:, 2] < 3.0 * std[:, 2]).all()  # five, where the mean over a sample was left in
    beta = rrrgen.compile("planar2r").beta
    np.testing.assert_allclose(found.beta, beta, atol=0.01 * np.abs(beta).max())
    assert (found.error < 0.03).all()
    assert (found.rigid_error > 4 * found.error).all()
    assert "stiffness: " in "\n".join(found.lines())


@pytest.mark.parametrize(
    ("robot", "seconds", "resolution"),
    [("pendulum", 4.0, 5e-6), ("rrr", 4.0, 5e-6), pytest.param("puma560", 8.0, 1e-6, marks=pytest.mark.sweep)],
)
def test_deviations_of_stiffness_damping_and_rotor_are_honest_on_arms_of_any_size(
    robot: str, seconds: float, resolution: float
) -> None:
    """D/K is 0.4 ms here, a lag of 6 degrees at 40 Hz.

    To first order in it, K and J were 20 deviations off; to second order, D was 1 % too small, 16 deviations.
    """
    model = rrrgen.compile(robot)
    n, rng = model.n, np.random.default_rng(3)
    q, dq, ddq = fourier_motion(np.arange(0.0, 4.0, 0.01), n, seed=4)
    inertia = np.mean([np.diag(model.mass_matrix(x)) for x in q], axis=0)
    rotor, locked = inertia * rng.uniform(0.4, 1.0, n), 2.0 * np.pi * 15.0 * rng.uniform(0.8, 1.4, n)
    stiffness = locked**2 * inertia
    damping = 0.04 * stiffness / locked
    torque = 0.05 * np.sqrt(np.mean(np.asarray(model.inverse_dynamics(q, dq, ddq)) ** 2, axis=0))
    friction = Friction(coulomb_viscous(tuple(torque / np.sqrt(np.mean(dq**2, axis=0))), tuple(torque)))
    plant = make_plant(model, joints=FlexibleJoints(tuple(rotor), tuple(stiffness), tuple(damping)), friction=friction)
    t = np.arange(round(seconds / PERIOD)) * PERIOD
    tones = np.arange(1.0, FASTEST, 0.5)
    phases = rng.uniform(0.0, 2.0 * np.pi, (n, len(tones)))
    excitation = np.stack([np.cos(2.0 * np.pi * np.outer(t, tones) + each).sum(axis=1) for each in phases], axis=1)
    made = VirtualRobot(plant, Instruments(encoder_resolution=(resolution,) * n), PERIOD).run(
        lambda times: fourier_motion(times, n, seed=4),
        seconds,
        pd_gains(inertia + rotor, 4.0),
        BackwardDifference(PERIOD),
        seed=1,
        excitation=8.0 * (inertia + rotor) * excitation / excitation.std(axis=0),
    )
    names = tuple(joint.name for joint in model.spec.joints)
    found = identify_elastic_joints(model, [Log(names, made.t, made.q, made.tau)])
    truth = np.column_stack([stiffness, damping, rotor])
    got, std = found.values[:, :3], found.std[:, :3]
    np.testing.assert_allclose(got, truth, rtol=0.02)
    np.testing.assert_allclose(got[:, [0, 2]], truth[:, [0, 2]], rtol=0.004)
    assert (np.abs(got - truth) < 3.0 * std).all()


def test_positions_of_the_links_confirm_it(log) -> None:
    """Noisy readings of the links, at the positions that follow from the truth: q = theta - c tau_t."""
    model = rrrgen.compile("planar2r")
    low_pass = kernels(60.0, PERIOD)[0][:, None]
    q = log.q
    for _ in range(3):  # tau_t depends on q in turn, but hardly
        dq = np.gradient(q, PERIOD, axis=0)
        torque = model.inverse_dynamics(q, dq, np.gradient(dq, PERIOD, axis=0))
        q = log.q - fftconvolve(torque, low_pass, mode="same", axes=0) / STIFFNESS
    link = replace(log, q=q + 2e-6 * np.random.default_rng(3).normal(size=q.shape), tau=None)
    both = identify_elastic_joints(model, [log], [link], bandwidth=30.0)
    np.testing.assert_allclose(both.values[:, 0], STIFFNESS, rtol=0.02)


def test_rigid_joints_are_said_to_be_stiff() -> None:
    stiff = FlexibleJoints(ROTOR, tuple(1e4 * k for k in STIFFNESS), tuple(1e2 * d for d in DAMPING))
    with pytest.raises(DerivationError, match=r"no joint shows that it is elastic: .* q1 above \d"):
        identify_elastic_joints(rrrgen.compile("planar2r"), [recorded(2.0, stiff)], bandwidth=40.0)


def test_what_cannot_be_used_is_refused(log) -> None:
    model = rrrgen.compile("planar2r")
    for logs, links, bandwidth, words in (
        ([replace(log, tau=None)], [], None, "no torques"),
        ([log], [log, log], None, "2 recordings of link positions beside 1"),
        ([log], [replace(log, t=log.t + 1.0)], None, "not recorded at the times of the rotors"),
        ([log], [], 500.0, r"must lie between 0 and 333"),
        ([replace(log, t=log.t[:500], q=log.q[:500], tau=log.tau[:500])], [], 20.0, "too short|too few"),
    ):
        with pytest.raises(InputError, match=words):
            identify_elastic_joints(model, logs, links, bandwidth)
    with pytest.raises(InputError, match="3"):
        identify_elastic_joints(rrrgen.compile("rrr"), [log])


def test_a_recording_at_rest_is_refused(log) -> None:
    still = replace(log, q=np.zeros_like(log.q), tau=np.zeros_like(log.q))
    with pytest.raises(DerivationError, match="all torques of the recording are zero"):
        identify_elastic_joints(rrrgen.compile("planar2r"), [still], bandwidth=40.0)
    driven = replace(log, q=np.zeros_like(log.q))
    with pytest.raises(DerivationError, match="no joint moves"):
        identify_elastic_joints(rrrgen.compile("planar2r"), [driven], bandwidth=40.0)
