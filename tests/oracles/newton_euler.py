"""Kinematics and dynamics of a serial chain from plain numbers, every vector in the base frame.

Written for clarity, one state at a time: positions, then velocities and accelerations link by link, then d'Alembert's
inertial force and moment of every link about its centre of mass, then the power of their sum along each joint axis.
Everything is analytic in q, dq, ddq, so complex arguments give complex-step derivatives (no abs, no conjugation).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

PARAMETER_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True)
class Link:
    """Mass (kg), centre of mass (m) in the link frame, inertia tensor (kg m^2) about it, in the axes of the frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray

    def parameters(self) -> np.ndarray:
        """The ten standard parameters about the origin of the link frame, tensor signs, order PARAMETER_NAMES."""
        m, c = self.mass, self.com
        S = self.inertia + m * (c @ c * np.eye(3) - np.outer(c, c))
        return np.array([m, *(m * c), S[0, 0], S[0, 1], S[1, 1], S[0, 2], S[1, 2], S[2, 2]])

    def pseudo_inertia(self) -> np.ndarray:
        """The 4x4 integral of [x y z 1]'[x y z 1] dm; positive definite exactly for a spatial distribution of mass."""
        m, c = self.mass, self.com
        S = self.inertia + m * (c @ c * np.eye(3) - np.outer(c, c))
        P = np.zeros((4, 4))
        P[:3, :3] = 0.5 * np.trace(S) * np.eye(3) - S
        P[:3, 3] = P[3, :3] = m * c
        P[3, 3] = m
        return P


@dataclass(frozen=True)
class Robot:
    """A serial chain: rows ``(type, alpha, a, d, theta)`` in rad and m, type "revolute" or "prismatic".

    ``gravity`` is the acceleration of gravity in the base frame, the frame in which every result is expressed;
    ``base`` stands before the first row, ``tool`` after the last. ``signs`` are -1 for joints that move against the
    axes of their rows, else 1; () stands for 1 throughout.
    """

    convention: str
    rows: tuple[tuple[str, float, float, float, float], ...]
    gravity: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    base: np.ndarray = field(default_factory=lambda: np.eye(4))
    tool: np.ndarray = field(default_factory=lambda: np.eye(4))
    links: tuple[Link, ...] = ()
    name: str = "robot"
    signs: tuple[int, ...] = ()

    @property
    def n(self) -> int:
        return len(self.rows)

    @property
    def phi(self) -> np.ndarray:
        """The 10 n standard parameters, link after link."""
        return np.concatenate([link.parameters() for link in self.links])

    def with_links(self, links: tuple[Link, ...]) -> Robot:
        return replace(self, links=tuple(links))


def cross(a, b) -> np.ndarray:
    """a x b of two 3-vectors; numpy's own takes ten times as long for a single pair."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine, exact at the whole quarter turns that DH tables are full of."""
    quarters = angle / (np.pi / 2)
    if not np.iscomplexobj(angle) and quarters == np.round(quarters):
        k = int(np.round(quarters)) % 4
        return (1.0, 0.0, -1.0, 0.0)[k], (0.0, 1.0, 0.0, -1.0)[k]
    return np.cos(angle), np.sin(angle)


def screw_z(theta, d) -> np.ndarray:
    """Rotation by theta about z and translation by d along z."""
    c, s = cos_sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])


def screw_x(alpha, a) -> np.ndarray:
    """Rotation by alpha about x and translation by a along x."""
    c, s = cos_sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Frames:
    """Where everything is: link frames (n, 4, 4), the tip, per joint its direction and a point on its axis."""

    links: np.ndarray
    tip: np.ndarray
    axes: np.ndarray
    points: np.ndarray


def frames(robot: Robot, q) -> Frames:
    """Every frame of the chain at q, in the base frame."""
    T = np.array(robot.base)
    links, axes, points = [], [], []
    for (kind, alpha, a, d, theta), qi, sign in zip(robot.rows, q, robot.signs or [1] * robot.n, strict=True):
        turn, shift = (theta + sign * qi, d) if kind == "revolute" else (theta, d + sign * qi)
        if robot.convention == "standard":  # the joint axis is z of the frame before the row
            axes.append(sign * T[:3, 2])
            points.append(T[:3, 3])
            T = T @ screw_z(turn, shift) @ screw_x(alpha, a)
        else:  # the joint axis is z of the row's own frame
            T = T @ screw_x(alpha, a) @ screw_z(turn, shift)
            axes.append(sign * T[:3, 2])
            points.append(T[:3, 3])
        links.append(T)
    return Frames(np.array(links), T @ robot.tool, np.array(axes), np.array(points))


