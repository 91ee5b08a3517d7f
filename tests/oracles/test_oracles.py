"""The oracles agree with one another, with energy, and with the numbers published for the reference arm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import chapter14, lagrange
from oracles import newton_euler as ne
from oracles.external import MuJoCo, Pinocchio, RoboticsToolbox
from oracles.known_robots import BASE_PARAMETER_COUNTS
from oracles.numeric_rank import base_parameter_count, matrix_rank
from oracles.random_robots import number_text, random_robot, random_state, robots_with_states, to_yaml

AGREEMENT = 1e-12  # relative to the largest entry; measured at most 1e-14 for n <= 8 (round-off of cancelling terms)
THIRD_PARTY = 1e-10  # MuJoCo stores orientations as quaternions and diagonalises inertias
STEP = 1e-30  # complex step
states = robots_with_states(max_joints=8)
without_signs = robots_with_states(max_joints=8, signs=(1,))


def difference(a, b, scale=None) -> float:
    """Largest difference relative to the largest reference entry."""
    size = np.max(np.abs(b)) if scale is None else scale
    return float(np.max(np.abs(np.asarray(a) - b)) / max(size, 1e-300))


@given(states)
def test_newton_euler_equals_lagrange(drawn):
    robot, q, dq, ddq = drawn
    tau = ne.inverse_dynamics(robot, q, dq, ddq)
    scale = np.max(np.abs(tau))
    M = lagrange.mass_matrix(robot, q)
    assert difference(lagrange.inverse_dynamics(robot, q, dq, ddq), tau) < AGREEMENT
    assert difference(ne.mass_matrix(robot, q), M) < AGREEMENT
    assert difference(ne.gravity(robot, q), lagrange.gravity(robot, q), scale) < AGREEMENT
    assert np.all(np.linalg.eigvalsh(M) > 0)
    assert difference(M @ ddq + ne.bias(robot, q, dq), tau) < AGREEMENT
    assert difference(ne.coriolis(robot, q, dq) + ne.gravity(robot, q), ne.bias(robot, q, dq), scale) < AGREEMENT


@given(states)
def test_power_balance(drawn):
    """d(K + U)/dt = tau.dq, the derivative by the complex step."""
    robot, q, dq, ddq = drawn
    tau = ne.inverse_dynamics(robot, q, dq, ddq)
    power = sum(ne.energy(robot, q + 1j * STEP * dq, dq + 1j * STEP * ddq)).imag / STEP
    assert difference(power, tau @ dq, np.sum(np.abs(tau * dq))) < AGREEMENT


@given(states)
def test_regressor_times_parameters_is_the_torque(drawn):
    robot, q, dq, ddq = drawn
    tau = ne.inverse_dynamics(robot, q, dq, ddq)
    assert difference(ne.standard_regressor(robot, q, dq, ddq) @ robot.phi, tau) < AGREEMENT


@given(states)
def test_jacobian_is_the_derivative_of_the_tip(drawn):
    robot, q, dq, _ = drawn
    T = ne.forward_kinematics(robot, q + 1j * STEP * dq)
    rate, R = T.imag / STEP, T.real[:3, :3]
    W = rate[:3, :3] @ R.T
    twist = np.array([*rate[:3, 3], W[2, 1], W[0, 2], W[1, 0]])
    assert difference(ne.jacobian(robot, q) @ dq, twist, max(1.0, np.max(np.abs(twist)))) < AGREEMENT
    rate_of_J = ne.jacobian(robot, q + 1j * STEP * dq).imag / STEP @ dq
    assert difference(ne.jacobian_dot_dq(robot, q, dq), rate_of_J, max(1.0, np.max(np.abs(rate_of_J)))) < AGREEMENT


@given(states)
def test_link_jacobians_are_the_derivatives_of_the_link_frames(drawn):
    robot, q, dq, _ = drawn
    T = ne.frames(robot, q + 1j * STEP * dq).links
    rate, R = T.imag / STEP, T.real[:, :3, :3]
    W = rate[:, :3, :3] @ np.swapaxes(R, 1, 2)
    twists = np.column_stack([rate[:, :3, 3], W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]])
    assert difference(ne.link_jacobians(robot, q) @ dq, twists, max(1.0, np.max(np.abs(twists)))) < AGREEMENT


@given(states)
def test_forward_dynamics_inverts_inverse_dynamics(drawn):
    robot, q, dq, ddq = drawn
    tau = ne.inverse_dynamics(robot, q, dq, ddq)
    again = ne.inverse_dynamics(robot, q, dq, ne.forward_dynamics(robot, q, dq, tau))
    assert difference(again, tau) < AGREEMENT


@pytest.mark.parametrize("package", [Pinocchio, MuJoCo, RoboticsToolbox])
def test_third_parties_agree(package):
    @settings(max_examples=30)
    @given(without_signs)
    def agree(drawn):
        robot, q, dq, ddq = drawn
        other = package(robot)
        tau = ne.inverse_dynamics(robot, q, dq, ddq)
        assert difference(other.inverse_dynamics(q, dq, ddq), tau) < THIRD_PARTY
        assert difference(other.mass_matrix(q), ne.mass_matrix(robot, q)) < THIRD_PARTY
        assert difference(other.forward_kinematics(q), ne.forward_kinematics(robot, q)) < THIRD_PARTY

    agree()


@settings(max_examples=30)
@given(without_signs)
def test_regressor_equals_pinocchio_column_by_column(drawn):
    robot, q, dq, ddq = drawn
    Y = ne.standard_regressor(robot, q, dq, ddq)
    assert difference(Pinocchio(robot).standard_regressor(q, dq, ddq), Y) < THIRD_PARTY


def chapter_draw(seed: int) -> tuple[list[dict[str, float]], np.ndarray, np.ndarray, np.ndarray]:
    """Arbitrary non-zero parameters in the chapter's convention, and a state."""
    rng = np.random.default_rng(seed)
    links = [dict(zip(chapter14.LINK_KEYS, rng.uniform(-1, 1, 10), strict=True)) for _ in range(3)]
    q, dq, ddq = rng.uniform(-np.pi, np.pi, 3), rng.uniform(-3, 3, 3), rng.uniform(-10, 10, 3)
    return links, q, dq, ddq


