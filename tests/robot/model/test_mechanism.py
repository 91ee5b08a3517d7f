"""Named tips of a robot that branches: the joints that move each alone, and the functions of every tip."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from emit.c_tools import C99, CXX, compile_all, compiler, run, write
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.derive import closed_form, derive_once
from rrrgen.derive.functions.table import functions_for
from rrrgen.emit.package import emit
from rrrgen.ik.classify import tip_plans
from rrrgen.robot.file import loads_spec
from rrrgen.robot.model.mechanism import tip_arm
from rrrgen.verify import verify

TWO_ARMS = """\
schema: rrrgen/1
name: pair
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
base: {translation: [0.1, 0.2, 0.3], rpy: [10, -20, 30]}
joints:
  - {name: lift, type: prismatic, alpha: 20, a: 0.1, theta: 0}
  - {name: yaw, type: revolute, alpha: 0, a: 0.2, d: 0.5}
  - {name: l1, type: revolute, parent: yaw, gamma: 80, b: 0.3, alpha: -90, a: 0.05, d: 0.1, limits: {upper: 170}}
  - {name: l2, type: revolute, alpha: 90, a: 0.1, d: 0.02, theta: 40}
  - {name: r1, type: revolute, parent: yaw, gamma: -90, b: 0.3, alpha: -90, a: 0.05, d: 0.1}
  - {name: r2, type: prismatic, alpha: 90, a: 0.1, d: 0.1, theta: 10}
tip: yaw
tips:
  left: {row: l2, tool: {translation: [0.25, 0, 0.05], rpy: [0, 30, 0]}}
  elbow: {row: l1, tool: {translation: [0.1, 0, 0]}}
  right: {row: r2, tool: {translation: [0, 0, 0.1]}}
