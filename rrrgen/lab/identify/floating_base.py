"""Identification on a floating base: its wrench as six further rows of the estimation, its motion as six coordinates.

The base moves by quasi-coordinates, whose velocities are its twist: they stand before the joints in all arrays of the
estimation, as :data:`~rrrgen.lab.data.mapping.ON_BASE` names them. Rows that were not measured, the wrench or the joint
torques, are not part of it, and the identifiable combinations are those of the others: joint torques alone do not
determine the ten parameters of the base, the wrench alone determines all, and a flight all but one factor (Ayusawa,
Venture and Nakamura 2014).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import ON_BASE
from rrrgen.robot.spec import JointSpec

if TYPE_CHECKING:
    from rrrgen.lab.identify.observations import Recording
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.runtime.model import Model

SIX = len(ON_BASE)
UNIT_NORM = 1e-2
"""Largest error of the norm of a recorded quaternion, which is rounded or interpolated; it is normalised."""


def with_base_joints(spec: RobotSpec) -> RobotSpec:
    """``spec`` with three prismatic and three revolute joints for its base, for names, types and limits only."""
    import sympy as sp

    zero = sp.S.Zero
    base = tuple(
        JointSpec(name, "prismatic" if k < SIX // 2 else "revolute", alpha=zero, a=zero, d=zero, theta=zero)
        for k, name in enumerate(ON_BASE)
    )
    return replace(spec, joints=(*base, *spec.joints))


@dataclass(frozen=True)
class FloatingModel:
    """A compiled robot with its floating base as six joints; a ``RigidModel`` for the estimation.

    Of the positions (N, 6 + n), the entries 2 to 5 are the orientation of the base and those before them mean nothing.
    """

    robot: Model

    @property
    def n(self) -> int:
        """Number of joints with the six of the base."""
        return self.robot.n + SIX

    @property
    def spec(self) -> RobotSpec:
        """The robot file with the six joints of the base (:func:`with_base_joints`)."""
        return with_base_joints(self.robot.spec)

    @property
    def base_parameter_names(self) -> Sequence[str]:
        """Names of the base parameters."""
        return self.robot.base_parameter_names

    @property
    def base_projection(self) -> Array:
        """The matrix (b, 10 links) that maps standard parameters, the body of the base first, to base parameters."""
        return self.robot.base_projection

    def regressor(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Regressor (N, 6 + n, b) of wrench and torques at N states, (N, 6 + n) each."""
        orientation = q[..., 2:SIX]
        orientation = orientation / np.linalg.norm(orientation, axis=-1, keepdims=True)
        joints = q[..., SIX:], dq[..., SIX:], ddq[..., SIX:]
        return np.asarray(self.robot.floating_regressor(*joints, orientation, dq[..., :SIX], ddq[..., :SIX]))

    def standard_regressor(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Refused: a payload at the last link is estimated with the base at rest."""
        raise InputError("a payload is estimated with the base at rest: hold it, and record no motion of the base")


def on_floating_base(recordings: Sequence[Recording]) -> bool:
    """Whether ``recordings`` have the motion of a floating base.

    Raises :class:`InputError` if some have it and some have not.
    """
    moving = {recording.joints[:SIX] == ON_BASE for recording in recordings}
    if len(moving) > 1:
        raise InputError("some recordings have the motion of the floating base and some do not: give it in all or none")
    return moving == {True}


def measured_rows(recordings: Sequence[Recording]) -> NDArray[np.bool_]:
    """Mask (n,) of the torques that are measured somewhere in ``recordings``."""
    mask = np.zeros(len(recordings[0].joints), bool)
    for recording in recordings:
        for part in recording.parts():
            if part.tau is not None:
                mask |= part.valid.any(axis=0)
            if mask.all():
                return mask
    return mask


def check_base(recordings: Sequence[Recording]) -> bool:
    """Check the orientations in recordings of a floating base; returns whether any measured torque is not zero.

    Raises :class:`InputError` for orientations that are no unit quaternions.
    """
    torques = False
    for recording in recordings:
        for part in recording.parts():
            norm = np.linalg.norm(part.q[:, 2:SIX], axis=1)
            off = np.abs(norm - 1.0)
            if len(off) and np.max(off) > UNIT_NORM:
                k = int(np.argmax(off))
                raise InputError(
                    f"the orientation at t = {part.t[k]:.6g} s has the norm {norm[k]:.3g}: a unit quaternion x, y, z, "
                    "w is needed, of the base in the world"
                )
            torques = torques or (part.tau is not None and bool(np.any(part.tau[part.valid])))
    return torques
