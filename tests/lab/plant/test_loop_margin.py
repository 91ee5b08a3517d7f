"""The margin of sampled loops, against closed forms and simulations that know nothing of it."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.plant.controllers import BackwardDifference, DeviationFilter, ReferenceMotion
from rrrgen.lab.plant.loop_margin import SampledArm, torque_noise
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints

TS = 1e-3


def kalman(period: float, poles: float) -> DeviationFilter:
    m = kalman_matrices(period, 1.0, poles**6)
    return DeviationFilter(m.E, m.k)


def growth(masses, kp, kd, observer, delay: int, samples: int = 4000) -> float:
    """Growth per sample of a deviation, by running the observer itself against the exact steps of ``M ddq = tau``."""
    n = len(kp)
    e, de = np.full(n, 1e-3) * np.arange(1, n + 1), np.zeros(n)
    zero = ReferenceMotion(np.zeros(n), np.zeros(n), np.zeros(n))
    waiting = [np.zeros(n)] * delay
    observer.start(e, zero)
    sizes, inverse = [], np.linalg.inv(masses)
    for _ in range(samples):
        q, dq = observer.update(e, zero)
        waiting = [*waiting, -kp * q - kd * dq]
        ddq = inverse @ waiting.pop(0)
        e, de = e + TS * de + 0.5 * TS**2 * ddq, de + TS * ddq
        sizes.append(np.linalg.norm(np.concatenate([e, TS * de])))
        if sizes[-1] > 1e100:
            break
    half = len(sizes) // 2
    return float((max(sizes[-50:]) / max(sizes[half - 50 : half])) ** (1.0 / (len(sizes) - half)))


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("poles", [None, 200.0, 1500.0])
def test_the_largest_pole_is_how_fast_a_simulated_deviation_grows(delay: int, poles: float | None) -> None:
    """Two joints of which one is light: stable and unstable loops alike; 1 % of what a sample grows or decays."""
    masses = np.array([[1.0, 0.3], [0.3, 0.15]])  # its lightest direction has a sixteenth of the inertia of joint 1
    omega = 2 * np.pi * 4.0
    kp, kd = np.diag(masses) * omega**2, 2 * np.diag(masses) * omega
    observer = BackwardDifference(TS) if poles is None else kalman(TS, poles)
    arm = SampledArm.at(masses[None], None, None, TS, delay=delay, slowest=4.0)
    margin = arm.margin(observer.feedback(kp, kd))
    seen = growth(masses, kp, kd, observer, delay)
    assert margin.radius == pytest.approx(seen, abs=0.01 * abs(seen - 1.0) + 2e-5)
    assert margin.unstable == (seen > 1.0)
    assert (margin.modulus < 0.0) == margin.unstable


def test_the_margin_of_one_joint_is_its_distance_from_minus_one() -> None:
    """A double integrator under PD with backward differences, its response written out."""
    J, kp, kd = 0.7, 900.0, 40.0
    found = SampledArm.at(np.array([[[J]]]), None, None, TS, delay=2, slowest=4.0).margin(
        BackwardDifference(TS).feedback([kp], [kd])
    )
    z = np.exp(1j * np.linspace(1e-3, np.pi, 200_001))
    L = (kp + kd * (1 - 1 / z) / TS) * z**-2 * TS**2 * (z + 1) / (2 * J * (z - 1) ** 2)
    assert found.modulus == pytest.approx(np.abs(1 + L).min(), rel=0.01)  # the grid of the margin is 5 % apart
    assert found.radius < 1.0


def test_coupled_joints_have_the_margin_of_their_worst_direction() -> None:
    """Equally fast joints: along the eigenvectors of M relative to the gains, the loops are those of one joint each."""
    rng = np.random.default_rng(4)
    A = rng.normal(size=(4, 4))
    masses = A @ A.T + 0.05 * np.eye(4)
    gains = np.diag(masses)
    omega, observer = 2 * np.pi * 4.0, kalman(TS, 2000.0)
    kp, kd = gains * omega**2, 2 * gains * omega
    together = SampledArm.at(masses[None], None, None, TS, slowest=4.0).margin(observer.feedback(kp, kd))
    alone = [
        SampledArm.at(np.array([[[inertia]]]), None, None, TS, slowest=4.0).margin(
            observer.feedback([omega**2], [2 * omega])
        )
        for inertia in np.linalg.eigvalsh(masses / np.sqrt(np.outer(gains, gains)))
    ]
    worst = min(alone, key=lambda margin: margin.modulus)
    assert together.modulus == pytest.approx(worst.modulus, rel=1e-6)
    assert together.frequency == pytest.approx(worst.frequency)
    assert together.radius == pytest.approx(max(margin.radius for margin in alone), rel=1e-9)


def test_behind_stiff_springs_the_arm_is_a_rigid_one_and_soft_ones_matter() -> None:
    masses, rotors = np.array([[[0.8, 0.1], [0.1, 0.2]]]), np.array([0.3, 0.1])
    kp, kd = np.array([600.0, 200.0]), np.array([40.0, 14.0])
    feedback = kalman(TS, 1000.0).feedback(kp, kd)

    def margin(stiffness: float, base: FlexibleBase | None = None):
        joints = FlexibleJoints(tuple(rotors), (stiffness,) * 2, (stiffness * 1e-3,) * 2)
        return SampledArm.at(masses, joints, base, TS, slowest=4.0).margin(feedback)

    rigid = SampledArm.at(masses + np.diag(rotors), None, None, TS, slowest=4.0).margin(feedback)
    assert margin(1e8).modulus == pytest.approx(rigid.modulus, rel=0.01)
    heavy_base = FlexibleBase(inertia=1e6, frequency=28.0)
    assert margin(1e8, heavy_base).modulus == pytest.approx(rigid.modulus, rel=0.01)
    assert margin(1e3).modulus < 0.95 * rigid.modulus


def test_the_noise_of_the_torque_is_that_of_a_filtered_white_sequence() -> None:
    """Standard deviation of the output over 200 000 samples of noise, known to 1 %."""
    system = kalman(TS, 500.0).feedback([900.0], [40.0])[0]
    output = system.run(np.random.default_rng(1).normal(size=200_000))
    assert torque_noise(system) == pytest.approx(output.std(), rel=0.02)