"""
"""A column that lifts and yaws carries an arm of two turning joints and one with a slide; a tip also at an elbow."""

Q = np.array([0.2, 0.5, 0.4, -0.3, 0.9, 0.15])


@pytest.fixture(scope="module")
def spec():
    return loads_spec(TWO_ARMS)


@pytest.fixture(scope="module")
def model(spec):
    return rrrgen.compile(spec)


def test_a_tip_is_moved_by_joints_of_its_own_behind_those_that_it_shares(spec):
    arms = {tip: tip_arm(spec, tip) for tip in spec.tips}
    found = {tip: (arm.spec.name, arm.carrier, arm.joints, arm.shared) for tip, arm in arms.items()}
    assert found == {
        "left": ("pair_left", 1, (2, 3), (0, 1)),
        "elbow": ("pair_elbow", 1, (2,), (0, 1)),  # a tip on the way to another shares nothing with it
        "right": ("pair_right", 1, (4, 5), (0, 1)),
    }
    assert arms["left"].spec.joints[0].limits == spec.joints[2].limits


def test_a_tip_without_joints_of_its_own_or_with_shared_ones_behind_them_is_refused():
    lone = loads_spec(TWO_ARMS.replace("elbow: {row: l1,", "head: {row: yaw,"))
    assert tip_arm(lone, "head").joints == (0, 1)  # on the way to the others
    tied = loads_spec(TWO_ARMS.replace("{name: r2,", "{name: r2, follows: {r2: 1, l2: 0.1},"))
    with pytest.raises(DerivationError, match="pair_right: r1 moves this tip alone and stands before joints"):
        tip_arm(tied, "right")
    assert "stands before joints" in tip_plans(tied)["right"][1].reason


def test_every_tip_has_its_functions_and_a_robot_with_one_of_them_has_no_others(spec):
    names = set(derive_once(spec).programs)
    kinematics = ("forward_kinematics", "jacobian", "kinematics", "jacobian_dot_dq", "tip_target", "add_payload")
    assert {f"{tip}_{name}" for tip in spec.tips for name in kinematics} <= names
    assert not any(function.tip for function in functions_for(spec.at_tip("left"), ("model",)))


def test_verification_covers_every_tip(model):
    report = verify(model, samples=20, libraries=False)
    assert report.ok
    rows = [row.function for row in report.rows]
    for tip in ("left", "elbow", "right"):
        assert f"{tip}_jacobian_dot_dq" in rows
        assert f"{tip}_inverse_kinematics: FK(row) = target" in rows


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("tip", ["left", "elbow", "right"])
def test_inverse_kinematics_of_a_tip_keeps_the_other_joints(spec, model, tip, backend):
    robot = model if backend == "c" else rrrgen.compile(spec, backend="numpy")
    own = list(tip_arm(spec, tip).joints)
    T = robot.forward_kinematics(Q, tip=tip)
    place = T if robot.tip_ik(tip).plan.task == "pose" else T[:3, 3]
    found = robot.inverse_kinematics(place, Q, tip=tip, limits=False)
    assert np.abs(found.q - Q).max(axis=1).min() < 1e-9
    for q in found.q:
        assert np.delete(q, own).tolist() == np.delete(Q, own).tolist()
        assert np.abs(robot.forward_kinematics(q, tip=tip)[:3, 3] - T[:3, 3]).max() < 1e-12
    far = np.array(place)
    far[..., -1] += 1e3 if tip == "right" else 9.0
    batch = robot.inverse_kinematics(np.stack([place, far]), Q, tip=tip, limits=False)
    assert batch.counts.tolist() == [len(found), 0]
    assert np.isnan(batch.q[1]).all()


def test_wrong_tips_are_refused_with_those_that_there_are(model):
    with pytest.raises(ValueError, match="the robot has no tip 'lft'; its tips are left, elbow, right"):
        model.jacobian(Q, tip="lft")
    with pytest.raises(ValueError, match="tip 'left' needs q_ref, which holds lift, yaw, shared with other tips"):
        model.inverse_kinematics([0.1, 0.2, 0.3], tip="left")
    with pytest.raises(ValueError, match="its tips are none: name them under tips"):
        rrrgen.compile("planar2r", backend="numpy").jacobian([0.1, 0.2], tip="left")
    with pytest.raises(ValueError, match="tip= must name a tip that shares joints"):
        model.tip_target(np.eye(4), Q)
    with pytest.raises(InputError, match="last row of a pose"):
        model.tip_target(np.ones((4, 4)), Q, tip="left")


def test_functions_of_other_groups_closed_forms_and_casadi_have_the_tips_too(model, spec):
    casadi = pytest.importorskip("casadi")
    tool = np.array([[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1.0]])
    T, J = model.tool_kinematics(Q, tool, tip="left")
    last = model.link_frames(Q)[3]
    assert np.abs(T - last @ tool).max() < 1e-14
    assert np.abs(model.casadi_function("left_tool_kinematics")(Q, casadi.DM(tool))[1] - J).max() < 1e-14
    form = closed_form(spec, "elbow_forward_kinematics").matrix()
    values = {f"q{k + 1}": x for k, x in enumerate(Q)}
    numbers = np.array(form.subs({s: values[s.name] for s in form.free_symbols}).evalf(), dtype=float)
    assert np.abs(numbers - model.forward_kinematics(Q, tip="elbow")).max() < 1e-13
    branch = model.casadi_function("left_inverse_kinematics")
    target = model.tip_target(model.forward_kinematics(Q, tip="left"), Q, tip="left")[:3, 3]
    signs = [casadi.DM(s) for s in ([1, 1], [1, -1], [-1, 1], [-1, -1])]
    found = [np.array(branch(target, s[: branch.size1_in(1)])).ravel() for s in signs]
    assert min(np.abs(q - Q[2:4]).max() for q in found) < 1e-9


def test_a_payload_at_a_tip_loads_its_link(model, spec):
    beta = np.arange(len(model.base_parameters), dtype=float)
    loaded = model.add_payload(2.0, [0.1, 0.2, 0.3], beta=beta, tip="right")
    wanted = beta + model.base_projection[:, 50:60] @ [2, 0.2, 0.4, 0.6, 0.26, -0.04, 0.2, -0.06, -0.12, 0.1]
    assert np.abs(loaded - wanted).max() < 1e-12


@pytest.mark.parametrize(("name", "real"), [("gcc", "double"), pytest.param("clang", "float", marks=pytest.mark.sweep)])
def test_emitted_c_of_all_tips_compiles_without_warnings_and_passes_its_self_test(spec, name, real, tmp_path):
    files = {path: text for path, text in emit(derive_once(spec), real).items() if path.endswith((".c", ".h"))}
    folder = write({path: text for path, text in files.items() if "/" not in path}, tmp_path)
    done = run(compile_all(folder, [compiler(name), *C99]))
    assert done.returncode == 0, done.stdout
    for tip in ("left", "elbow", "right"):
        assert f"ok      inverse kinematics of {tip}: every row meets its target" in done.stdout
        assert f"pair_{tip}_forward_kinematics(" in files["pair.h"]
    assert run(compile_all(folder, [compiler("g++"), *CXX], "as_cpp")).returncode == 0
