"""Functions with gravity as an input, and those of the group "control", against the independent dynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings

from derive.comparison import Reference, failures
from oracles import newton_euler as oracle
from oracles.numeric_rank import matrix_rank
from oracles.random_robots import random_robot, random_state, robots, to_yaml
from pipeline.optimized import bundled
from rrrgen.derive import derive_model
from rrrgen.derive.optimizer import Optimizer
from rrrgen.program import Role, count_operations
from rrrgen.robot.file import load_spec, loads_spec

FINDING = (Phase.explicit, Phase.generate)  # a robot prints as it is; shrinking one would take minutes

FEEL_GRAVITY = {
    *("gravity", "bias", "dynamics_terms", "inverse_dynamics", "energy"),
    *("inverse_dynamics_derivatives", "forward_dynamics_derivatives"),
    *("regressor", "regressor_transpose", "standard_regressor"),
    *("momentum_terms", "reference_torque", "reference_regressor_transpose"),
}


def functions(robot, *groups, any_gravity=False):
    """All functions of the groups in all ways, and K of ``beta = K phi``."""
    spec = loads_spec(to_yaml(robot))
    recorded = derive_model(spec.in_any_gravity() if any_gravity else spec, groups)
    known = {name: ways for name, ways in recorded.alternatives.items() if hasattr(Reference, f"_{name}")}
    return known, np.array(recorded.base_projection).reshape(-1, 10 * robot.n)


@settings(max_examples=4, phases=FINDING)
@given(robots(max_joints=3))
def test_the_functions_for_control_equal_the_independent_dynamics(robot):
    programs, K = functions(robot, "control")
    assert set(programs) == {"momentum_terms", "reference_torque", "reference_regressor_transpose"}
    assert failures(Reference(robot, K), programs) == {}


@settings(max_examples=4, phases=FINDING)
@given(robots(max_joints=3))
def test_every_function_takes_any_gravity(robot):
    programs, K = functions(robot, "model", "control", any_gravity=True)
    assert {name for name, (first, *_) in programs.items() if first.takes(Role.GRAVITY)} == FEEL_GRAVITY
    there = replace(robot, gravity=np.array([1.5, -7.25, 4.5]))
    assert failures(Reference(there, K, states=1), programs) == {}


@pytest.mark.parametrize("seed", range(4))
def test_the_base_parameters_are_those_of_all_directions_of_gravity(seed):
    """Their number is the rank of the regressor over states and gravity vectors, and K spans its rows."""
    robot = random_robot(9100 + seed, n=2 + seed % 3)
    K = functions(robot, "model", any_gravity=True)[1]
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(15):
        here = replace(robot, gravity=rng.uniform(-10, 10, 3))
        rows.append(oracle.standard_regressor(here, *random_state(here, rng)))
    stacked = np.concatenate(rows)
    assert matrix_rank(stacked).rank == len(K)
    assert matrix_rank(np.concatenate([stacked, K])).rank == len(K)


MORE = {  # operations that gravity at run time may cost
    "inverse_dynamics": 22,
    "bias": 22,
    "gravity": 34,
    "dynamics_terms": 35,
    "regressor": 20,
    "reference_torque": 24,
}
PAYLOADS = {"add_payload": 60}
CONTROL = {
    "rrr": {"momentum_terms": 84, "reference_torque": 101, "reference_regressor_transpose": 110},
    "panda": {"momentum_terms": 530, "reference_torque": 647, "reference_regressor_transpose": 634},
}


@pytest.mark.parametrize(("name", "b"), [("rrr", 17), ("panda", 45)])
@pytest.mark.sweep(but=["rrr-17"])
def test_operations(name, b):
    spec = load_spec(name)
    usual, recorded = bundled(name), derive_model(spec, ("control",))
    counted = {f: recorded.alternatives[f] for f in CONTROL[name]}
    control = Optimizer()(replace(recorded.only(counted), beta_nominal=None))
    recorded = derive_model(spec.in_any_gravity(), ("model", "control"))
    counted = {
        f: ways for f, ways in recorded.alternatives.items() if f in (*MORE, *PAYLOADS, "mass_matrix")
    }  # forward dynamics needs M
    general = Optimizer()(replace(recorded.only(counted), beta_nominal=None))
    assert general.b == b
    fixed = {f: count_operations(p).total for f, p in {**usual.programs, **control.programs}.items()}
    free = {f: count_operations(p).total for f, p in general.programs.items()}
    assert {f: free[f] - fixed[f] for f, more in MORE.items() if free[f] - fixed[f] > more} == {}
    assert {f: fixed[f] for f, most in CONTROL[name].items() if fixed[f] > most} == {}
    assert all(max(fixed[f], free[f]) <= most for f, most in PAYLOADS.items())
