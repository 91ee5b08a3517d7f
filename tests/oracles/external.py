"""Other people's dynamics as oracles: Pinocchio, MuJoCo and the Robotics Toolbox, each built from a Robot.

Constructors skip the calling test, with the reason, when the package is not installed. All three take gravity as the
acceleration of gravity, [0, 0, -9.81] for an upright robot.
"""

from __future__ import annotations

import numpy as np
import pytest

from oracles.newton_euler import Robot, screw_x, screw_z


def motion_split(robot: Robot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Per row (before, after): T = before * motion(q) * after, the motion turning about or sliding along z."""
    split = []
    for _, alpha, a, d, theta in robot.rows:
        screw, twist = screw_z(theta, d), screw_x(alpha, a)
        split.append((np.eye(4), screw @ twist) if robot.convention == "standard" else (twist @ screw, np.eye(4)))
    return split


def parameter_transport(T: np.ndarray) -> np.ndarray:
    """The 10x10 matrix that takes standard parameters about frame B to frame A when T is B seen from A.

    The pseudo-inertia P = int [r 1]'[r 1] dm goes over as T P T'.
    """
    X = np.zeros((10, 10))
    places = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
    for k in range(10):
        P, S = np.zeros((4, 4)), np.zeros((3, 3))
        if k == 0:
            P[3, 3] = 1.0
        elif k < 4:
            P[k - 1, 3] = P[3, k - 1] = 1.0
        else:
            row, column = places[k - 4]
            S[row, column] = S[column, row] = 1.0
            P[:3, :3] = 0.5 * np.trace(S) * np.eye(3) - S
        P = T @ P @ T.T
        S = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
        X[:, k] = [P[3, 3], *P[:3, 3], *(S[place] for place in places)]
    return X


class Pinocchio:
    """The robot in Pinocchio: joints RZ/PZ at the moving frames, inertias carried to them."""

    def __init__(self, robot: Robot) -> None:
        self.pin = pin = pytest.importorskip("pinocchio", reason="oracle Pinocchio (package pin) is not installed")
        self.robot = robot
        self.model = pin.Model()
        self.model.gravity.linear = robot.gravity
        before_joint, parent = robot.base, 0
        for i, (before, after) in enumerate(motion_split(robot)):
            joint = pin.JointModelRZ() if robot.rows[i][0] == "revolute" else pin.JointModelPZ()
            parent = self.model.addJoint(parent, joint, pin.SE3(before_joint @ before), f"joint{i}")
            if robot.links:
                link = robot.links[i]
                inertia = pin.Inertia(link.mass, link.com, link.inertia)
                self.model.appendBodyToJoint(parent, inertia, pin.SE3(after))
            before_joint = after
        self.tip = pin.SE3(before_joint @ robot.tool)
        self.data = self.model.createData()

    def inverse_dynamics(self, q, dq, ddq) -> np.ndarray:
        return self.pin.rnea(self.model, self.data, q, dq, ddq).copy()

    def mass_matrix(self, q) -> np.ndarray:
        M = np.triu(self.pin.crba(self.model, self.data, q))
        return M + np.triu(M, 1).T

    def inverse_dynamics_derivatives(self, q, dq, ddq) -> tuple[np.ndarray, ...]:
        """dtau/dq, dtau/d(dq), M."""
        self.pin.computeRNEADerivatives(self.model, self.data, q, dq, ddq)
        upper = np.triu(self.data.M)
        return self.data.dtau_dq.copy(), self.data.dtau_dv.copy(), upper + np.triu(upper, 1).T

    def forward_dynamics_derivatives(self, q, dq, tau) -> tuple[np.ndarray, ...]:
        """d(ddq)/dq, d(ddq)/d(dq), inv(M)."""
        self.pin.computeABADerivatives(self.model, self.data, q, dq, tau)
        upper = np.triu(self.data.Minv)
        return self.data.ddq_dq.copy(), self.data.ddq_dv.copy(), upper + np.triu(upper, 1).T

    def forward_kinematics(self, q) -> np.ndarray:
        self.pin.forwardKinematics(self.model, self.data, q)
        return (self.data.oMi[self.robot.n] * self.tip).homogeneous

    def standard_regressor(self, q, dq, ddq) -> np.ndarray:
        """Pinocchio's joint torque regressor, its columns carried from the joint frames to the link frames."""
        Y = self.pin.computeJointTorqueRegressor(self.model, self.data, q, dq, ddq)
        Y = np.reshape(Y, (self.robot.n, -1))  # the binding drops the row axis of a single joint
        transports = [parameter_transport(after) for _, after in motion_split(self.robot)]
        return np.hstack([Y[:, 10 * j : 10 * j + 10] @ X for j, X in enumerate(transports)])


class MuJoCo:
    """The robot in MuJoCo: one body per link at the moving frame, axis z, nothing that touches or limits."""

    def __init__(self, robot: Robot) -> None:
        self.mujoco = mujoco = pytest.importorskip("mujoco", reason="oracle MuJoCo (package mujoco) is not installed")
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(self._mjcf())
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)

    def _mjcf(self) -> str:
        def text(values) -> str:
            return " ".join(repr(float(v)) for v in values)

        def place(T: np.ndarray) -> str:
            quaternion = np.zeros(4)
            self.mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).reshape(9))
            return f'pos="{text(T[:3, 3])}" quat="{text(quaternion)}"'

        lines, before_joint = [], self.robot.base
        for (kind, *_), (before, after), link in zip(
            self.robot.rows, motion_split(self.robot), self.robot.links, strict=True
        ):
            R = after[:3, :3]
            S = R @ link.inertia @ R.T
            entries = (S[0, 0], S[1, 1], S[2, 2], S[0, 1], S[0, 2], S[1, 2])
            lines.append(
                f"<body {place(before_joint @ before)}>"
                f'<joint type="{"hinge" if kind == "revolute" else "slide"}" axis="0 0 1"/>'
                f'<inertial mass="{link.mass!r}" pos="{text(after[:3, 3] + R @ link.com)}" '
                f'fullinertia="{text(entries)}"/>'
            )
            before_joint = after
        lines.append(f'<site name="tip" {place(before_joint @ self.robot.tool)}/>' + "</body>" * self.robot.n)
        return (
            f'<mujoco><compiler angle="radian"/><option gravity="{text(self.robot.gravity)}"/><worldbody>'
            + "\n".join(lines)
            + "</worldbody></mujoco>"
        )

    def _at(self, q) -> None:
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q, 0.0, 0.0
        self.mujoco.mj_forward(self.model, self.data)

    def inverse_dynamics(self, q, dq, ddq) -> np.ndarray:
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q, dq, ddq
        self.mujoco.mj_inverse(self.model, self.data)
        return self.data.qfrc_inverse.copy()

    def mass_matrix(self, q) -> np.ndarray:
        self._at(q)
        columns = np.zeros((self.robot.n, self.robot.n))
        for row, unit in zip(columns, np.eye(self.robot.n), strict=True):
            self.mujoco.mj_mulM(self.model, self.data, row, unit)
        return columns.T

    def forward_kinematics(self, q) -> np.ndarray:
        self._at(q)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.data.site("tip").xmat.reshape(3, 3), self.data.site("tip").xpos
        return T


