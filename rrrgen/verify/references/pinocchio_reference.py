"""Pinocchio as a reference: RZ and PZ joints at the moving frames, bodies carried there."""

from __future__ import annotations

import numpy as np

from rrrgen.verify.references.chain import Array, Chain, centre_and_tensor
from rrrgen.verify.references.reference import ReferenceUnavailableError


class PinocchioReference:
    """The chain as a ``pinocchio.Model``."""

    def __init__(self, chain: Chain, phi: Array) -> None:
        try:
            import pinocchio as pin
        except ImportError as error:
            raise ReferenceUnavailableError.at_import(error, "pin") from error
        if np.any(phi[:, 0] <= 0.0):
            raise ReferenceUnavailableError("a link has no mass, so it has no centre of mass")
        self._pin = pin
        self.name = f"Pinocchio {pin.__version__}"
        self._model = pin.Model()
        self._model.gravity.linear = chain.gravity
        offset, joint = chain.base, 0
        for i, (before, after) in enumerate(chain.around_joints()):
            kind = pin.JointModelRZ() if chain.revolute[i] else pin.JointModelPZ()
            joint = self._model.addJoint(joint, kind, pin.SE3(offset @ before), f"joint{i + 1}")
            centre, tensor = centre_and_tensor(phi[i])
            try:
                body = pin.Inertia(float(phi[i, 0]), centre, tensor)
            except RuntimeError as error:
                raise ReferenceUnavailableError(f"refuses link {i + 1}: {str(error).splitlines()[-1]}") from error
            self._model.appendBodyToJoint(joint, body, pin.SE3(after))
            offset = after
        self._last, self._tip = joint, pin.SE3(offset @ chain.tool)
        self._data = self._model.createData()
        self._drive_inertia = chain.drive_inertia

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        """tau (n,) by ``rnea``; drive inertia is added here, as its meaning there differs between versions."""
        tau = self._pin.rnea(self._model, self._data, q, dq, ddq)
        return np.array(tau) + self._drive_inertia @ ddq

    def mass_matrix(self, q: Array) -> Array:
        """M (n, n) by ``crba``, which fills only the upper triangle in some versions."""
        upper = np.triu(self._pin.crba(self._model, self._data, q))
        return np.asarray(upper + np.triu(upper, 1).T + self._drive_inertia)

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (4, 4) of the tip in the base frame."""
        self._pin.forwardKinematics(self._model, self._data, q)
        return np.array((self._data.oMi[self._last] * self._tip).homogeneous)
