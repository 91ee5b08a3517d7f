"""Friction as a robot file states it: one law for all joints, or a law for each, evaluated with NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import Array, FrictionModel, coulomb_viscous


class MixedFriction:
    """Friction of n joints or motors, each with a law of its own: ``models[i]`` for joint i, plus ``offset`` (n,), N m.

    Speeds ``dq`` are (..., n) in rad/s (m/s), torques (..., n) in N m (N); ``load`` (..., n) are the torques that the
    joints carry without friction. The state z of a joint whose law has none is 0.
    """

    def __init__(self, models: Sequence[FrictionModel], offset: ArrayLike) -> None:
        self.models = tuple(models)
        self.offset = np.asarray(offset, dtype=float)
        self.has_state = any(model.has_state for model in models)
        self.has_load = any(model.has_load for model in models)

    def torque(self, dq: ArrayLike, width: ArrayLike = 0.0, load: ArrayLike = 0.0) -> Array:
        """Friction torque; in steady sliding if a law has a state. ``width`` > 0 replaces sgn(x) by tanh(x/width)."""
        each = (dq, self._spread(width, dq), self._spread(load, dq))
        return np.asarray(self._each("torque", each) + self.offset)

    def directed(self, dq: ArrayLike, direction: ArrayLike, load: ArrayLike = 0.0) -> Array:
        """Friction torques (..., n) with sgn(dq) replaced by ``direction`` (..., n), each -1, 0 or +1."""
        return np.asarray(self._each("directed", (dq, direction, self._spread(load, dq))) + self.offset)

    def rate(self, z: ArrayLike, dq: ArrayLike) -> Array:
        """Rates dz/dt (..., n) of the states ``z`` at speeds ``dq``; zero for laws without a state."""
        return self._each("rate", (z, dq))

    def state_torque(self, z: ArrayLike, dq: ArrayLike, load: ArrayLike = 0.0, width: ArrayLike = 0.0) -> Array:
        """Friction torques (..., n) in the states ``z`` at speeds ``dq``, N m or N.

        ``width`` > 0 replaces sgn(x) by tanh(x/width) in laws without a state.
        """
        each = (z, dq, self._spread(load, dq), self._spread(width, dq))
        return np.asarray(self._each("state_torque", each) + self.offset)

    @staticmethod
    def _spread(value: ArrayLike, dq: ArrayLike) -> Array:
        return np.broadcast_to(np.asarray(value, dtype=float), np.shape(dq))

    def _each(self, name: str, values: tuple[Any, ...]) -> Array:
        arrays = [np.asarray(value, dtype=float) for value in values]
        columns = [
            getattr(model, name)(*(array[..., i : i + 1] for array in arrays)) for i, model in enumerate(self.models)
        ]
        return np.concatenate(columns, axis=-1)


def robot_friction(spec: Any) -> FrictionModel | MixedFriction | None:
    """Friction at the joints as a robot file states it, None if it states none; parameters left out count as 0."""
    return stated_friction([joint.friction for joint in spec.joints])


def motor_friction(spec: Any) -> FrictionModel | MixedFriction | None:
    """Friction at the shafts of coupled motors as a robot file states it, None if it states none."""
    return None if spec.drives is None else stated_friction([motor.friction for motor in spec.drives.motors])


def stated_friction(given: Sequence[Any]) -> FrictionModel | MixedFriction | None:
    """Friction of several joints from their ``FrictionSpec`` (None for a joint without), None if no joint has one."""
    if all(friction is None for friction in given):
        return None
    rows = np.array([[_stated(f, key) for key in ("viscous", "coulomb", "offset")] for f in given])
    if all(friction is None or friction.law is None for friction in given):
        return FrictionModel(LAWS["coulomb_viscous"], rows)
    models = [
        coulomb_viscous(row[:1], row[1:2])
        if friction is None or friction.law is None
        else FrictionModel(LAWS[friction.law.name], np.array([friction.law.values]))
        for friction, row in zip(given, rows, strict=True)
    ]
    return MixedFriction(models, rows[:, 2])


def _stated(friction: Any, key: str) -> float:
    value = None if friction is None else getattr(friction, key)
    return 0.0 if value is None else float(value)
