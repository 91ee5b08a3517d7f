"""Closed loops that no order of dyads solves: Newton's method against dyads, other references, and its own status."""

from __future__ import annotations

from functools import lru_cache

import mpmath
import numpy as np
import pytest

import rrrgen
from derive.loops import COUPLED, SIX_BAR, SIX_BAR_BY_NEWTON, TOGGLE
from derive.test_loops import rank
from rrrgen.base.errors import DerivationError
from rrrgen.derive import prepare, record
from rrrgen.derive.functions.table import FUNCTIONS, recorders
from rrrgen.derive.optimizer import Optimizer
from rrrgen.derive.recursions.link_frames import PRECISE, precise_chain
from rrrgen.derive.recursions.loop_positions import LoopClosure
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.robot.model import build_model
from rrrgen.runtime.loop_positions import ARRAYS, FollowedLoops
from rrrgen.verify import verify
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

PERIOD = 1e-3


@lru_cache
def derivation(text):
    return prepare(loads_spec(text))


@lru_cache
def function(text, name):
    return recorders(name)[0](derivation(text).recording())


def call(text, name, *values):
    return evaluate(function(text, name), *values)


def beta_of(text):
    spec, basis = derivation(text).spec, derivation(text).compiler_basis
    K = np.array([[float(spec.nominal(v)) for v in row] for row in basis.projection])
    return K @ nominal_parameters(spec).ravel()


@lru_cache
def loops_of(text):
    return FollowedLoops(loads_spec(text))


def precise_positions(text, q, near):
    """The positions (p,) of the passive joints at ``q`` in 60 digits, as floats."""
    model = build_model(loads_spec(text))
    with mpmath.workdps(PRECISE):
        x = [mpmath.mpf(float(v)) for v in near]
        for _ in range(8):
            x = precise_chain(model, [*map(mpmath.mpf, q), *x]).loops.step()
        return np.array(x, dtype=float)


# -- against dyads ---------------------------------------------------------------------------------------------------


Q = np.linspace(-0.9, 0.9, 5)[:, None]
DQ, DDQ = np.random.default_rng(0).uniform(-2, 2, (2, 5, 1))


def test_positions_and_rates_are_those_of_dyads():
    passive, W, _, status = call(SIX_BAR, "closed_loops", Q)
    found, its_W, _, its_status = call(SIX_BAR_BY_NEWTON, "closed_loops", Q, loops_of(SIX_BAR_BY_NEWTON).at(Q))
    assert not np.any([status, its_status])
    np.testing.assert_allclose(found, passive, atol=1e-12)
    np.testing.assert_allclose(its_W, W, atol=1e-12)


def test_torques_and_base_parameters_are_those_of_dyads():
    """The relations of the columns are found numerically; those of the dyads are exact."""
    assert derivation(SIX_BAR_BY_NEWTON).compiler_basis.projection == derivation(SIX_BAR).compiler_basis.projection
    beta = beta_of(SIX_BAR)
    (tau,) = call(SIX_BAR, "inverse_dynamics", Q, DQ, DDQ, beta)
    loop_q = loops_of(SIX_BAR_BY_NEWTON).at(Q)
    (found,) = call(SIX_BAR_BY_NEWTON, "inverse_dynamics", Q, DQ, DDQ, loop_q, beta)
    assert np.abs(found - tau).max() < 1e-12 * np.abs(tau).max()


@pytest.mark.sweep
def test_derivatives_are_those_of_dyads():
    found, dyads = (rrrgen.compile(loads_spec(text), backend="numpy") for text in (SIX_BAR_BY_NEWTON, SIX_BAR))
    for name in ("inverse_dynamics_derivatives", "forward_dynamics_derivatives"):
        for own, other in zip(getattr(found, name)(Q, DQ, DDQ), getattr(dyads, name)(Q, DQ, DDQ), strict=True):
            assert np.abs(own - other).max() < 1e-10 * np.abs(other).max()


# -- against other references ----------------------------------------------------------------------------------------


