"""The virtual robot's mechanics against closed-form solutions, energy, and an independent integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from oracles import newton_euler
from oracles.random_robots import random_link
from rrrgen.base.errors import InputError
from rrrgen.lab.plant.friction import Friction, MotorFriction
from rrrgen.lab.plant.integration import RigidIntegrator, StiffIntegrator, make_integrator
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints, make_plant
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel, MixedFriction, coulomb_viscous

STEP = 1e-3


class Masses:
    """n uncoupled inertias in a constant field: ddq = (tau - weight)/J, joint by joint."""

    def __init__(self, inertia: list[float], weight: list[float] | None = None) -> None:
        self.J = np.array(inertia)
        self.weight = np.zeros(len(inertia)) if weight is None else np.array(weight)
        self.n = len(inertia)

    def mass_matrix(self, q, beta=None):
        return np.diag(self.J)

    def inverse_dynamics(self, q, dq, ddq, beta=None):
        return self.J * ddq + self.weight


class Coupled(Masses):
    """A constant, coupled mass matrix."""

    M = np.array([[2.0, 0.8], [0.8, 0.5]])

    def __init__(self) -> None:
        super().__init__([2.0, 0.5])

    def mass_matrix(self, q, beta=None):
        return self.M

    def inverse_dynamics(self, q, dq, ddq, beta=None):
        return self.M @ ddq


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


def advance(integrator, state, tau, duration: float, step: float = STEP):
    for _ in range(round(duration / step)):
        state = integrator.advance(state, np.asarray(tau, dtype=float), step)
    return state


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


def test_coulomb_friction_stops_a_mass_where_the_formula_says_and_holds_it() -> None:
    J, level, speed = 0.5, 2.0, 1.3
    plant = make_plant(Masses([J]), friction=Friction(coulomb_viscous([0.0], [level])))
    state = advance(RigidIntegrator(plant, 2), np.array([0.0, speed]), [0.0], 1.0)
    assert state[0] == pytest.approx(J * speed**2 / (2 * level), rel=1e-9)
    assert state[1] == 0.0
    held = advance(RigidIntegrator(plant, 2), state, [0.99 * level], 0.5)
    assert np.array_equal(held, state)  # no creep at all
    moving = advance(RigidIntegrator(plant, 2), state, [-1.5 * level], 0.2)
    assert moving[1] == pytest.approx(-0.5 * level / J * 0.2, rel=1e-12)


def test_a_stop_in_the_middle_of_a_step_reverses_under_gravity() -> None:
    """Thrown up against weight and friction: different decelerations before and after the turning point."""
    J, weight, level, speed = 1.0, 3.0, 1.0, 2.0
    plant = make_plant(Masses([J], [weight]), friction=Friction(coulomb_viscous([0.0], [level])))
    up = speed * J / (weight + level)
    after = 1.0 - up
    expected = speed * up / 2 - 0.5 * (weight - level) / J * after**2
    state = advance(RigidIntegrator(plant, 1), np.array([0.0, speed]), [0.0], 1.0)
    assert state[0] == pytest.approx(expected, rel=1e-9)
    assert state[1] == pytest.approx(-(weight - level) / J * after, rel=1e-9)


def loaded(coulomb: float, ratio: float) -> Friction:
    return Friction(FrictionModel(LAWS["load_dependent"], np.array([[coulomb, 0.0, ratio]])))


@pytest.mark.parametrize(("sign", "torque"), [(1.0, 6.0), (-1.0, 6.0), (1.0, -2.0), (-1.0, -2.0)])
def test_friction_under_a_load_takes_its_share_of_it(sign, torque) -> None:
    """The drive's torque is that of the load and of friction, which grows with the load, lifting and lowering."""
    J, weight, level, ratio = 0.5, 3.0, 0.8, 0.25
    plant = make_plant(Masses([J], [weight]), friction=loaded(level, ratio))
    state = advance(RigidIntegrator(plant, 2), np.array([0.0, sign * 5.0]), [torque], 0.05)
    load = J * (state[1] - sign * 5.0) / 0.05 + weight
    assert load + sign * (level + ratio * abs(load)) == pytest.approx(torque, rel=1e-12)


def test_a_load_holds_itself_between_the_torques_that_lift_and_lower_it() -> None:
    weight, level, ratio = 3.0, 0.8, 0.25
    plant = make_plant(Masses([0.5], [weight]), friction=loaded(level, ratio))
    lift, lower = weight * (1 + ratio) + level, weight * (1 - ratio) - level
    for torque, moves in ((0.999 * lift, 0), (1.001 * lift, 1), (1.001 * lower, 0), (0.999 * lower, -1)):
        state = advance(RigidIntegrator(plant, 2), np.zeros(2), [torque], 0.01)
        assert np.sign(state[1]) == moves


def test_loads_of_coupled_motors_settle() -> None:
    """Motors slide at W dq and carry W^-T tau; load and friction together are the torque of the drives."""
    W = np.array([[1.0, 0.0], [1.0, 1.0]])
    law = FrictionModel(LAWS["load_dependent"], np.array([[0.4, 0.1, 0.1], [0.3, 0.2, 0.15]]))
    friction = Friction(MotorFriction(None, law, W))
    dq, tau = np.array([0.7, -1.9]), np.array([8.0, -5.0])
    found = friction.smooth_torque(dq, tau)
    carried = np.linalg.solve(W.T, tau - found)
    assert W.T @ law.torque(W @ dq, load=carried) == pytest.approx(found, rel=1e-12)


