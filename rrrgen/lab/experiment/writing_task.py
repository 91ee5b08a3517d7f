"""The writing task: letters in a vertical plane with a prescribed tip speed, and the joint motion that draws them.

Every segment starts and ends at rest, because direction or curvature jump between segments. Along it, the tip follows
``s = L (u - sin(2 pi u)/(2 pi))`` with u = t/T, so that speed and acceleration are continuous over the whole task.
Longer segments are faster. Source: (14.32), Fig. 14.3, Fig. 14.6 of D. Kostic, B. de Jager, M. Steinbuch, Modeling and
Identification for Robot Motion Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import DerivationError, InputError

# ------------------------------------------------------------------------------------------------------------------
# Letters as strokes in closed form: lines and circular arcs in a unit box, baseline 0, height 1.
#
# A stroke is drawn without lifting; the tip stays in the plane, so strokes are joined by straight transfers.
# ------------------------------------------------------------------------------------------------------------------

Point = tuple[float, float]
Floats = NDArray[np.floating]


@dataclass(frozen=True)
class Line:
    """A straight piece from ``start`` to ``end``, m."""

    start: Point
    end: Point

    @property
    def length(self) -> float:
        """Arc length, m."""
        return math.dist(self.start, self.end)

    def frame(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Position, unit tangent and curvature vector at the arc lengths ``s`` (m,), each (m, 2)."""
        a, b = np.array(self.start), np.array(self.end)
        tangent = np.broadcast_to((b - a) / self.length, (s.size, 2))
        return a + s[:, None] * tangent, tangent, np.zeros((s.size, 2))

    def place(self, scale: float, shift: Point) -> Line:
        """The piece scaled about the origin, then shifted."""
        return Line(_place(self.start, scale, shift), _place(self.end, scale, shift))


