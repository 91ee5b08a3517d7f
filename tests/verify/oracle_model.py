"""A stand-in for a compiled model: the Model interface, computed by the tests' oracles."""

from __future__ import annotations

import numpy as np
import sympy as sp

from oracles import newton_euler as ne
from oracles.lagrange import STEP
from oracles.newton_euler import Link, Robot
from oracles.numeric_rank import stacked_regressor
from rrrgen.base.errors import DerivationError
from rrrgen.robot.spec import DriveSpec, FixedTransform, FrictionSpec, JointSpec, LinkSpec, RobotSpec
from rrrgen.runtime.engines import NumpyEngine


def exact(value: float) -> sp.Rational:
    """The rational that prints like the float, so that float() gives the float back."""
    return sp.Rational(repr(float(value)))


def exact_angle(value: float) -> sp.Expr:
    """The multiple of pi/2 that the float is nearest to, if it is one, else the rational that prints like it."""
    quarters = round(value / (np.pi / 2))
    return sp.Rational(quarters, 2) * sp.pi if quarters * (np.pi / 2) == value else exact(value)


def fixed_transform(T: np.ndarray) -> FixedTransform:
    return FixedTransform(tuple(exact(v) for v in T[:3, :3].ravel()), (exact(T[0, 3]), exact(T[1, 3]), exact(T[2, 3])))