def test_torques_of_coupled_loops_agree_with_the_tree_and_its_numerical_constraint_jacobian():
    spec = loads_spec(COUPLED)
    q = np.linspace(-0.6, 0.6, 5)[:, None]
    reference = NewtonEuler(chain_of(spec), nominal_parameters(spec))
    x, solved = reference.loops.solve(q)
    assert solved.all()
    np.testing.assert_allclose(loops_of(COUPLED).at(q), x[:, 1:], atol=1e-12)
    tau = reference.inverse_dynamics(q, DQ, DDQ)
    (found,) = call(COUPLED, "inverse_dynamics", q, DQ, DDQ, x[:, 1:], beta_of(COUPLED))
    assert np.abs(found - tau).max() < 1e-12 * np.abs(tau).max()


@pytest.mark.sweep  # half a minute; loops that share no body are in test_loops.py
def test_the_number_of_base_parameters_of_coupled_loops_is_the_rank_of_the_regressor():
    assert len(derivation(COUPLED).compiler_basis.names) == rank(loads_spec(COUPLED)) == 13


@pytest.mark.sweep
@pytest.mark.parametrize("text", [COUPLED, TOGGLE], ids=["coupled", "toggle"])
def test_every_function_agrees_with_all_references(text):
    report = verify(rrrgen.compile(loads_spec(text), backend="numpy"), samples=6, seed=1)
    assert report.ok, report
    assert "solve_loops" in {row.function for row in report.rows}


# -- steps and their status ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_two_steps_from_the_prediction_leave_round_off(speed):
    """Drives at 1 and 5 rad/s, called at 1 kHz."""
    q_last = np.array([0.3])
    last = precise_positions(COUPLED, q_last, loops_of(COUPLED).at(q_last))
    q = q_last + speed * PERIOD
    found, gap, status = call(COUPLED, "solve_loops", q, q_last, last)
    assert status == 0
    assert gap < 1e-15
    assert np.abs(found - precise_positions(COUPLED, q, found)).max() < 1e-14


DEAD = (
    SIX_BAR_BY_NEWTON.replace("rocker: [0.4", "rocker: [0.05")
    .replace("a: 0, d: 0}", "a: 0, d: 0, limits: {lower: 100}}", 1)
    .replace("coupler: 40, rocker: 60", "coupler: -116, rocker: 35")
    .replace("link: -15, leaf: 55", "link: 60, leaf: 95")
)
"""The crank reaches dead points and positions where coupler and rocker do not meet."""

LIMIT = np.arccos((0.2**2 + 0.5**2 - 0.65**2) / (2 * 0.2 * 0.5))
"""Coupler and rocker are aligned there."""


def test_the_status_reports_dead_points_and_loops_that_are_not_closed():
    loops = loops_of(DEAD)
    last = loops.at([LIMIT - 0.02])
    *_, status = call(DEAD, "solve_loops", [LIMIT - 0.019], [LIMIT - 0.02], last)
    assert status == 0
    found, gap, status = call(DEAD, "solve_loops", [LIMIT + 0.02], [LIMIT - 0.02], last)
    assert status == 2
    assert np.all(np.isfinite(found))
    assert gap > 1e-5
    near = precise_positions(DEAD, [LIMIT - 1e-8], loops.at([LIMIT - 1e-3]))
    *_, status = call(DEAD, "closed_loops", [LIMIT - 1e-8], near)
    assert status == 1
    *_, status = call(DEAD, "closed_loops", [LIMIT - 0.02], last + 1e-3)
    assert status == 2


def test_loops_that_close_from_far_off_are_assembled_as_before():
    q, count = LIMIT - 0.4, 2000
    last = loops_of(DEAD).at([q]) + np.random.default_rng(1).normal(0, 0.1, (count, 4))
    at = np.full((count, 1), q)
    found, _, status = call(DEAD, "solve_loops", at, at, last)
    model = LoopClosure(build_model(loads_spec(DEAD)), ARRAYS)
    before, after = (model.loops([at[:, 0], *x.T]).sine for x in (last, found))
    solved = np.ravel(status) == 0
    assert 0 < np.sum(solved) < count
    assert np.all(before[solved] * after[solved] > 0)


@pytest.mark.parametrize("place", range(3))
def test_numbers_that_are_none_are_not_solved(place):
    values = [np.array([0.1]), np.array([0.1]), np.array(loops_of(COUPLED).at([0.1]))]
    values[place] = values[place] * np.nan
    *_, status = call(COUPLED, "solve_loops", *values)
    assert status == 2


