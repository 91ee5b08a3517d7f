"""Friction models: a friction law with the parameters of every joint, evaluated with NumPy, read from YAML or JSON.

Equation numbers (14.x): Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError
from rrrgen.robot.friction.laws import LAWS, FrictionLaw, neural_law

Array = NDArray[Any]


class _NumPy:
    """The operations that friction laws use, for NumPy arrays."""

    sign = staticmethod(np.sign)
    exp = staticmethod(np.exp)
    tanh = staticmethod(np.tanh)


class _SmoothNumPy(_NumPy):
    """NumPy operations with sgn(x) replaced by tanh(x/width), so that friction is smooth at rest."""

    def __init__(self, width: Array) -> None:
        self.width = width

    def sign(self, x: Array) -> Array:  # type: ignore[override]
        return np.asarray(np.tanh(x / self.width))


NUMPY = _NumPy()


@dataclass(frozen=True, eq=False)
class FrictionModel:
    """Friction of n joints under one law; ``parameters`` (n, k) in the order of ``law.parameters``.

    Every method takes speeds (..., n) in rad/s (m/s) and returns torques (..., n) in N m (N), sgn(0) = 0. The Coulomb
    friction of a load-dependent law grows with ``load`` (..., n), the torques without friction, N m (N).
    Source: (14.11)-(14.14).
    """

    law: FrictionLaw
    parameters: Array

    def __post_init__(self) -> None:
        values = np.array(self.parameters, dtype=float)
        if values.ndim != 2 or values.shape[1] != len(self.law.parameters):
            names = ", ".join(p.name for p in self.law.parameters)
            raise InputError(f"friction law '{self.law.name}' takes per joint: {names}; got shape {values.shape}")
        for k, parameter in enumerate(self.law.parameters):
            if parameter.positive and not np.all(values[:, k] > 0.0):
                raise InputError(f"friction law '{self.law.name}': {parameter.name} must be positive")
        values.setflags(write=False)
        object.__setattr__(self, "parameters", values)

    @cached_property
    def _columns(self) -> tuple[Array, ...]:
        return tuple(self.parameters.T)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.parameters.shape[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, joint by joint, e.g. ``viscous1``."""
        return tuple(f"{p.name}{i + 1}" for i in range(self.n) for p in self.law.parameters)

    @property
    def has_state(self) -> bool:
        """Whether the law has a state (LuGre, Dahl): a bristle deflection z per joint, rad or m."""
        return self.law.rate is not None

    @property
    def has_load(self) -> bool:
        """Whether the friction depends on the torques that the joints carry without friction."""
        return self.law.has_load

    def _under(self, load: ArrayLike) -> Any:
        """Parameters, one array (..., n) each, with the Coulomb friction raised for the torques ``load`` (..., n)."""
        return self.law.under_load(self._columns, np.abs(np.asarray(load, dtype=float)))

    def torque(self, dq: ArrayLike, width: ArrayLike = 0.0, load: ArrayLike = 0.0) -> Array:
        """Friction torque at the speeds ``dq``; in steady sliding if the law has a state.

        ``width`` > 0, a number or one per joint, replaces sgn(x) by the smooth tanh(x/width).
        """
        speeds = np.asarray(dq, dtype=float)
        ops = _SmoothNumPy(np.asarray(width)) if np.all(np.asarray(width) > 0.0) else NUMPY
        return np.asarray(self.law.torque(ops, speeds, self._under(load)) + 0.0 * speeds)

    def columns(self, dq: ArrayLike) -> Array:
        """Regressor columns Y_f (..., n, n k) of a linear law: the friction torques are ``Y_f p_f``.

        p_f (n k,) are the parameters joint by joint, in the order of :attr:`names`; ``dq`` (..., n) are the speeds.
        Raises InputError for a law that is not linear in its parameters.
        """
        if self.law.columns is None:
            raise InputError(f"friction law '{self.law.name}' is not linear in its parameters")
        speeds = np.asarray(dq, dtype=float)
        n, k = self.parameters.shape
        Y = np.zeros((*speeds.shape, n, k))
        parts = [np.broadcast_to(part, speeds.shape) for part in self.law.columns(NUMPY, speeds)]
        for i in range(n):
            Y[..., i, i, :] = np.stack([part[..., i] for part in parts], axis=-1)
        return Y.reshape((*speeds.shape, n * k))

    def rate(self, z: ArrayLike, dq: ArrayLike) -> Array:
        """Rate dz/dt (..., n) of the states ``z`` at speeds ``dq``; zero for laws without a state. Source: (14.13)."""
        if self.law.rate is None:
            return np.zeros(np.broadcast_shapes(np.shape(z), np.shape(dq)))
        return np.asarray(self.law.rate(NUMPY, np.asarray(z), np.asarray(dq), self._columns))

    def state_torque(self, z: ArrayLike, dq: ArrayLike, load: ArrayLike = 0.0, width: ArrayLike = 0.0) -> Array:
        """Friction torques (..., n) for the states ``z`` (..., n) at speeds ``dq`` (..., n). Source: (14.13).

        Laws without a state ignore ``z``; they are smoothed by ``width`` as in :meth:`torque`.
        """
        if self.law.state_torque is None:
            return self.torque(dq, width, load)
        return np.asarray(self.law.state_torque(NUMPY, np.asarray(z), np.asarray(dq), self._under(load)))

    def step(self, z: ArrayLike, dq: ArrayLike, period: float, load: ArrayLike = 0.0) -> tuple[Array, Array]:
        """States z and torques, (..., n) each, after ``period`` (s) at constant speeds ``dq``. Source: (14.13).

        The state equation is solved exactly for constant speed, which is stable for any period.
        """
        if self.law.step is None:
            return np.zeros_like(np.asarray(z, dtype=float)), self.torque(dq, load=load)
        following, torque = self.law.step(NUMPY, np.asarray(z), np.asarray(dq), self._under(load), period)
        return np.asarray(following), np.asarray(torque)

    def torque_in_direction(self, dq: ArrayLike, direction: ArrayLike, load: ArrayLike = 0.0) -> Array:
        """Friction torques (..., n) with sgn(dq) replaced by ``direction`` (..., n), each -1, 0 or +1.

        At rest the results for -1 and +1 are the break-away torques, between which friction can take any value.
        """
        speeds = np.asarray(dq, dtype=float)
        ops = FixedDirection(np.asarray(direction, dtype=float))
        return np.asarray(self.law.torque(ops, speeds, self._under(load)))

    def passivity_margin(self) -> Array:
        """Passivity margin of each joint, (n,), N m s/rad (N s/m): the law is passive where it is not negative.

        LuGre: ``alpha2 - sigma1 alpha0/alpha1``. Zero for laws without such a condition; they are passive if their
        torque opposes the motion at every speed. Source: after (14.13).
        """
        return np.zeros(self.n) if self.law.passivity is None else np.asarray(self.law.passivity(self._columns))

    def to_json(self) -> dict[str, Any]:
        """Plain data ``{law: NAME, joints: [{parameter: value}, ...]}``, as :meth:`from_mapping` reads it."""
        rows = [{p.name: float(v) for p, v in zip(self.law.parameters, row, strict=True)} for row in self.parameters]
        return {"law": self.law.name, "joints": rows}

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> FrictionModel:
        """Read ``{law: NAME, joints: [{parameter: value}, ...]}``. Raises InputError that lists every fault.

        A parameter left out is 0 where that is allowed.
        """
        law = _law(data)
        faults, rows = [], []
        for i, joint in enumerate(data.get("joints") or []):
            known = {p.name for p in law.parameters}
            faults += [f"friction of joint {i + 1}: unknown '{key}'" for key in joint if key not in known]
            missing = [p.name for p in law.parameters if p.positive and p.name not in joint]
            faults += [f"friction of joint {i + 1}: '{name}' is needed" for name in missing]
            rows.append([float(joint.get(p.name, 0.0)) for p in law.parameters])
        if faults or not rows:
            raise InputError("; ".join(faults) or "friction: 'joints' must list one mapping per joint")
        return cls(law, np.array(rows))


