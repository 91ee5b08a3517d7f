"""Random serial chains, by seed and as Hypothesis strategies, and their rrrgen/1 YAML text.

Every number is a short decimal, a rational entry of a rational rotation, or a simple multiple of pi, so the text and
the floats of the Robot hold the same values (pi/2 exactly, where an exact compiler must see a right angle).
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from oracles.newton_euler import Link, Robot

RIGHT_ANGLES = (0.0, np.pi / 2, -np.pi / 2, np.pi)
ODD_ANGLES = (0.7, -1.1, 2.3, np.pi / 6, -np.pi / 4)
LENGTHS = (0.0, 0.25, -0.3, 0.415, 0.08)
GRAVITIES = ((0.0, 0.0, -9.81), (0.0, 0.0, 0.0), (0.0, -9.81, 0.0), (3.1, -2.7, -8.9), (9.81, 0.0, 0.0))
QUATERNIONS = ((1, 0, 0, 0), (1, 1, 0, 0), (1, 2, 2, 0), (2, -1, 1, 3), (0, 1, 1, 0), (1, 1, -1, 1))
TRANSLATIONS = ((0.0, 0.0, 0.0), (0.1, -0.2, 0.35), (0.0, 0.0, 0.125))
MAX_JOINTS = 8


def random_link(rng: np.random.Generator) -> Link:
    """The inertia of a cloud of point masses, rounded to short decimals.

    The cloud spreads by centimetres in every direction, far more than the rounding, so the pseudo-inertia stays > 0.
    """
    masses = rng.uniform(0.1, 1.0, 8)
    points = rng.normal(0.0, 0.12, (8, 3)) + rng.normal(0.0, 0.15, 3)
    m = round(float(masses.sum()), 3)
    com = np.round(masses @ points / masses.sum(), 4)
    arms = points - masses @ points / masses.sum()
    tensor = sum(w * (r @ r * np.eye(3) - np.outer(r, r)) for w, r in zip(masses, arms, strict=True))
    return Link(m, com, np.round(tensor + 2e-3 * np.eye(3), 6))


def arbitrary_link(rng: np.random.Generator) -> Link:
    """Non-zero numbers without physical sense, as the chapter uses them for its check (14.6.3)."""
    tensor = np.round(rng.uniform(-1, 1, (3, 3)), 3)
    return Link(round(float(rng.uniform(0.5, 3)), 3), np.round(rng.uniform(-0.5, 0.5, 3), 3), (tensor + tensor.T) / 2)


def transform(quaternion: tuple[int, int, int, int], translation: tuple[float, float, float]) -> np.ndarray:
    """The rational rotation of an integer quaternion (w, x, y, z), with a translation."""
    w, x, y, z = quaternion
    norm = w * w + x * x + y * y + z * z
    T = np.eye(4)
    T[:3, :3] = [
        [(norm - 2 * (y * y + z * z)) / norm, 2 * (x * y - w * z) / norm, 2 * (x * z + w * y) / norm],
        [2 * (x * y + w * z) / norm, (norm - 2 * (x * x + z * z)) / norm, 2 * (y * z - w * x) / norm],
        [2 * (x * z - w * y) / norm, 2 * (y * z + w * x) / norm, (norm - 2 * (x * x + y * y)) / norm],
    ]
    T[:3, 3] = translation
    return T


def random_robot(
    seed: int,
    n: int | None = None,
    *,
    convention: str | None = None,
    prismatic: float = 0.25,
    right_angles: float = 0.6,
    links: str = "physical",
    frames: bool = True,
    max_joints: int = 7,
) -> Robot:
    """The robot of a seed. ``prismatic`` and ``right_angles`` are probabilities; links: physical, arbitrary or none.

    ``frames=False`` leaves base and tool at the identity.
    """
    rng = np.random.default_rng(seed)

    def pick(options):
        return options[int(rng.integers(len(options)))]

    count = int(rng.integers(1, max_joints + 1)) if n is None else n
    rows = []
    for _ in range(count):
        kind = "prismatic" if rng.random() < prismatic else "revolute"
        alpha = pick(RIGHT_ANGLES) if rng.random() < right_angles else pick(ODD_ANGLES)
        offset = 0.0 if rng.random() < 0.6 else pick(RIGHT_ANGLES + ODD_ANGLES)
        rows.append((kind, alpha, pick(LENGTHS), pick(LENGTHS), offset))
    draw_link = {"physical": random_link, "arbitrary": arbitrary_link}.get(links)
    return Robot(
        convention or pick(("standard", "modified")),
        tuple(rows),
        np.array(pick(GRAVITIES)),
        transform(pick(QUATERNIONS), pick(TRANSLATIONS)) if frames else np.eye(4),
        transform(pick(QUATERNIONS), pick(TRANSLATIONS)) if frames else np.eye(4),
        tuple(draw_link(rng) for _ in range(count)) if draw_link else (),
        f"random{seed}",
    )


def random_state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, dq, ddq of ordinary size: angles over the whole turn, speeds and accelerations of a few units."""
    return rng.uniform(-np.pi, np.pi, robot.n), rng.uniform(-3, 3, robot.n), rng.uniform(-10, 10, robot.n)


