"""MuJoCo as a reference: the robot as an MJCF model with one body per link, joint axes z, no contacts, no limits."""

from __future__ import annotations

import numpy as np

from rrrgen.verify.references.numeric_robot import Array, Chain, centre_and_tensor, without_mass
from rrrgen.verify.references.reference import ReferenceUnavailableError


def _text(values: Array) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _inertial(phi: Array, after: Array) -> str:
    """The element of a body's inertia, from standard parameters (10,) in the frame ``after`` (4, 4) of the body."""
    centre, tensor = centre_and_tensor(phi)
    R = after[:3, :3]
    moved = R @ tensor @ R.T
    entries = np.array([moved[0, 0], moved[1, 1], moved[2, 2], moved[0, 1], moved[0, 2], moved[1, 2]])
    at = _text(after[:3, 3] + R @ centre)
    return f'<inertial mass="{float(phi[0])!r}" pos="{at}" fullinertia="{_text(entries)}"/>'


class MujocoReference:
    """The robot as a ``mujoco.MjModel``; where joints follow others, its results are converted to q.

    ``phi`` (links, 10) are the standard parameters.
    """

    def __init__(self, chain: Chain, phi: Array) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise ReferenceUnavailableError.at_import(error, "mujoco") from error
        self._mujoco = mujoco
        self.name = f"MuJoCo {mujoco.__version__}"
        if np.any(np.delete(phi, without_mass(chain, phi), axis=0)[:, 0] <= 0.0):
            raise ReferenceUnavailableError("a link has no mass, so it has no centre of mass")
        try:
            self._model = mujoco.MjModel.from_xml_string(self._mjcf(chain, phi))
        except ValueError as error:
            raise ReferenceUnavailableError(f"refuses the model: {str(error).splitlines()[0]}") from error
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)
        # MuJoCo's armature is a diagonal matrix; the drive inertia of coupled joints is added to its results
        self._added = chain.drive_inertia - (np.diag(np.diag(chain.drive_inertia)) if chain.plain else 0.0)
        self._coupling = chain.coupling[chain.moving]
        self._places = [self._model.joint(f"joint{i}").dofadr[0] for i in chain.moving]

    def _mjcf(self, chain: Chain, phi: Array) -> str:
        """The model as MJCF text."""
        around = chain.around_joints()
        behind, bodies = [after for _, after in around], [""] * chain.links
        moving, bare = chain.moving, without_mass(chain, phi)
        for i in reversed(range(chain.links)):
            before, after = around[i]
            kind = "hinge" if chain.revolute[i] else "slide"
            armature = float(chain.drive_inertia[i, i]) if chain.plain else 0.0
            site = f'<site name="tip" {self._place(after @ chain.tool)}/>' if i == chain.tip else ""
            beyond = "".join(bodies[k] for k in range(chain.links) if chain.parents[k] == i)
            joint = (
                f'<joint name="joint{i}" type="{kind}" axis="0 0 1" armature="{armature!r}"/>' if i in moving else ""
            )
            inertial = "" if i in bare else _inertial(phi[i], after)
            place = self._place(chain.behind(behind, i) @ before)
            bodies[i] = f"<body {place}>{joint}{inertial}{site}{beyond}</body>"
        roots = "".join(body for body, parent in zip(bodies, chain.parents, strict=True) if parent < 0)
        head = f'<compiler angle="radian"/><option gravity="{_text(chain.gravity)}"/>'
        return f"<mujoco>{head}<worldbody>{roots}</worldbody></mujoco>"

    def _place(self, T: Array) -> str:
        quaternion = np.zeros(4)
        self._mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).reshape(9))
        return f'pos="{_text(T[:3, 3])}" quat="{_text(quaternion)}"'

    def _at(self, q: Array) -> None:
        self._data.qpos[self._places], self._data.qvel[:] = self._coupling @ q, 0.0
        self._mujoco.mj_forward(self._model, self._data)

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The joint torques tau (n,), computed by ``mj_inverse``."""
        for store, value in zip((self._data.qpos, self._data.qvel, self._data.qacc), (q, dq, ddq), strict=True):
            store[self._places] = self._coupling @ value
        self._mujoco.mj_inverse(self._model, self._data)
        tau = np.array(self._data.qfrc_inverse)[self._places]
        return np.asarray(tau @ self._coupling + self._added @ ddq)

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix M (n, n), column by column by ``mj_mulM``, whose signature is the same in all versions."""
        self._at(q)
        n = self._model.nv
        columns = np.zeros((n, n))
        for row, unit in zip(columns, np.eye(n), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        M = columns.T[np.ix_(self._places, self._places)]
        return np.asarray(self._coupling.T @ M @ self._coupling + self._added)

    def forward_kinematics(self, q: Array) -> Array:
        """Pose (4, 4) of the tip in the base frame, from a MuJoCo site."""
        self._at(q)
        tip, T = self._data.site("tip"), np.eye(4)
        T[:3, :3], T[:3, 3] = np.reshape(tip.xmat, (3, 3)), tip.xpos
        return T
