"""The recursion of dM/dq against differentiated mass matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oracles import newton_euler as oracle
from oracles.lagrange import STEP
from oracles.random_robots import random_robot, random_state, to_yaml
from rrrgen.derive import prepare, record
from rrrgen.derive.derived_model import Derivation
from rrrgen.derive.functions.table import get_function, with_sources
from rrrgen.derive.recursions.mass_matrix_derivatives import mass_matrix_derivatives
from rrrgen.program import Port, Program, evaluate
from rrrgen.program.differentiation import jacobian
from rrrgen.program.passes.folding import Fold
from rrrgen.robot.file import load_spec, loads_spec

EXAMPLES = Path(__file__).parents[2] / "examples"
ROUND_OFF = 1e-13


def recorded(derivation: Derivation) -> Program:
    """dM_ij/dq_k at [k][i][j]."""
    r = derivation.recording()
    slopes = mass_matrix_derivatives(r.chain(), r.inertias())
    values = [x for D in slopes for row in D for x in row]
    return r.builder.program("dM", [(Port("dM", (r.n, r.n, r.n)), values)])


@pytest.mark.parametrize("seed", range(6))
def test_random_arms_against_another_newton_euler(seed):
    """Revolute and prismatic joints, both conventions."""
    robot = random_robot(seed, n=4, convention="modified" if seed % 2 else "standard")
    spec = loads_spec(to_yaml(robot))
    derivation = prepare(spec)
    q, _, _ = random_state(robot, np.random.default_rng(seed))
    expected = [oracle.mass_matrix(robot, q + 1j * STEP * e).imag / STEP for e in np.eye(4)]
    nominal = record(derivation, with_sources([get_function("mass_matrix")])).nominal
    (found,) = evaluate(Fold(nominal)(recorded(derivation)), q)
    assert np.max(np.abs(found - expected)) < ROUND_OFF * np.max(np.abs(expected))


@pytest.mark.parametrize("path", ["trees/hand", "trees/torso", "palletiser/robot"])
def test_trees_and_joints_that_follow_others_against_the_differentiated_mass_matrix(path):
    derivation = prepare(load_spec(str(EXAMPLES / f"{path}.yaml")))
    model = record(derivation, with_sources([get_function("mass_matrix")]))
    slopes = jacobian(model.alternatives["mass_matrix"][0], "M", ("q",))
    program, rng = recorded(derivation), np.random.default_rng(1)
    q, beta = (rng.uniform(-1, 1, port.size) for port in program.inputs)
    n = len(q)
    expected = np.moveaxis(evaluate(slopes, q, beta)[1].reshape(n, n, n), -1, 0)
    (found,) = evaluate(program, q, beta)
    assert np.max(np.abs(found - expected)) < ROUND_OFF * np.max(np.abs(expected))
