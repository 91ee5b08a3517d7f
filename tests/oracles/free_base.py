"""Robots on a floating base in Pinocchio, with a free flyer, and in MuJoCo, with a free joint."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rrrgen.verify.references.libraries import MujocoReference
from rrrgen.verify.references.numeric_robot import centre_and_tensor, chain_of, nominal_parameters, without_mass


class FreePinocchio:
    """The robot on a free flyer, with a joint for every row; ``S`` takes [twist; dq] to the velocities of all rows."""

    def __init__(self, spec) -> None:
        self.pin = pin = pytest.importorskip("pinocchio")
        self.chain, phi = chain_of(spec), nominal_parameters(spec)
        bare = without_mass(self.chain, phi)
        chain, around = self.chain, self.chain.around_joints()
        self.model = free = pin.Model()
        free.gravity.linear = chain.gravity
        behind, joints = (
            [after for _, after in around],
            {0: free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")},
        )
        for i in chain.depth_first():
            before, after = around[i]
            if i:
                kind = pin.JointModelRZ() if chain.revolute[i] else pin.JointModelPZ()
                place = pin.SE3(chain.behind(behind, i) @ before)
                joints[i] = free.addJoint(joints[chain.parents[i]], kind, place, f"joint{i}")
            if i in bare:
                continue
            centre, tensor = centre_and_tensor(phi[i])
            free.appendBodyToJoint(joints[i], pin.Inertia(float(phi[i, 0]), centre, tensor), pin.SE3(after))
        self.tips = {}
        for name in ("", *spec.tips):
            one = chain_of(spec.at_tip(name)) if name else chain
            place = pin.SE3(around[one.tip][1] @ one.tool)
            self.tips[name] = free.addFrame(pin.Frame(f"tip {name}", joints[one.tip], place, pin.FrameType.OP_FRAME))
        self.data = free.createData()
        self.S = np.zeros((free.nv, 6 + chain.n))
        self.S[:6, :6] = np.eye(6)
        for i in range(1, chain.links):
            self.S[free.joints[joints[i]].idx_v, 6:] = chain.coupling[i]

    def rows(self, q) -> np.ndarray:
        """The positions of all rows for those of Pinocchio's convention (7 + n)."""
        return np.concatenate([q[:7], self.S[6:, 6:] @ q[7:]])

    def inverse_dynamics(self, q, v, a) -> np.ndarray:
        """Wrench and torques (6 + n,) by ``rnea``."""
        return self.S.T @ self.pin.rnea(self.model, self.data, self.rows(q), self.S @ v, self.S @ a)

    def mass_matrix(self, q) -> np.ndarray:
        """M (6 + n, 6 + n) by ``crba``."""
        upper = np.triu(self.pin.crba(self.model, self.data, self.rows(q)))
        return self.S.T @ (upper + np.triu(upper, 1).T) @ self.S

    def regressor(self, q, v, a) -> np.ndarray:
        """The regressor (6 + n, 10 links) of the inertial parameters of all links."""
        Y = self.pin.computeJointTorqueRegressor(self.model, self.data, self.rows(q), self.S @ v, self.S @ a)
        return self.S.T @ Y


class FreeMujoco(MujocoReference):
    """The robot on a free joint."""

    def _mjcf(self, chain, phi):
        return re.sub(r"(<worldbody><body [^>]*>)", r"\1<freejoint/>", super()._mjcf(chain, phi))

    def forces(self, qpos, qvel, qacc):
        self._data.qpos[:7], self._data.qvel[:6], self._data.qacc[:6] = qpos[:7], qvel[:6], qacc[:6]
        places = np.array(self._places)
        for store, shift, values in (
            (self._data.qpos, 1, qpos[7:]),
            (self._data.qvel, 0, qvel[6:]),
            (self._data.qacc, 0, qacc[6:]),
        ):
            store[places + shift] = self._coupling @ values
        self._mujoco.mj_inverse(self._model, self._data)
        forces = np.array(self._data.qfrc_inverse)
        return np.concatenate([forces[:6], forces[places] @ self._coupling])
