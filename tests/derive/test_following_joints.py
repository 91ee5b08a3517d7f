"""Joints that follow others: every function against Newton-Euler, and MuJoCo's equality constraints."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from derive.trees import PALLETISER, PLACED_TREE, TREE, X, Y, Z
from rrrgen.derive import prepare
from rrrgen.derive.functions.table import recorders
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.verify import verify


@pytest.mark.parametrize(
    "text", [TREE.format(convention="modified"), pytest.param(PLACED_TREE, marks=pytest.mark.sweep)]
)
def test_every_function_of_a_tree_with_followers_agrees_with_newton_euler(text):
    """Prismatic and revolute followers with fractions, several branches and roots; verify asks every function."""
    model = rrrgen.compile(loads_spec(text), backend="numpy")
    report = verify(model, samples=6, libraries=False)
    assert [row for row in report.rows if not row.ok] == []
    assert len(report.rows) > 40


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
