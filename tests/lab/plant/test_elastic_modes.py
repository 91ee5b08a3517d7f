"""Vibrations by mass matrix and stiffness, against closed forms and the differentiated plant of the virtual robot."""

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.plant.elastic_modes import elastic_modes
from rrrgen.lab.plant.friction import Friction
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints, make_plant
from rrrgen.robot.friction.models import coulomb_viscous

JOINTS = FlexibleJoints((0.8, 0.25, 0.06), (1.45e5, 1.2e5, 4e4), (14.0, 8.0, 3.0))
BASE = FlexibleBase(12.0, 28.0, 0.1)


def test_two_masses_have_their_closed_form():
    M, J, K, D = 1.2, 0.8, 1.45e5, 14.0
    (mode,) = elastic_modes(np.array([[M]]), 0, FlexibleJoints((J,), (K,), (D,)), None)
    reduced = M * J / (M + J)
    omega = np.sqrt(K / reduced)
    assert mode.frequency == pytest.approx(omega / (2 * np.pi), rel=1e-9)
    assert mode.damping == pytest.approx(D / (2 * reduced * omega), rel=1e-9)
    # rotor over acceleration of the rigid whole: 1/s^2 + (M/J)/(s^2 + ..)
    assert mode.peak == pytest.approx(M / J / (2 * mode.damping), rel=0.01)


def test_a_flexible_base_alone_shows_at_its_own_frequency():
    (mode,) = elastic_modes(np.array([[1.2]]), 0, None, BASE)
    assert (mode.frequency, mode.damping) == (pytest.approx(28.0), pytest.approx(0.1))
    with pytest.raises(InputError, match="no vibration"):
        elastic_modes(np.eye(1), 0, None, None)


def test_modes_are_those_of_the_virtual_robot():
    """Eigenvalues of the differentiated equations of motion, gravity and centrifugal terms included."""
    model = rrrgen.compile("rrr")
    plant = make_plant(model, friction=Friction(coulomb_viscous((0.0,) * 3, (0.0,) * 3)), joints=JOINTS, base=BASE)
    q = np.array([0.3, 0.4, 1.1])
    state = plant.initial_state(q, np.zeros(3))
    tau, f = plant.body.bias(q, np.zeros(3)), plant.state_derivative()
    steps = 1e-6 * np.eye(len(state))
    A = np.column_stack([(f(state + h, 0.0, tau) - f(state - h, 0.0, tau)) / 2e-6 for h in steps])
    values = np.linalg.eigvals(A)
    values = values[values.imag > 10.0]
    truth = np.abs(values) / (2 * np.pi)
    M = model.mass_matrix(q)
    found = {round(mode.frequency, 6): mode for i in range(3) for mode in elastic_modes(M, i, JOINTS, BASE)}
    assert len(found) == 4
    for mode in found.values():
        nearest = int(np.argmin(np.abs(truth - mode.frequency)))
        assert mode.frequency == pytest.approx(truth[nearest], rel=2e-4)
        assert mode.damping == pytest.approx(-values[nearest].real / np.abs(values[nearest]), rel=2e-3)


def test_loops_of_the_other_joints_hold_their_drives():
    M = np.array([[1.2, 0.4], [0.4, 0.5]])
    joints = FlexibleJoints((0.8, 0.3), (1.4e5, 0.9e5), (5.0, 3.0))
    free = elastic_modes(M, 0, joints, None)
    held = elastic_modes(M, 0, joints, None, (0.0, 200.0))
    assert len(free) == len(held) == 2
    assert abs(free[0].frequency / held[0].frequency - 1.0) > 0.02
