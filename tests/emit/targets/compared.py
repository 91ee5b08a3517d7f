"""Files of simulators and what their programs compute from them."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters


def states(spec, seed=0, count=5):
    random = np.random.default_rng(seed)
    return (random.uniform(-3, 3, (count, spec.n)) for _ in range(3))


def ours(spec, q, dq, ddq, drives=True):
    """Poses and torques without friction by the built-in Newton-Euler recursion."""
    chain = chain_of(spec)
    reference = NewtonEuler(chain, nominal_parameters(spec))
    tau = reference.inverse_dynamics(q, dq, ddq)
    return reference.forward_kinematics(q), tau if drives else tau - ddq @ chain.drive_inertia.T


def only(exported):
    ((_, text),) = exported.files.items()
    return text


def mujoco_answers(text, spec, q, dq, ddq):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, poses, torques = mujoco.MjData(model), [], []
    for state in zip(q, dq, ddq, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(model, data)
        torques.append(np.array(data.qfrc_inverse))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.reshape(data.site("tip").xmat, (3, 3)), data.site("tip").xpos
        poses.append(T)
    return np.stack(poses), np.stack(torques)


def names_of(model):
    return [parameter.name for parameter in model.base_parameters]
