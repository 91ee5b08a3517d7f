"""Arms of other kinds than the bundled ones under PD control, simulated with Pinocchio and recorded as drives do it.

Nothing is shared with the package: the dynamics are Pinocchio's, controller, friction, encoders and files are written
here. Positions are quantised at the motor and written in degrees or millimetres, torques as currents with noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from oracles.external import Pinocchio
from oracles.newton_euler import Link, Robot
from oracles.random_robots import number_text, to_yaml

H = np.pi / 2
PERIOD, STEPS = 1e-3, 4  # s; integration steps in a period
BENT = {"revolute": 2e-4, "prismatic": 2e-5}  # rad, m: what bends before a joint slides
CONSTANT, RATIO = 0.1, 100.0  # N m/A or N/A, motor revolutions per joint revolution


def link(mass: float, com: tuple[float, ...], size: float) -> Link:
    """A link with radii of gyration near ``size`` (m), its axes of inertia turned a little."""
    tensor = mass * size**2 * np.array([[1.0, 0.05, -0.04], [0.05, 0.8, 0.06], [-0.04, 0.06, 0.6]])
    return Link(mass, np.array(com), tensor)


@dataclass(frozen=True)
class Arm:
    """A robot with drive inertia, viscous friction, Coulomb friction, offset and Stribeck excess of every joint (n,).

    ``amplitude`` (n,) is the size of its motions, rad or m.
    """

    robot: Robot
    inertia: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    amplitude: np.ndarray
    excess: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def carrying(self, payload: Link | None) -> Arm:
        """The arm with ``payload`` fixed to its last link."""
        if payload is None:
            return self
        last = self.robot.links[-1]
        mass = last.mass + payload.mass
        com = (last.mass * last.com + payload.mass * payload.com) / mass
        tensor = np.zeros((3, 3))
        for body in (last, payload):
            c = body.com - com
            tensor += body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return replace(self, robot=self.robot.with_links((*self.robot.links[:-1], Link(mass, com, tensor))))

    def friction(self, dq: np.ndarray, z: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Friction torque at the speeds ``dq``, and the state ``z`` (part of the level, Dahl) after a step ``h``."""
        level = self.coulomb + self.excess * np.exp(-((dq / 0.1) ** 2))
        s = np.sign(dq)
        z = s + (z - s) * np.exp(-np.abs(dq) * h / self._bent)
        return self.viscous * dq + level * z, z

    @cached_property
    def _bent(self) -> np.ndarray:
        return np.array([BENT[kind] for kind, *_ in self.robot.rows])

    def yaml(self, friction: float = 1.0, links: float = 1.0) -> str:
        """The robot file; friction and masses multiplied by factors, where the file is to be wrong."""
        bodies = tuple(replace(k, mass=links * k.mass, inertia=links * k.inertia) for k in self.robot.links)
        own = self.robot.with_links(bodies)
        rows = zip(self.viscous, self.coulomb, self.inertia, strict=True)
        texts = [
            f"name: joint_{i + 1}, friction: {{viscous: {number_text(friction * fv)}, "
            f"coulomb: {number_text(friction * fc)}}}, drive: {{inertia: {number_text(Ia)}}}, "
            for i, (fv, fc, Ia) in enumerate(rows)
        ]
        head, *joints = to_yaml(own).split("  - {type:")
        return head + "".join("  - {" + text + "type:" + row for text, row in zip(texts, joints, strict=True))


SIX = Arm(
    Robot(
        "modified",
        (
            ("revolute", 0.0, 0.0, 0.42, 0.0),
            ("revolute", -H, 0.12, 0.0, 0.0),
            ("revolute", 0.0, 0.45, 0.03, 0.0),
            ("revolute", -H, 0.04, 0.38, 0.0),
            ("revolute", H, 0.0, 0.0, 0.0),
            ("revolute", -H, 0.0, 0.09, 0.0),
        ),
        links=(
            link(14.0, (0.03, 0.01, -0.08), 0.15),
            link(11.0, (0.21, 0.01, 0.06), 0.16),
            link(7.0, (0.03, -0.06, 0.02), 0.11),
            link(3.0, (0.0, 0.02, -0.12), 0.08),
            link(1.6, (0.01, -0.02, 0.01), 0.05),
            link(0.5, (0.005, 0.0, -0.02), 0.03),
        ),
        name="six",
    ),
    inertia=np.array([1.2, 1.4, 0.7, 0.12, 0.11, 0.06]),
    viscous=np.array([6.0, 7.0, 4.0, 0.6, 0.5, 0.3]),
    coulomb=np.array([4.0, 4.5, 3.0, 0.6, 0.5, 0.3]),
    amplitude=np.array([0.9, 0.6, 0.7, 1.0, 1.0, 1.2]),
    excess=np.zeros(6),
)
SCARA = Arm(
    Robot(
        "standard",
        (
            ("revolute", 0.0, 0.4, 0.35, 0.0),
            ("revolute", np.pi, 0.3, 0.0, 0.0),
            ("prismatic", 0.0, 0.0, 0.0, 0.0),
            ("revolute", 0.0, 0.0, 0.02, 0.0),
        ),
        links=(
            link(9.0, (-0.2, 0.01, 0.02), 0.12),
            link(6.0, (-0.14, 0.0, -0.03), 0.1),
            link(1.4, (0.0, 0.0, -0.1), 0.08),
            link(0.3, (0.002, 0.0, -0.02), 0.02),
        ),
        name="scara",
    ),
    inertia=np.array([0.5, 0.3, 3.0, 0.004]),
    viscous=np.array([3.0, 2.0, 20.0, 0.02]),
    coulomb=np.array([2.0, 1.5, 6.0, 0.06]),
    amplitude=np.array([0.8, 0.9, 0.06, 1.5]),
    excess=np.zeros(4),
)


