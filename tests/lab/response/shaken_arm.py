"""Recordings of planar2r with elastic joints, one joint excited at a time, and the truth: the differentiated plant."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import rrrgen
from rrrgen.base.arrays import Array
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.plant.controllers import BackwardDifference, pd_gains
from rrrgen.lab.plant.experiment import Instruments, VirtualRobot
from rrrgen.lab.plant.friction import Friction
from rrrgen.lab.plant.plant import FlexibleJoints, Plant, make_plant
from rrrgen.robot.friction.models import coulomb_viscous

SAMPLING, PERIOD, PERIODS = 1e-3, 1.0, 6
LOWEST, HIGHEST = 3, 64  # Hz, of the multisine
JOINTS = FlexibleJoints((0.4, 0.06), (9000.0, 2500.0), (1.5, 0.3))
VISCOUS = (0.3, 0.1)


def plant(coulomb: tuple[float, float] = (0.0, 0.0)) -> Plant:
    """The arm, its rotors with viscous friction, and Coulomb friction if asked for."""
    return make_plant(rrrgen.compile("planar2r"), joints=JOINTS, friction=Friction(coulomb_viscous(VISCOUS, coulomb)))


@cache
def experiment(
    posture: tuple[float, float], joint: int, coulomb: tuple[float, float] = (0.0, 0.0), noise: float = 0.02
) -> Log:
    """The arm held about ``posture``, a multisine added to the torque of ``joint``."""
    rng = np.random.default_rng([joint, round(100 * posture[1])])
    samples = round(PERIOD / SAMPLING)
    t = np.arange(samples) * SAMPLING
    tones = np.arange(LOWEST, HIGHEST) / PERIOD
    wave = np.cos(2 * np.pi * np.outer(t, tones) + rng.uniform(0, 2 * np.pi, len(tones))).sum(axis=1)
    excitation = np.zeros((samples * PERIODS, 2))
    excitation[:, joint] = np.tile(wave * (2.0, 0.6)[joint] / wave.std(), PERIODS)
    model = rrrgen.compile("planar2r")
    start = np.asarray(posture)
    inertia = np.diag(model.mass_matrix(start)) + np.asarray(JOINTS.rotor_inertia)
    instruments = Instruments(encoder_resolution=(1e-6, 1e-6), torque_noise=(noise, 0.3 * noise))

    def held(times: Array) -> tuple[Array, Array, Array]:
        still = np.zeros((len(times), 2))
        return still + start, still, still

    robot = VirtualRobot(plant(coulomb), instruments, SAMPLING)
    made = robot.run(
        held, PERIOD * PERIODS, pd_gains(inertia, 4.0), BackwardDifference(SAMPLING), seed=joint, excitation=excitation
    )
    return Log(("q1", "q2"), made.t, made.q, made.tau)


def truth(posture: Array, frequency: Array) -> tuple[Any, Array, Array]:
    """Response (L, 2, 2) of the arm at ``frequency`` (L,), and frequencies (Hz) and dampings of its two modes."""
    arm = plant()
    state = arm.initial_state(posture, np.zeros(2))
    tau, f, size = arm.body.bias(state[:2], np.zeros(2)), arm.state_derivative(), len(state)
    by_state, by_torque = 1e-6 * np.eye(size), 1e-6 * np.eye(2)
    A = np.column_stack([(f(state + h, 0.0, tau) - f(state - h, 0.0, tau)) / 2e-6 for h in by_state])
    B = np.column_stack([(f(state, 0.0, tau + h) - f(state, 0.0, tau - h)) / 2e-6 for h in by_torque])
    C = np.column_stack([(arm.encoders(state + h) - arm.encoders(state - h)) / 2e-6 for h in by_state])
    G = np.stack([C @ np.linalg.solve(2j * np.pi * each * np.eye(size) - A, B) for each in frequency])
    s = np.linalg.eigvals(A)
    s = s[np.argsort(np.abs(s))][s.imag[np.argsort(np.abs(s))] > 10.0]
    return G, np.abs(s) / (2 * np.pi), -s.real / np.abs(s)
