"""Robots of the Robotics Toolbox: the same poses and torques, friction and drives at the joint."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters


def toolbox():
    return pytest.importorskip("roboticstoolbox")


@pytest.mark.parametrize("name", ["Puma560", "Panda", "Stanford", "UR10", "IRB140", "LWR4", "Cobra600"])
def test_models_of_the_toolbox(name):
    robot = getattr(toolbox().models.DH, name)()
    spec = rrrgen.from_toolbox(robot, name="arm", angle_tolerance=0.0)
    q, dq, ddq = (np.random.default_rng(0).uniform(-1, 1, (3, spec.n)) for _ in range(3))
    phi = nominal_parameters(spec)
    ours = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10)) if phi is None else phi)
    np.testing.assert_allclose(ours.forward_kinematics(q), [robot.fkine(x).A for x in q], atol=1e-9)
    if phi is not None and all(link.r is not None for link in robot.links):
        bare = robot.nofriction(coulomb=True, viscous=True)
        gravity = robot.base.A[:3, :3].T @ np.ravel(robot.gravity)
        tau = [bare.rne_python(*state, gravity=gravity) for state in zip(q, dq, ddq, strict=True)]
        np.testing.assert_allclose(ours.inverse_dynamics(q, dq, ddq), np.reshape(tau, q.shape), atol=1e-9)


def test_friction_and_drives_are_at_the_joint():
    rtb = toolbox()
    link = rtb.RevoluteDH(a=0.4, alpha=1.5708, m=1, r=[0.1, 0, 0], I=[0.1, 0.2, 0.2, 0, 0, 0], Jm=2e-4, G=-50, B=1e-3,
                          Tc=[0.3, -0.1], qlim=[-1, 2])  # fmt: skip
    spec = rrrgen.from_toolbox(rtb.DHRobot([link], name="one arm"))
    (joint,) = spec.joints
    assert spec.name == "one_arm"
    assert str(joint.alpha) == "pi/2"
    assert (joint.limits.lower, joint.limits.upper) == (-1, 2)
    assert joint.drive.inertia == pytest.approx(0.5)
    assert joint.drive.gear_ratio == -50
    assert joint.friction.viscous == pytest.approx(2.5)
    assert joint.friction.coulomb == pytest.approx(10)
    assert joint.friction.offset == pytest.approx(5)
    dq = np.array([0.7])
    assert link.friction(dq[0]) == pytest.approx(-(2.5 * 0.7 + 10 + 5))


def test_other_objects_are_refused():
    with pytest.raises(InputError, match="is no DHRobot"):
        rrrgen.from_toolbox([1, 2])


LINK = {"sigma": 0, "a": 0.1, "alpha": 0.0, "d": 0.0, "theta": 0.0, "offset": 0.0, "qlim": None, "m": 1.0,
        "r": np.zeros(3), "I": np.eye(3), "Jm": 0.0, "B": 0.0, "Tc": [0.0, 0.0], "G": 0.0, "mdh": False}  # fmt: skip
ROBOT = {"mdh": False, "base": np.eye(4), "tool": np.eye(4), "gravity": [0, 0, -9.81], "name": "arm"}


def robot_with(link=(), **robot):
    """A robot of two links as the importer sees it; values of the second link or of the robot are replaced."""
    links = [SimpleNamespace(**LINK), SimpleNamespace(**{**LINK, **dict(link)})]
    return SimpleNamespace(**{"links": links, **ROBOT, **robot})


BROKEN = {
    "symbol": ({"a": sp.Symbol("a2")}, {}, "a of link 2 is 'a2', not a finite number", "replace symbols by"),
    "nan": ({"d": float("nan")}, {}, "d of link 2 is 'nan', not a finite number", ""),
    "text": ({"alpha": "90"}, {}, "alpha of link 2 is '90', not a finite number", ""),
    "nothing": ({"offset": None}, {}, "offset of link 2 is 'None', not a finite number", ""),
    "joint": ({"sigma": 2}, {}, "sigma of link 2 is '2'", "0 revolute, 1 prismatic"),
    "convention": ({"mdh": True}, {}, "link 2 is not of the standard convention", "one convention for all"),
    "limits": ({"qlim": [1, -1]}, {}, "qlim of link 2 is [1, -1]: the lower bound is above", ""),
    "three limits": ({"qlim": [0, 1, 2]}, {}, "qlim of link 2 has 3 values instead of 2", ""),
    "one limit": ({"qlim": "wide"}, {}, "qlim of link 2 has 1 values instead of 2", ""),
    "tensor": ({"I": np.zeros(6)}, {}, "I of link 2 has 6 values instead of 9", ""),
    "skew tensor": ({"I": np.triu(np.ones((3, 3)))}, {}, "I of link 2 is not symmetric", "3 x 3"),
    "mass": ({"m": -1}, {}, "m of link 2 is negative", ""),
    "viscous": ({"B": -1}, {}, "B of link 2 is negative", "takes energy"),
    "Coulomb": ({"Tc": [-1, 1]}, {}, "Tc of link 2 is [-1, 1]", "[positive, negative]"),
    "rotor": ({"Jm": -1}, {}, "Jm of link 2 is negative", ""),
    "gear": ({"G": np.nan}, {}, "G of link 2 is 'nan'", ""),
    "gravity": ({}, {"gravity": [0, 9.81]}, "gravity has 2 values instead of 3", ""),
    "base": ({}, {"base": np.eye(3)}, "base has 9 values instead of 16", ""),
    "tool": ({}, {"tool": np.diag([1, 2, 1, 1])}, "the rotation of tool is not orthonormal", ""),
    "matrix of nan": ({}, {"tool": np.full((4, 4), np.nan)}, "entry 1 of tool is 'nan'", ""),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_robots(case):
    link, robot, message, hint = BROKEN[case]
    with pytest.raises(InputError) as caught:
        rrrgen.from_toolbox(robot_with(link, **robot))
    (fault,) = caught.value.faults
    assert fault.file == "arm of the Robotics Toolbox"
    assert fault.message.startswith(message)
    assert hint in fault.hint


def test_every_fault_is_told_and_sound_robots_are_read():
    spec = rrrgen.from_toolbox(robot_with({"qlim": [-np.inf, 2.0]}))
    assert (spec.joints[1].limits.lower, spec.joints[1].limits.upper, spec.joints[0].limits.upper) == (None, 2.0, None)
    robot = robot_with({"a": "x", "m": np.inf, "Tc": [1.0]}, gravity=None)
    del robot.links[0].qlim
    with pytest.raises(InputError) as caught:
        rrrgen.from_toolbox(robot)
    assert len(caught.value.faults) == 5
    assert "link 1 has no 'qlim'" in str(caught.value)
    for other in (type(robot), None, SimpleNamespace(**{**vars(robot), "links": 3})):
        with pytest.raises(InputError, match="is no DHRobot with links"):
            rrrgen.from_toolbox(other)
    with pytest.raises(InputError, match="angle_tolerance is -1, not an angle"):
        rrrgen.from_toolbox(robot_with(), angle_tolerance=-1)


def test_a_flipped_joint_is_a_row_with_a_sign():
    class Flipped:
        """A link of the toolbox seen with its flip."""

        def __init__(self, link):
            self.link, self.isflip = link, True

        def __getattr__(self, name):
            return getattr(self.link, name)

    robot = toolbox().models.DH.Puma560()
    plain = rrrgen.from_toolbox(robot)
    links = [Flipped(link) if k in (0, 2) else link for k, link in enumerate(robot.links)]
    parts = {name: getattr(robot, name) for name in ("mdh", "base", "tool", "gravity")}
    spec = rrrgen.from_toolbox(type("Arm", (), {**parts, "links": links, "name": "arm"})())
    q = np.random.default_rng(1).uniform(-1, 1, (4, 6))
    signs = np.array([-1, 1, -1, 1, 1, 1])
    ours, theirs = (NewtonEuler(chain_of(s), nominal_parameters(s)) for s in (spec, plain))
    np.testing.assert_allclose(ours.forward_kinematics(q), theirs.forward_kinematics(q * signs), atol=1e-12)
    tau = theirs.inverse_dynamics(q * signs, q * signs, q * signs) * signs
    np.testing.assert_allclose(ours.inverse_dynamics(q, q, q), tau, atol=1e-10)
    assert [joint.sign for joint in spec.joints] == signs.tolist()
    assert spec.links == plain.links
