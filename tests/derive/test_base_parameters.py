"""Minimal base parameters: counts against the published table and singular values, expressions against torques.

The counts of random structures are compared where these are derived, in tests/pipeline/test_random_robots.py.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from derive.structures import BASE_PARAMETER_COUNTS, TABLE, with_columns, with_named_lengths
from oracles import newton_euler as oracle
from oracles.newton_euler import Robot
from oracles.numeric_rank import base_parameter_count, matrix_rank
from oracles.random_robots import random_link, random_robot, random_state, robots, to_yaml
from rrrgen.derive.functions.recording import FunctionBuilder, parametrize
from rrrgen.derive.functions.table import recorders
from rrrgen.derive.parameters.base_parameters import MOST_FACTORED_TERMS, base_set, factor_coefficient, standard_symbols
from rrrgen.program import evaluate
from rrrgen.robot.file import bundled_names, load_spec, loads_spec
from rrrgen.robot.model import build_model
from rrrgen.robot.model.drives import drive_terms
from rrrgen.runtime.regressor_columns import drive_columns
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of

CLEAR_GAP = 1e5  # measured gaps of singular values are above 1e8; nothing between the two sides of the rank
ROUND_OFF = 1e-11  # relative to the largest torque; some hundred roundings of 1e-16
STATES = 80  # several rows per parameter
SAMPLES = 25  # states for singular values: 25 n rows for 10 n columns
FINDING = (Phase.explicit, Phase.generate)  # robots print as they are; shrinking one would take minutes


def derived_set(text: str):
    return base_set(build_model(loads_spec(text)))


def regressor_values(text: str, states: int = STATES, seed: int = 3):
    """The compiler's base regressor at random states, and those states."""
    spec = loads_spec(text)
    model = build_model(spec)
    program = recorders("regressor")[0](FunctionBuilder(model, parametrize(base_set(model), None)))
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (states, spec.n))
    dq, ddq = rng.uniform(-2, 2, (2, states, spec.n))
    return spec, evaluate(program, q, dq, ddq)[0], dq, ddq


def rank(Y: np.ndarray) -> int:
    found = matrix_rank(Y.reshape(-1, Y.shape[-1]))
    assert found.gap > CLEAR_GAP
    return found.rank


@pytest.mark.parametrize(("robot", "counts"), TABLE, ids=[robot.name for robot, _ in TABLE])
def test_the_published_table(robot: Robot, counts: tuple[int, int, int, int]):
    """Rigid body, + drive inertia, + friction, + offset: the symbolic count and the ranks of the columns."""
    text = to_yaml(robot)
    spec, Y, dq, ddq = regressor_values(text)
    assert Y.shape[-1] == rank(Y) == counts[0]
    for (drive, friction, offset), count in zip(
        ((True, False, False), (True, True, False), (True, True, True)), counts[1:], strict=True
    ):
        asked = drive_terms(loads_spec(with_columns(text, drive, friction, offset)))
        assert len(asked) == robot.n * (drive + 2 * friction + offset)
        assert rank(np.concatenate([Y, drive_columns(asked, dq, ddq)], axis=-1)) == count, asked
    assert spec.n == robot.n


@pytest.mark.parametrize("name", sorted(BASE_PARAMETER_COUNTS))
def test_known_counts_by_singular_values(name):
    robot, count = BASE_PARAMETER_COUNTS[name]
    found = base_parameter_count(robot)
    assert len(derived_set(to_yaml(robot)).parameters) == found.rank == count
    assert found.gap > CLEAR_GAP


RIGHT = (0.0, np.pi / 2, -np.pi / 2, np.pi)


@settings(max_examples=20, phases=FINDING)
@given(robots(max_joints=6, links="none", angles=RIGHT))
def test_counts_of_structures_full_of_right_angles_equal_the_rank(robot):
    """Where parallel, coincident and perpendicular axes are the rule."""
    assert len(derived_set(to_yaml(robot)).parameters) == base_parameter_count(robot, SAMPLES).rank


@settings(max_examples=12, phases=FINDING)
@given(robots(min_joints=2, max_joints=5, angles=(*RIGHT, 0.7), gravities=((0.0, 0.0, -9.81), (3.1, -2.7, -8.9))))
def test_symbolic_lengths(robot):
    """Named lengths: the same count, and the expressions at nominal values give tau = Y beta."""
    named, text = with_named_lengths(robot)
    spec = loads_spec(text)
    own = base_set(build_model(spec))
    assert len(own.parameters) == base_parameter_count(named, SAMPLES).rank
    check_torques(named, spec, own)


