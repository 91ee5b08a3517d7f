"""Every public function against the independent Newton-Euler and the energies' own oracle, at random states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from oracles import lagrange
from oracles import newton_euler as oracle
from oracles.newton_euler import Link, Robot
from oracles.random_robots import random_link, random_state, transform
from rrrgen.program import Program, evaluate

DOUBLE = 1e-11  # relative to the largest value over the states: some hundred to thousand roundings of 1e-16

FRICTION = {"friction_with", "smooth_friction"}
"""Functions that are no rigid-body mechanics; tests/pipeline/test_friction_laws.py compares them with retyped laws."""


class Reference:
    """What the functions of ``robot`` must give at ``states`` random states; ``K`` is the map from phi to beta.

    ``error(function, outputs)`` is the largest difference relative to the size of the quantity: torques to the largest
    torque, energies to the largest energy, everything else to its own largest entry.
    """

    def __init__(self, robot: Robot, K: np.ndarray, states: int = 2, seed: int = 0) -> None:
        self.robot, self.K = robot, np.asarray(K, dtype=float)
        rng = np.random.default_rng(seed)
        drawn = [random_state(robot, rng) for _ in range(states)]
        # states that a float holds too, so that either precision computes the same thing
        self.q, self.dq, self.ddq = (np.float32(np.array(part)).astype(float) for part in zip(*drawn, strict=True))
        self.e = np.float32(rng.uniform(-1, 1, self.q.shape)).astype(float)
        self.tau = self.each(oracle.inverse_dynamics, self.q, self.dq, self.ddq)
        self.torque = float(np.max(np.abs(self.tau))) or 1.0
        self.beta = self.K @ robot.phi
        self.v, self.a = (np.float32(rng.uniform(-3, 3, self.q.shape)).astype(float) for _ in range(2))
        self.payload = random_link(rng)
        self.frame = transform((2, -1, 1, 3), (0.1, -0.2, 0.35))

    def each(self, function: Callable[..., np.ndarray], *arguments: np.ndarray) -> np.ndarray:
        return np.array([function(self.robot, *state) for state in zip(*arguments, strict=True)])

    def arguments(self, program: Program) -> list[np.ndarray]:
        """The inputs of a program at these states."""
        known = {"q": self.q, "dq": self.dq, "ddq": self.ddq, "tau": self.tau, "e": self.e, "beta": self.beta}
        known |= {"v": self.v, "a": self.a, "phi": self.robot.phi, "gravity": self.robot.gravity, "frame": self.frame}
        known |= {"mass": self.payload.mass, "com": self.payload.com, "inertia": self.payload.inertia}
        return [np.asarray(known[port.name]) for port in program.inputs]

    def program_error(self, function: str, program: Program) -> float:
        """Error of a program's reference evaluation; infinite where anything is not a number."""
        with np.errstate(all="ignore"):
            outputs = evaluate(program, *self.arguments(program))
        return self.error(function, outputs)

    def error(self, function: str, outputs: tuple[np.ndarray, ...]) -> float:
        if not all(np.all(np.isfinite(value)) for value in outputs):
            return np.inf
        return float(getattr(self, f"_{function}")(*outputs))

    def _torques(self, value: np.ndarray, expected: np.ndarray) -> float:
        return float(np.max(np.abs(value - expected))) / self.torque

    @cached_property
    def M(self) -> np.ndarray:
        return self.each(oracle.mass_matrix, self.q)

    @cached_property
    def christoffel(self) -> np.ndarray:
        return self.each(lagrange.christoffel_matrix, self.q, self.dq)

    @cached_property
    def standard(self) -> np.ndarray:
        return self.each(oracle.standard_regressor, self.q, self.dq, self.ddq)

    def _forward_kinematics(self, T):
        return relative(T, self.each(oracle.forward_kinematics, self.q))

    def _link_frames(self, T):
        return relative(T, np.array([oracle.frames(self.robot, q).links for q in self.q]))

    def _jacobian(self, J):
        return relative(J, self.each(oracle.jacobian, self.q))

    def _link_jacobians(self, J):
        return relative(J, self.each(oracle.link_jacobians, self.q))

    def _kinematics(self, T, J):
        return max(self._forward_kinematics(T), self._jacobian(J))

    def _jacobian_dot_dq(self, a):
        return relative(a, self.each(oracle.jacobian_dot_dq, self.q, self.dq), least=1.0)

    def _mass_matrix(self, M):
        return max(relative(M, self.M), relative(M, np.swapaxes(M, 1, 2)))

    def _coriolis_matrix(self, C):
        """The matrix of the Christoffel symbols; and dM/dt - 2 C is skew, with dM/dt from the oracle's energies."""
        rate = np.array(
            [
                np.einsum("kij,k->ij", lagrange.mass_matrix_derivatives(self.robot, q), dq)
                for q, dq in zip(self.q, self.dq, strict=True)
            ]
        )
        size = float(np.max(np.abs(self.M)) * np.max(np.abs(self.dq)))
        skew = rate - C - np.swapaxes(C, 1, 2)  # half the symmetric part of dM/dt - 2 C
        product = np.einsum("bij,bj->bi", C, self.dq)
        return max(
            np.max(np.abs(C - self.christoffel)) / size,
            np.max(np.abs(skew)) / size,
            self._torques(product, self.each(oracle.coriolis, self.q, self.dq)),
        )

    def _coriolis(self, c):
        return self._torques(c, self.each(oracle.coriolis, self.q, self.dq))

    def _coriolis_transpose(self, p):
        return self._torques(p, np.einsum("bji,bj->bi", self.christoffel, self.dq))

    def _gravity(self, g):
        return self._torques(g, self.each(lagrange.gravity, self.q))

    def _bias(self, h):
        return self._torques(h, self.each(oracle.bias, self.q, self.dq))

    def _dynamics_terms(self, M, c, g):
        return max(self._mass_matrix(M), self._coriolis(c), self._gravity(g))

    def _inverse_dynamics(self, tau):
        return self._torques(tau, self.tau)

    def _forward_dynamics(self, ddq, status):
        """Status ok, and the accelerations reproduce tau: the residual, so that a hard M is not held against it."""
        if np.any(status != 0):
            return np.inf
        bias = self.each(oracle.bias, self.q, self.dq)
        residual = np.einsum("bij,bj->bi", self.M, ddq) + bias - self.tau
        size = np.einsum("bij,bj->bi", np.abs(self.M), np.abs(ddq)) + np.abs(bias)
        return np.max(np.abs(residual)) / max(float(np.max(size)), self.torque)

    def _slopes(self, ddq: np.ndarray, by: str) -> np.ndarray:
        """dtau_i/dq_j or dtau_i/d(dq_j) by the complex step through the oracle, (states, n, n)."""
        slopes = []
        for q, dq, a in zip(self.q, self.dq, ddq, strict=True):
            columns = []
            for e in 1j * lagrange.STEP * np.eye(self.robot.n):
                state = (q + e, dq, a) if by == "q" else (q, dq + e, a)
                columns.append(oracle.inverse_dynamics(self.robot, *state).imag / lagrange.STEP)
            slopes.append(np.array(columns).T)
        return np.array(slopes)

    def _inverse_dynamics_derivatives(self, tau, dtau_dq, dtau_dv, M):
        return max(
            self._torques(tau, self.tau),
            relative(dtau_dq, self._slopes(self.ddq, "q"), least=self.torque),
            relative(dtau_dv, self._slopes(self.ddq, "dq"), least=self.torque),
            self._mass_matrix(M),
        )

    def _forward_dynamics_derivatives(self, ddq, dddq_dq, dddq_dv, dddq_dtau, status):
        """Residuals again: M X = -dtau/dx at the accelerations found, and M times its inverse."""
        errors = [self._forward_dynamics(ddq, status)]
        identity = -np.broadcast_to(np.eye(self.robot.n), self.M.shape)
        for X, right in (
            (dddq_dq, self._slopes(ddq, "q")),
            (dddq_dv, self._slopes(ddq, "dq")),
            (dddq_dtau, identity),
        ):
            size = np.max(np.abs(self.M) @ np.abs(X) + np.abs(right))
            floor = self.torque if right is not identity else 0.0
            errors.append(float(np.max(np.abs(self.M @ X + right)) / max(size, floor)))
        return max(errors)

    def _regressor(self, Y):
        return relative(Y @ self.K, self.standard)

    def _regressor_transpose(self, r):
        expected = np.einsum("bij,bi->bj", self.standard, self.e)
        return np.max(np.abs(r @ self.K - expected)) / (np.max(np.abs(self.standard)) * np.max(np.abs(self.e)))

    def _standard_regressor(self, Y):
        return relative(Y, self.standard)

    def _base_parameters(self, beta):
        return relative(beta, self.beta)

    def _add_payload(self, beta):
        return relative(beta, self._loaded(self.payload))

    def _add_payload_at(self, beta):
        R, p = self.frame[:3, :3], self.frame[:3, 3]
        body = self.payload
        return relative(beta, self._loaded(Link(body.mass, R @ body.com + p, R @ body.inertia @ R.T)))

    def _loaded(self, body: Link) -> np.ndarray:
        return self.beta + self.K[:, -10:] @ body.parameters()

    def _momentum_terms(self, p, ct, g):
        momentum = np.einsum("bij,bj->bi", self.M, self.dq)
        return max(relative(p, momentum), self._coriolis_transpose(ct), self._gravity(g))

    def _reference_torque(self, tau):
        return self._torques(tau, self._at_reference)

    @property
    def _at_reference(self) -> np.ndarray:
        """M a + C(q, dq) v + g with the matrix of the Christoffel symbols, which the oracle differentiates."""
        moving = np.einsum("bij,bj->bi", self.M, self.a) + np.einsum("bij,bj->bi", self.christoffel, self.v)
        return moving + self.each(lagrange.gravity, self.q)

    def _reference_regressor_transpose(self, r):
        """C(q, dq) v = c((dq + v)/2) - c((dq - v)/2), so that Y is the difference of two usual regressors."""
        weightless = replace(self.robot, gravity=np.zeros(3))
        Y = self.each(oracle.standard_regressor, self.q, (self.dq + self.v) / 2, self.a)
        halves = zip(self.q, (self.dq - self.v) / 2, strict=True)
        Y -= np.array([oracle.standard_regressor(weightless, q, half, np.zeros_like(q)) for q, half in halves])
        expected = np.einsum("bij,bi->bj", Y, self.e)
        power = np.einsum("bi,bi->b", self.e, self._at_reference)
        return max(
            np.max(np.abs(r @ self.K - expected)) / (np.max(np.abs(Y)) * np.max(np.abs(self.e))),
            np.max(np.abs(r @ self.beta - power)) / self.torque,
        )

    def _energy(self, kinetic, potential):
        """Kinetic energy, and potential energy up to a constant: differences to the first state."""
        expected, at_rest = self.each(oracle.energy, self.q, self.dq).T
        own, reference = potential - potential[0], at_rest - at_rest[0]
        return max(relative(kinetic, expected), np.max(np.abs(own - reference)) / max(np.max(np.abs(reference)), 1.0))


def relative(value: np.ndarray, expected: np.ndarray, least: float = 1e-9) -> float:
    """Largest difference in units of the largest expected entry."""
    assert value.shape == expected.shape
    return float(np.max(np.abs(value - expected)) / max(float(np.max(np.abs(expected))), least))


def failures(
    reference: Reference, programs: Mapping[str, tuple[Program, ...]], tolerance: float = DOUBLE
) -> dict[str, float]:
    """Function (and which of its programs) -> error, for every program that is not within the tolerance."""
    errors = {
        f"{name}[{k}]": reference.program_error(name.removesuffix("_nominal"), program)
        for name, ways in programs.items()
        for k, program in enumerate(ways)
    }
    return {name: error for name, error in errors.items() if not error <= tolerance}
