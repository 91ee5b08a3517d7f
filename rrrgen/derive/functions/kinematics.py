"""Recorders of the kinematic functions: poses and Jacobians."""

from __future__ import annotations

from typing import Any

from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.recursions import kinematics as poses
from rrrgen.derive.recursions.linear_algebra import flat
from rrrgen.program import Port, Program

BASE = "base frame"
PRODUCT = "T = T_base A_1(q_1) ... A_n(q_n) T_tool   (14.5)"
VELOCITY = "[v; omega] = J(q) dq"


def forward_kinematics(r: FunctionBuilder) -> Program:
    """Record T(q) (4, 4), the tip in the base frame, by products of transforms from the base outwards. (14.5)"""
    return _pose(r, poses.forward_kinematics(r.chain()))


def forward_kinematics_inwards(r: FunctionBuilder) -> Program:
    """Record T(q) (4, 4), the tip in the base frame, by moving its axes and position from the tip inwards. (14.5)"""
    return _pose(r, poses.forward_kinematics_inwards(r.chain()))


def _pose(r: FunctionBuilder, T: list[list[Any]]) -> Program:
    return r.builder.program("forward_kinematics", [(pose_port(), flat(T))], "Pose of the tip.", PRODUCT)


def pose_port() -> Port:
    """The output port T (4, 4): the pose of the tip in the base frame."""
    return Port("T", (4, 4), "1, m", BASE, "homogeneous transform of the tip")


def jacobian_port(r: FunctionBuilder) -> Port:
    """The output port J (6, n): the geometric Jacobian of the tip in the base frame."""
    return Port("J", (6, r.n), "m, 1", BASE, "rows 1-3 linear, rows 4-6 angular velocity of the tip")


def link_frames(r: FunctionBuilder) -> Program:
    """Record the poses (n, 4, 4) of the link frames 1..n in the base frame."""
    frames = poses.link_frames(r.chain())
    port = Port("T", (r.model.links, 4, 4), "1, m", BASE, "homogeneous transforms of the link frames 1..n")
    values = [value for frame in frames for value in flat(frame)]
    return r.builder.program(
        "link_frames", [(port, values)], "Poses of all link frames.", "T_i = T_base A_1(q_1) ... A_i(q_i)"
    )


def jacobian(r: FunctionBuilder) -> Program:
    """Record J(q) (6, n), base frame: [v; omega] = J dq of the tip, in m/s and rad/s."""
    J = poses.jacobian(r.chain())
    return r.builder.program("jacobian", [(jacobian_port(r), flat(J))], "Geometric Jacobian at the tip.", VELOCITY)


def link_jacobians(r: FunctionBuilder) -> Program:
    """Record the geometric Jacobians (n, 6, n) of all link frames in the base frame, linear rows first."""
    chain = r.chain()
    frames = poses.joint_frames(chain)
    matrices = [poses.point_jacobian(chain, frames, k, X.p) for k, X in enumerate(chain.link_frames)]
    meaning = "of the origins of the link frames 1..n, each rows 1-3 linear, rows 4-6 angular velocity"
    return r.builder.program(
        "link_jacobians",
        [(Port("J", (r.model.links, 6, r.n), "m, 1", BASE, meaning), [value for J in matrices for value in flat(J)])],
        "Geometric Jacobians of all link frames.",
        "[v_i; omega_i] = J_i(q) dq,  torques of a wrench at frame i: J_i' [f; m]",
        ["Columns of joints beyond the link are zero."],
    )


def kinematics(r: FunctionBuilder) -> Program:
    """Record T (4, 4) and J (6, n) of the tip in one program, so that they share subexpressions."""
    chain = r.chain()
    T, J = poses.forward_kinematics(chain), poses.jacobian(chain)
    return r.builder.program(
        "kinematics",
        [(pose_port(), flat(T)), (jacobian_port(r), flat(J))],
        "Pose of the tip and geometric Jacobian; they share their evaluation.",
        f"{PRODUCT},  {VELOCITY}",
    )


def jacobian_dot_dq(r: FunctionBuilder) -> Program:
    """Record (dJ/dt) dq (6,), base frame: the acceleration of the tip for ddq = 0, in m/s^2 and rad/s^2."""
    chain = r.chain()
    a = poses.jacobian_dot_dq(chain, r.joints("dq"))
    port = Port("a", (6,), "m/s^2, rad/s^2", BASE, "linear, then angular acceleration of the tip for ddq = 0")
    return r.builder.program(
        "jacobian_dot_dq", [(port, a)], "Time derivative of the Jacobian times dq.", "a = (dJ/dt) dq"
    )


FORWARD_KINEMATICS = (forward_kinematics, forward_kinematics_inwards)
