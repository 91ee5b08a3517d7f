"""Closed loops of dyads: positions, torques, base parameters and dead points against independent oracles."""

from __future__ import annotations

from functools import lru_cache

import mpmath
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import rrrgen
from derive.loops import CYLINDER, FIVE_BAR, FOUR_BAR, PALLETISER, SLIDER_CRANK, SLIDES, STACKED
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.derive import closed_form, prepare, record
from rrrgen.derive.functions.table import FUNCTIONS, recorders
from rrrgen.derive.optimizer import Optimizer
from rrrgen.derive.recursions.link_frames import PRECISE, precise_chain
from rrrgen.exporting import export_robot
from rrrgen.ik.classify import plan
from rrrgen.program import count_operations
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.robot.model import build_model
from rrrgen.verify import verify
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters
from rrrgen.verify.subject import draw_states

FILES = {
    "four_bar": FOUR_BAR,
    "five_bar": FIVE_BAR,
    "stacked": STACKED,
    "slider_crank": SLIDER_CRANK,
    "cylinder": CYLINDER,
    "slides": SLIDES,
}
COUPLED = PALLETISER.with_name("robot.yaml")


@pytest.fixture(scope="module")
def four_bar():
    return rrrgen.compile(loads_spec(FOUR_BAR), backend="numpy")


def rank(spec):
    """The rank of the stacked standard regressor of the numerical reference, over the states of ``draw_states``."""
    chain = chain_of(spec)
    s = draw_states(chain, 8 * chain.links, np.random.default_rng(3))
    Y = NewtonEuler(chain, np.zeros((chain.links, 10))).standard_regressor(s.q, s.dq, s.ddq)
    Y = Y.reshape(-1, 10 * chain.links)
    lengths = np.linalg.norm(Y, axis=0)
    sizes = np.linalg.svd((Y / np.maximum(lengths, 1e-9))[:, lengths > 1e-9], compute_uv=False)
    return np.sum(sizes > 1e-9 * sizes[0])


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("four_bar", 8),
        ("five_bar", 11),
        ("slider_crank", 6),  # the mass of the slider acts as one at the end of the rod
        ("cylinder", 8),
        pytest.param("stacked", None, marks=pytest.mark.sweep),
        pytest.param("slides", None, marks=pytest.mark.sweep),
    ],
)
def test_the_number_of_base_parameters_is_the_rank_of_the_regressor(name, count):
    spec = loads_spec(FILES[name])
    found = len(prepare(spec).compiler_basis.names)
    assert found == rank(spec)
    assert count in (None, found)


@pytest.mark.parametrize(
    ("name", "most"), [("four_bar", 132), ("five_bar", 169), ("slider_crank", 56), ("cylinder", 114)]
)
def test_operations_of_inverse_dynamics_stay_low(name, most):
    """At most 5 % more than a prototype of the same recursions had, or with a prismatic joint than at first."""
    recorded = record(prepare(loads_spec(FILES[name])), [FUNCTIONS["inverse_dynamics"]])
    assert count_operations(Optimizer()(recorded).programs["inverse_dynamics"]).total <= 1.05 * most


def test_every_function_of_a_four_bar_agrees_with_newtons_method(four_bar):
    report = verify(four_bar, samples=6, seed=1)
    assert report.ok, report
    assert {row.function for row in report.rows} >= {"closed_loops: W", "inverse_dynamics", "jacobian_dot_dq"}


def test_every_function_of_a_cylinder_agrees_with_newtons_method():
    report = verify(rrrgen.compile(loads_spec(CYLINDER), backend="numpy"), samples=6, seed=1)
    assert report.ok, report


@pytest.mark.sweep
@pytest.mark.parametrize(
    "spec",
    [*(loads_spec(text) for text in (FIVE_BAR, STACKED, SLIDER_CRANK, SLIDES)), load_spec(PALLETISER)],
    ids=lambda s: s.name,
)
def test_every_function_of_further_loops_agrees_with_newtons_method(spec):
    report = verify(rrrgen.compile(spec, backend="numpy"), samples=6, seed=1)
    assert report.ok, report