CONVENTIONS = [  # inertia about, products, gravity direction, whether (14.46)/(14.47) hold
    ("origin", "positive", -1, True),
    ("origin", "tensor", -1, False),
    ("com", "positive", -1, False),
    ("com", "tensor", -1, False),
    ("origin", "positive", +1, False),
]


@pytest.mark.parametrize(("about", "products", "up", "holds"), CONVENTIONS)
def test_convention_table_of_the_chapter(about, products, up, holds):
    """Only one reading of the inertias reproduces (14.46)/(14.47); every other one is off by many N m."""
    worst, size = 0.0, 0.0
    for seed in range(200):
        links, q, dq, ddq = chapter_draw(seed)
        bodies = [chapter14.link_from_chapter(link, about, products) for link in links]
        tau = ne.inverse_dynamics(chapter14.rrr(bodies, (0, 0, up * chapter14.G)), q, dq, ddq)
        printed = np.array(chapter14.regressor_1447(q, dq, ddq)) @ chapter14.base_parameters_1446(links)
        worst, size = max(worst, np.max(np.abs(printed - tau))), max(size, np.max(np.abs(tau)))
    if holds:
        assert worst < 1e-14 * size
    else:
        assert worst > 5.0


def test_ranks_of_the_chapter():
    rng = np.random.default_rng(0)
    arm = chapter14.rrr()
    draws = [rng.uniform(-3, 3, (3, 3)) for _ in range(60)]
    printed = np.vstack([np.array(chapter14.regressor_1447(*draw)) for draw in draws])
    general = np.vstack([ne.standard_regressor(arm, *draw) for draw in draws])
    still = np.vstack([chapter14.regressor_1447(draw[0], np.zeros(3), np.zeros(3)) for draw in draws])
    assert matrix_rank(general).rank == matrix_rank(printed).rank == 15
    assert matrix_rank(np.hstack([printed, general])).rank == 15
    assert matrix_rank(np.delete(printed, (3, 14), axis=1)).rank == 13
    assert matrix_rank(still).rank == 4
    link1 = np.max(np.abs(general[:, :10]), axis=0)
    assert ne.PARAMETER_NAMES[int(np.argmax(link1))] == "Iyy"
    assert np.max(np.delete(link1, 6)) < AGREEMENT


def test_chapter_kinematics():
    arm, rng = chapter14.rrr(), np.random.default_rng(1)
    for q in rng.uniform(-np.pi, np.pi, (50, 3)):
        T = ne.forward_kinematics(arm, q)
        assert difference(chapter14.fk_1444(q), T[:3, 3]) < AGREEMENT
        assert difference(chapter14.orientation_1443(q), T[:3, :3]) < AGREEMENT
        a2, a3 = chapter14.A2, chapter14.A3
        rho = a3 * np.cos(q[1] + q[2]) + a2 * np.cos(q[1])
        assert np.linalg.det(ne.jacobian(arm, q)[:3]) == pytest.approx(-a2 * a3 * np.sin(q[2]) * rho, abs=1e-14)