def reference(arm: Arm, seed: int, seconds: float, still: tuple[int, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Positions and speeds (N, n) of a periodic motion of 10 s; the joints ``still`` do not move."""
    rng, t = np.random.default_rng(seed), PERIOD * np.arange(round(seconds / PERIOD))
    n = arm.robot.n
    q, dq = np.zeros((len(t), n)), np.zeros((len(t), n))
    for j in range(n):
        size = rng.normal(size=(6, 2)) / np.sqrt(np.arange(1, 7))[:, None]
        scale = 0.0 if j in still else arm.amplitude[j] / np.sum(np.hypot(*size.T)) * 1.6
        for h, (a, b) in enumerate(scale * size, start=1):
            w = 2.0 * np.pi * 0.1 * h
            q[:, j] += a * np.sin(w * t) + b * np.cos(w * t)
            dq[:, j] += w * (a * np.cos(w * t) - b * np.sin(w * t))
    middle = np.array([0.0, -0.6, 0.5, 0.2, 0.6, 0.0]) if n == 6 else np.array([0.1, 0.4, 0.1, 0.0])
    return q + middle, dq


def simulate(arm: Arm, q_r: np.ndarray, dq_r: np.ndarray, resolution: float = 2e-6) -> tuple[np.ndarray, np.ndarray]:
    """Encoder readings and held torques (N, n) of the arm under PD control of about 5 Hz, from the reference."""
    own = Pinocchio(arm.robot)
    own.model.armature = arm.inertia
    data, aba = own.data, own.pin.aba
    q, v = q_r[0].copy(), dq_r[0].copy()
    M = own.pin.crba(own.model, data, q)
    mass = np.diag(np.asarray(M)) if np.max(np.diag(np.asarray(M))) > np.max(arm.inertia) else None
    assert mass is not None
    w = 2.0 * np.pi * 5.0
    kp, kd = w**2 * mass, 2.0 * w * mass
    readings, torques = np.zeros_like(q_r), np.zeros_like(q_r)
    before, z, h = q - PERIOD * v, np.zeros(len(q)), PERIOD / STEPS
    for k in range(len(q_r)):
        seen = np.round(q / resolution) * resolution
        speed, before = (seen - before) / PERIOD, seen
        tau = kp * (q_r[k] - seen) + kd * (dq_r[k] - speed)
        readings[k], torques[k] = seen, tau
        for _ in range(STEPS):
            friction, z = arm.friction(v, z, h)
            v = v + h * aba(own.model, data, q, v, tau - friction)
            q = q + h * v
    return readings, torques


def write(
    folder: Path, name: str, arm: Arm, q: np.ndarray, tau: np.ndarray, noise: np.ndarray, gains: np.ndarray, seed: int
) -> Path:
    """Write a recording with its mapping file: motor degrees or millimetres, and currents with ``noise`` (n,) in N m.

    ``gains`` (n,) are true over written torque constant, so that the mapping file is wrong by them.
    """
    rng = np.random.default_rng(seed)
    current = (tau + noise * rng.normal(size=tau.shape)) / gains / (CONSTANT * RATIO)
    joints, columns, header = [], [PERIOD * np.arange(len(q))], ["zeit"]
    for j, (kind, *_) in enumerate(arm.robot.rows):
        turning = kind == "revolute"
        sign = -1 if j % 2 else 1
        zero = 10.0 * (j + 1)
        columns += [sign * RATIO * np.degrees(q[:, j] - np.radians(zero)), sign * current[:, j]]
        position = f"{{column: enc{j}, sign: {sign}}}"
        torque = f"{{column: cur{j}, sign: {sign}, constant: {CONSTANT} N*m/A}}"
        ratio, offset = f"gear_ratio: {RATIO}", f"zero: {zero} deg"
        if not turning:
            columns[-2:] = [sign * 1e3 * q[:, j], sign * current[:, j] * CONSTANT * RATIO]
            position = f"{{column: enc{j}, unit: mm, sign: {sign}}}"
            torque = f"{{column: cur{j}, unit: N, sign: {sign}}}"
            ratio, offset = "gear_ratio: 1", "zero: 0 m"
        header += [f"enc{j}", f"cur{j}"]
        joints.append(f"  - {{name: joint_{j + 1}, {ratio}, {offset}, position: {position}, torque: {torque}}}")
    table, head = folder / f"{name}.csv", ",".join(header)
    np.savetxt(table, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.9g")
    text = f"schema: rrrgen-log/1\nfiles: {name}.csv\ntime: {{column: zeit, unit: s}}\n"
    text += "units: {position: deg, torque: A}\nside: motor\njoints:\n" + "\n".join(joints) + "\n"
    path = folder / f"{name}.yaml"
    path.write_text(text)
    return path