@pytest.mark.sweep
def test_torques_of_a_stacked_loop_agree_with_the_reference():
    spec = loads_spec(STACKED)
    chain = chain_of(spec)
    reference = NewtonEuler(chain, nominal_parameters(spec))
    s = draw_states(chain, 10, np.random.default_rng(2))
    tau = reference.inverse_dynamics(s.q, s.dq, s.ddq)
    program = recorded(spec, "inverse_dynamics")
    beta = beta_of(spec)
    found = np.array([evaluate(program, *state, beta)[0] for state in zip(s.q, s.dq, s.ddq, strict=True)])
    assert np.abs(found - tau).max() < 1e-11 * np.abs(tau).max()


@lru_cache(maxsize=2)
def derivation(text):
    return prepare(loads_spec(text))


def recorded(spec, name):
    return recorders(name)[0](derivation(dumps(spec)).recording())


def beta_of(spec):
    basis = derivation(dumps(spec)).compiler_basis
    K = np.array([[float(spec.nominal(v)) for v in row] for row in basis.projection])
    return K @ nominal_parameters(spec).ravel()


@pytest.mark.sweep
def test_a_loop_with_nearly_equal_sides_moves_as_the_parallelogram():
    """Sides off by 1e-6 m: torques differ from those of the constant coupling by about as much."""
    text = PALLETISER.read_text(encoding="utf-8").replace("a: 900", "a: 945.001").replace("-1345", "-1325.001")
    near, equal = loads_spec(text), load_spec(COUPLED)
    rng = np.random.default_rng(0)
    closed, coupled = (recorded(spec, "inverse_dynamics") for spec in (near, equal))
    beta, beta_coupled = beta_of(near), beta_of(equal)
    Ia = [joint.drive.inertia for joint in near.joints]
    for q in rng.uniform([-2, -0.4, 0.3, -1], [2, 0.8, 1.2, 1], (10, 4)):
        dq, ddq = rng.normal(size=(2, 4))
        found = evaluate(closed, q, dq, ddq, [*beta, *Ia])[0]
        expected = evaluate(coupled, q, dq, ddq, [*beta_coupled, *Ia])[0]
        assert np.abs(np.array(found) - expected).max() < 1e-5 * np.abs(expected).max()


def test_both_assemblies_are_mirror_images(four_bar):
    other = rrrgen.compile(loads_spec(FOUR_BAR.replace("+1", "-1")), backend="numpy")
    q = np.linspace(-3, 3, 7)[:, None]
    (passive, W, sine), (mirrored, its_W, its_sine) = four_bar.closed_loops(q), other.closed_loops(-q)
    np.testing.assert_allclose(passive * [1, -1], mirrored, atol=1e-12)
    np.testing.assert_allclose(W, its_W, atol=1e-12)
    np.testing.assert_allclose(sine, its_sine, atol=1e-12)


# -- prismatic passive joints ----------------------------------------------------------------------------------------

SIDE = st.sampled_from(["+1", "-1"])
SHORT = st.builds(lambda k, side: int(side) * k / 1000, st.integers(20, 150), SIDE)
LONG = st.builds(lambda k, side: int(side) * k / 1000, st.integers(500, 900), SIDE)


@st.composite
def slider_cranks(draw):
    """Slider-cranks of random dimensions that turn fully, with the slider in any direction and sense."""
    text = SLIDER_CRANK.replace("gamma: 90", f"gamma: {draw(st.integers(-180, 180))}, sign: {draw(SIDE)}")
    text = text.replace("a: 0.05", f"a: {draw(SHORT)}").replace("a: 0.2", f"a: {draw(SHORT)}")
    text = text.replace("0.6, 0, 0", f"{draw(LONG)}, {draw(SHORT)}, 0")
    return text.replace("slider: [0, 0, 0]", f"slider: [{draw(SHORT)}, 0, 1]").replace("+1", draw(SIDE))