def test_sticking_couples_through_the_mass_matrix() -> None:
    """Joint 1 is driven; joint 2 is dragged along by inertia until its friction lets go."""
    friction = Friction(coulomb_viscous([0.0, 0.0], [0.0, 1.0]))
    integrator = RigidIntegrator(make_plant(Coupled(), friction=friction), 2)
    # holding joint 2 takes 0.8*a1 = 0.8*tau/2
    held = advance(integrator, np.zeros(4), [2.4, 0.0], 0.1)
    assert held[2:] == pytest.approx([0.12, 0.0], rel=1e-12)
    assert held[3] == 0.0
    free = advance(integrator, np.zeros(4), [5.0, 0.0], 0.1)
    expected = np.linalg.solve(Coupled.M, [5.0, 1.0]) * 0.1  # joint 2 slides backwards: friction pushes forwards
    assert free[3] < 0
    assert free[2:] == pytest.approx(expected, rel=1e-12)


def test_stribeck_sticks_at_the_breakaway_torque() -> None:
    law = FrictionModel(LAWS["stribeck"], np.array([[0.5, 1.0, 0.0, 0.1]]))
    integrator = RigidIntegrator(make_plant(Masses([1.0]), friction=Friction(law)), 2)
    assert np.array_equal(advance(integrator, np.zeros(2), [1.49], 0.1), np.zeros(2))
    assert advance(integrator, np.zeros(2), [1.51], 0.1)[1] > 0.0


def test_smooth_laws_need_no_stops() -> None:
    law = FrictionModel(LAWS["neural"], np.array([[1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.1]]))
    integrator = RigidIntegrator(make_plant(Masses([1.0]), friction=Friction(law)), 4)

    def rates(_, x):
        return [x[1], 0.3 - np.tanh(2 * x[1]) - 0.1 * x[1]]

    expected = solve_ivp(rates, (0, 1), [0.0, -0.5], rtol=1e-12, atol=1e-12).y[:, -1]
    assert np.abs(advance(integrator, np.array([0.0, -0.5]), [0.3], 1.0) - expected).max() < 1e-10


def test_stiff_and_rigid_integration_agree_away_from_rest() -> None:
    arm, friction = OracleArm(), Friction(coulomb_viscous([0.2, 0.1], [0.5, 0.2]))
    plant = make_plant(arm, friction=friction)
    start = np.array([0.2, -0.5, 2.0, -3.0])
    rigid = advance(RigidIntegrator(plant, 2), start, [0.5, 0.1], 0.05)
    stiff = advance(StiffIntegrator(plant), start, [0.5, 0.1], 0.05)
    assert np.abs(rigid - stiff).max() < 1e-6


# -- LuGre ---------------------------------------------------------------------------------------------------------

LUGRE = FrictionModel(LAWS["lugre"], np.array([[2e4, 60.0, 0.5, 1.0, 0.6, 0.1]]))


def test_lugre_presliding_is_a_spring_and_sliding_the_stribeck_curve() -> None:
    plant = make_plant(Masses([0.05]), friction=Friction(LUGRE))
    integrator = make_integrator(plant)
    assert isinstance(integrator, StiffIntegrator)
    rest = advance(integrator, plant.initial_state([0.0], [0.0]), [0.2], 0.3)
    # monotone loading: x = -(gamma/sigma0) ln(1 - tau/gamma), gamma = alpha0 + alpha1 at rest
    assert plant.encoders(rest)[0] == pytest.approx(-(1.5 / 2e4) * np.log(1 - 0.2 / 1.5), rel=1e-3)
    sliding = advance(integrator, plant.initial_state([0.0], [2.0]), [2.2], 0.6)
    speed = plant.speeds(sliding)[0]
    assert float(LUGRE.torque(np.array([speed]))[0]) == pytest.approx(2.2, rel=2e-3)


def test_bristles_beside_a_law_that_jumps() -> None:
    """One joint's bristles have a state, the other joint's friction jumps at rest: it holds, then slides."""
    dahl = FrictionModel(LAWS["dahl"], np.array([[1.0, 0.3, 1e-3]]))
    load = FrictionModel(LAWS["load_dependent"], np.array([[0.4, 0.3, 0.1]]))
    plant = make_plant(Masses([0.05, 0.01], [0.0, 0.3]), friction=Friction(MixedFriction([dahl, load], [0.0, 0.0])))
    integrator, state = make_integrator(plant), plant.initial_state([0.0, 0.0], [0.0, 0.0])
    for tau in ([0.5, 0.5], [0.5, 0.1], [0.5, 0.5]):
        state = advance(integrator, state, tau, 0.02)
    assert abs(plant.speeds(state)[1]) < 1e-3  # up to the speed over which the sign is smoothed
    alone = make_plant(Masses([0.05]), friction=Friction(dahl))
    other = advance(make_integrator(alone), alone.initial_state([0.0], [0.0]), [0.5], 0.06)
    assert plant.encoders(state)[0] == pytest.approx(alone.encoders(other)[0], rel=1e-5)
    state = advance(integrator, state, [0.5, 1.33], 0.5)
    assert plant.speeds(state)[1] == pytest.approx((1.33 - 0.3 - 0.4 - 0.1 * 0.3) / 0.3, rel=1e-4)


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
