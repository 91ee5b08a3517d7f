"""The reference libraries, each imported only when it is used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from rrrgen.verify.references.closed_loops import LoopSolver
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, centre_and_tensor, without_mass

# ------------------------------------------------------------------------------------------------------------------
# The interface of a reference library.
# ------------------------------------------------------------------------------------------------------------------


class Reference(Protocol):
    """Interface of a reference: the same robot in another library, evaluated at one state (n,) at a time."""

    name: str

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The joint torques tau (n,), with drive inertia and without friction."""
        ...

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix M (n, n), with drive inertia."""
        ...

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (4, 4) of the tip in the base frame."""
        ...


class ReferenceUnavailableError(Exception):
    """Raised if a reference library is not installed or cannot represent a robot; the text says which."""

    @classmethod
    def at_import(cls, error: ImportError, package: str) -> ReferenceUnavailableError:
        """The error for a failed import of ``package``; its text says whether it is missing or broken."""
        if isinstance(error, ModuleNotFoundError):
            return cls(f"not installed (pip install {package}): {error}")
        return cls(f"installed, but its import fails: {error}")


# ------------------------------------------------------------------------------------------------------------------
# The reference libraries, each imported only when it is used
# ------------------------------------------------------------------------------------------------------------------


def _pinocchio(chain: NumericRobot, phi: Array) -> Reference:
    return PinocchioReference(chain, phi)


def _mujoco(chain: NumericRobot, phi: Array) -> Reference:
    return MujocoReference(chain, phi)


def _toolbox(chain: NumericRobot, phi: Array) -> Reference:
    return ToolboxReference(chain, phi)


class ClosedReference:
    """A robot with closed loops: the open tree in a library, reduced by W of a numerical solution of the loops.

    ``library`` makes the reference of the tree; ``phi`` (links, 10) are the standard parameters.
    """

    def __init__(self, library: Library, chain: NumericRobot, phi: Array) -> None:
        tree = chain.spanning_tree()
        self._tree, self._drive_inertia = library(tree, phi), chain.drive_inertia
        self._loops = LoopSolver(chain, NewtonEuler(tree, phi))
        self.name = self._tree.name

    def _at(self, q: Array) -> tuple[Array, Array]:
        """The positions x (n + p,) of the tree, and the matrix (n + p, n) of their rates."""
        x = self._loops.solve(q[None])[0]
        return x[0], np.concatenate([np.eye(len(q)), self._loops.passive_rates(x)[0]])

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The torques tau (n,) of the driven joints."""
        x, C = self._at(q)
        ddx = C @ ddq
        ddx[len(q) :] += self._loops.passive_accelerations(x[None], (C @ dq)[None])[0]
        return np.asarray(C.T @ self._tree.inverse_dynamics(x, C @ dq, ddx) + self._drive_inertia @ ddq)

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix M (n, n)."""
        x, C = self._at(q)
        return np.asarray(C.T @ self._tree.mass_matrix(x) @ C + self._drive_inertia)

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (4, 4) of the tip in the base frame."""
        return self._tree.forward_kinematics(self._at(q)[0])


Library = Callable[[NumericRobot, Array], Reference]

LIBRARIES: dict[str, Callable[[NumericRobot, Array], Reference]] = {
    "Pinocchio": _pinocchio,
    "MuJoCo": _mujoco,
    "Robotics Toolbox": _toolbox,
}
"""Constructors of the references by name of the library; each raises ReferenceUnavailableError if the library is
missing or cannot model the robot."""


# ------------------------------------------------------------------------------------------------------------------
# MuJoCo as a reference: the robot as an MJCF model with one body per link, joint axes z, no contacts, no limits.
# ------------------------------------------------------------------------------------------------------------------


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

    def __init__(self, chain: NumericRobot, phi: Array) -> None:
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

    def _mjcf(self, chain: NumericRobot, phi: Array) -> str:
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


# ------------------------------------------------------------------------------------------------------------------
# Pinocchio as a reference: joints of its kinds RZ and PZ (about and along z), with one body per link.
# ------------------------------------------------------------------------------------------------------------------


class PinocchioReference:
    """The robot as a ``pinocchio.Model``; where joints follow others, its results are converted to q.

    ``phi`` (links, 10) are the standard parameters.
    """

    def __init__(self, chain: NumericRobot, phi: Array) -> None:
        try:
            import pinocchio as pin
        except ImportError as error:
            raise ReferenceUnavailableError.at_import(error, "pin") from error
        bare = without_mass(chain, phi)
        if np.any(np.delete(phi, bare, axis=0)[:, 0] <= 0.0):
            raise ReferenceUnavailableError("a link has no mass, so it has no centre of mass")
        self._pin = pin
        self.name = f"Pinocchio {pin.__version__}"
        self._model = pin.Model()
        self._model.gravity.linear = chain.gravity
        around = chain.around_joints()
        behind, joints = [after for _, after in around], {-1: 0}
        for i in chain.depth_first():  # crba is right for trees that are numbered branch by branch
            before, after = around[i]
            kind = pin.JointModelRZ() if chain.revolute[i] else pin.JointModelPZ()
            place = pin.SE3(chain.behind(behind, i) @ before)
            joint = self._model.addJoint(joints[chain.parents[i]], kind, place, f"joint{i + 1}")
            joints[i] = joint
            if i in bare:
                continue
            centre, tensor = centre_and_tensor(phi[i])
            try:
                body = pin.Inertia(float(phi[i, 0]), centre, tensor)
            except RuntimeError as error:
                raise ReferenceUnavailableError(f"refuses link {i + 1}: {str(error).splitlines()[-1]}") from error
            self._model.appendBodyToJoint(joint, body, pin.SE3(after))
        self._last, self._tip = joints[chain.tip], pin.SE3(behind[chain.tip] @ chain.tool)
        self._data = self._model.createData()
        self._chain = chain
        self._places = [self._model.joints[joints[i]].idx_v for i in range(chain.links)]
        self._drive_inertia = chain.drive_inertia

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The joint torques tau (n,), computed by ``rnea``.

        Drive inertia is added here, because its meaning in Pinocchio differs between versions.
        """
        tau = self._pin.rnea(self._model, self._data, *(self._of_rows(x) for x in (q, dq, ddq)))
        return np.asarray(np.array(tau)[self._places] @ self._chain.coupling + self._drive_inertia @ ddq)

    def _of_rows(self, x: Array) -> Array:
        values = np.zeros(self._chain.links)
        values[self._places] = self._chain.coupling @ x
        return values

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix M (n, n), computed by ``crba``, which fills only the upper triangle in some versions."""
        upper = np.triu(self._pin.crba(self._model, self._data, self._of_rows(q)))
        M = (upper + np.triu(upper, 1).T)[np.ix_(self._places, self._places)]
        return np.asarray(self._chain.coupling.T @ M @ self._chain.coupling + self._drive_inertia)

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (4, 4) of the tip in the base frame."""
        self._pin.forwardKinematics(self._model, self._data, self._of_rows(q))
        return np.array((self._data.oMi[self._last] * self._tip).homogeneous)


