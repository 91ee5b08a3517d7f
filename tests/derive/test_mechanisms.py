"""Joints that follow others and branches: MuJoCo with constraints, and an own Newton-Euler over the tree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.derive import prepare
from rrrgen.derive.functions.table import recorders
from rrrgen.derive.recursions.linear_algebra import factorize
from rrrgen.program import Builder, Port
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.robot.model import build_model
from rrrgen.robot.model.inertial_parameters import standard_parameters
from rrrgen.verify import verify
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of

PALLETISER = Path(__file__).resolve().parents[2] / "examples" / "palletiser" / "robot.yaml"

TREE = """\
schema: rrrgen/1
name: tree
convention: {convention}
units: {{angle: rad, length: m}}
gravity: [1, -2, -9.5]
base: {{translation: [0.1, 0.2, 0.3], rpy: [0.3, -0.2, 0.5]}}
joints:
  - {{name: lift, type: prismatic, alpha: 0.3, a: 0.1, theta: 0.4}}
  - {{name: swing, type: revolute, alpha: 0, a: 0.3, d: 0.1, theta: 0.2, follows: {{swing: 1, lift: 2/3}}}}
  - {{name: twin, type: revolute, alpha: 0, a: 0.25, d: 0.05, theta: -0.3, follows: {{swing: -3/2}}}}
  - {{name: hand, type: revolute, alpha: -pi/2, a: 0.1, d: 0, theta: 0}}
  - {{name: side, type: revolute, alpha: 0.7, a: -0.2, d: 0.1, parent: lift, follows: {{hand: -1, swing: 1/2}}}}
  - {{name: rack, type: prismatic, alpha: pi/2, a: 0.1, d: 0.2, theta: 0.1, parent: swing, follows: {{hand: 0.04}}}}
  - {{name: arm2, type: revolute, alpha: 0, a: 0.2, d: -0.1, theta: 0.6, parent: base, follows: {{swing: 2}}}}
tip: hand
tool: {{translation: [0.1, 0, 0.2], rpy: [0.1, 0.2, 0.3]}}
"""

PLACED_TREE = (
    TREE.format(convention="modified")
    .replace("theta: 0.2, ", "theta: 0.2, gamma: 0.9, b: 0.07, ")
    .replace("a: 0.1, theta: 0.4}", "a: 0.1, theta: 0.4, gamma: -0.4, b: 0.2}")
    .replace("parent: lift,", "parent: lift, gamma: pi/2, b: -0.3,")
    .replace("parent: swing,", "parent: swing, gamma: 1.1, b: 0.05,")
    .replace("parent: base,", "parent: base, gamma: -pi, b: 0.4,")
)
"""Turns of any size and by quarters, before revolute and prismatic rows, parallel and tilted ones, at the base."""


@pytest.mark.parametrize("text", [TREE.format(convention="modified"), PLACED_TREE])
def test_every_function_of_a_tree_with_followers_agrees_with_newton_euler(text):
    """Prismatic and revolute followers with fractions, several branches and roots; verify asks every function."""
    model = rrrgen.compile(loads_spec(text), backend="numpy")
    report = verify(model, samples=6, libraries=False)
    assert [row for row in report.rows if not row.ok] == []
    assert len(report.rows) > 40


def test_the_number_of_base_parameters_is_the_rank_of_the_regressor():
    for spec in (loads_spec(TREE.format(convention="standard")), load_spec(PALLETISER)):
        chain = chain_of(spec)
        rng = np.random.default_rng(3)
        states = rng.uniform(-3, 3, (3, 60, spec.n))
        Y = NewtonEuler(chain, np.zeros((chain.links, 10))).standard_regressor(*states).reshape(-1, 10 * chain.links)
        lengths = np.linalg.norm(Y, axis=0)
        sizes = np.linalg.svd((Y / np.maximum(lengths, 1e-9))[:, lengths > 1e-9], compute_uv=False)
        assert len(prepare(spec).compiler_basis.names) == np.sum(sizes > 1e-9 * sizes[0])


# -- the palletiser as a closed loop in MuJoCo, written down by hand ------------------------------

X, Y, Z = np.eye(3)
SHOULDER, UPRIGHT = X * 0.26 + Z * 0.815, Z * 0.945
# origin, x axis and z axis of every link frame at q = 0, in the order of the file
FRAMES = (
    (SHOULDER, X, Y),
    (SHOULDER + UPRIGHT, Z, Y),
    (SHOULDER - 0.3 * X, X, Y),
    (SHOULDER - 0.3 * X + UPRIGHT, Z, Y),
    (SHOULDER + UPRIGHT + 1.025 * X, X, Y),
    (SHOULDER + UPRIGHT + 1.245 * X, X, -Z),
    (SHOULDER + UPRIGHT + 1.245 * X - 0.25 * Z, X, -Z),
)
HINGES = (Z * 0, SHOULDER, SHOULDER, FRAMES[2][0], FRAMES[1][0], FRAMES[4][0], FRAMES[5][0])
AXES = (Z, Y, Y, Y, Y, Y, -Z)
NAMES = ("column", "shoulder", "elbow", "rod", "forearm", "wrist", "turn")
CARRIERS = (None, "column", "column", "elbow", "shoulder", "forearm", "wrist")


def closed_loop(spec) -> str:
    """MJCF: seven hinges, the rod's end tied to the forearm, the sum of the angles to the wrist held."""

    def text(values) -> str:
        return " ".join(repr(float(v)) for v in values)

    def body(i: int) -> str:
        (origin, x, z), link = FRAMES[i], spec.links[i]
        R = np.column_stack([x, np.cross(z, x), z])
        xx, yy, zz, xy, xz, yz = (float(v) for v in link.inertia)
        tensor = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
        com = origin + R @ np.array([float(v) for v in link.com])
        place = HINGES[i] - (HINGES[NAMES.index(CARRIERS[i])] if CARRIERS[i] else 0)
        entries = [tensor[k] for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        beyond = "".join(body(k) for k, carrier in enumerate(CARRIERS) if carrier == NAMES[i])
        return (
            f'<body name="{NAMES[i]}" pos="{text(place)}"><joint name="{NAMES[i]}" axis="{text(AXES[i])}"/>'
            f'<inertial pos="{text(com - HINGES[i])}" mass="{float(link.mass)!r}" fullinertia="{text(entries)}"/>'
            f"{beyond}</body>"
        )

    level = "".join(f'<joint joint="{name}" coef="1"/>' for name in ("shoulder", "forearm", "wrist"))
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>{body(0)}</worldbody>'
        f'<tendon><fixed name="level">{level}</fixed></tendon><equality>'
        f'<connect body1="rod" body2="forearm" anchor="{text(UPRIGHT)}"/><tendon tendon1="level"/>'
        "</equality></mujoco>"
    )


