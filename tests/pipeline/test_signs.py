"""Joints with ``sign: -1``: everything that names a link frame means the frame of the robot file.

The dynamics of such robots are compared in tests/derive/test_dynamics.py and tests/emit/targets/test_export.py, link
frames among them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from oracles import newton_euler as oracle
from oracles.random_robots import random_link, random_robot, to_yaml, transform
from rrrgen.derive import derive
from rrrgen.lab.calibrate.geometry import GeometryEntry, geometry_of
from rrrgen.lab.calibrate.robot_file import calibrated_spec
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.runtime.inverse_kinematics import load_solver, load_tool_solver
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of

TOOLS = "tools:\n  gripper: {translation: [0.1, 0.2, 0.3], rpy: [0.3, -0.2, 0.1]}\n"


def turned(seed: int, convention: str, **options):
    """A random arm of three joints whose first and last move against their rows."""
    robot = random_robot(seed, 3, convention=convention, **options)
    return replace(robot, signs=(-1, 1, -1), name="turned")


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_tools_and_payloads_are_in_the_frame_of_the_file(convention, tmp_path):
    """A tool of the file, a tool and a payload at run time, parameters of links and their regressor."""
    robot = turned(3, convention)
    (tmp_path / "turned.yaml").write_text(to_yaml(robot) + TOOLS, encoding="utf-8")
    model = rrrgen.compile(tmp_path / "turned.yaml", backend="numpy")
    gripping = rrrgen.compile(f"{tmp_path / 'turned.yaml'}@gripper", backend="numpy")
    assert not model.spec.faults
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-2, 2, (3, 3))
    last = oracle.frames(robot, q).links[-1]
    np.testing.assert_allclose(model.link_frames(q)[-1], last, atol=1e-14)
    tool = np.array(model.spec.tools["gripper"].matrix(), float)
    np.testing.assert_allclose(gripping.forward_kinematics(q), last @ tool, atol=1e-14)
    np.testing.assert_allclose(model.tool_kinematics(q, tool)[0], last @ tool, atol=1e-14)
    np.testing.assert_allclose(model.base_parameters_of(robot.phi), model.beta, rtol=1e-12, atol=1e-12)
    Y = oracle.standard_regressor(robot, q, dq, ddq)
    np.testing.assert_allclose(model.standard_regressor(q, dq, ddq), Y, atol=1e-12 * np.abs(Y).max())
    load = random_link(rng)
    beta = model.add_payload(load.mass, load.com, load.inertia)
    loaded = oracle.inverse_dynamics(robot, q, dq, ddq) + Y[:, -10:] @ load.parameters()
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, beta=beta), loaded, rtol=1e-11)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.sweep(but=["modified"])
def test_a_basis_may_stand_beside_a_sign(convention):
    """Its expressions are in the link frames of the file, as those of the same robot without signs are."""
    text = to_yaml(turned(4, convention, prismatic=0.0))
    model = derive(loads_spec(text))
    entries = ", ".join(f'"b{k} = {p.expression}"' for k, p in enumerate(model.base_parameters, 1))
    chosen = derive(loads_spec(f"{text}basis: {{products: tensor, parameters: [{entries}]}}\n"))
    assert [str(p.expression) for p in chosen.base_parameters] == [str(p.expression) for p in model.base_parameters]


@pytest.mark.parametrize("name", ["puma560", "stanford", "panda", "scara"])
def test_inverse_kinematics_of_turned_joints(name):
    spec = load_spec(name)
    joints = tuple(replace(j, sign=-1 if i % 2 == 0 else 1) for i, j in enumerate(spec.joints))
    spec = replace(spec, joints=joints, name="turned", basis=None)
    solver = load_solver(spec, backend="numpy")
    for q in np.random.default_rng(1).uniform(-1, 1, (4, spec.n)):
        goal = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10))).forward_kinematics(q[None])[0]
        given = {"redundancy": solver.parameter(q)} if solver.plan.locked is not None else {}
        found = solver.solve(goal, q, limits=False, sort="nearest", **given)
        apart = found.q[0] - q
        turning = [joint.is_revolute for joint in joints]
        assert np.abs(np.where(turning, (apart + np.pi) % (2 * np.pi) - np.pi, apart)).max() < 1e-7


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_inverse_kinematics_with_a_tool_at_run_time(convention):
    values = ((0.7, 0.3, 0.2, 0.4), (-1.1, 0.25, 0.1, 0.0), (0.5, 0.2, 0.15, 0.3))
    tool = transform((1, 2, 2, 0), (0.1, -0.2, 0.35))
    robot = replace(turned(8, convention), rows=tuple(("revolute", *row) for row in values), tool=tool)
    solver = load_tool_solver(loads_spec(to_yaml(robot)), backend="numpy")
    for q in np.random.default_rng(2).uniform(-2, 2, (5, 3)):
        tool = np.array([0.1, -0.2, 0.3])
        goal = (oracle.frames(robot, q).links[-1] @ [*tool, 1.0])[:3]
        answer = solver.solve([*goal, *tool], q, limits=False, sort="nearest")
        np.testing.assert_allclose(answer.q[0], q, atol=1e-7)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("beta", [False, True])
def test_a_calibrated_robot_keeps_signs_and_link_frames(convention, beta):
    """With an angle beta all rows are new; the pose of the tip at a joint position and the mechanics stay."""
    robot = replace(turned(5, convention, right_angles=0.0), tool=transform((1, 2, 2, 0), (0.1, -0.2, 0.35)))
    spec = loads_spec(to_yaml(robot))
    geometry = geometry_of(spec)
    q = np.random.default_rng(3).uniform(-2, 2, (6, 3))
    expected = np.array([oracle.forward_kinematics(robot, x) for x in q])
    np.testing.assert_allclose(geometry.forward(q), expected, atol=1e-12)
    entries = [
        GeometryEntry("row", "theta", 1),
        GeometryEntry("row", "alpha", 0),
        GeometryEntry("row", "d", 2),
        GeometryEntry("tool", "x", 0),
    ]
    if beta:
        entries.append(GeometryEntry("row", "beta", 1))
    moved = geometry.with_step(entries, np.full(len(entries), 2e-3))
    told = loads_spec(dumps(calibrated_spec(spec, moved, "test")))
    np.testing.assert_allclose(geometry_of(told).forward(q), moved.forward(q), atol=1e-10)
    phi = np.zeros((3, 10))
    np.testing.assert_allclose(NewtonEuler(chain_of(told), phi).forward_kinematics(q), moved.forward(q), atol=1e-10)
    if not beta:
        assert [joint.sign for joint in told.joints] == [-1, 1, -1]
        assert told.links == spec.links
        frames = NewtonEuler(chain_of(told), phi).link_frames(q)
        stated = np.array([oracle.frames(robot, x).links for x in q])
        assert np.abs(frames - stated).max() < 0.05


def test_gains_of_a_calibration_keep_the_sign():
    robot = turned(5, "modified", right_angles=0.0)
    spec = loads_spec(to_yaml(robot))
    gains = np.array([1.01, 0.99, 1.02])
    told = loads_spec(dumps(calibrated_spec(spec, replace(geometry_of(spec), gains=gains), "test")))
    q = np.random.default_rng(3).uniform(-2, 2, (6, 3))
    expected = np.array([oracle.forward_kinematics(robot, x * gains) for x in q])
    found = NewtonEuler(chain_of(told), np.zeros((3, 10))).forward_kinematics(q)
    np.testing.assert_allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.sweep(but=["standard"])
def test_tools_and_payloads_of_a_mechanism_with_signs(convention, tmp_path):
    """A follower and its leader move against their rows: y = -q and y = 2 q."""
    robot = random_robot(6, 3, convention=convention, prismatic=0.0)
    lines = to_yaml(robot).splitlines()
    rows = [k for k, line in enumerate(lines) if line.startswith("  - {type")]
    lines[rows[0]] = lines[rows[0]].replace("{type", "{name: lead, sign: -1, type")
    lines[rows[2]] = lines[rows[2]].replace("{type", "{sign: -1, follows: {lead: -2}, type")
    (tmp_path / "turned.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    model = rrrgen.compile(tmp_path / "turned.yaml", backend="numpy")
    S = np.array([[-1, 0], [0, 1], [2, 0]])
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-2, 2, (3, 2))
    y = (S @ q, S @ dq, S @ ddq)
    frames = oracle.frames(robot, y[0])
    np.testing.assert_allclose(model.link_frames(q), frames.links, atol=1e-14)
    Y = S.T @ oracle.standard_regressor(robot, *y)
    np.testing.assert_allclose(model.standard_regressor(q, dq, ddq), Y, atol=1e-12 * np.abs(Y).max())
    load = random_link(rng)
    beta = model.add_payload(load.mass, load.com, load.inertia)
    expected = Y @ robot.phi + Y[:, -10:] @ load.parameters()
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, beta=beta), expected, rtol=1e-11)
    tool = transform((1, 2, 2, 0), (0.1, -0.2, 0.35))
    np.testing.assert_allclose(model.tool_kinematics(q, tool)[0], frames.links[-1] @ tool, atol=1e-14)