def check_torques(robot: Robot, spec, own) -> None:
    """tau = Y beta with beta from the expressions in link symbols, at the numbers of the robot."""
    model = build_model(spec)
    program = recorders("regressor")[0](FunctionBuilder(model, parametrize(own, None)))
    beta = np.array(sp.lambdify(standard_symbols(spec.n), [spec.nominal(e) for e in own.expressions()])(*robot.phi))
    rng = np.random.default_rng(11)
    states = [random_state(robot, rng) for _ in range(3)]
    tau = np.array([oracle.inverse_dynamics(robot, *state) for state in states])
    Y = evaluate(program, *(np.array(part) for part in zip(*states, strict=True)))[0]
    assert np.max(np.abs(Y @ beta - tau)) <= ROUND_OFF * np.max(np.abs(tau))


@pytest.mark.parametrize("off", [2e-16, 1e-12, 1e-8, 1e-4])
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_angles_beside_a_right_angle_give_the_torques(convention, off):
    """Eliminations by the sine or cosine of such an angle multiply round-off by its inverse; others are chosen."""
    kinds = ("revolute", "prismatic", "revolute", "revolute")
    base = random_robot(7, n=len(kinds), convention=convention)
    rows = [(kind, -np.pi / 2, *row[2:]) for kind, row in zip(kinds, base.rows, strict=True)]
    text = to_yaml(replace(base, rows=tuple(rows))).replace("alpha: -pi/2", f"alpha: -(pi/2 - {off:.0e})")
    assert text.count(f"{off:.0e}") == len(kinds)
    spec = loads_spec(text)
    own = base_set(build_model(spec))
    robot = replace(base, rows=tuple((kind, alpha + off, *rest) for kind, alpha, *rest in rows))
    check_torques(robot, spec, own)


@pytest.mark.parametrize("name", bundled_names())
@pytest.mark.sweep(but=[*bundled_names()[::2]])
def test_expressions_of_bundled_robots_give_the_torques(name):
    """Random links on the bundled geometry, the user's basis (where there is one) left out."""
    spec = replace(load_spec(name), basis=None)
    rng = np.random.default_rng(2)
    robot = Robot(
        spec.convention,
        tuple(spec.dh_table()),
        np.array([float(spec.nominal(g)) for g in spec.gravity]),
        np.array(spec.base.matrix().applyfunc(spec.nominal), dtype=float),
        np.array(spec.tool.matrix().applyfunc(spec.nominal), dtype=float),
        tuple(random_link(rng) for _ in range(spec.n)),
    )
    check_torques(robot, spec, base_set(build_model(spec)))


def test_lift_is_a_right_inverse_of_the_projection():
    """K lift = 1, exactly: every base parameter can be realised alone by a robot with standard parameters."""
    for seed in (0, 3, 8, 21):
        own = derived_set(to_yaml(random_robot(seed, n=4, links="none")))
        product = sp.Matrix(own.projection) * sp.Matrix([[_expression(v) for v in row] for row in own.lift])
        assert product.applyfunc(lambda v: sp.simplify(v)) == sp.eye(len(own.parameters))


def _expression(value) -> sp.Expr:
    from rrrgen.program.polynomials import to_expression

    return to_expression(value)


@cache
def puma():
    return base_set(build_model(load_spec("puma560")))


def test_parameters_nearest_to_the_base_are_kept():
    """The documented order of preference: link by link from the base, Jxx Jyy Jxy Jxz Jyz hx hy within a link."""
    order = ["Jxx", "Jyy", "Jxy", "Jxz", "Jyz", "hx", "hy"]
    kept = puma().parameters
    assert list(kept) == sorted(kept, key=lambda p: (p[0], order.index(p[1])))
    removed = [d.parameter for d in puma().dependencies]
    assert set(removed).isdisjoint(kept)
    for dependency in puma().dependencies:  # a removed one depends on kept ones before it only
        before = [p for p in kept if (p[0], order.index(p[1])) < _place(dependency.parameter, order)]
        assert set(dependency.combination) <= set(before)


def _place(parameter, order):
    return parameter[0], order.index(parameter[1])


def test_another_seed_of_the_random_states_changes_nothing():
    model = build_model(replace(load_spec("rrr"), basis=None))
    one, two = base_set(model), base_set(model, seed=77)
    assert one.names == two.names
    assert one.expressions() == two.expressions()


REPORT = """
from rrrgen.robot.file import load_spec
from rrrgen.derive.parameters.base_parameters import base_set
from rrrgen.robot.model import build_model
from dataclasses import replace
for name in ("rrr", "stanford", "scara"):
    own = base_set(build_model(replace(load_spec(name), basis=None)))
    print(own.names, own.expressions(), own.units)
"""