def test_the_palletiser_agrees_with_mujocos_equality_constraints():
    """Constraints held, torques and mass matrix of the drives, and the constrained accelerations, to 1e-10."""
    mujoco = pytest.importorskip("mujoco")
    spec = load_spec(PALLETISER)
    loop = mujoco.MjModel.from_xml_string(closed_loop(spec))
    data = mujoco.MjData(loop)
    recorded = prepare(spec)
    programs = {name: recorders(name)[0](recorded.recording()) for name in ("inverse_dynamics", "mass_matrix")}
    beta, inertia = _parameters(recorded, spec)
    order = [int(loop.joint(name).dofadr[0]) for name in NAMES]  # MuJoCo numbers branch by branch
    S = np.zeros((loop.nv, spec.n))
    S[order] = [[float(v) for v in row] for row in spec.mechanism.matrix]
    places = [order[NAMES.index(joint.name)] for joint in spec.joints]
    rng = np.random.default_rng(1)
    for q, dq, ddq in rng.uniform(-1, 1, (20, 3, spec.n)):
        data.qpos[:], data.qvel[:], data.qacc[:] = S @ q, S @ dq, 0
        mujoco.mj_forward(loop, data)
        J = np.reshape(data.efc_J, (-1, loop.nv))
        assert np.abs(data.efc_pos).max() < 1e-14
        assert np.linalg.matrix_rank(J, 1e-9) == loop.nv - spec.n
        assert np.abs(J @ S).max() < 1e-14  # the motion that the constraints leave is that of the drives
        M = np.zeros((loop.nv, loop.nv))
        for k, unit in enumerate(np.eye(loop.nv)):
            mujoco.mj_mulM(loop, data, M[k], unit)
        bias = np.array(data.qfrc_bias)
        tau, mass = (
            evaluate(programs[name], *arguments, [*beta, *inertia])[0]
            for name, arguments in (("inverse_dynamics", (q, dq, ddq)), ("mass_matrix", (q,)))
        )
        assert np.abs(mass - np.diag(inertia) - S.T @ M @ S).max() < 1e-10 * np.abs(mass).max()
        # accelerations under those torques: M a - J' lambda = B tau - bias, J a = 0, as J keeps its null space
        drive = np.zeros(loop.nv)
        drive[places] = tau - inertia * ddq
        independent = np.linalg.svd(J)[2][: loop.nv - spec.n]
        size = len(independent)
        K = np.block([[M, -independent.T], [independent, np.zeros((size, size))]])
        a = np.linalg.solve(K, np.concatenate([drive - bias, np.zeros(size)]))[: loop.nv]
        assert np.abs(a - S @ ddq).max() < 1e-10