@st.composite
def robots(
    draw,
    *,
    min_joints: int = 1,
    max_joints: int = 7,
    conventions: tuple[str, ...] = ("standard", "modified"),
    types: tuple[str, ...] = ("revolute", "prismatic"),
    angles: tuple[float, ...] = RIGHT_ANGLES + ODD_ANGLES,
    lengths: tuple[float, ...] = LENGTHS,
    gravities: tuple[tuple[float, float, float], ...] = GRAVITIES,
    frames: bool = True,
    links: str = "physical",
    signs: tuple[int, ...] = (1, 1, -1),
) -> Robot:
    """Hypothesis strategy of robots; shrinks towards few joints, zero angles and lengths."""
    n = draw(st.integers(min_joints, max_joints))
    row = st.tuples(*map(st.sampled_from, (types, angles, lengths, lengths, angles)))
    rows = draw(st.lists(row, min_size=n, max_size=n))
    base, tool = np.eye(4), np.eye(4)
    if frames:
        base, tool = (
            transform(draw(st.sampled_from(QUATERNIONS)), draw(st.sampled_from(TRANSLATIONS))) for _ in range(2)
        )
    seed = draw(st.integers(0, 2**16))
    rng = np.random.default_rng(seed)
    draw_link = {"physical": random_link, "arbitrary": arbitrary_link}.get(links)
    bodies = tuple(draw_link(rng) for _ in range(n)) if draw_link else ()
    convention = draw(st.sampled_from(conventions))
    gravity = np.array(draw(st.sampled_from(gravities)))
    turned = tuple(draw(st.lists(st.sampled_from(signs), min_size=n, max_size=n)))
    return Robot(convention, tuple(rows), gravity, base, tool, bodies, "random_robot", turned)


@st.composite
def robots_with_states(draw, **options) -> tuple[Robot, np.ndarray, np.ndarray, np.ndarray]:
    """A robot with one state (q, dq, ddq)."""
    robot = draw(robots(**options))
    return robot, *random_state(robot, np.random.default_rng(draw(st.integers(0, 2**16))))


def number_text(value: float, angle: bool = False) -> str:
    """The value as a YAML scalar that an exact reader turns into the same float."""
    value = float(value)
    if angle and value != 0.0:
        turns = Fraction(value / np.pi).limit_denominator(12)
        if float(turns.numerator * np.pi / turns.denominator) == value:
            p, q = turns.numerator, turns.denominator
            return ("-" if p < 0 else "") + ("pi" if abs(p) == 1 else f"{abs(p)}*pi") + ("" if q == 1 else f"/{q}")
    short = repr(value)
    ratio = Fraction(value).limit_denominator(1000)
    if len(short) > 12 and ratio.numerator / ratio.denominator == value:
        return f"{ratio.numerator}/{ratio.denominator}"
    return short


def _vector(values) -> str:
    return "[" + ", ".join(number_text(v) for v in values) + "]"


def _transform_text(key: str, T: np.ndarray) -> list[str]:
    if np.array_equal(T, np.eye(4)):
        return []
    rotation = ", ".join(_vector(row) for row in T[:3, :3])
    return [f"{key}: {{translation: {_vector(T[:3, 3])}, rotation: [{rotation}]}}"]


def to_yaml(robot: Robot, name: str | None = None) -> str:
    """The rrrgen/1 file of the robot."""
    lines = ["schema: rrrgen/1", f"name: {name or robot.name}", f"convention: {robot.convention}"]
    lines += ["units: {angle: rad, length: m}", f"gravity: {_vector(robot.gravity)}"]
    lines += [*_transform_text("base", robot.base), "joints:"]
    for (kind, alpha, a, d, theta), sign in zip(robot.rows, robot.signs or [1] * robot.n, strict=True):
        angles = f"alpha: {number_text(alpha, True)}, theta: {number_text(theta, True)}"
        turned = ", sign: -1" if sign < 0 else ""
        lines.append(f"  - {{type: {kind}, {angles}, a: {number_text(a)}, d: {number_text(d)}{turned}}}")
    if robot.links:
        lines.append("links:")
    for link in robot.links:
        S = link.inertia
        entries = zip(("xx", "yy", "zz", "xy", "xz", "yz"), (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2), strict=True)
        inertia = ", ".join(f"{key}: {number_text(S[row, column])}" for key, row, column in entries)
        lines.append(
            f"  - {{mass: {number_text(link.mass)}, com: {_vector(link.com)}, inertia: {{about: com, {inertia}}}}}"
        )
    return "\n".join(lines + _transform_text("tool", robot.tool)) + "\n"