class RoboticsToolbox:
    """The robot as a DHRobot; gravity is turned into the frame of the first row, so its base stays the identity."""

    def __init__(self, robot: Robot) -> None:
        rtb = pytest.importorskip(
            "roboticstoolbox", reason="oracle Robotics Toolbox (package roboticstoolbox-python) is not installed"
        )
        kinds = {
            ("standard", "revolute"): rtb.RevoluteDH,
            ("standard", "prismatic"): rtb.PrismaticDH,
            ("modified", "revolute"): rtb.RevoluteMDH,
            ("modified", "prismatic"): rtb.PrismaticMDH,
        }
        joints = []
        for i, (kind, alpha, a, d, theta) in enumerate(robot.rows):
            body = robot.links[i] if robot.links else None
            inertial = {"m": body.mass, "r": body.com, "I": body.inertia, "G": 1.0} if body else {}
            variable = {"d": d, "offset": theta} if kind == "revolute" else {"theta": theta, "offset": d}
            joints.append(kinds[robot.convention, kind](a=a, alpha=alpha, **variable, **inertial))
        self.robot = robot
        self.arm = rtb.DHRobot(joints, name=robot.name, gravity=robot.base[:3, :3].T @ robot.gravity)

    def inverse_dynamics(self, q, dq, ddq, gravity=None) -> np.ndarray:
        # rne_python, not rne: the C routine of 1.5.0 is wrong (by the size of the torque) for most chains whose first
        # joint is prismatic, where the Python routine, Pinocchio and MuJoCo agree with one another to round-off.
        field = self.arm.gravity if gravity is None else gravity
        return np.asarray(self.arm.rne_python(q, dq, ddq, gravity=field), dtype=float).reshape(-1)

    def mass_matrix(self, q) -> np.ndarray:
        zero = np.zeros(self.robot.n)
        return np.array([self.inverse_dynamics(q, zero, e, np.zeros(3)) for e in np.eye(self.robot.n)]).T

    def forward_kinematics(self, q) -> np.ndarray:
        return self.robot.base @ np.asarray(self.arm.fkine(q).A) @ self.robot.tool