def _parameters(recorded, spec):
    phi = [float(v) for link in spec.links for v in _standard(link)]
    K = np.array([[float(v) for v in row] for row in recorded.compiler_basis.projection])
    return K @ phi, np.array([joint.drive.inertia for joint in spec.joints])


def _standard(link):
    m, (x, y, z) = link.mass, link.com
    xx, yy, zz, xy, xz, yz = link.inertia_about_origin()
    return m, m * x, m * y, m * z, xx, xy, yy, xz, yz, zz


HAND = """\
schema: rrrgen/1
name: hand
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: roll, type: revolute, alpha: 0, a: 0, d: 0.1}
  - {name: pitch, type: revolute, alpha: 90, a: 0, d: 0, drive: {inertia: 0.01}}
  - {name: left, type: revolute, alpha: 0, a: 0, d: 0.03, theta: 70, follows: {}}
  - {name: l1, type: revolute, alpha: 90, a: 0.1, d: 0}
  - {name: l2, type: revolute, alpha: 0, a: 0.05, d: 0}
  - {name: right, type: revolute, alpha: 0, a: 0, d: -0.03, theta: 110, follows: {}, parent: pitch}
  - {name: r1, type: revolute, alpha: 90, a: 0.1, d: 0}
  - {name: r2, type: revolute, alpha: 0, a: 0.05, d: 0}
tip: r2
links:
"""
LINK = "  - {{mass: {0}, com: [0.0{0}, 0.01, 0.02], inertia: {{about: com, xx: 0.0{0}, yy: 0.0{0}2, zz: 0.0{0}1}}}}\n"
NOTHING = "  - {mass: 0, com: [0, 0, 0], inertia: {about: com, xx: 0, yy: 0, zz: 0}}\n"
MOVING = [LINK.format(k) for k in range(1, 7)]


def test_fixed_rows_need_no_link():
    """The libraries then take part: a fixed row without mass is no body of theirs."""
    pytest.importorskip("mujoco")
    short = loads_spec(HAND + "".join(MOVING))
    whole = loads_spec(HAND + "".join([*MOVING[:2], NOTHING, *MOVING[2:4], NOTHING, *MOVING[4:]]))
    assert short == whole
    report = verify(rrrgen.compile(short, backend="numpy"), samples=4)
    assert [row for row in report.rows if not row.ok] == []
    assert any("MuJoCo" in row.reference for row in report.rows)
    with pytest.raises(InputError, match="5 links for 8 joints") as raised:
        loads_spec(HAND + "".join(MOVING[1:]))
    assert "describe all 8 links, or 6 without those of fixed rows" in str(raised.value)


def test_regrouping_names_the_link_that_carries_the_joint():
    """Joint 7 stands on the fixed row 6, which stands on link 2; row 6 comes after link 5 of the other finger."""
    model = rrrgen.compile(loads_spec(HAND + "".join(MOVING)), backend="numpy").derived
    reasons = {entry.parameter: entry.reason for entry in model.regrouping}
    assert "of joint 5 is regrouped to link 4: J4 += X5" in reasons["Iyy5"]
    assert "of joint 6 is regrouped to link 2: J2 += X6" in reasons["m6"]
    assert "of joint 7 is regrouped to link 6: J6 += X7" in reasons["m7"]


def test_parameters_of_all_links_link_by_link():
    spec = loads_spec(HAND + "".join(MOVING))
    model = rrrgen.compile(spec, backend="numpy")
    phi = np.array([[float(value) for value in standard_parameters(link)] for link in spec.links])
    np.testing.assert_allclose(model.base_parameters_of(phi), model.beta, rtol=1e-12)
    np.testing.assert_allclose(model.base_parameters_of(phi.ravel()), model.beta, rtol=1e-12)
    for wrong in (phi[:6], phi.ravel()[:60]):
        with pytest.raises(ValueError, match=r"phi has shape .* expected \(8, 10\) or \(\.\.\., 80\)"):
            model.base_parameters_of(wrong)


