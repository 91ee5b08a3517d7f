"""Robots of the Robotics Toolbox: the same poses and torques, friction and drives at the joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from rrrgen.errors import InputError
from rrrgen.verify.references.chain import chain_of, nominal_parameters
from rrrgen.verify.references.newton_euler import NewtonEuler


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


def test_a_flipped_joint_is_an_exact_row():
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
    assert replace(spec.joints[1], alpha=plain.joints[1].alpha) != spec.joints[1]