def spec_of(robot: Robot, drive: tuple[float, ...] = (), friction: FrictionSpec | None = None) -> RobotSpec:
    """The oracle's robot as a description; ``drive`` are inertias per joint."""
    joints = tuple(
        JointSpec(
            f"q{i + 1}",
            row[0],
            *(convert(v) for convert, v in zip((exact_angle, exact, exact, exact_angle), row[1:], strict=True)),
            friction=friction,
            drive=DriveSpec(inertia=drive[i]) if drive else None,
            sign=robot.signs[i] if robot.signs else 1,
        )
        for i, row in enumerate(robot.rows)
    )
    links = tuple(
        LinkSpec(
            exact(link.mass),
            tuple(exact(c) for c in link.com),
            tuple(exact(link.inertia[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
            "com",
        )
        for link in robot.links
    )
    return RobotSpec(
        robot.name,
        robot.convention,
        tuple(exact(g) for g in robot.gravity),
        {},
        joints,
        links or None,
        fixed_transform(robot.base),
        fixed_transform(robot.tool),
    )


def pseudo_inertia(parameters: np.ndarray) -> np.ndarray:
    """The 4x4 matrix (14.9) of ten standard parameters."""
    m, mx, my, mz, xx, xy, yy, xz, yz, zz = parameters
    S = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    J = np.zeros((4, 4))
    J[:3, :3] = 0.5 * np.trace(S) * np.eye(3) - S
    J[:3, 3] = J[3, :3] = mx, my, mz
    J[3, 3] = m
    return J


def batched(function):
    """A method of one state as a method of states (..., n); the model remembers the answers it has given."""

    def answer(self, row, phi):
        key = (function, *(value.tobytes() for value in row), None if phi is None else phi.tobytes())
        if key not in self.answers:
            self.answers[key] = function(self, *row, phi)
        return self.answers[key]

    def over_batch(self, *states, beta=None):
        states = [np.asarray(s, dtype=float) for s in states]
        lead = np.broadcast_shapes(*(s.shape[:-1] for s in states))
        flat = [np.broadcast_to(s, (*lead, s.shape[-1])).reshape(-1, s.shape[-1]) for s in states]
        phi = self._phi(beta)
        rows = [answer(self, row, phi) for row in zip(*flat, strict=True)]
        if isinstance(rows[0], tuple):
            return tuple(np.reshape(part, (*lead, *np.shape(part[0]))) for part in zip(*rows, strict=True))
        return np.reshape(rows, (*lead, *np.shape(rows[0])))

    return over_batch


class OracleModel:
    """Model computed by oracles; base parameters from the singular vectors of the stacked regressor.

    beta = K phi with orthonormal K, hence Y_base = Y_standard K' and phi = K' beta moves every function correctly.
    """

    def __init__(self, robot: Robot, drive: tuple[float, ...] = (), friction: FrictionSpec | None = None) -> None:
        self.robot, self.n, self.engine = robot, robot.n, NumpyEngine({})
        self.answers = {}  # function, state and parameters -> what the function gives
        self.spec = spec_of(robot, drive, friction)
        self.drive = np.array(drive or [0.0] * robot.n)
        _, s, V = np.linalg.svd(stacked_regressor(robot), full_matrices=False)
        self.base_projection = V[s > 1e-10 * s[0]]
        self.base_parameter_names = tuple(f"p{k + 1}" for k in range(len(self.base_projection)))
        self.base_parameters = sp.symbols(self.base_parameter_names)
        self.beta = self.base_projection @ robot.phi if robot.links else None
        drives = [f"Ia{i + 1}" for i in range(self.n)] if drive else []
        self._friction_terms = [kind for kind in ("viscous", "coulomb", "offset") if getattr(friction, kind, None)]
        frictions = [f"{kind}{i + 1}" for i in range(self.n) for kind in self._friction_terms]
        self.identification_parameter_names = (*self.base_parameter_names, *drives, *frictions)

    @property
    def ik(self):
        """The oracles solve no inverse kinematics, as a chain for which there is no family."""
        raise DerivationError("the oracle has no inverse kinematics")

    def _phi(self, beta) -> np.ndarray | None:
        chosen = self.beta if beta is None else np.asarray(beta)
        return None if chosen is None else self.base_projection.T @ chosen

    def _regressor(self, q, dq, ddq) -> np.ndarray:
        return ne.standard_regressor(self.robot, q, dq, ddq)

    def _bias(self, q, dq, phi) -> np.ndarray:
        return self._christoffel(q, dq, phi) @ dq + self._gravity(q, phi)

    def _gravity(self, q, phi) -> np.ndarray:
        return np.array([self._potential(q + 1j * STEP * unit, phi).imag for unit in np.eye(self.n)]) / STEP

    def _potential(self, q, phi):
        frames, potential = ne.frames(self.robot, q).links, 0.0
        for T, (m, *h) in zip(frames, phi.reshape(self.n, 10)[:, :4], strict=True):
            potential = potential - self.robot.gravity @ (m * T[:3, 3] + T[:3, :3] @ h)
        return potential

    @batched
    def forward_kinematics(self, q, _phi):
        return ne.forward_kinematics(self.robot, q)

    @batched
    def link_frames(self, q, _phi):
        return ne.frames(self.robot, q).links

    @batched
    def jacobian(self, q, _phi):
        return ne.jacobian(self.robot, q)

    @batched
    def link_jacobians(self, q, _phi):
        return ne.link_jacobians(self.robot, q)

    @batched
    def kinematics(self, q, _phi):
        return ne.forward_kinematics(self.robot, q), ne.jacobian(self.robot, q)

    @batched
    def jacobian_dot_dq(self, q, dq, _phi):
        return ne.jacobian_dot_dq(self.robot, q, dq)

    def _mass(self, q, phi) -> np.ndarray:
        """The trace form (14.7): m_ik = sum over links of Tr(dT/dq_k J (dT/dq_i)')."""
        f = ne.frames(self.robot, q)
        rates = np.zeros((self.n, self.n, 4, 4), dtype=f.links.dtype)  # of the frame of link j for joint i
        for i, (kind, *_) in enumerate(self.robot.rows):
            twist = np.zeros((4, 4), dtype=f.links.dtype)
            z = f.axes[i]
            if kind == "revolute":
                twist[:3, :3] = [[0, -z[2], z[1]], [z[2], 0, -z[0]], [-z[1], z[0], 0]]
                twist[:3, 3] = -twist[:3, :3] @ f.points[i]
            else:
                twist[:3, 3] = z
            rates[i:, i] = twist @ f.links[i:]
        J = np.array([pseudo_inertia(row) for row in phi.reshape(self.n, 10)])
        return np.einsum("jiab,jbc,jkac->ik", rates, J, rates, optimize=True) + np.diag(self.drive)

    @batched
    def mass_matrix(self, q, phi):
        return self._mass(q, phi)

    def _christoffel(self, q, dq, phi) -> np.ndarray:
        D = np.array([self._mass(q + 1j * STEP * unit, phi).imag for unit in np.eye(self.n)]) / STEP
        cross = np.einsum("jik,k->ij", D, dq)
        return 0.5 * (np.einsum("kij,k->ij", D, dq) + cross - cross.T)

    @batched
    def coriolis_matrix(self, q, dq, phi):
        return self._christoffel(q, dq, phi)

    @batched
    def coriolis_transpose(self, q, dq, phi):
        return self._christoffel(q, dq, phi).T @ dq

    @batched
    def coriolis(self, q, dq, phi):
        return self._christoffel(q, dq, phi) @ dq

    @batched
    def gravity(self, q, phi):
        return self._gravity(q, phi)

    @batched
    def bias(self, q, dq, phi):
        return self._bias(q, dq, phi)

    @batched
    def dynamics_terms(self, q, dq, phi):
        return self._mass(q, phi), self._christoffel(q, dq, phi) @ dq, self._gravity(q, phi)

    @batched
    def inverse_dynamics(self, q, dq, ddq, phi):
        return self._mass(q, phi) @ ddq + self._bias(q, dq, phi)

    @batched
    def forward_dynamics(self, q, dq, tau, phi):
        return self._accelerations(q, dq, tau, phi)

    def _accelerations(self, q, dq, tau, phi) -> np.ndarray:
        M = self._mass(q, phi)
        np.linalg.cholesky(M)  # refuses what is not positive definite
        return np.linalg.solve(M, tau - self._bias(q, dq, phi))

    def _slopes(self, q, dq, ddq, phi) -> tuple[np.ndarray, np.ndarray]:
        """d tau / dq and d tau / d dq by complex steps."""
        by_q = [self._regressor(q + 1j * STEP * unit, dq, ddq) @ phi for unit in np.eye(self.n)]
        by_dq = [self._regressor(q, dq + 1j * STEP * unit, ddq) @ phi for unit in np.eye(self.n)]
        return np.imag(by_q).T / STEP, np.imag(by_dq).T / STEP

    @batched
    def inverse_dynamics_derivatives(self, q, dq, ddq, phi):
        M = self._mass(q, phi)
        return M @ ddq + self._bias(q, dq, phi), *self._slopes(q, dq, ddq, phi), M

    @batched
    def forward_dynamics_derivatives(self, q, dq, tau, phi):
        ddq, inverse = self._accelerations(q, dq, tau, phi), np.linalg.inv(self._mass(q, phi))
        by_q, by_dq = self._slopes(q, dq, ddq, phi)
        return ddq, -inverse @ by_q, -inverse @ by_dq, inverse

    def base_parameters_of(self, phi):
        return np.asarray(phi) @ self.base_projection.T

    def add_payload_at(self, mass, com, inertia, frame, *, beta):
        return self.add_payload(mass, com, inertia, frame, beta=beta)

    def friction_with(self, dq, friction):
        viscous, coulomb, offset = np.moveaxis(np.reshape(friction, (*np.shape(dq), 3)), -1, 0)
        return viscous * dq + coulomb * np.sign(dq) + offset

    def smooth_friction(self, dq, friction, width):
        viscous, coulomb, offset = np.moveaxis(np.reshape(friction, (*np.shape(dq), 3)), -1, 0)
        return viscous * dq + coulomb * np.tanh(dq / width) + offset

    def add_payload(self, mass, com, inertia, frame=None, *, beta):
        mass, com, inertia = (np.asarray(each, dtype=float) for each in (mass, com, inertia))
        if frame is not None:
            R = frame[..., :3, :3]
            com = np.einsum("...ij,...j->...i", R, com) + frame[..., :3, 3]
            inertia = R @ inertia @ np.swapaxes(R, -1, -2)
        bodies = np.broadcast_arrays(mass[..., None, None], com[..., None, :], inertia)
        added = [
            Link(m.flat[0], c[0], tensor).parameters()
            for m, c, tensor in zip(*(body.reshape(-1, *body.shape[-2:]) for body in bodies), strict=True)
        ]
        return beta + np.reshape(added, (*mass.shape, 10)) @ self.base_projection[:, -10:].T

    @batched
    def energy(self, q, dq, phi):
        return 0.5 * dq @ self._mass(q, phi) @ dq, self._potential(q, phi)

    @batched
    def friction(self, dq, _phi):
        terms = [joint.friction or FrictionSpec() for joint in self.spec.joints]
        viscous, coulomb, offset = (
            np.array([getattr(term, kind) or 0.0 for term in terms]) for kind in ("viscous", "coulomb", "offset")
        )
        return viscous * dq + coulomb * np.sign(dq) + offset

    @batched
    def standard_regressor(self, q, dq, ddq, _phi):
        return self._regressor(q, dq, ddq)

    @batched
    def regressor(self, q, dq, ddq, _phi):
        return self._regressor(q, dq, ddq) @ self.base_projection.T

    @batched
    def regressor_transpose(self, q, dq, ddq, e, _phi):
        return self.base_projection @ (self._regressor(q, dq, ddq).T @ e)

    @batched
    def identification_regressor(self, q, dq, ddq, _phi):
        blocks = [self._regressor(q, dq, ddq) @ self.base_projection.T]
        if np.any(self.drive):
            blocks.append(np.diag(ddq))
        signals = {"viscous": dq, "coulomb": np.sign(dq), "offset": np.ones(self.n)}
        for i in range(self.n):
            unit = np.eye(self.n)[:, [i]]
            blocks.extend(unit * signals[kind][i] for kind in self._friction_terms)
        return np.hstack(blocks)