# ------------------------------------------------------------------------------------------------------------------
# The Robotics Toolbox for Python as a reference, the only one that takes Denavit-Hartenberg rows directly.
# ------------------------------------------------------------------------------------------------------------------


class ToolboxReference:
    """The robot as a ``roboticstoolbox.DHRobot``.

    Gravity is given in the frame of the first row, so that base and tool need not be part of it. ``rne_python`` is
    called instead of ``rne``: the C routine of version 1.5.0 is wrong for most chains whose first joint is prismatic.
    """

    def __init__(self, chain: NumericRobot, phi: Array) -> None:
        try:
            import roboticstoolbox as rtb
        except ImportError as error:
            raise ReferenceUnavailableError.at_import(error, "roboticstoolbox-python") from error
        if not chain.plain:
            raise ReferenceUnavailableError("joints that follow others or branch off are not part of a DHRobot")
        if np.any(phi[:, 0] <= 0.0):
            raise ReferenceUnavailableError("a link has no mass, so it has no centre of mass")
        self.name = f"Robotics Toolbox {rtb.__version__}"
        standard = chain.convention == "standard"
        revolute = rtb.RevoluteDH if standard else rtb.RevoluteMDH
        prismatic = rtb.PrismaticDH if standard else rtb.PrismaticMDH
        joints = []
        for i in range(chain.n):
            centre, tensor = centre_and_tensor(phi[i])
            d, theta = float(chain.d[i]), float(chain.theta[i])
            common: dict[str, Any] = {
                "a": float(chain.a[i]),
                "alpha": float(chain.alpha[i]),
                "m": float(phi[i, 0]),
                "r": centre,
            }
            drive: dict[str, Any] = {"I": tensor, "Jm": float(chain.drive_inertia[i, i]), "G": 1.0}
            if chain.revolute[i]:
                joints.append(revolute(d=d, offset=theta, **common, **drive))
            else:
                joints.append(prismatic(theta=theta, offset=d, **common, **drive))
        self._arm = rtb.DHRobot(joints, name=chain.name)
        self._gravity = chain.base[:3, :3].T @ chain.gravity
        # a rotor of the toolbox belongs to one joint; the off-diagonal drive inertia is added to its results
        self._coupling = chain.drive_inertia - np.diag(np.diag(chain.drive_inertia))
        self._base, self._tool, self._n = chain.base, chain.tool, chain.n
        self._signs = np.diag(chain.coupling)

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Joint torques tau (n,) by the toolbox's recursive Newton-Euler in Python, plus coupled drive inertia."""
        return self._rne(q, dq, ddq, self._gravity)

    def _rne(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        q_row, dq_row, ddq_row = (self._signs * x for x in (q, dq, ddq))
        tau = np.asarray(self._arm.rne_python(q_row, dq_row, ddq_row, gravity=gravity), dtype=np.float64).reshape(-1)
        return self._signs * tau + self._coupling @ ddq

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix M (n, n), column by column, from the torques for unit accelerations."""
        still = np.zeros(self._n)
        return np.stack([self._rne(q, still, unit, np.zeros(3)) for unit in np.eye(self._n)], axis=1)

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (4, 4) of the tip in the base frame."""
        return np.asarray(self._base @ np.asarray(self._arm.fkine(self._signs * q).A) @ self._tool)