class FixedDirection(_NumPy):
    """NumPy operations in which sgn(dq) is replaced by given ``signs``, one per joint, whatever the speed."""

    def __init__(self, signs: Array) -> None:
        self.signs = signs

    def sign(self, x: Array) -> Array:  # type: ignore[override]
        """The given signs, in place of sgn(``x``)."""
        return self.signs


def _law(data: Mapping[str, Any]) -> FrictionLaw:
    name = data.get("law")
    if name == "neural":
        joints = data.get("joints") or [{}]
        return neural_law(max(1, sum(1 for key in joints[0] if str(key).startswith("f"))))
    if name not in LAWS:
        raise InputError(f"friction law '{name}' is not one of {', '.join(sorted(LAWS))}")
    return LAWS[str(name)]


def coulomb_viscous(
    viscous: Sequence[float], coulomb: Sequence[float], offset: Sequence[float] | None = None
) -> FrictionModel:
    """A model of viscous and Coulomb friction, ``tau_f = viscous dq + coulomb sgn(dq) + offset``. Source: (14.11).

    Each argument has one number per joint, (n,): ``viscous`` in N m s/rad (N s/m), ``coulomb`` and ``offset`` in N m
    (N); the offset is zero by default.
    """
    zeros = np.zeros(len(viscous)) if offset is None else offset
    return FrictionModel(LAWS["coulomb_viscous"], np.column_stack([viscous, coulomb, zeros]))


