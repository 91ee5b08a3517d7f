"""Models in which one function is distorted or missing."""

from __future__ import annotations

import numpy as np

from oracles import chapter14
from oracles.newton_euler import Link
from oracles.random_robots import random_robot
from rrrgen.robot.spec import FrictionSpec
from verify.oracle_model import OracleModel

SAMPLES = 4
FRICTION = FrictionSpec(viscous=0.3, coulomb=0.2, offset=0.1)


def arm(**options) -> OracleModel:
    """The reference arm with random physical links."""
    return OracleModel(chapter14.rrr(random_robot(1, 3).links), **options)


class Broken:
    """A model in which one function is distorted."""

    def __init__(self, model: OracleModel, name: str, distort) -> None:
        self._model, self._name, self._distort = model, name, distort

    def __getattr__(self, name: str):
        attribute = getattr(self._model, name)
        if name != self._name:
            return attribute
        if not callable(attribute):
            return self._distort(attribute)
        return lambda *states, **options: self._distort(attribute(*states, **options))


FUNCTIONS = [
    "forward_kinematics",
    "link_frames",
    "jacobian",
    "link_jacobians",
    "jacobian_dot_dq",
    "mass_matrix",
    "coriolis_matrix",
    "coriolis",
    "bias",
    "coriolis_transpose",
    "gravity",
    "inverse_dynamics",
    "forward_dynamics",
    "regressor",
    "standard_regressor",
    "regressor_transpose",
    "identification_regressor",
    "friction",
]


class Without:
    """A model that lacks one function, or answers to every other name through ``__getattr__`` as a wrapper does."""

    def __init__(self, model: OracleModel, name: str) -> None:
        self._model, self._name = model, name

    def __getattr__(self, name: str):
        if name == self._name:
            raise AttributeError(f"no function {name}")
        return getattr(self._model, name)


DERIVATIVES = ["inverse_dynamics_derivatives", "forward_dynamics_derivatives"]


def flip_largest(value):
    """One sign error, in one entry, at every state: the entry that is largest on average."""
    value = np.array(value)
    entries = value.reshape(len(value), -1)
    k = int(np.argmax(np.mean(np.abs(entries), axis=0)))
    entries[:, k] *= -1
    return entries.reshape(value.shape)


def indefinite_arm() -> OracleModel:
    links = (*chapter14.rrr(random_robot(1, 3).links).links[:2], Link(1.0, np.zeros(3), -2.0 * np.eye(3)))
    return OracleModel(chapter14.rrr(links))