def test_nothing_is_infinite_where_the_loops_are_not_closed():
    q = np.linspace(-np.pi, np.pi, 101)[:, None]
    loop_q = loops_of(DEAD).at(q)
    *_, status = call(DEAD, "closed_loops", q, loop_q)
    assert {0, 2} <= set(np.ravel(status))
    for name, *further in (("closed_loops",), ("jacobian",), ("inverse_dynamics", q, q)):
        values = [q, *further, loop_q, *([beta_of(DEAD)] if further else [])]
        assert all(np.all(np.isfinite(v)) for v in call(DEAD, name, *values))


# -- in Python -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model():
    derived = Optimizer()(
        record(derivation(COUPLED), [FUNCTIONS[n] for n in ("inverse_dynamics", "closed_loops", "solve_loops")])
    )
    from rrrgen.robot.identity import identify
    from rrrgen.runtime.load import load_model

    return load_model(derived, identify(derived.spec), backend="numpy")


def test_a_model_follows_the_passive_joints_or_takes_them(model):
    assert model.loop_joint_names == ("coupler", "rocker", "crank", "link")
    q, dq, ddq = np.array([0.2]), np.array([1.0]), np.array([-0.5])
    loop_q = model.loop_positions(q)
    tau = model.inverse_dynamics(q, dq, ddq)
    np.testing.assert_array_equal(model.at_loops(loop_q).inverse_dynamics(q, dq, ddq), tau)
    found, _ = model.solve_loops(q + PERIOD, q, loop_q)
    np.testing.assert_allclose(found, model.loop_positions(q + PERIOD), atol=1e-13)
    assert not np.array_equal(model.at_loops(found).inverse_dynamics(q + PERIOD, dq, ddq), tau)
    with pytest.raises(ValueError, match="not solved"):
        model.solve_loops(q + 1.5, q, loop_q)
    with pytest.raises(ValueError, match="solve: newton"):
        rrrgen.compile("pendulum", backend="numpy").at_loops([0.0])


@pytest.mark.sweep
def test_compiled_code_takes_steps_along_a_motion():
    compiled = rrrgen.compile(loads_spec(COUPLED))
    q = np.array([-0.5])
    loop_q, worst = compiled.loop_positions(q), 0.0
    for _ in range(1000):
        loop_q, gap = compiled.solve_loops(q + PERIOD, q, loop_q)
        q, worst = q + PERIOD, max(worst, float(gap))
    assert worst < 1e-15
    np.testing.assert_allclose(loop_q, compiled.loop_positions(q), atol=1e-13)


# -- what is refused -------------------------------------------------------------------------------------------------


def test_a_start_far_from_any_way_to_assemble_the_loops_is_refused():
    with pytest.raises(DerivationError, match=r"first, second cannot be assembled near the start.*drives are at 0"):
        prepare(loads_spec(SIX_BAR_BY_NEWTON.replace("coupler: [0.6", "coupler: [3")))


def test_loops_that_are_locked_at_their_start_are_refused():
    stuck = SIX_BAR_BY_NEWTON.replace("rocker: [0.4", f"rocker: [{0.6 - 0.3!r}").replace(
        "coupler: 40, rocker: 60", "coupler: 0, rocker: 0"
    )
    with pytest.raises(DerivationError, match="locked or at a dead point"):
        prepare(loads_spec(stuck))


@pytest.mark.parametrize("group", ["control", "hessian", "observer"])
def test_groups_that_do_not_exist_are_refused_with_the_reason(group):
    from rrrgen.derive.functions.table import functions_for

    with pytest.raises(DerivationError, match=f"the group {group} does not exist with loops solved by Newton's method"):
        functions_for(loads_spec(COUPLED), (group,))


def test_loops_that_need_each_other_are_refused_with_the_way_out():
    text = COUPLED
    for line in [each for each in COUPLED.splitlines(keepends=True) if each.startswith(("    solve", "    start"))]:
        text = text.replace(line, "    assembly: +1\n" if "start" in line else "", 1)
    with pytest.raises(rrrgen.InputError, match="need each other") as refused:
        loads_spec(text)
    assert "solve: newton" in str(refused.value)


@pytest.mark.parametrize("text", [SIX_BAR_BY_NEWTON, COUPLED, TOGGLE])
def test_the_start_is_printed_back(text):
    spec = loads_spec(text)
    assert loads_spec(dumps(spec)).mechanism == spec.mechanism
