"""Comparison of an imported robot with its source file, read by another library: URDF by Pinocchio, MJCF by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from rrrgen.robot.importers.importing import Imported
from rrrgen.robot.importers.interface import ImportedChain
from rrrgen.verify.references.libraries import ReferenceUnavailableError
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, chain_of, nominal_parameters

STATES = 20
SEED = 1
AGREE = 1e-9  # relative; both sides compute with doubles, and frames up to 1 km away cost 1e-10 of the torques
LEVERAGE = 10.0  # relative difference per rad by which angles were changed; at most 1.1 for the arms of real_urdfs
ROOT = 6  # speeds of a free root, in front of those of the joints
ROOT_JOINT = "free root"  # its joint in Pinocchio; its own name for it could be that of a joint of the file
FASTEST = 2.0  # rad/s, rad/s^2 (m/s, m/s^2), largest speeds and accelerations of random states


@dataclass(frozen=True)
class SourceComparison:
    """The largest differences of tip poses and of torques between a robot file and its source, at random states.

    ``library`` is the one that read the source. ``pose`` is in m and in entries of the rotation matrix, relative to the
    reach if that is more than 1 m; ``torque`` is relative to the largest torque. A difference is None where it could
    not be computed, and ``reason`` says why. ``explained`` is the largest difference that rounding explains, of numbers
    and of angles that were made exact.
    """

    library: str = ""
    pose: float | None = None
    torque: float | None = None
    reason: str = ""
    explained: float = AGREE

    @property
    def contradictions(self) -> str:
        """The differences that rounding does not explain, in words; empty where robot file and source move alike."""
        differences = {"poses": self.pose, "torques": self.torque}
        larger = [
            f"{name} {self._size(x)}" for name, x in differences.items() if x is not None and self._contradicts(x)
        ]
        return f"{', '.join(larger)}, where rounding explains {self.explained:.1e}" if larger else ""

    def _contradicts(self, difference: float) -> bool:
        return not difference <= self.explained  # NaN too

    def _size(self, difference: float) -> str:
        return f"{'differ by' if self._contradicts(difference) else 'agree to'} {difference:.1e}"

    def __str__(self) -> str:
        if self.pose is None:
            return f"not compared with the source: {self.reason}"
        torque = (
            f"torques {self._size(self.torque)}" if self.torque is not None else f"torques not compared: {self.reason}"
        )
        states = f"at {STATES} random states, relative to reach and largest torque"
        return f"{self.library} reads the source: poses {self._size(self.pose)}, {torque} {states}"


class _Source(Protocol):
    """A source as a library reads it; ``has_drives`` says whether its torques have those of rotor inertia."""

    name: str
    has_drives: bool

    def pose(self, q: Array) -> Array: ...

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array: ...


def compare_with_source(imported: Imported, seed: int = SEED) -> SourceComparison:
    """Compare poses of all tips and inverse dynamics of the robot file with those of its source.

    The inertia of drives counts where the source can state it.
    """
    assert imported.chain is not None
    try:
        source = _SOURCES[imported.format](imported.source, imported.chain)
    except ReferenceUnavailableError as error:
        return SourceComparison(reason=str(error))
    spec = imported.spec
    phi = nominal_parameters(spec)
    chain = chain_of(spec)
    if not source.has_drives:
        chain = replace(chain, drive_inertia=np.zeros((spec.n, spec.n)))
    ours = NewtonEuler(chain, np.zeros((chain.links, 10)) if phi is None else phi)
    random = np.random.default_rng(seed)
    q = random.uniform(-np.pi, np.pi, (STATES, spec.n))
    dq, ddq = (random.uniform(-FASTEST, FASTEST, q.shape) for _ in range(2))
    S = chain.coupling[list(imported.chain.rows)] if imported.chain.rows else chain.coupling
    y = q @ S.T + np.array(imported.chain.offsets or np.zeros(len(S)))
    poses = np.stack([source.pose(state) for state in y])
    reach = max(1.0, float(np.abs(poses[:, :3, 3]).max()))
    pose = float(np.abs(poses - ours.forward_kinematics(q)).max()) / reach
    for tip, link in imported.chain.tips.items():
        of_tip = _SOURCES[imported.format](imported.source, replace(imported.chain, tip=link))
        tip_poses = NewtonEuler(chain_of(spec.at_tip(tip)), ours.phi).forward_kinematics(q)
        pose = max(pose, float(np.abs(np.stack([of_tip.pose(state) for state in y]) - tip_poses).max()) / reach)
    explained = AGREE + LEVERAGE * imported.chain.rounded
    if phi is None:
        return SourceComparison(source.name, pose, None, "the chain has no inertia", explained)
    try:
        torques = np.stack([source.torque(*state) for state in zip(y, dq @ S.T, ddq @ S.T, strict=True)]) @ S
    except ReferenceUnavailableError as error:
        return SourceComparison(source.name, pose, None, str(error), explained)
    size = float(np.abs(torques).max()) or 1.0
    torque = float(np.abs(torques - ours.inverse_dynamics(q, dq, ddq)).max()) / size
    return SourceComparison(source.name, pose, torque, explained=explained)


class _PinocchioSource:
    """A URDF as Pinocchio reads it, its root free: the base of the chain is held where it is at q = 0."""

    has_drives = False

    def __init__(self, text: str, chain: ImportedChain) -> None:
        try:
            import pinocchio as pin
        except ImportError as error:
            raise ReferenceUnavailableError.at_import(error, "pin") from error
        self.name, self._pin = f"Pinocchio {pin.__version__}", pin
        try:
            self._model: Any = pin.buildModelFromXML(text, pin.JointModelFreeFlyer(), ROOT_JOINT)
        except (ValueError, RuntimeError, TypeError) as error:  # TypeError: names of roots came with Pinocchio 3.3
            raise ReferenceUnavailableError(f"{self.name} refuses the file: {str(error).splitlines()[0]}") from error
        self._data = self._model.createData()
        unknown = [name for name in (chain.base, chain.tip) if not self._model.existFrame(name)]
        unknown += [name for name in (*chain.joints, *chain.held) if not self._model.existJointName(name)]
        if unknown:
            raise ReferenceUnavailableError(f"{self.name} reads the file without {', '.join(unknown)}")
        self._frames = [self._model.getFrameId(name) for name in (chain.base, chain.tip)]
        self._joints = [self._model.joints[self._model.getJointId(name)] for name in chain.joints]
        self._still = pin.neutral(self._model)
        for name, value in chain.held.items():
            self._set(self._still, self._model.joints[self._model.getJointId(name)], value)

    @staticmethod
    def _set(positions: Array, joint: Any, value: float) -> None:
        """Set a joint position; Pinocchio stores that of a joint without limits as cosine and sine."""
        if joint.nq == 2:
            positions[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
        elif joint.nq == 1:
            positions[joint.idx_q] = value

    def _positions(self, q: Array) -> Array:
        positions: Array = self._still.copy()
        for joint, value in zip(self._joints, q, strict=True):
            self._set(positions, joint, value)
        return positions

    def pose(self, q: Array) -> Array:
        self._pin.framesForwardKinematics(self._model, self._data, self._positions(q))
        base, tip = (self._data.oMf[frame] for frame in self._frames)
        return np.array((base.inverse() * tip).homogeneous)

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques at the joints of the chain by virtual work, of motions in which the base rests.

        Joint speeds ``dq`` move the root by ``-R^-1 J dq``, with the Jacobian of the base (6, 6 + joints) in columns
        ``R`` of the root and ``J`` of the joints.
        """
        pin, model, data = self._pin, self._model, self._data
        places = [joint.idx_v for joint in self._joints]
        base = (self._frames[0], pin.ReferenceFrame.LOCAL)
        positions = self._with_resting_base(q)
        jacobian = pin.computeFrameJacobian(model, data, positions, *base)
        motions = np.zeros((model.nv, len(places)))
        motions[places, range(len(places))] = 1.0
        motions[:ROOT] = -np.linalg.solve(jacobian[:, :ROOT], jacobian[:, places])
        speeds, accelerations = motions @ dq, motions @ ddq
        pin.forwardKinematics(model, data, positions, speeds, accelerations)
        drift = pin.getFrameAcceleration(model, data, *base).vector
        accelerations[:ROOT] -= np.linalg.solve(jacobian[:, :ROOT], drift)
        return np.asarray(motions.T @ pin.rnea(model, data, positions, speeds, accelerations))

    def _with_resting_base(self, q: Array) -> Array:
        """Positions of all joints with the root placed so that the base is where it is at q = 0."""
        places = []
        for values in (np.zeros_like(q), q):
            positions = self._positions(values)
            self._pin.framesForwardKinematics(self._model, self._data, positions)
            places.append(self._data.oMf[self._frames[0]].copy())
        home, moved = places
        positions[: self._model.joints[self._model.getJointId(ROOT_JOINT)].nq] = self._pin.SE3ToXYZQUAT(
            home * moved.inverse()
        )
        return positions


