"""Friction of the virtual robot: sticking, stops and loads, where the formulas say, and bristles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lab.plant.masses import Masses, advance
from rrrgen.lab.plant.friction import Friction, MotorFriction
from rrrgen.lab.plant.integration import RigidIntegrator, StiffIntegrator, make_integrator
from rrrgen.lab.plant.plant import make_plant
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel, MixedFriction, coulomb_viscous


class Coupled(Masses):
    """A constant, coupled mass matrix."""

    M = np.array([[2.0, 0.8], [0.8, 0.5]])

    def __init__(self) -> None:
        super().__init__([2.0, 0.5])

    def mass_matrix(self, q, beta=None):
        return self.M

    def inverse_dynamics(self, q, dq, ddq, beta=None):
        return self.M @ ddq


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


@pytest.mark.sweep
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