@dataclass(frozen=True)
class Motion:
    """Per link (n, 3): angular velocity, angular acceleration, velocity and acceleration of the frame's origin."""

    omega: np.ndarray
    omega_dot: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


def motion(robot: Robot, f: Frames, dq, ddq) -> Motion:
    """Velocities and accelerations of the links (no gravity in them), from the base outwards."""
    w = wd = v = acc = np.zeros(3)
    o = robot.base[:3, 3]
    rows = []
    for i, (kind, *_) in enumerate(robot.rows):
        z, end = f.axes[i], f.links[i][:3, 3]
        if kind == "revolute":  # a point on the axis belongs to both links
            r = f.points[i] - o
            v, acc = v + cross(w, r), acc + cross(wd, r) + cross(w, cross(w, r))
            wd = wd + z * ddq[i] + cross(w, z * dq[i])
            w = w + z * dq[i]
            r = end - f.points[i]
            v, acc = v + cross(w, r), acc + cross(wd, r) + cross(w, cross(w, r))
        else:  # the link slides along z, seen from the link before it
            r = end - o
            v = v + cross(w, r) + z * dq[i]
            acc = acc + cross(wd, r) + cross(w, cross(w, r)) + 2 * cross(w, z * dq[i]) + z * ddq[i]
        o = end
        rows.append((w, wd, v, acc))
    return Motion(*(np.array(part) for part in zip(*rows, strict=True)))


def joint_forces(robot: Robot, f: Frames, i: int, forces, moments, about) -> np.ndarray:
    """Force or torque of joint i that carries ``forces`` acting at ``about`` and ``moments`` on links i..n."""
    total = sum(forces[i:])
    if robot.rows[i][0] == "prismatic":
        return f.axes[i] @ total
    arms = sum(cross(about[j] - f.points[i], forces[j]) + moments[j] for j in range(i, robot.n))
    return f.axes[i] @ arms


def inverse_dynamics(robot: Robot, q, dq, ddq, gravity=None) -> np.ndarray:
    """tau (n,): N m at revolute, N at prismatic joints. Newton-Euler about the centres of mass."""
    g = robot.gravity if gravity is None else np.asarray(gravity)
    f = frames(robot, q)
    s = motion(robot, f, dq, ddq)
    forces, moments, centres = [], [], []
    for i, link in enumerate(robot.links):
        R = f.links[i][:3, :3]
        r, inertia = R @ link.com, R @ link.inertia @ R.T
        w, wd = s.omega[i], s.omega_dot[i]
        centre_acceleration = s.acceleration[i] + cross(wd, r) + cross(w, cross(w, r))
        forces.append(link.mass * (centre_acceleration - g))
        moments.append(inertia @ wd + cross(w, inertia @ w))
        centres.append(f.links[i][:3, 3] + r)
    return np.array([joint_forces(robot, f, i, forces, moments, centres) for i in range(robot.n)])


def mass_matrix(robot: Robot, q) -> np.ndarray:
    """M (n, n), column k the torque for a unit acceleration of joint k, without gravity and at rest."""
    zero = np.zeros(robot.n)
    return np.array([inverse_dynamics(robot, q, zero, e, gravity=np.zeros(3)) for e in np.eye(robot.n)]).T


def gravity(robot: Robot, q) -> np.ndarray:
    """g (n,), the torque that holds the arm still."""
    return inverse_dynamics(robot, q, np.zeros(robot.n), np.zeros(robot.n))


def coriolis(robot: Robot, q, dq) -> np.ndarray:
    """c (n,), the velocity-dependent part of the torque."""
    return inverse_dynamics(robot, q, dq, np.zeros(robot.n), gravity=np.zeros(3))


def bias(robot: Robot, q, dq) -> np.ndarray:
    """c + g (n,)."""
    return inverse_dynamics(robot, q, dq, np.zeros(robot.n))


