"""The built-in reference against the tests' own oracles, which were written separately."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles import newton_euler as ne
from oracles.random_robots import random_robot, random_state, robots, to_yaml
from rrrgen.robot.file import loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, is_physical, nominal_parameters
from verify.oracle_model import spec_of

ONE_ULP_OF_PI = 4.5e-16  # pi/6 rounds differently as one exact number and as a quotient of floats
AGREEMENT = 1e-12  # relative; measured at most 2e-15 (3e-14 of one unit for dJ/dt dq) for n <= 8


def difference(value, expected, scale=0.0) -> float:
    return float(np.max(np.abs(value - expected)) / max(np.max(np.abs(expected)), scale, 1e-300))


@given(robots(max_joints=8), st.integers(0, 2**16))
def test_built_in_reference_equals_the_oracles(robot, seed):
    spec = spec_of(robot)
    chain, phi = chain_of(spec), nominal_parameters(spec)
    built_in = NewtonEuler(chain, phi)
    rng = np.random.default_rng(seed)
    states = [random_state(robot, rng) for _ in range(2)]
    q, dq, ddq = (np.array(part) for part in zip(*states, strict=True))
    tau = np.array([ne.inverse_dynamics(robot, *state) for state in states])
    torque = np.max(np.abs(tau))
    assert is_physical(phi)
    assert difference(built_in.inverse_dynamics(q, dq, ddq), tau) < AGREEMENT
    regressors = np.array([ne.standard_regressor(robot, *state) for state in states])
    assert difference(built_in.standard_regressor(q, dq, ddq), regressors) < AGREEMENT
    assert difference(built_in.mass_matrix(q), np.array([ne.mass_matrix(robot, x) for x in q])) < AGREEMENT
    assert difference(built_in.gravity(q), np.array([ne.gravity(robot, x) for x in q]), torque) < AGREEMENT
    c = np.array([ne.coriolis(robot, x, v) for x, v in zip(q, dq, strict=True)])
    assert difference(built_in.coriolis(q, dq), c, torque) < AGREEMENT
    assert difference(built_in.link_frames(q), np.array([ne.frames(robot, x).links for x in q])) < AGREEMENT
    assert (
        difference(built_in.forward_kinematics(q), np.array([ne.forward_kinematics(robot, x) for x in q])) < AGREEMENT
    )
    assert difference(built_in.jacobian(q), np.array([ne.jacobian(robot, x) for x in q])) < AGREEMENT
    rate = np.array([ne.jacobian_dot_dq(robot, x, v) for x, v in zip(q, dq, strict=True)])
    assert difference(built_in.jacobian_dot_dq(q, dq), rate, 10.0) < AGREEMENT
    energies = np.array([ne.energy(robot, x, v) for x, v in zip(q, dq, strict=True)]).T
    assert difference(np.array(built_in.energy(q, dq)), energies) < AGREEMENT


@pytest.mark.parametrize("seed", range(8))
def test_chain_of_a_file_holds_the_numbers_of_the_robot(seed):
    """The text of a random robot, read by the product, gives the numbers it was written from."""
    robot = random_robot(seed)
    spec = loads_spec(to_yaml(robot))
    chain = chain_of(spec)
    assert [row[0] == "revolute" for row in robot.rows] == list(chain.revolute)
    table = np.array([row[1:] for row in robot.rows])
    read = np.column_stack([chain.alpha, chain.a, chain.d, chain.theta])
    assert np.max(np.abs(read - table)) <= ONE_ULP_OF_PI
    assert np.array_equal(chain.gravity, robot.gravity)
    assert np.array_equal(chain.base, robot.base)
    assert np.array_equal(chain.tool, robot.tool)
    assert difference(nominal_parameters(spec).ravel(), robot.phi) < AGREEMENT
