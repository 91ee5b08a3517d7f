"""The test cases: robots, two sets of inertias for each, states, and reference values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, chain_of, nominal_parameters

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec

ROBOTS = ("rrr", "puma560", "ur10e", "panda")
STATES = 16
"""States per robot: too many for a branch predictor to learn, few enough for the first-level cache."""

Numbers = Literal["dense", "file"]
"""Set of inertias. ``dense``: random bodies without zeros, as identification gives; ``file``: the file's."""


@dataclass(frozen=True)
class Case:
    """One robot, its inertias and its states (N, 4 n): q, dq, ddq (or tau), e."""

    spec: RobotSpec
    chain: NumericRobot
    dense: Array
    file: Array | None
    states: Array

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.spec.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.chain.n

    def parts(self) -> tuple[Array, Array, Array, Array]:
        """q, dq, ddq, e, each (N, n)."""
        q, dq, ddq, e = np.split(self.states, 4, axis=1)
        return q, dq, ddq, e

    def phi(self, numbers: Numbers) -> Array:
        """Standard parameters (n, 10)."""
        chosen = self.dense if numbers == "dense" else self.file
        if chosen is None:
            raise ValueError(f"{self.name} has no links in its file")
        return chosen

    @cached_property
    def references(self) -> dict[Numbers, References]:
        """Reference values for both sets of inertias."""
        sets: tuple[Numbers, ...] = ("dense", "file") if self.file is not None else ("dense",)
        return {numbers: References(NewtonEuler(self.chain, self.phi(numbers)), self) for numbers in sets}


class References:
    """Values of the built-in Newton-Euler, which shares no code with any contender."""

    def __init__(self, model: NewtonEuler, case: Case) -> None:
        q, dq, ddq, e = case.parts()
        M, c, g = model.mass_matrix(q), model.coriolis(q, dq), model.gravity(q)
        tau = model.inverse_dynamics(q, dq, ddq)
        inverse = np.asarray(np.linalg.inv(M), dtype=float)
        acceleration = np.einsum("kij,kj->ki", inverse, ddq - c - g)  # the third part of a state read as torque
        slopes = _inverse_derivatives(model, q, dq, acceleration)
        self.e = e
        self.dq = dq
        self.values: dict[str, Array] = {
            "inverse_dynamics": tau,
            "mass_matrix": M,
            "bias": c + g,
            "coriolis": c,
            "gravity": g,
            "forward_dynamics": acceleration,
            "inverse_dynamics_derivatives": _flat(tau, *_inverse_derivatives(model, q, dq, ddq), M),
            "forward_dynamics_derivatives": _flat(acceleration, *(-inverse @ slope for slope in slopes), inverse),
            "kinematics": _flat(model.forward_kinematics(q), model.jacobian(q)),
        }


def _inverse_derivatives(model: NewtonEuler, q: Array, dq: Array, ddq: Array) -> list[Array]:
    """Derivatives of inverse dynamics by q and by velocity, each (N, n, n)."""
    return [
        _slope(lambda step: model.inverse_dynamics(q + step, dq, ddq), q),
        _slope(lambda step: model.inverse_dynamics(q, dq + step, ddq), q),
    ]


def _flat(*parts: Array) -> Array:
    """``parts`` (N, ...) flattened and concatenated, (N, sum of sizes)."""
    return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)


def _slope(function: Callable[[Array], Array], like: Array) -> Array:
    """Derivatives (N, n, n) of (N, n) by differences of eighth order, exact to about 1e-11."""
    n, columns = like.shape[1], []
    for j in range(n):
        unit = np.zeros(n)
        unit[j] = _STEP
        terms = [weight * (function(k * unit) - function(-k * unit)) for k, weight in _WEIGHTS]
        columns.append(sum(terms, np.zeros_like(like)) / _STEP)
    return np.stack(columns, axis=2)


_STEP = 0.01
_WEIGHTS = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))


def make_case(spec: RobotSpec, seed: int = 0) -> Case:
    """A case with random states and random dense bodies, without drives, which not every rival supports."""
    rng = np.random.default_rng([seed, spec.n])
    chain = chain_of(spec)
    chain = replace(chain, drive_inertia=np.zeros((chain.n, chain.n)))
    n = chain.n
    q, dq, ddq, e = (rng.uniform(-scale, scale, (STATES, n)) for scale in (np.pi, 3.0, 10.0, 1.0))
    return Case(spec, chain, dense_bodies(rng, n), nominal_parameters(spec), np.hstack([q, dq, ddq, e]))


def dense_bodies(rng: np.random.Generator, n: int) -> Array:
    """Standard parameters (n, 10) of random clouds of point masses: physical bodies without symmetry."""
    rows = []
    for _ in range(n):
        mass = rng.uniform(1.0, 5.0)
        points = rng.normal(scale=0.15, size=(8, 3)) + rng.normal(scale=0.1, size=3)
        E = points.T @ points * mass / 8
        S = np.trace(E) * np.eye(3) - E
        rows.append([mass, *(mass * points.mean(axis=0)), S[0, 0], S[0, 1], S[1, 1], S[0, 2], S[1, 2], S[2, 2]])
    return np.array(rows)
