"""Pinocchio as a reference: joints of its kinds RZ and PZ (about and along z), with one body per link."""

from __future__ import annotations

import numpy as np

from rrrgen.verify.references.numeric_robot import Array, Chain, centre_and_tensor, without_mass
from rrrgen.verify.references.reference import ReferenceUnavailableError


class PinocchioReference:
    """The robot as a ``pinocchio.Model``; where joints follow others, its results are converted to q.

    ``phi`` (links, 10) are the standard parameters.
    """

    def __init__(self, chain: Chain, phi: Array) -> None:
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