def forward_dynamics(robot: Robot, q, dq, tau) -> np.ndarray:
    """ddq (n,) from M ddq = tau - c - g."""
    return np.linalg.solve(mass_matrix(robot, q), tau - bias(robot, q, dq))


def forward_kinematics(robot: Robot, q) -> np.ndarray:
    """The tip (4, 4) in the base frame."""
    return frames(robot, q).tip


def jacobian(robot: Robot, q) -> np.ndarray:
    """J (6, n) at the tip in the base frame, linear rows first."""
    f = frames(robot, q)
    J = np.zeros((6, robot.n), dtype=f.tip.dtype)
    for i, (kind, *_) in enumerate(robot.rows):
        z = f.axes[i]
        if kind == "revolute":
            J[:3, i], J[3:, i] = cross(z, f.tip[:3, 3] - f.points[i]), z
        else:
            J[:3, i] = z
    return J


def link_jacobians(robot: Robot, q) -> np.ndarray:
    """J_i (n, 6, n) of the link frames: joint k moves what lies behind it, about or along its own axis."""
    f, J = frames(robot, q), np.zeros((robot.n, 6, robot.n))
    for i in range(robot.n):
        for k in range(i + 1):
            z, arm = f.axes[k], f.links[i, :3, 3] - f.points[k]
            J[i, :, k] = [*np.cross(z, arm), *z] if robot.rows[k][0] == "revolute" else [*z, 0, 0, 0]
    return J


def jacobian_dot_dq(robot: Robot, q, dq) -> np.ndarray:
    """dJ/dt dq (6,): the tip's linear and angular acceleration when every ddq is zero."""
    f = frames(robot, q)
    s = motion(robot, f, dq, np.zeros(robot.n))
    w, wd, r = s.omega[-1], s.omega_dot[-1], f.tip[:3, 3] - f.links[-1][:3, 3]
    return np.concatenate([s.acceleration[-1] + cross(wd, r) + cross(w, cross(w, r)), wd])


def energy(robot: Robot, q, dq) -> tuple[float, float]:
    """Kinetic energy, and potential energy -sum m g.c counted from the base frame's origin (J)."""
    f = frames(robot, q)
    s = motion(robot, f, dq, np.zeros(robot.n))
    kinetic = potential = 0.0
    for i, link in enumerate(robot.links):
        R, w = f.links[i][:3, :3], s.omega[i]
        v = s.velocity[i] + cross(w, R @ link.com)
        kinetic = kinetic + 0.5 * link.mass * (v @ v) + 0.5 * (R.T @ w) @ link.inertia @ (R.T @ w)
        potential = potential - link.mass * (robot.gravity @ (f.links[i][:3, 3] + R @ link.com))
    return kinetic, potential


def standard_regressor(robot: Robot, q, dq, ddq) -> np.ndarray:
    """Y (n, 10 n), tau = Y phi, from the wrench of each link about its frame's origin for unit parameters.

    force = m (a - g) + wd x h + w x (w x h), moment = I wd + w x I w + h x (a - g), with a the acceleration of the
    origin, h the first moment and I the tensor about the origin, all in the base frame.
    """
    f = frames(robot, q)
    s = motion(robot, f, dq, ddq)
    Y = np.zeros((robot.n, 10 * robot.n), dtype=np.result_type(f.links, np.asarray(dq), np.asarray(ddq)))
    places = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
    for j in range(robot.n):
        R, w, wd = f.links[j][:3, :3], s.omega[j], s.omega_dot[j]
        lift = s.acceleration[j] - robot.gravity
        for k in range(10):
            force = moment = np.zeros(3)
            if k == 0:
                force = lift
            elif k < 4:
                h = R[:, k - 1]
                force, moment = cross(wd, h) + cross(w, cross(w, h)), cross(h, lift)
            else:
                row, column = places[k - 4]
                unit = np.zeros((3, 3))
                unit[row, column] = unit[column, row] = 1.0
                tensor = R @ unit @ R.T
                moment = tensor @ wd + cross(w, tensor @ w)
            wrench = moment + cross(f.links[j][:3, 3], force)  # about the origin of the base frame
            for i in range(j + 1):
                z = f.axes[i]
                if robot.rows[i][0] == "prismatic":
                    Y[i, 10 * j + k] = z @ force
                else:
                    Y[i, 10 * j + k] = z @ (wrench - cross(f.points[i], force))
    return Y