def test_a_humanoid_has_enough_rows():
    legs = "".join(
        f"  - {{name: {leg}{k}, type: revolute, alpha: 90, a: 0.1, d: 0{', parent: base' * (k == 0)}}}\n"
        for leg in ("a", "b", "c", "d", "f")
        for k in range(8)
    )
    spec = loads_spec(HAND.partition("joints:")[0] + "joints:\n" + legs + "tip: a7\n")
    assert spec.n == 40


def test_a_tree_is_factorized_from_the_tips_without_fill_in():
    """Two branches of two joints on one: L has no entry between them, and solutions are those of NumPy."""
    pattern = np.array([[1, 1, 1, 1, 1], [1, 1, 1, 0, 0], [1, 1, 1, 0, 0], [1, 0, 0, 1, 1], [1, 0, 0, 1, 1]])
    b = Builder()
    values, right = b.input(Port("M", (5, 5))), b.input(Port("b", (5,)))
    M = [[values[5 * i + j] if pattern[i, j] else 0 for j in range(5)] for i in range(5)]
    factors = factorize(b, M, tips_first=True)
    filled = {(factors.order[i], factors.order[j]) for i in range(5) for j in range(i) if factors.L[i][j] != 0}
    assert filled == {(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (3, 4)}
    inverse = [value for row in factors.negative_inverse() for value in row]
    outputs = [(Port("x", (5,)), factors.solve(list(right))), (Port("N", (5, 5)), inverse)]
    program = b.program("solution", [*outputs, (Port("status", ()), [factors.status])])
    rng = np.random.default_rng(2)
    matrix, rhs = pattern * (0.1 + 0.1 * rng.random()) + np.diag(1 + rng.random(5)), rng.random(5)
    x, negative, status = evaluate(program, matrix, rhs)
    np.testing.assert_allclose(matrix @ x, rhs, rtol=1e-13)
    np.testing.assert_allclose(matrix @ negative, -np.eye(5), atol=1e-13)
    assert status == 0


TREES = Path(__file__).resolve().parents[2] / "examples" / "trees"


@pytest.mark.parametrize(("name", "b"), [("torso", 85), ("hand", 50)])
def test_base_parameters_of_the_example_trees(name, b):
    """Seven for each revolute joint, one for the first about the direction of gravity."""
    spec = load_spec(TREES / f"{name}.yaml")
    assert len(prepare(spec).compiler_basis.names) == b == 7 * (spec.n - 1) + 1


def test_the_origins_of_a_branch_follow_the_rules_of_a_chain():
    """A chain with an idle stub beside it has the canonical frames of the chain."""
    chain = load_spec("rrr")
    rows = dumps(chain)
    head = rows.partition("links:")[0]
    joints, base = head.rstrip().split("\n"), [row.before for row in build_model(chain).joints]
    stub = "  - {name: stub, type: revolute, alpha: 90 deg, a: 0.1, d: 0.2, parent: base}"
    where = next(i for i, line in enumerate(joints) if line.startswith("tool:")) if "tool:" in head else len(joints)
    text = "\n".join([*joints[:where], stub, f"tip: {chain.rows[-1].name}", *joints[where:]]) + "\n"
    tree = build_model(loads_spec(text))
    assert [joint.before for joint in tree.joints[:-1]] == base
    assert tree.blocks[-1] == (chain.n,)


@pytest.mark.parametrize("tip", ["finger", "thumb"])
def test_each_tip_has_its_kinematics(tip):
    """Pose and Jacobian of both fingers against Newton-Euler; the other finger does not move the tip."""
    spec = load_spec(f"{TREES / 'hand.yaml'}@{tip}")
    recorded, q = prepare(spec), np.random.default_rng(5).uniform(-3, 3, spec.n)
    programs = [recorders(name)[0](recorded.recording()) for name in ("forward_kinematics", "jacobian")]
    T, J = (np.array(evaluate(program, q)[0], float) for program in programs)
    reference = NewtonEuler(chain_of(spec), np.zeros((len(spec.rows), 10)))
    np.testing.assert_allclose(T, reference.forward_kinematics(q[None])[0], atol=1e-14)
    np.testing.assert_allclose(J, reference.jacobian(q[None])[0], atol=1e-14)
    still = slice(5, 8) if tip == "finger" else slice(2, 5)
    assert not J[:, still].any()
    assert np.count_nonzero(np.linalg.norm(J, axis=0)) == 5