@dataclass(frozen=True)
class Arc:
    """A circular arc about ``centre`` from angle ``begin`` over ``sweep`` (rad, counter-clockwise positive)."""

    centre: Point
    radius: float
    begin: float
    sweep: float

    @property
    def length(self) -> float:
        """Arc length, m."""
        return self.radius * abs(self.sweep)

    @property
    def start(self) -> Point:
        """The first point of the arc in its plane, m."""
        return self._point(self.begin)

    @property
    def end(self) -> Point:
        """The last point of the arc in its plane, m."""
        return self._point(self.begin + self.sweep)

    def _point(self, angle: float) -> Point:
        return (self.centre[0] + self.radius * math.cos(angle), self.centre[1] + self.radius * math.sin(angle))

    def frame(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Position, unit tangent and curvature vector at the arc lengths ``s`` (m,), each (m, 2)."""
        turn = math.copysign(1.0, self.sweep)
        angle = self.begin + turn * s / self.radius
        outward = np.column_stack([np.cos(angle), np.sin(angle)])
        tangent = turn * np.column_stack([-np.sin(angle), np.cos(angle)])
        return np.array(self.centre) + self.radius * outward, tangent, -outward / self.radius

    def place(self, scale: float, shift: Point) -> Arc:
        """The piece scaled about the origin, then shifted."""
        return Arc(_place(self.centre, scale, shift), scale * self.radius, self.begin, self.sweep)


Segment = Line | Arc
Stroke = tuple[Segment, ...]


def _place(point: Point, scale: float, shift: Point) -> Point:
    return (scale * point[0] + shift[0], scale * point[1] + shift[1])


def _lines(*points: Point) -> Stroke:
    return tuple(Line(a, b) for a, b in pairwise(points))


_UP, _DOWN, _LEFT, _RIGHT = math.pi / 2, -math.pi / 2, math.pi, 0.0
_HALF = math.pi


def _bowl(left: float, bottom: float, top: float, right: float) -> Stroke:
    """The bowl of a letter from top left to bottom left: a line, a clockwise half circle, and a line back."""
    r = (top - bottom) / 2.0
    x = right - r
    return (Line((left, top), (x, top)), Arc((x, bottom + r), r, _UP, -_HALF), Line((x, bottom), (left, bottom)))


W = 0.6
"""Width of a letter over its height."""

LETTERS: dict[str, tuple[Stroke, ...]] = {
    "A": (_lines((0, 0), (W / 2, 1), (W, 0)), _lines((0.15, 0.35), (W - 0.15, 0.35))),
    "B": (_lines((0, 0), (0, 1)), _bowl(0, 0.5, 1, 0.55), _bowl(0, 0, 0.5, W)),
    "C": (
        (
            Arc((0.3, 0.7), 0.3, math.radians(30), math.radians(150)),
            Line((0, 0.7), (0, 0.3)),
            Arc((0.3, 0.3), 0.3, _LEFT, math.radians(150)),
        ),
    ),
    "D": (_lines((0, 0), (0, 1)), _bowl(0, 0, 1, W)),
    "E": (_lines((W, 1), (0, 1), (0, 0), (W, 0)), _lines((0, 0.5), (0.45, 0.5))),
    "F": (_lines((W, 1), (0, 1), (0, 0)), _lines((0, 0.5), (0.45, 0.5))),
    "H": (_lines((0, 0), (0, 1)), _lines((0, 0.5), (W, 0.5)), _lines((W, 1), (W, 0))),
    "I": (_lines((W / 2, 1), (W / 2, 0)),),
    "J": ((Line((W, 1), (W, 0.3)), Arc((0.3, 0.3), 0.3, _RIGHT, -_HALF)),),
    "K": (_lines((0, 1), (0, 0)), _lines((W, 1), (0, 0.45), (W, 0))),
    "L": (_lines((0, 1), (0, 0), (W, 0)),),
    "M": (_lines((0, 0), (0, 1), (W / 2, 0.4), (W, 1), (W, 0)),),
    "N": (_lines((0, 0), (0, 1), (W, 0), (W, 1)),),
    "O": (
        (
            Arc((0.3, 0.7), 0.3, _RIGHT, _HALF),
            Line((0, 0.7), (0, 0.3)),
            Arc((0.3, 0.3), 0.3, _LEFT, _HALF),
            Line((W, 0.3), (W, 0.7)),
        ),
    ),
    "P": (_lines((0, 0), (0, 1)), _bowl(0, 0.5, 1, W)),
    "R": (_lines((0, 0), (0, 1)), (*_bowl(0, 0.5, 1, W), Line((0, 0.5), (W, 0)))),
    "S": (
        (Arc((0.3, 0.75), 0.25, math.radians(30), math.radians(240)), Arc((0.3, 0.25), 0.25, _UP, math.radians(-240))),
    ),
    "T": (_lines((0, 1), (W, 1)), _lines((W / 2, 1), (W / 2, 0))),
    "U": ((Line((0, 1), (0, 0.3)), Arc((0.3, 0.3), 0.3, _LEFT, _HALF), Line((W, 0.3), (W, 1))),),
    "V": (_lines((0, 1), (W / 2, 0), (W, 1)),),
    "W": (_lines((0, 1), (0.15, 0), (W / 2, 0.6), (0.45, 0), (W, 1)),),
    "X": (_lines((0, 0), (W, 1)), _lines((0, 1), (W, 0))),
    "Y": (_lines((0, 1), (W / 2, 0.5), (W, 1)), _lines((W / 2, 0.5), (W / 2, 0))),
    "Z": (_lines((0, 1), (W, 1), (0, 0), (W, 0)),),
}
"""The strokes of every letter, in the order they are drawn."""


def text_path(text: str, corner: Point, size: Point, spacing: float = 0.25) -> tuple[tuple[Segment, bool], ...]:
    """The path that writes ``text`` into the box at ``corner`` (lower left, m) of ``size`` (width, height, m).

    Returns segments in order with True for ink, False for a transfer. The text is as large as fits and centred;
    ``spacing`` is the gap between letters over their height. Raises InputError for letters that are not known.
    """
    unknown = sorted({c for c in text if c != " " and c not in LETTERS})
    if unknown or not text.strip():
        known = "".join(sorted(LETTERS))
        raise InputError(f"the writing task knows the letters {known} and the blank, not {unknown or 'an empty text'}")
    advance = W + spacing
    width = len(text) * advance - spacing
    scale = min(size[0] / width, size[1])
    origin = (corner[0] + (size[0] - scale * width) / 2.0, corner[1] + (size[1] - scale) / 2.0)
    path: list[tuple[Segment, bool]] = []
    for k, letter in enumerate(text):
        shift = (origin[0] + scale * k * advance, origin[1])
        for stroke in LETTERS.get(letter, ()):
            placed = [segment.place(scale, shift) for segment in stroke]
            if path and math.dist(path[-1][0].end, placed[0].start) > 1e-9 * scale:
                path.append((Line(path[-1][0].end, placed[0].start), False))
            path += [(segment, True) for segment in placed]
    return tuple(path)


# ------------------------------------------------------------------------------------------------------------------
# The writing task
# ------------------------------------------------------------------------------------------------------------------

Array = NDArray[Any]
InverseKinematics = Callable[[Array], Array]
"""Tip positions (m, 3) along a path to joint positions (m, n) along a path."""


FARTHEST = 1000.0
"""Largest coordinate of the writing window, m: beyond it are mistyped numbers."""


@dataclass(frozen=True)
class WritingPlane:
    """The writing window: ranges of ``x`` and ``z`` in the vertical plane at ``y``, m, base frame.

    Source: Fig. 14.3.
    """

    x: tuple[float, float] = (-0.25, 0.25)
    z: tuple[float, float] = (0.35, 0.85)
    y: float = -0.4

    def __post_init__(self) -> None:
        if self.x[0] >= self.x[1] or self.z[0] >= self.z[1]:
            raise InputError("the writing window needs x[0] < x[1] and z[0] < z[1]")
        if far := [value for value in (*self.x, *self.z, self.y) if not abs(value) <= FARTHEST]:
            raise InputError(f"the writing window reaches {far[0]:g} m from the base; at most {FARTHEST:g} m")


@dataclass(frozen=True)
class WritingTask:
    """Tip motion that writes a text: segments, whether they are ink, and the time each one takes (s)."""

    segments: tuple[Segment, ...]
    ink: tuple[bool, ...]
    durations: tuple[float, ...]
    plane: WritingPlane = field(default_factory=WritingPlane)

    @property
    def duration(self) -> float:
        """Duration of the whole task, s."""
        return math.fsum(self.durations)

    @property
    def peak_speed(self) -> float:
        """The largest tip speed, m/s: ``2 L/T`` of the fastest segment."""
        return max(2.0 * s.length / T for s, T in zip(self.segments, self.durations, strict=True))

    def evaluate(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Tip position, velocity and acceleration at the times ``t`` (m,), each (m, 3), base frame.

        Before the start and after the end the tip rests.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        ends = np.cumsum(self.durations)
        index = np.clip(np.searchsorted(ends, times, side="right"), 0, len(ends) - 1)
        position, velocity, acceleration = (np.zeros((times.size, 3)) for _ in range(3))
        position[:, 1] = self.plane.y
        for k in np.unique(index):
            here = index == k
            T = self.durations[k]
            u = np.clip((times[here] - (ends[k] - T)) / T, 0.0, 1.0)
            parts = _along(self.segments[k], u, T)
            for whole, part in zip((position, velocity, acceleration), parts, strict=True):
                whole[np.ix_(here, [0, 2])] = part
        return position, velocity, acceleration

    def speed(self, t: ArrayLike) -> Array:
        """Tip speed ``v = sqrt(dx^2 + dz^2)``, (m,). Source: (14.32)."""
        return np.asarray(np.linalg.norm(self.evaluate(t)[1], axis=1))


def _along(segment: Segment, u: Array, duration: float) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration in the plane, (m, 2) each, along a segment that takes ``duration`` (s).

    ``u`` (m,) are fractions of the duration.
    """
    L, turn = segment.length, 2.0 * math.pi
    s = L * (u - np.sin(turn * u) / turn)
    v = L / duration * (1.0 - np.cos(turn * u))
    a = turn * L / duration**2 * np.sin(turn * u)
    point, tangent, curvature = segment.frame(s)
    return point, v[:, None] * tangent, a[:, None] * tangent + (v**2)[:, None] * curvature


def writing_task(
    text: str = "RRR",
    *,
    plane: WritingPlane | None = None,
    duration: float = 10.0,
    peak_speed: float = 0.7,
    pace: Sequence[float] = (1.0,),
    margin: float = 0.02,
) -> WritingTask:
    """Write ``text`` into the window in ``duration`` s without exceeding ``peak_speed`` (m/s).

    All segments have the same peak acceleration, times the square of their ``pace``, which is repeated over the drawn
    segments and makes some of them faster. ``plane`` is the window, ``margin`` (m) stays free around the text. Raises
    InputError if the duration is too short for the peak speed, or for letters that are not known.
    """
    window = plane if plane is not None else WritingPlane()
    size = (window.x[1] - window.x[0] - 2.0 * margin, window.z[1] - window.z[0] - 2.0 * margin)
    if margin < 0.0 or min(size) <= 0.0:
        raise InputError(f"a margin of {margin:g} m around the text leaves no room in the writing window")
    path = text_path(text, (window.x[0] + margin, window.z[0] + margin), size)
    segments, ink = tuple(s for s, _ in path), tuple(i for _, i in path)
    if not pace or min(pace) <= 0.0:
        raise InputError("the pace of the strokes must be positive")
    count, shares = 0, []
    for segment, inked in path:
        share = math.sqrt(segment.length) / (pace[count % len(pace)] if inked else 1.0)
        count += inked
        shares.append(share)
    scale = duration / math.fsum(shares)
    task = WritingTask(segments, ink, tuple(scale * share for share in shares), window)
    if task.peak_speed > peak_speed * (1.0 + 1e-12):
        needed = duration * task.peak_speed / peak_speed
        raise InputError(f"'{text}' in {duration:g} s needs {task.peak_speed:.3g} m/s; give it {needed:.3g} s")
    return task


@dataclass(frozen=True, eq=False)
class JointPath:
    """The joint motion of a writing task: the reference of the experiment.

    For the tip velocity v and acceleration a, ``dq = J_v^-1 v`` and ``ddq = J_v^-1 (a - dJ_v/dt dq)``; J_v is the
    Jacobian of the tip position, whose pseudoinverse is used for more than three joints.
    """

    task: WritingTask
    model: Any
    inverse_kinematics: InverseKinematics

    def evaluate(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Joint position, velocity and acceleration at increasing times ``t`` (m,), each (m, n)."""
        position, velocity, acceleration = self.task.evaluate(t)
        q = np.asarray(self.inverse_kinematics(position))
        J = np.asarray(self.model.jacobian(q))[:, :3, :]
        dq = _solve(J, velocity)
        bias = np.asarray(self.model.jacobian_dot_dq(q, dq))[:, :3]
        return q, dq, _solve(J, acceleration - bias)


RANGE_STEP = 1e-2
"""Interval of the times at which a path is compared with position limits, s."""


def excesses_of_range(path: JointPath) -> list[str]:
    """Sentences about the joints that the path moves beyond their position limits; empty if it keeps to all of them.

    The inverse kinematics follows one branch from the start, whatever the limits are.
    """
    t = np.arange(0.0, path.task.duration + RANGE_STEP, RANGE_STEP)
    q = path.inverse_kinematics(path.task.evaluate(t)[0])
    rows = [
        (joint.name, q[:, i], joint.limits, "rad" if joint.is_revolute else "m")
        for i, joint in enumerate(path.model.spec.joints)
    ]
    sentences = []
    for name, positions, limits, unit in rows:
        for side, limit, end in (("lower", limits.lower, positions.min()), ("upper", limits.upper, positions.max())):
            if limit is not None and (end < float(limit) if side == "lower" else end > float(limit)):
                sentences.append(
                    f"the writing task moves joint {name} to {end:.3g} {unit}, beyond its {side} limit of "
                    f"{float(limit):.3g} {unit}"
                )
    return sentences


def _solve(J: Array, rows: Array) -> Array:
    if J.shape[1] == J.shape[2]:
        return np.asarray(np.linalg.solve(J, rows[:, :, None])[:, :, 0])
    return np.asarray((np.linalg.pinv(J) @ rows[:, :, None])[:, :, 0])


def newton_inverse_kinematics(
    model: Any, start: ArrayLike, tolerance: float = 1e-12, iterations: int = 50
) -> InverseKinematics:
    """Inverse kinematics of tip positions by Newton's method, which starts at ``start`` (n,) and follows the path.

    Works for any arm and stays on the branch of ``start``. ``tolerance`` is that of the tip position, m; ``iterations``
    bounds the steps per point. The returned function raises DerivationError, naming the point, if it does not converge
    because the point is out of reach or singular.
    """

    def solve(positions: Array) -> Array:
        q = np.array(start, dtype=float)
        joint_positions = np.zeros((len(positions), q.size))
        for k, target in enumerate(np.asarray(positions, dtype=float)):
            q = _newton(model, q, target, tolerance, iterations)
            joint_positions[k] = q
        return joint_positions

    return solve


def _newton(model: Any, q: Array, target: Array, tolerance: float, iterations: int) -> Array:
    best = math.inf
    for _ in range(iterations):
        error = target - np.asarray(model.forward_kinematics(q))[:3, 3]
        size = float(np.linalg.norm(error))
        if size <= tolerance or (size >= best and best < 1e3 * tolerance):
            return q
        best = min(best, size)
        J = np.asarray(model.jacobian(q))[:3]
        step = np.linalg.lstsq(J, error, rcond=1e-10)[0]
        q = q + step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-300))
    raise DerivationError(
        f"no joint position was found for the tip at {np.round(target, 4).tolist()} m: it came no nearer "
        f"than {best:.3g} m"
    )


def solver_inverse_kinematics(
    solver: Any, start: ArrayLike, revolute: Sequence[bool] | None = None
) -> InverseKinematics:
    """Closed-form inverse kinematics along a path, on the branch whose first solution is nearest to ``start`` (n,).

    ``solver`` is a position solver of :mod:`rrrgen.ik`, with ``solve_batch(positions) -> q, counts``.
    """

    def solve(positions: Array) -> Array:
        batch = solver.solve_batch(positions, limits=False)  # limits hold for the unwrapped path: see excesses_of_range
        valid = np.arange(batch.q.shape[1]) < np.asarray(batch.counts)[:, None]
        if not valid[:, 0].all():
            point = np.round(np.asarray(positions)[int(np.argmin(valid[:, 0]))], 4).tolist()
            raise DerivationError(f"the tip cannot reach {point} m, a point of the path")
        return follow_branch(batch.q, valid, start, revolute)

    return solve


def follow_branch(
    solutions: Array,
    valid: NDArray[np.bool_],
    start: ArrayLike | None = None,
    revolute: Sequence[bool] | None = None,
) -> Array:
    """Choose one continuous joint path (m, n) among all solutions along a path of m points.

    ``solutions`` (m, s, n) and ``valid`` (m, s) are those of closed-form inverse kinematics. At each point the solution
    nearest to the previous one is taken, revolute joints unwrapped; ``start`` (n,) determines the first, by default the
    first valid one. ``revolute`` (n,) gives the joint types, all revolute by default. Raises DerivationError if a point
    has no valid solution.
    """
    paths = np.asarray(solutions, dtype=float)
    reachable = np.asarray(valid).any(axis=1)
    if not reachable.all():
        raise DerivationError(f"point {int(np.argmin(reachable))} of the path is out of reach")
    last = paths[0, int(np.argmax(valid[0]))] if start is None else np.asarray(start, dtype=float)
    branch = np.zeros((paths.shape[0], paths.shape[2]))
    turn = 2.0 * np.pi * np.asarray([True] * paths.shape[2] if revolute is None else revolute)
    for k in range(paths.shape[0]):
        candidates = paths[k][np.asarray(valid[k])]
        candidates = candidates + turn * np.round((last - candidates) / (2.0 * np.pi))
        last = candidates[int(np.argmin(np.linalg.norm(candidates - last, axis=1)))]
        branch[k] = last
    return branch