@st.composite
def cylinders(draw):
    """Cylinders of random dimensions, whose axis passes beside both pins, under a boom that turns fully."""
    text = CYLINDER.replace("a: 0.04", f"a: {draw(SHORT) / 2}").replace("a: 0.4", f"a: {draw(LONG)}")
    text = text.replace("theta: 30", f"theta: {draw(st.integers(-180, 180))}, sign: {draw(SIDE)}")
    text = text.replace("-0.6, -0.2, 0", f"{draw(SHORT) - 1.2}, {draw(SHORT)}, 0")
    text = text.replace("piston: [0, 0, 0]", f"piston: [{draw(SHORT) / 2}, 0, 0]")
    return text.replace("theta: 0}", f"theta: 0, d: {draw(SHORT)}, sign: {draw(SIDE)}}}").replace(
        ": +1", f": {draw(SIDE)}"
    )


@settings(max_examples=12)
@given(st.one_of(slider_cranks(), cylinders()), st.integers(0, 10**6))
def test_positions_and_rates_of_random_mechanisms_agree_with_newtons_method(text, seed):
    spec, rng = loads_spec(text), np.random.default_rng(seed)
    q, dq = rng.uniform(-np.pi, np.pi, (2, 1)), rng.uniform(-2, 2, (2, 1))
    reference = NewtonEuler(chain_of(spec), np.zeros((len(spec.rows), 10))).loops
    x, solved = reference.solve(q)
    assert solved.all()
    W = reference.passive_rates(x)
    expected = reference.passive_accelerations(x, np.concatenate([dq, np.einsum("nij,nj->ni", W, dq)], axis=1))
    model, mechanism = build_model(spec), spec.mechanism
    signs = [int(mechanism.matrix[row][1 + j]) for j, row in enumerate(mechanism.passive)]
    (slide,) = (j for j, row in enumerate(mechanism.passive) if not spec.rows[row].is_revolute)
    with mpmath.workdps(PRECISE):
        for at, rate, position, velocity, acceleration in zip(q, dq, x, W[:, :, 0], expected, strict=True):
            chain = precise_chain(model, [mpmath.mpf(at[0])])
            both = chain.joint_rates([1]), chain.joint_accelerations([mpmath.mpf(rate[0])], [0])
            rates, second = ([s * each[row] for s, row in zip(signs, mechanism.passive, strict=True)] for each in both)
            np.testing.assert_allclose(np.array(rates, float), velocity, rtol=1e-9, atol=1e-10)
            np.testing.assert_allclose(np.array(second, float), acceleration, rtol=1e-8, atol=1e-9)
            displacement = signs[slide] * chain.joints[mechanism.passive[slide]].slide
            assert abs(displacement - position[1 + slide]) < 1e-12


def torques_agree(text):
    spec = loads_spec(text)
    s = draw_states(chain_of(spec), 4, np.random.default_rng(1))
    tau = NewtonEuler(chain_of(spec), nominal_parameters(spec)).inverse_dynamics(s.q, s.dq, s.ddq)
    found = evaluate(recorded(spec, "inverse_dynamics"), s.q, s.dq, s.ddq, beta_of(spec))[0]
    assert np.abs(np.array(found) - tau).max() < 1e-12 * np.abs(tau).max()


@pytest.mark.parametrize("mechanisms", [slider_cranks, cylinders])
def test_torques_of_random_mechanisms_agree_with_the_reference(mechanisms):
    settings(max_examples=2)(given(mechanisms())(torques_agree))()


def test_torques_agree_where_the_angle_of_the_slider_has_no_short_cosine():
    """The loop and the frames have to know its sine as the same number, or columns seem to be independent."""
    assert SLIDER_CRANK.count("gamma: 90") == 1
    torques_agree(SLIDER_CRANK.replace("gamma: 90", "gamma: 21"))


