"""The virtual robot's mechanics against closed-form solutions, energy, and an independent integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lab.plant.masses import Masses, advance
from oracles import newton_euler
from oracles.random_robots import random_link
from rrrgen.base.errors import InputError
from rrrgen.lab.plant.friction import Friction
from rrrgen.lab.plant.integration import RigidIntegrator, StiffIntegrator, make_integrator
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints, make_plant
from rrrgen.robot.friction.models import coulomb_viscous


class OracleArm:
    """The independent Newton-Euler of an arm of two links with gravity."""

    def __init__(self, seed: int = 3) -> None:
        rng = np.random.default_rng(seed)
        rows = (("revolute", np.pi / 2, 0.1, 0.2, 0.3), ("revolute", 0.0, 0.4, 0.1, 0.0))
        self.robot = newton_euler.Robot("standard", rows, links=tuple(random_link(rng) for _ in rows))
        self.n = 2

    def mass_matrix(self, q, beta=None):
        return newton_euler.mass_matrix(self.robot, q)

    def inverse_dynamics(self, q, dq, ddq, beta=None):
        return newton_euler.inverse_dynamics(self.robot, q, dq, ddq)

    def energy(self, q, dq) -> float:
        return float(np.sum(newton_euler.energy(self.robot, q, dq)))


def test_rigid_steps_equal_a_tight_independent_integration() -> None:
    arm = OracleArm()
    plant = make_plant(arm, drive_inertia=[0.3, 0.05])
    tau = np.array([1.0, -0.4])
    start = np.array([0.2, -0.5, 0.7, -1.1])

    def rates(_, x):
        M = arm.mass_matrix(x[:2]) + np.diag([0.3, 0.05])
        return np.concatenate([x[2:], np.linalg.solve(M, tau - newton_euler.bias(arm.robot, x[:2], x[2:]))])

    expected = solve_ivp(rates, (0, 0.1), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    got = advance(RigidIntegrator(plant, 2), start, tau, 0.1)
    assert np.abs(got - expected).max() < 1e-9


def test_energy_is_kept_without_friction() -> None:
    arm = OracleArm()
    start = np.array([0.2, -0.5, 0.7, -1.1])
    end = advance(RigidIntegrator(make_plant(arm), 2), start, [0.0, 0.0], 0.15)
    # relative to the kinetic energy that is exchanged with the potential
    exchanged = np.ptp([newton_euler.energy(arm.robot, x[:2], x[2:])[0] for x in (start, end)])
    assert exchanged > 0.01
    assert abs(arm.energy(end[:2], end[2:]) - arm.energy(start[:2], start[2:])) < 1e-8 * exchanged


def test_stiff_and_rigid_integration_agree_away_from_rest() -> None:
    arm, friction = OracleArm(), Friction(coulomb_viscous([0.2, 0.1], [0.5, 0.2]))
    plant = make_plant(arm, friction=friction)
    start = np.array([0.2, -0.5, 2.0, -3.0])
    rigid = advance(RigidIntegrator(plant, 2), start, [0.5, 0.1], 0.05)
    stiff = advance(StiffIntegrator(plant), start, [0.5, 0.1], 0.05)
    assert np.abs(rigid - stiff).max() < 1e-6


# -- LuGre ---------------------------------------------------------------------------------------------------------


# -- flexibility ---------------------------------------------------------------------------------------------------


def test_flexible_joint_swings_at_its_two_mass_frequency() -> None:
    link, rotor, k = 0.3, 0.1, 400.0
    plant = make_plant(Masses([link]), joints=FlexibleJoints((rotor,), (k,), (0.0,)))
    state = plant.initial_state([0.0], [0.0])
    state[plant.layout["rotor"]] = 0.01
    omega = np.sqrt(k * (1 / link + 1 / rotor))
    integrator = make_integrator(plant)
    half = integrator.advance(state, np.zeros(1), np.pi / omega)
    twist = [float((x[plant.layout["rotor"]] - x[plant.layout["q"]])[0]) for x in (state, half)]
    assert twist[1] == pytest.approx(-twist[0], rel=1e-5)
    momentum = link * half[plant.layout["dq"]][0] + rotor * half[plant.layout["rotor_speed"]][0]
    assert abs(momentum) < 1e-8


def test_stiff_springs_approach_the_rigid_robot_with_drive_inertia() -> None:
    arm = OracleArm()
    rotors = (0.2, 0.05)
    rigid = advance(
        RigidIntegrator(make_plant(arm, drive_inertia=rotors), 2), np.array([0.2, -0.5, 0.0, 0.0]), [3.0, 1.0], 0.05
    )
    plant = make_plant(arm, joints=FlexibleJoints(rotors, (1e6, 1e6), (300.0, 100.0)))
    flexible = advance(make_integrator(plant), plant.initial_state([0.2, -0.5], [0.0, 0.0]), [3.0, 1.0], 0.05)
    moved = np.abs(rigid[:2] - [0.2, -0.5]).max()
    assert np.abs(plant.encoders(flexible) - rigid[:2]).max() < 5e-3 * moved


def test_springs_carry_the_links_at_the_start() -> None:
    plant = make_plant(Masses([0.3], [5.0]), joints=FlexibleJoints((0.1,), (1000.0,), (1.0,)))
    state = plant.initial_state([0.7], [0.0])
    assert plant.encoders(state)[0] == 0.7
    rates = plant.state_derivative()(state, 0.0, np.array([5.0]))
    assert np.abs(rates).max() < 1e-12


def test_flexible_base_has_the_frequency_response_of_the_chapter() -> None:
    """tau -> q1 is 1/(J s^2) + 1/(Jb s^2 + d s + k): anti-resonance, then a resonance at 28 Hz with phase lead."""
    J, base = 1.2, FlexibleBase(inertia=6.0, frequency=28.0, damping_ratio=0.1)
    plant = make_plant(Masses([J]), base=base)
    rates = plant.state_derivative()
    size = plant.initial_state([0.0], [0.0]).size
    A = np.array([rates(column, 0.0, np.zeros(1)) for column in np.eye(size)]).T
    b = rates(np.zeros(size), 0.0, np.ones(1))
    c = np.array([plant.encoders(column)[0] for column in np.eye(size)])
    for f in (1.0, 10.0, 25.0, 28.0, 40.0, 200.0):
        s = 2j * np.pi * f
        expected = 1 / (J * s**2) + 1 / (base.inertia * s**2 + base.damping * s + base.stiffness)
        got = c @ np.linalg.solve(s * np.eye(size) - A, b)
        assert abs(got - expected) < 1e-9 * abs(expected)
    s = 2j * np.pi * 24.0
    below = 1 / (J * s**2) + 1 / (base.inertia * s**2 + base.damping * s + base.stiffness)
    assert np.angle(below) % (2 * np.pi) > np.pi  # lead over the double integrator's -180 degrees


def test_faults_of_a_plant_are_input_errors() -> None:
    with pytest.raises(InputError):
        FlexibleJoints((0.1,), (0.0,), (0.0,))
    with pytest.raises(InputError):
        FlexibleBase(inertia=-1.0)
    with pytest.raises(InputError, match="rotor_inertia"):
        make_plant(Masses([1.0]), joints=FlexibleJoints((0.1,), (1.0,), (0.0,)), drive_inertia=[1.0])
    with pytest.raises(InputError, match="1 rotors for 2 joints"):
        make_plant(Masses([1.0, 1.0]), joints=FlexibleJoints((0.1,), (1.0,), (0.0,)))