@pytest.mark.sweep  # tests/emit/test_determinism.py compares all files of two robots
def test_the_choice_does_not_depend_on_the_hash_seed():
    texts = {_output(REPORT, seed) for seed in ("0", "4711")}
    assert len(texts) == 1
    assert "Izz1" in texts.pop()


def _output(code: str, hash_seed: str) -> str:
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True
    ).stdout


ODD_PRISMATIC = """
schema: rrrgen/1
name: odd
convention: modified
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {type: prismatic, alpha: 0.7, theta: 0, a: 0, d: 0}
  - {type: prismatic, alpha: 2.3, theta: 0, a: 0.415, d: 0.25}
  - {type: revolute, alpha: -1.1, theta: 0, a: 0, d: 0.415}
  - {type: prismatic, alpha: 2.3, theta: -1.1, a: -0.3, d: 0.25}
"""


def test_rows_that_only_seem_independent_are_not_used():
    """Polynomials in the sine and cosine of one odd angle may differ and still be the same number."""
    own = derived_set(ODD_PRISMATIC)
    robot = Robot(
        "modified",
        (
            ("prismatic", 0.7, 0.0, 0.0, 0.0),
            ("prismatic", 2.3, 0.415, 0.25, 0.0),
            ("revolute", -1.1, 0.0, 0.415, 0.0),
            ("prismatic", 2.3, -0.3, 0.25, -1.1),
        ),
        np.array([0.0, -9.81, 0.0]),
        links=tuple(random_link(np.random.default_rng(k)) for k in range(4)),
    )
    assert len(own.parameters) == base_parameter_count(robot).rank
    check_torques(robot, loads_spec(ODD_PRISMATIC), own)


ODD_SLIDE = """\
schema: rrrgen/1
name: slide
convention: modified
units: {angle: rad, length: m}
gravity: [6.37, -1.87, 5.07]
joints:
  - {name: turn, type: revolute, alpha: pi/2, a: 0, d: 0.3}
  - {name: held, type: revolute, gamma: 0.4, b: -0.96, alpha: -0.7, a: 0.46, theta: 0.9, d: 0.23, follows: {}}
  - {name: slide, type: prismatic, gamma: 0.34, b: 0, alpha: 0.49, a: -0.41, theta: -0.48, d: 0}
"""


def test_a_quotient_with_the_sines_of_many_odd_angles_stays_one():
    """Multiplied by the conjugates of its denominator, as shorter ones are, it took minutes."""
    own = derived_set(ODD_SLIDE)
    spec, Y, dq, ddq = regressor_values(ODD_SLIDE)
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (STATES, spec.n))
    chain = chain_of(spec)
    standard = NewtonEuler(chain, np.zeros((chain.links, 10))).standard_regressor(q, dq, ddq)
    projection = np.array([[float(value.doit().evalf()) for value in row] for row in own.projection])
    difference = Y @ projection - standard.reshape(*Y.shape[:2], -1)
    assert np.max(np.abs(difference)) < ROUND_OFF * np.max(np.abs(standard))
    assert rank(Y) == len(own.parameters) == 6


def test_a_quotient_with_the_sines_of_few_odd_angles_is_made_rational():
    text = ODD_SLIDE.replace("gamma: 0.4, ", "").replace("gamma: 0.34, ", "")
    factors = [factor for dependency in derived_set(text).dependencies for factor in dependency.combination.values()]
    assert any(factor.has(sp.sin) for factor in factors)
    assert not any(sp.fraction(sp.together(factor))[1].has(sp.sin) for factor in factors)


@given(st.permutations([1, 2, 3]))
@settings(max_examples=6)
def test_gravity_along_any_axis(order):
    """The count depends on where gravity points, not on the name of the axis: tilted base and tilted gravity agree."""
    gravity = [0.0, 0.0, 0.0]
    gravity[order[0] - 1] = -9.81
    robot = Robot("standard", (("revolute", 0.0, 0.3, 0.0, 0.0), ("revolute", 0.0, 0.2, 0.0, 0.0)), np.array(gravity))
    assert len(derived_set(to_yaml(replace(robot, name="arm"))).parameters) == (4 if order[0] == 3 else 6)


def test_sums_are_factored_unless_they_are_long():
    x, y = sp.symbols("x y")
    assert factor_coefficient(x * y + x) == x * (y + 1)
    long = sp.Add(*(x * y**k for k in range(MOST_FACTORED_TERMS + 1)))
    assert factor_coefficient(long) is long