def test_a_cylinder_as_the_drive_needs_the_force_that_gives_the_torque_of_the_boom():
    """The same mechanism over the length of its cylinder: ``tau = W f`` at rest, and the same positions."""
    driven = CYLINDER.replace("passive: [barrel, piston]", "passive: [boom, barrel]")
    by_angle, by_length = loads_spec(CYLINDER), loads_spec(driven)
    q = np.linspace(0.4, 1.6, 5)[:, None]
    passive, W, _, status = evaluate(recorded(by_angle, "closed_loops"), q)
    length = passive[:, 1, 0][:, None]
    turned, its_W, _, its_status = evaluate(recorded(by_length, "closed_loops"), length)
    assert not np.any([status, its_status])
    np.testing.assert_allclose(np.arctan2(turned[:, 0, 1], turned[:, 0, 0])[:, None], q, atol=1e-12)
    np.testing.assert_allclose(its_W[:, 0, 0] * W[:, 1, 0], 1, rtol=1e-11)
    ratio, rest, ddq = W[:, 1], np.zeros_like(q), np.ones_like(q)
    tau = evaluate(recorded(by_angle, "inverse_dynamics"), q, rest, ddq, beta_of(by_angle))[0]
    force = evaluate(recorded(by_length, "inverse_dynamics"), length, rest, ratio * ddq, beta_of(by_length))[0]
    np.testing.assert_allclose(ratio * force, tau, rtol=1e-10)


SHORT_ROD = SLIDER_CRANK.replace("0.6, 0, 0", "0.15, 0, 0").replace("a: 0.05", "a: 0.02")
"""The crank is longer than the rod: it reaches dead points, where the rod is across the axis of the slider."""

FAR_AXIS = CYLINDER.replace("a: 0.04", "a: 0.9")
"""The axis of the cylinder passes its joint so far that the boom's pin is out of its reach at some angles."""


def test_the_status_tells_dead_points_of_slides():
    limit = np.arcsin((0.15 + 0.02) / 0.2)  # the rod hangs upright from the pin of the crank to the axis of the slider
    program = recorded(loads_spec(SHORT_ROD), "closed_loops")
    q = np.array([[limit - 1e-2], [limit - 1e-9], [limit + 1e-2]])
    _, W, sine, status = evaluate(program, q)
    assert list(np.ravel(status)) == [0, 1, 2]
    assert np.all(np.isfinite(W))
    assert sine[0, 0] > 0.05 > sine[1, 0] > sine[2, 0] == 0


def test_a_cylinder_without_length_is_a_dead_point():
    """The pin of the boom passes through the joint of the barrel, and the axis of the cylinder through both."""
    text = CYLINDER.replace("a: 0.04", "a: 0").replace("-0.6, -0.2, 0", "-0.8, 0, 0")
    program = recorded(loads_spec(text), "closed_loops")
    q = -np.pi / 3 + np.array([[0.0], [1e-5], [1e-1]])
    _, W, _, status = evaluate(program, q)
    assert list(np.ravel(status)) == [1, 1, 0]
    assert np.all(np.isfinite(W))


@pytest.mark.parametrize("text", [SHORT_ROD, FAR_AXIS], ids=["slider", "cylinder"])
def test_nothing_is_nan_where_a_slide_cannot_be_assembled(text):
    spec = loads_spec(text)
    q = np.linspace(-np.pi, np.pi, 401)[:, None]
    *_, status = evaluate(recorded(spec, "closed_loops"), q)
    assert {0, 2} <= set(np.ravel(status))
    for values in evaluate(recorded(spec, "inverse_dynamics"), q, q, q, beta_of(spec)):
        assert np.all(np.isfinite(values))


# -- dead points ----------------------------------------------------------------------------------------------------


DEAD = FOUR_BAR.replace("rocker: [0.4, 0, 0]", "rocker: [0.05, 0, 0]")
"""The crank reaches dead points, where rod and rocker are aligned, and positions where they do not meet."""