class _MujocoSource:
    """An MJCF as MuJoCo reads it, without springs, damping, limits and contacts."""

    has_drives = True

    def __init__(self, text: str, chain: ImportedChain) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise ReferenceUnavailableError.at_import(error, "mujoco") from error
        self.name, self._mujoco = f"MuJoCo {mujoco.__version__}", mujoco
        try:
            self._model: Any = mujoco.MjModel.from_xml_string(text)
        except ValueError as error:
            reason = str(error).strip().splitlines()[0]
            raise ReferenceUnavailableError(f"{self.name} cannot load the file alone: {reason}") from error
        self._data = mujoco.MjData(self._model)
        unknown = [name for name in (chain.base, chain.tip) if not self._has(name, "BODY", "SITE")]
        unknown += [name for name in (*chain.joints, *chain.held) if not self._has(name, "JOINT")]
        if unknown:  # such as static bodies with fusestatic
            raise ReferenceUnavailableError(f"{self.name} reads the file without {', '.join(unknown)}")
        self._ends = [self._end(name) for name in (chain.base, chain.tip)]
        self._joints = [self._model.joint(name) for name in chain.joints]
        held = [(self._model.joint(name), value) for name, value in chain.held.items()]
        single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        self._held = [(joint, value) for joint, value in held if joint.type[0] in single]
        self._move(np.zeros(len(self._joints)))
        self._base_at_rest = self._pose_of(self._ends[0])

    def _has(self, name: str, *kinds: str) -> bool:
        kind_numbers = (getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}") for kind in kinds)
        return any(self._mujoco.mj_name2id(self._model, kind, name) >= 0 for kind in kind_numbers)

    def _end(self, name: str) -> Any:
        body = self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_BODY, name)
        return self._data.body(body) if body >= 0 else self._data.site(name)

    def _move(self, q: Array) -> None:
        for joint, value in [*zip(self._joints, q, strict=True), *self._held]:
            self._data.qpos[joint.qposadr[0]] = value
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)

    def pose(self, q: Array) -> Array:
        self._move(q)
        base, tip = (self._pose_of(end) for end in self._ends)
        return np.asarray(np.linalg.solve(base, tip))

    @staticmethod
    def _pose_of(end: Any) -> Array:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.reshape(end.xmat, (3, 3)), end.xpos
        return T

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques at the joints of the chain, those of armature included.

        Raises ReferenceUnavailableError where the joints move the base, as MuJoCo holds the world instead.
        """
        model, data = self._model, self._data
        self._move(q)
        if not np.allclose(self._pose_of(self._ends[0]), self._base_at_rest, rtol=0, atol=AGREE):
            raise ReferenceUnavailableError(f"{self.name} holds the world, and the robot file the base of the chain")
        places = [joint.dofadr[0] for joint in self._joints]
        data.qvel[:] = 0.0
        data.qvel[places] = dq
        self._mujoco.mj_comVel(model, data)
        tau, inertial, accelerations = (np.zeros(model.nv) for _ in range(3))
        self._mujoco.mj_rne(model, data, 0, tau)
        accelerations[places] = ddq
        self._mujoco.mj_fwdPosition(model, data)  # the mass matrix with armature of joints, tendons and actuators
        self._mujoco.mj_mulM(model, data, inertial, accelerations)
        return np.asarray((tau + inertial)[places])


_SOURCES: dict[str, Callable[[str, ImportedChain], _Source]] = {"urdf": _PinocchioSource, "mjcf": _MujocoSource}
