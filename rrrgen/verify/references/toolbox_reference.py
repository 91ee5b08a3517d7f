"""The Robotics Toolbox for Python as a reference, the only one that takes Denavit-Hartenberg rows directly."""

from __future__ import annotations

from typing import Any

import numpy as np

from rrrgen.verify.references.numeric_robot import Array, Chain, centre_and_tensor
from rrrgen.verify.references.reference import ReferenceUnavailableError


class ToolboxReference:
    """The robot as a ``roboticstoolbox.DHRobot``.

    Gravity is given in the frame of the first row, so that base and tool need not be part of it. ``rne_python`` is
    called instead of ``rne``: the C routine of version 1.5.0 is wrong for most chains whose first joint is prismatic.
    """

    def __init__(self, chain: Chain, phi: Array) -> None:
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