@pytest.fixture(scope="module")
def dead():
    return rrrgen.compile(loads_spec(DEAD), backend="numpy")


def test_the_status_tells_dead_points_and_positions_that_cannot_be_assembled(dead):
    # rod and rocker aligned: the pin of the crank is 0.65 m or 0.55 m from that of the base
    limit = np.arccos((0.2**2 + 0.5**2 - 0.65**2) / (2 * 0.2 * 0.5))
    q = np.array([[limit - 1e-2], [limit - 1e-9], [limit + 1e-2]])
    (_, W, _), status = dead.closed_loops(q, with_status=True)
    assert list(status) == [0, 1, 2]
    assert np.all(np.isfinite(W))
    with pytest.raises(np.linalg.LinAlgError, match="dead point"):
        dead.closed_loops(q[1])
    with pytest.raises(ValueError, match="cannot be assembled"):
        dead.closed_loops(q[2])


def test_nothing_is_nan_at_dead_points_and_beyond(dead):
    q = np.linspace(-np.pi, np.pi, 401)[:, None]
    assert np.all(np.isfinite(dead.inverse_dynamics(q, q, q)))
    assert np.all(np.isfinite(dead.jacobian(q)))
    assert np.all(np.isfinite(dead.forward_kinematics(q)))
    assert np.all(np.isfinite(dead.inverse_dynamics_derivatives(q, q, q).dtau_dq))


# -- exact numbers, and what is refused -----------------------------------------------------------------------------


def test_factors_of_micrometres_are_exact_fractions():
    precise = (
        FOUR_BAR.replace("a: 0.5,", "a: 0.500123,").replace("a: 0.2,", "a: 0.199877,").replace("[0.4,", "[0.400001,")
    )
    dependencies = prepare(loads_spec(precise)).compiler_basis.dependencies
    factors = [factor for each in dependencies for factor in each.combination.values()]
    assert all(factor.is_Rational and factor.q < 10**13 for factor in factors)
    assert max(factor.q for factor in factors) > 10**5


def test_factors_with_square_roots_of_the_geometry_are_exact():
    spec = loads_spec(FOUR_BAR.replace("rocker: [0.4, 0, 0]", "rocker: [0.2*sqrt(3), 0.2, 0]"))
    basis = prepare(spec).compiler_basis
    factors = {factor for each in basis.dependencies for factor in each.combination.values()}
    assert len(basis.names) == rank(spec) == 8
    assert any(factor.has(sp.sqrt(3)) for factor in factors)


def test_factors_with_any_other_number_are_decimals():
    spec = loads_spec(FOUR_BAR.replace("rocker: [0.4, 0, 0]", "rocker: [0.4*cos(0.3), 0.4*sin(0.3), 0]"))
    basis = prepare(spec).compiler_basis
    assert len(basis.names) == 8
    assert max(factor.q for each in basis.dependencies for factor in each.combination.values()) > 10**20


def test_a_loop_that_can_nowhere_be_assembled_is_refused():
    with pytest.raises(DerivationError, match="no positions within the limits at which bars can be assembled"):
        prepare(loads_spec(FOUR_BAR.replace("rod: [0.6", "rod: [3")))


def test_what_does_not_exist_with_loops_is_refused_with_the_reason():
    spec = loads_spec(FOUR_BAR)
    assert "closed loops" in plan(spec).reason
    with pytest.raises(DerivationError, match="closed loops"):
        closed_form(spec, "mass_matrix")
    for target in ("urdf", "mjcf"):
        with pytest.raises(DerivationError, match="closed loops"):
            export_robot(spec, target)


def test_a_parallelogram_is_refused_and_follows_is_proposed():
    text = PALLETISER.read_text(encoding="utf-8").replace("a: 900", "a: 945").replace("-1345", "-1325")
    with pytest.raises(InputError, match="parallelogram") as refused:
        loads_spec(text)
    assert "follows" in str(refused.value)