def test_chapter_formulas_are_symbolic_too():
    """The same functions evaluated with SymPy and then put into numbers give the NumPy values."""
    sp = pytest.importorskip("sympy")
    q, dq, ddq = (sp.symbols(f"{name}1:4", real=True) for name in ("q", "v", "w"))
    a2, g = sp.symbols("a2 g", positive=True)
    R = sp.Matrix(chapter14.regressor_1447(q, dq, ddq, a2, g, xp=sp))
    values = np.random.default_rng(2).uniform(-2, 2, 9)
    numbers = dict(zip((*q, *dq, *ddq), values, strict=True)) | {a2: chapter14.A2, g: chapter14.G}
    expected = chapter14.regressor_1447(values[:3], values[3:6], values[6:])
    assert difference(np.array(R.subs(numbers), dtype=float), np.array(expected)) < AGREEMENT
    assert sum(entry == 0 for entry in R) == 13
    tip = sp.Matrix(chapter14.fk_1444(q, xp=sp)).subs(numbers)
    assert difference(np.array(tip, dtype=float).ravel(), chapter14.fk_1444(values[:3])) < AGREEMENT


def test_arbitrary_parameters_give_indefinite_mass_matrices_and_physical_ones_never():
    """A quarter of the chapter's arbitrary draws cannot be integrated; bodies made of point masses always can."""
    rng = np.random.default_rng(3)
    indefinite = 0
    for seed in range(200):
        links, q, _, _ = chapter_draw(seed)
        bodies = [chapter14.link_from_chapter({**link, "m": abs(link["m"])}) for link in links]
        indefinite += bool(np.linalg.eigvalsh(ne.mass_matrix(chapter14.rrr(bodies), q))[0] <= 0)
        body = random_robot(seed, 3, max_joints=3).links
        assert np.linalg.eigvalsh(ne.mass_matrix(chapter14.rrr(body), rng.uniform(-3, 3, 3)))[0] > 0
    assert indefinite > 20


@pytest.mark.parametrize("name", BASE_PARAMETER_COUNTS)
def test_known_base_parameter_counts(name):
    robot, count = BASE_PARAMETER_COUNTS[name]
    found = base_parameter_count(robot)
    assert found.rank == count
    assert found.gap > 1e9


def read_number(text: str) -> float:
    """The scalar as an exact reader would: decimals, p/q, and p*pi/q."""
    if "pi" not in text:
        top, _, bottom = text.partition("/")
        return float(top) / float(bottom or 1)
    top, _, bottom = text.replace("*pi", "pi").partition("/")
    factor = {"pi": 1.0, "-pi": -1.0}.get(top) or float(top.removesuffix("pi"))
    return factor * np.pi / float(bottom or 1)


@given(st.floats(-1e3, 1e3), st.integers(-24, 24), st.integers(1, 12))
def test_number_text_keeps_the_value(value, p, q):
    assert read_number(number_text(value)) == value
    assert read_number(number_text(p * np.pi / q, angle=True)) == p * np.pi / q
    assert number_text(np.pi / 2, True) == "pi/2"
    assert number_text(-np.pi, True) == "-pi"


@pytest.mark.parametrize("seed", range(5))
def test_yaml_holds_the_same_numbers(seed):
    yaml = pytest.importorskip("ruamel.yaml")
    robot = random_robot(seed)
    read = yaml.YAML(typ="safe", pure=True).load(to_yaml(robot))
    for (kind, *numbers), joint in zip(robot.rows, read["joints"], strict=True):
        assert joint["type"] == kind
        assert [read_number(str(joint[key])) for key in ("alpha", "a", "d", "theta")] == numbers
    for link, entry in zip(robot.links, read["links"], strict=True):
        assert [entry["mass"], *entry["com"]] == [link.mass, *link.com]
        assert entry["inertia"]["xz"] == link.inertia[0, 2]
    for key, T in (("base", robot.base), ("tool", robot.tool)):
        if key in read:
            rotation = [[read_number(str(v)) for v in row] for row in read[key]["rotation"]]
            assert np.array_equal(rotation, T[:3, :3])
            assert np.array_equal(read[key]["translation"], T[:3, 3])


def test_random_links_are_physical():
    for seed in range(50):
        assert all(np.linalg.eigvalsh(link.pseudo_inertia())[0] > 1e-4 for link in random_robot(seed).links)


def test_a_wrong_sign_is_seen():
    """The comparison itself can fail: one flipped product of inertia is far outside every tolerance."""
    robot = chapter14.rrr(random_robot(11, 3).links)
    link = robot.links[1]
    flipped = ne.Link(link.mass, link.com, link.inertia * np.array([[1, -1, 1], [-1, 1, 1], [1, 1, 1]]))
    broken = robot.with_links((robot.links[0], flipped, robot.links[2]))
    state = random_state(robot, np.random.default_rng(0))
    assert difference(ne.inverse_dynamics(broken, *state), ne.inverse_dynamics(robot, *state)) > 1e6 * THIRD_PARTY
