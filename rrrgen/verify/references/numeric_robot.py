"""The robot as floating-point numbers, the input of every reference implementation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rrrgen.robot.spec import FixedTransform, LoopSpec, RobotSpec

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NumericLoop:
    """A closed loop: its two ``passive`` rows, two ``pins`` (row, -1 for the base, and place (3,), m), its assembly.

    One that is no dyad has a ``start`` (2,) instead of an assembly: displacements of the passive rows near which it is
    assembled with the drives at :attr:`NumericRobot.home`.
    """

    passive: tuple[int, int]
    pins: tuple[tuple[int, Array], tuple[int, Array]]
    assembly: int
    start: tuple[float, ...] = ()


@dataclass(frozen=True)
class NumericRobot:
    """A robot in numbers: rows of the DH table (links,) in rad and m, fixed transforms (4, 4), gravity (3,), drives.

    ``gravity`` is in the base frame, m/s^2. ``drive_inertia`` (n, n) is what the drives add to the mass matrix: a
    diagonal, unless drives are coupled. ``parents`` are the links that carry the rows (-1: the base), ``tip`` is the
    link that carries the tool. ``coupling`` (links, n) maps q to the displacements of the rows; it is a diagonal of the
    signs of the joints unless they follow others. ``angles`` (n,) says which entries of q are angles. ``gamma`` and
    ``b`` (links,), rad and m, place branches on the links that carry them. With closed ``loops``, ``coupling`` has
    further columns for the displacements of their passive rows. ``home`` (n,) is the position of the drives next to
    zero within their limits.
    """

    name: str
    convention: str
    revolute: tuple[bool, ...]
    alpha: Array
    a: Array
    d: Array
    theta: Array
    gravity: Array
    base: Array
    tool: Array
    drive_inertia: Array
    parents: tuple[int, ...]
    tip: int
    coupling: Array
    angles: tuple[bool, ...]
    gamma: Array
    b: Array
    home: Array
    loops: tuple[NumericLoop, ...] = ()

    @property
    def n(self) -> int:
        """Number n of joint positions q."""
        return int(self.coupling.shape[1]) - 2 * len(self.loops)

    def spanning_tree(self) -> NumericRobot:
        """The tree without the pins of its loops, whose passive rows have positions of their own; without drives."""
        count = self.coupling.shape[1]
        passive = tuple(self.revolute[row] for loop in self.loops for row in loop.passive)
        return replace(
            self,
            loops=(),
            angles=(*self.angles, *passive),
            drive_inertia=np.zeros((count, count)),
            home=np.zeros(count),
        )

    @property
    def links(self) -> int:
        """Number of links, which is that of DH rows."""
        return len(self.revolute)

    @property
    def plain(self) -> bool:
        """Whether the robot is an unbranched chain in which every DH row has its own joint position, up to its sign."""
        chained = self.parents == tuple(range(-1, self.links - 1))
        return chained and np.array_equal(np.abs(self.coupling), np.eye(self.links))

    @property
    def moving(self) -> list[int]:
        """The rows that move with q; the others are fixed."""
        return [i for i in range(self.links) if np.any(self.coupling[i])]

    def path(self, row: int) -> list[int]:
        """Indices of the DH rows from the base to ``row``, in order."""
        return [] if row < 0 else [*self.path(self.parents[row]), row]

    def depth_first(self, parent: int = -1) -> list[int]:
        """The rows in depth-first order: branch by branch, each after the row whose link carries it."""
        rows = [i for i in range(self.links) if self.parents[i] == parent]
        return [k for i in rows for k in (i, *self.depth_first(i))]

    def behind(self, after: list[Array], row: int) -> Array:
        """The constant transform after the motion of the row that carries ``row``; the base transform for the base."""
        return self.base if self.parents[row] < 0 else after[self.parents[row]]

    def around_joints(self) -> list[tuple[Array, Array]]:
        """For every row i the constant transforms (before, after) in ``A_i(q) = before S(q) after``.

        S is the motion of the row about or along z. Standard ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``, modified ``Rz(gamma)
        Tz(b) Rx(alpha) Tx(a) Rz(theta) Tz(d)``.
        """
        pairs = []
        for i in range(self.links):
            twist, screw, lead = np.eye(4), np.eye(4), np.eye(4)
            c, s = np.cos(self.alpha[i]), np.sin(self.alpha[i])
            twist[1:3, 1:3] = [[c, -s], [s, c]]
            twist[0, 3] = self.a[i]
            for T, angle, shift in ((screw, self.theta[i], self.d[i]), (lead, self.gamma[i], self.b[i])):
                T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
                T[2, 3] = shift
            standard = self.convention == "standard"
            pairs.append((np.eye(4), screw @ twist) if standard else (lead @ twist @ screw, np.eye(4)))
        return pairs


def chain_of(spec: RobotSpec) -> NumericRobot:
    """Build the chain of a robot description, with named parameters at their nominal values."""

    def matrix(transform: FixedTransform) -> Array:
        T = np.eye(4)
        T[:3, :3] = np.reshape([float(spec.nominal(v)) for v in transform.rotation], (3, 3))
        T[:3, 3] = [float(spec.nominal(v)) for v in transform.translation]
        return T

    rows = spec.dh_table()
    return NumericRobot(
        name=spec.name,
        convention=spec.convention,
        revolute=tuple(row[0] == "revolute" for row in rows),
        alpha=np.array([row[1] for row in rows]),
        a=np.array([row[2] for row in rows]),
        d=np.array([row[3] for row in rows]),
        theta=np.array([row[4] for row in rows]),
        gravity=np.array([float(spec.nominal(g)) for g in spec.gravity]),
        base=matrix(spec.base),
        tool=matrix(spec.tool),
        drive_inertia=_drive_inertia(spec),
        parents=spec.parents,
        tip=spec.tip_row,
        coupling=_coupling(spec),
        angles=tuple(joint.is_revolute for joint in spec.joints),
        gamma=np.array([gamma for gamma, _ in spec.placements()]),
        b=np.array([b for _, b in spec.placements()]),
        home=np.clip(
            np.zeros(spec.n),
            [-np.inf if joint.limits.lower is None else joint.limits.lower for joint in spec.joints],
            [np.inf if joint.limits.upper is None else joint.limits.upper for joint in spec.joints],
        ),
        loops=tuple(_loop(spec, loop) for loop in spec.loops),
    )


def _loop(spec: RobotSpec, loop: LoopSpec) -> NumericLoop:
    first, second = ((row, np.array([float(spec.nominal(v)) for v in place])) for row, place in loop.pins)
    start = tuple(float(spec.nominal(v)) for v in loop.start or ())
    return NumericLoop(loop.passive, (first, second), loop.assembly, start)


def _coupling(spec: RobotSpec) -> Array:
    if spec.mechanism is None:
        return np.diag([float(joint.sign) for joint in spec.joints])
    return np.array([[float(value) for value in row] for row in spec.mechanism.matrix])


def _drive_inertia(spec: RobotSpec) -> Array:
    """Contribution (n, n) of all drives to the mass matrix: second derivatives of their energy by the joint speeds.

    Coupled motors turn at their gear ratios times the speeds ``dq_m`` with ``S dq_m = dq``, S the coupling matrix.
    """
    inertias = [0.0 if j.drive is None or j.drive.inertia is None else float(j.drive.inertia) for j in spec.joints]
    if spec.drives is None:
        return np.diag(inertias)
    rotors = [0.0 if motor.inertia is None else float(motor.inertia) for motor in spec.drives.motors]
    speeds = motor_speeds(spec, np.eye(spec.n))  # row k: the speeds of all motors while only joint k moves, at speed 1
    return np.asarray(np.diag(inertias) + (speeds * rotors) @ speeds.T)


def motor_speeds(spec: RobotSpec, dq: Array) -> Array:
    """Speeds (N, n) of coupled motors at the joint speeds ``dq`` (N, n), by numerical solution."""
    assert spec.drives is not None
    gears = np.array([float(motor.gear_ratio) for motor in spec.drives.motors])
    coupling = np.array([[float(value) for value in row] for row in spec.drives.joint_from_drive])
    return np.asarray(np.linalg.solve(coupling, dq.T).T * gears)


def motor_loads(spec: RobotSpec, tau: Array) -> Array:
    """Torques (N, n) of coupled motors that correspond to the joint torques ``tau`` (N, n), by equal power."""
    return np.asarray(np.linalg.solve(motor_speeds(spec, np.eye(spec.n)), tau.T).T)


def nominal_parameters(spec: RobotSpec) -> Array | None:
    """Standard parameters (n, 10) of the description's links, or None where it has none.

    The order is m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, about the origin of the link frame, with tensor signs.
    """
    if spec.links is None:
        return None
    rows = []
    for link in spec.links:
        m, (x, y, z) = float(link.mass), (float(c) for c in link.com)
        xx, yy, zz, xy, xz, yz = (float(v) for v in link.inertia_about_origin())
        rows.append([m, m * x, m * y, m * z, xx, xy, yy, xz, yz, zz])
    return np.array(rows)


def without_mass(chain: NumericRobot, phi: Array) -> list[int]:
    """The links without any inertia in ``phi`` (links, 10) that only hold a fixed row: no body at all."""
    return [i for i in range(chain.links) if i not in chain.moving and not np.any(phi[i])]


def inertia_tensor(parameters: Array) -> Array:
    """Inertia tensor (3, 3) about the origin of the link frame, from the standard ``parameters`` (10,) of one link."""
    xx, xy, yy, xz, yz, zz = parameters[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def centre_and_tensor(parameters: Array) -> tuple[Array, Array]:
    """Centre of mass (3,) and inertia tensor (3, 3) about it, from standard ``parameters`` (10,) with m > 0."""
    m = float(parameters[0])
    c = parameters[1:4] / m
    return c, inertia_tensor(parameters) - m * (c @ c * np.eye(3) - np.outer(c, c))


def is_physical(parameters: Array) -> bool:
    """Whether the pseudo-inertia of every link is positive definite, which implies M(q) > 0 for all q."""
    for row in parameters:
        S = inertia_tensor(row)
        P = np.empty((4, 4))
        P[:3, :3] = 0.5 * np.trace(S) * np.eye(3) - S
        P[:3, 3] = P[3, :3] = row[1:4]
        P[3, 3] = row[0]
        if np.linalg.eigvalsh(P)[0] <= 0.0:
            return False
    return True
