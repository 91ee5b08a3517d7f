"""Derivatives of the dynamics against Pinocchio's, and against CasADi's of the functions that CasADi users get.

The complex step through the independent Newton-Euler is compared with in test_dynamics.py and, after all passes,
in tests/pipeline. Results are compared relative to the largest entry of each matrix.
"""

from __future__ import annotations

import numpy as np
import pytest

from derive.test_dynamics import derived
from oracles.external import Pinocchio
from oracles.newton_euler import Robot
from oracles.random_robots import random_link, random_robot, random_state
from pipeline.optimized import bundled
from rrrgen.program import Program, evaluate
from samples.draws import draws

CLOSE = 1e-10
"""Relative to the largest entry: thousands of roundings, and what the condition of M makes of them."""

LEAST = 1e-3
"""What the largest entry counts as where all of them are round-off (dtau/d(dq) of one joint): torques are about 10."""

STATES = 3
INVERSE, FORWARD = "inverse_dynamics_derivatives", "forward_dynamics_derivatives"


def errors(found, expected) -> list[float]:
    """Largest difference of each matrix, relative to its largest entry."""
    pairs = zip(found, expected, strict=True)
    return [float(np.max(np.abs(one - other)) / max(np.max(np.abs(other)), LEAST)) for one, other in pairs]


def compare_with_pinocchio(robot: Robot, inverse: Program, forward: Program, beta: np.ndarray, seed: int) -> None:
    pinocchio = Pinocchio(robot)
    rng = np.random.default_rng(seed)
    for _ in range(STATES):
        q, dq, ddq = random_state(robot, rng)
        tau, *slopes = evaluate(inverse, q, dq, ddq, beta)
        assert errors([tau, *slopes], [pinocchio.inverse_dynamics(q, dq, ddq),
                                       *pinocchio.inverse_dynamics_derivatives(q, dq, ddq)]) <= [CLOSE] * 4  # fmt: skip
        found, *slopes, status = evaluate(forward, q, dq, tau, beta)
        assert status == 0
        assert max(errors([found, *slopes], [ddq, *pinocchio.forward_dynamics_derivatives(q, dq, tau)])) <= CLOSE


@pytest.mark.parametrize("seed", range(41, 41 + draws(7)))
def test_random_robots_against_pinocchio(seed):
    """Of 1 to 7 joints, in both conventions by turns."""
    joints = 1 + (seed - 41) % 7
    robot = random_robot(seed, n=joints, convention=("standard", "modified")[seed % 2])
    K, programs = derived(robot)
    compare_with_pinocchio(robot, programs[INVERSE][0], programs[FORWARD][0], K @ robot.phi, seed)


def with_random_links(name: str) -> tuple[Robot, np.ndarray]:
    """The geometry of a bundled robot with links of its own, and the base parameters of those."""
    spec = bundled(name).spec
    rng = np.random.default_rng(5)
    links = tuple(random_link(rng) for _ in range(spec.n))
    gravity = np.array([float(spec.nominal(g)) for g in spec.gravity])
    robot = Robot(spec.convention, tuple(spec.dh_table()), gravity, links=links)
    return robot, np.array(bundled(name).base_projection, dtype=float) @ robot.phi


@pytest.mark.parametrize("name", ["rrr", "scara", "stanford", "puma560", "ur10e", "panda"])
@pytest.mark.sweep(but=["rrr", "scara", "stanford", "puma560", "panda"])
def test_optimized_functions_of_bundled_robots_against_pinocchio(name):
    robot, beta = with_random_links(name)
    programs = bundled(name).programs
    compare_with_pinocchio(robot, programs[INVERSE], programs[FORWARD], beta, 9)


@pytest.mark.parametrize("name", ["rrr", "stanford", "panda"])
def test_derivatives_are_those_that_casadi_finds(name):
    """CasADi differentiates the emitted inverse and forward dynamics."""
    pytest.importorskip("casadi")
    from rrrgen.emit.casadi.function import function

    robot, beta = with_random_links(name)
    programs = bundled(name).programs
    q, dq, ddq = random_state(robot, np.random.default_rng(2))
    tau, *slopes = evaluate(programs[INVERSE], q, dq, ddq, beta)
    torques = function(programs["inverse_dynamics"], "f").factory("g", ["q", "dq", "ddq", "beta"],
              ["jac:tau:q", "jac:tau:dq", "jac:tau:ddq"])  # fmt: skip
    assert max(errors(slopes, [part.full() for part in torques(q, dq, ddq, beta)])) <= CLOSE
    _, *slopes, _ = evaluate(programs[FORWARD], q, dq, tau, beta)
    accelerations = function(programs["forward_dynamics"], "f").factory("g", ["q", "dq", "tau", "beta"],
                    ["jac:ddq:q", "jac:ddq:dq", "jac:ddq:tau"])  # fmt: skip
    assert max(errors(slopes, [part.full() for part in accelerations(q, dq, tau, beta)])) <= CLOSE


def test_a_mass_matrix_that_is_not_positive_definite_is_reported():
    """Status 1 and zeros everywhere, as for forward dynamics alone."""
    _, beta = with_random_links("rrr")
    q, dq, tau = np.random.default_rng(3).uniform(-1, 1, (3, 3))
    *values, status = evaluate(bundled("rrr").programs[FORWARD], q, dq, tau, -beta)
    assert status == 1
    assert all(np.all(value == 0) for value in values)
