"""The extended Kalman filter of a joint finds the parameters of torques that are computed here."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.lab.friction.candidate_laws import candidates
from rrrgen.lab.friction.joint_recording import JointData
from rrrgen.lab.friction.kalman_filter import kalman_estimates

PERIOD = 1e-3
TRUTH = {"inertia": 0.3, "gravity_cos": 0.5, "viscous": 0.8, "coulomb": 1.2, "delay": 0.0}
"""With a constant torque, which the first gravity coefficient is at a joint whose weight does not turn."""


def recorded() -> JointData:
    """Sines of a joint with a constant torque, Coulomb and viscous friction and noise of the torque, of 20 s."""
    random = np.random.default_rng(3)
    t = np.arange(20_000) * PERIOD
    q, dq, ddq = np.zeros((3, len(t)))
    for f in (0.2, 0.7, 1.3, 2.1):
        w, phase = 2 * np.pi * f, random.uniform(0, 2 * np.pi)
        q += 0.6 / w * np.sin(w * t + phase)
        dq += 0.6 * np.cos(w * t + phase)
        ddq -= 0.6 * w * np.sin(w * t + phase)
    tau = TRUTH["gravity_cos"] + TRUTH["inertia"] * ddq + TRUTH["viscous"] * dq + TRUTH["coulomb"] * np.sign(dq)
    tau += 0.05 * random.normal(size=len(t))
    return JointData("q1", PERIOD, np.round(q / 1e-5) * 1e-5, tau, np.ones(len(t), bool), ((0, len(t)),), 1e-5)


def test_one_pass_finds_inertia_and_friction_from_values_that_are_a_third_off():
    law = next(each for each in candidates(0) if each.name == "coulomb_viscous")
    truth = np.array([TRUTH[name] for name in law.names])
    start = truth * np.where(np.array(law.names) == "coulomb", 0.7, 1.3)
    (found,) = kalman_estimates([law], [start], recorded())
    assert found == pytest.approx(truth, rel=0.05)


def test_a_filter_that_diverges_keeps_the_start():
    law = next(each for each in candidates(0) if each.name == "coulomb_viscous")
    start = np.array([{**TRUTH, "inertia": 3.0}[name] for name in law.names])
    (found,) = kalman_estimates([law], [start], recorded())
    assert found == pytest.approx(start)