# ------------------------------------------------------------------------------------------------------------------
# Friction as a robot file states it: one law for all joints, or a law for each, evaluated with NumPy.
# ------------------------------------------------------------------------------------------------------------------


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
        arguments = (dq, self._broadcast(width, dq), self._broadcast(load, dq))
        return np.asarray(self._each("torque", arguments) + self.offset)

    def torque_in_direction(self, dq: ArrayLike, direction: ArrayLike, load: ArrayLike = 0.0) -> Array:
        """Friction torques (..., n) with sgn(dq) replaced by ``direction`` (..., n), each -1, 0 or +1."""
        return np.asarray(self._each("torque_in_direction", (dq, direction, self._broadcast(load, dq))) + self.offset)

    def rate(self, z: ArrayLike, dq: ArrayLike) -> Array:
        """Rates dz/dt (..., n) of the states ``z`` at speeds ``dq``; zero for laws without a state."""
        return self._each("rate", (z, dq))

    def state_torque(self, z: ArrayLike, dq: ArrayLike, load: ArrayLike = 0.0, width: ArrayLike = 0.0) -> Array:
        """Friction torques (..., n) in the states ``z`` at speeds ``dq``, N m or N.

        ``width`` > 0 replaces sgn(x) by tanh(x/width) in laws without a state.
        """
        arguments = (z, dq, self._broadcast(load, dq), self._broadcast(width, dq))
        return np.asarray(self._each("state_torque", arguments) + self.offset)

    @staticmethod
    def _broadcast(value: ArrayLike, dq: ArrayLike) -> Array:
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
    rows = np.array([[_value_or_zero(f, key) for key in ("viscous", "coulomb", "offset")] for f in given])
    if all(friction is None or friction.law is None for friction in given):
        return FrictionModel(LAWS["coulomb_viscous"], rows)
    models = [
        coulomb_viscous(row[:1], row[1:2])
        if friction is None or friction.law is None
        else FrictionModel(LAWS[friction.law.name], np.array([friction.law.values]))
        for friction, row in zip(given, rows, strict=True)
    ]
    return MixedFriction(models, rows[:, 2])


def _value_or_zero(friction: Any, key: str) -> float:
    value = None if friction is None else getattr(friction, key)
    return 0.0 if value is None else float(value)
