"""Random robots, derived, printed, compiled and called, against the independent Newton-Euler in either precision."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest

from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, random_state, to_yaml
from rrrgen.derive import derive_model
from rrrgen.derive.optimizer import Optimizer
from rrrgen.robot.file import loads_spec
from rrrgen.robot.identity import identify
from rrrgen.runtime.load import load_model
from samples.draws import draws

DOUBLE = 1e-11  # relative to the largest torque (matrix entry) over the states: hundreds of roundings of 1e-16
SINGLE = 1e-4  # the same for roundings of 6e-8, with cancellation
STATES = 10

CALLED = (
    "inverse_dynamics",
    "inverse_dynamics_nominal",
    "mass_matrix_nominal",
    "gravity_nominal",
    "coriolis_nominal",
    "forward_kinematics",
    "jacobian",
    "regressor",
    "standard_regressor",
)
"""The functions compared here; the others would only be compiled."""

JOINTS = (4, 5) + (1, 2, 3) * draws(2)
SINGLE_TOO = (0, 2, 6, 4)
"""Robots of every number of joints in single precision too: the same statements, whatever was derived."""


def one_by_one(function, *arguments):
    """``function`` of each state by itself: no loops over batches are built, which tests/runtime compares with this."""
    return np.stack([function(*state) for state in zip(*arguments, strict=True)])


def derive_called(spec):
    """What pipeline.derive returns, for the functions in CALLED alone: to optimize the others would take longer."""
    recorded = derive_model(spec)
    wanted = {"bias", *(name.removesuffix("_nominal") for name in CALLED)}  # bias: forward dynamics are made of it
    alternatives = {name: ways for name, ways in recorded.alternatives.items() if name in wanted}
    derived = Optimizer()(recorded.only(alternatives))
    return dataclasses.replace(derived, programs={name: derived.programs[name] for name in CALLED})


@pytest.mark.parametrize("seed", range(len(JOINTS)))
@pytest.mark.sweep(but=["2", "5"])
def test_compiled_c_equals_newton_euler(seed):
    robot = random_robot(1000 + seed, n=JOINTS[seed])
    rng = np.random.default_rng(seed)
    q, dq, ddq = (
        np.float32(np.stack(column)).astype(float)
        for column in zip(*(random_state(robot, rng) for _ in range(STATES)), strict=True)
    )
    spec = loads_spec(to_yaml(robot))
    derived = derive_called(spec)
    expected = {
        "inverse_dynamics": [oracle.inverse_dynamics(robot, *state) for state in zip(q, dq, ddq, strict=True)],
        "mass_matrix": [oracle.mass_matrix(robot, x) for x in q],
        "gravity": [oracle.gravity(robot, x) for x in q],
        "coriolis": [oracle.coriolis(robot, x, v) for x, v in zip(q, dq, strict=True)],
        "forward_kinematics": [oracle.forward_kinematics(robot, x) for x in q],
        "jacobian": [oracle.jacobian(robot, x) for x in q],
    }
    torque = np.max(np.abs(expected["inverse_dynamics"]))
    for real, tolerance in (("double", DOUBLE), ("float", SINGLE))[: 1 + (seed in SINGLE_TOO)]:
        model = load_model(derived, identify(spec), real=real)
        arguments = {"inverse_dynamics": (q, dq, ddq), "coriolis": (q, dq)}
        for name, values in expected.items():
            result = one_by_one(getattr(model, name), *arguments.get(name, (q,)))
            scale = torque if name in ("gravity", "coriolis") else max(np.max(np.abs(values)), 1e-9)
            assert np.max(np.abs(result - np.array(values))) <= tolerance * scale, (name, real)
        phi = robot.phi
        beta = np.asarray(derived.base_projection) @ phi
        at_run_time = one_by_one(partial(model.inverse_dynamics, beta=beta), q, dq, ddq)
        by_regressor = one_by_one(model.regressor, q, dq, ddq) @ beta
        by_standard_regressor = one_by_one(model.standard_regressor, q, dq, ddq) @ phi
        for result in (at_run_time, by_regressor, by_standard_regressor):
            assert np.max(np.abs(result - np.array(expected["inverse_dynamics"]))) <= tolerance * torque, real
