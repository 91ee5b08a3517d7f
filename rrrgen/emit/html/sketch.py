"""A drawing of the frames in the zero pose, as SVG in orthographic projection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import cos, dist, hypot, radians, sin

import sympy as sp

from rrrgen.robot.model.canonical_frames import dh_rows
from rrrgen.robot.model.drives import weighted_sum
from rrrgen.robot.spec import FixedTransform, RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# The frames of a robot in its zero pose, computed from the numbers of its Denavit-Hartenberg table.
# ------------------------------------------------------------------------------------------------------------------

Point = tuple[float, float, float]
Transform = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True)
class SketchFrame:
    """Frame i in the zero pose, the joint that moves it, and the path along the link to its origin.

    ``axis`` is a point on the joint axis and its direction; ``path`` the corner points of the DH displacements from the
    frame before.
    """

    frame: Transform
    revolute: bool
    axis: tuple[Point, Point]
    path: tuple[Point, ...]


def zero_pose(spec: RobotSpec) -> tuple[Transform, list[SketchFrame], Transform]:
    """Compute the zero pose (q = 0, nominal parameters): base frame, one :class:`SketchFrame` per DH row, tip frame.

    All are given in the base frame of the robot file.
    """
    base = _numbers(spec, spec.base)
    stages: list[SketchFrame] = []
    for row, parent in zip(dh_rows(spec, nominal=True), spec.parents, strict=True):
        T = base if parent < 0 else stages[parent].frame
        placed = _times(_rotation_z(float(row.gamma)), _shift(0.0, 0.0, float(row.b)))
        turn, slide = _rotation_z(float(row.theta)), _shift(0.0, 0.0, float(row.d))
        (reach, lean), (far, twist) = (
            (_shift(float(t.a), 0.0, 0.0), _rotation_x(float(t.alpha))) for t in (row.before, row.behind)
        )
        start = _times(_times(_times(T, placed), lean), reach)
        steps = (placed, lean, reach, turn, slide, far, twist)
        corners = [origin(T)]
        for step in steps:
            T = _times(T, step)
            corners.append(origin(T))
        path = tuple(p for k, p in enumerate(corners) if k == 0 or p != corners[k - 1])
        stages.append(SketchFrame(T, row.revolute, (origin(start), column(start, 2)), path))
    return base, stages, _times(stages[spec.tip_row].frame, _numbers(spec, spec.tool))


def variables(spec: RobotSpec) -> list[str]:
    """Text for the displacement of every DH row: ``q1``, ``−q1`` for a sign of -1, in a mechanism also ``q2 − q3``."""
    names = [f"q{k}" for k in range(1, spec.n + 1)]
    if spec.mechanism is None:
        return [f"−{name}" if joint.sign < 0 else name for name, joint in zip(names, spec.joints, strict=True)]
    return [weighted_sum(names, list(map(str, row))).replace("-", "−") for row in spec.mechanism.matrix]


def origin(T: Transform) -> Point:
    """The origin (3,) of a frame, m."""
    return T[0][3], T[1][3], T[2][3]


def column(T: Transform, k: int) -> Point:
    """The unit vector (3,) of axis k of a frame."""
    return T[0][k], T[1][k], T[2][k]


def _numbers(spec: RobotSpec, fixed: FixedTransform) -> Transform:
    rotation = [_value(spec, v) for v in fixed.rotation]
    shift = [_value(spec, v) for v in fixed.translation]
    rows = tuple((rotation[3 * r], rotation[3 * r + 1], rotation[3 * r + 2], shift[r]) for r in range(3))
    return (*rows, (0.0, 0.0, 0.0, 1.0))


def _value(spec: RobotSpec, expression: sp.Expr) -> float:
    return float(spec.nominal(expression))


def _rotation_z(angle: float) -> Transform:
    c, s = cos(angle), sin(angle)
    return ((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _rotation_x(angle: float) -> Transform:
    c, s = cos(angle), sin(angle)
    return ((1.0, 0.0, 0.0, 0.0), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0))


def _shift(x: float, y: float, z: float) -> Transform:
    return ((1.0, 0.0, 0.0, x), (0.0, 1.0, 0.0, y), (0.0, 0.0, 1.0, z), (0.0, 0.0, 0.0, 1.0))


def _times(A: Transform, B: Transform) -> Transform:
    return tuple(
        (
            sum(A[r][k] * B[k][0] for k in range(4)),
            sum(A[r][k] * B[k][1] for k in range(4)),
            sum(A[r][k] * B[k][2] for k in range(4)),
            sum(A[r][k] * B[k][3] for k in range(4)),
        )
        for r in range(4)
    )


# ------------------------------------------------------------------------------------------------------------------
# A drawing of the frames in the zero pose, as SVG in orthographic projection
# ------------------------------------------------------------------------------------------------------------------

WIDTH, HEIGHT, MARGIN = 640, 480, 70
AZIMUTH, ELEVATION = radians(-52.0), radians(22.0)  # direction of view; no axis of usual DH frames is parallel to it
_AXIS_CLASSES = ("x", "y", "z")
_TRIAD = 34.0  # length of the axes of a frame, px
_REACH = 58.0  # length of the positive side of a joint axis, px
_LABEL = 21.0  # labels closer than this, px, are written as one: the height of a line on a phone
_LETTER = 11.0  # width of a character there, px
_COINCIDENT = 1e-9  # m


@dataclass(frozen=True)
class View:
    """An orthographic projection: its ``scale`` (px per m) and the projected point ``middle`` that is in the centre."""

    scale: float
    middle: tuple[float, float]

    def at(self, p: Point) -> tuple[float, float]:
        """Screen position of a point, px, y down."""
        u, v = _flat(p)
        return WIDTH / 2 + self.scale * (u - self.middle[0]), HEIGHT / 2 - self.scale * (v - self.middle[1])


def _flat(p: Point) -> tuple[float, float]:
    """Coordinates of a point in the viewing plane, m."""
    x, y, z = p
    right = -sin(AZIMUTH) * x + cos(AZIMUTH) * y
    depth = cos(AZIMUTH) * x + sin(AZIMUTH) * y
    return right, cos(ELEVATION) * z - sin(ELEVATION) * depth


def frame_sketch(spec: RobotSpec) -> str:
    """An ``<svg>`` element with the base, every link frame, every joint axis and the tip at q = 0."""
    base, stages, tip = zero_pose(spec)
    points = [origin(base), origin(tip), *(p for stage in stages for p in (*stage.path, stage.axis[0]))]
    view = _view(points)
    parts = [_ground(view, origin(base))]
    parts += [_axis(view, stage) for stage in stages]
    parts += [_polyline(view, stage.path, "link") for stage in stages]
    parts.append(_polyline(view, (origin(stages[spec.tip_row].frame), origin(tip)), "tool"))
    parts += [_joint(view, stage) for stage in stages]
    frames = [("0", base), *((str(k), s.frame) for k, s in enumerate(stages, start=1))]
    if dist(origin(tip), origin(stages[spec.tip_row].frame)) > _COINCIDENT:
        frames.append(("tip", tip))
    parts += [_triad(view, frame) for _, frame in frames]
    parts += _apart([*_frame_labels(view, frames), *_variable_labels(view, stages, variables(spec))])
    parts += _gravity(spec)
    title = escape(f"Frames of {spec.name} in the zero pose")
    body = "\n".join(part for part in parts if part)
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{title}">\n<title>{title}</title>\n{body}\n</svg>'
    )


def _view(points: Sequence[Point]) -> View:
    flat = [_flat(p) for p in points]
    low = [min(f[k] for f in flat) for k in range(2)]
    high = [max(f[k] for f in flat) for k in range(2)]
    spans = [(WIDTH - 2 * MARGIN) / max(high[0] - low[0], 1e-6), (HEIGHT - 2 * MARGIN) / max(high[1] - low[1], 1e-6)]
    scale = min(spans) if max(high[0] - low[0], high[1] - low[1]) > _COINCIDENT else 1.0
    return View(scale, ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2))


def _px(value: float) -> str:
    text = f"{value:.1f}"
    return "0.0" if text == "-0.0" else text


def _line(start: tuple[float, float], end: tuple[float, float], kind: str) -> str:
    (x1, y1), (x2, y2) = start, end
    return f'<line class="{kind}" x1="{_px(x1)}" y1="{_px(y1)}" x2="{_px(x2)}" y2="{_px(y2)}"/>'


def _text(place: tuple[float, float], text: str, kind: str) -> str:
    where = f'x="{_px(place[0])}" y="{_px(place[1])}"'
    halo = f'<text class="{kind} halo" {where} aria-hidden="true">{escape(text)}</text>'  # keeps lines off the letters
    return f'{halo}<text class="{kind}" {where}>{escape(text)}</text>'


def _polyline(view: View, path: Sequence[Point], kind: str) -> str:
    corners = " ".join(f"{_px(x)},{_px(y)}" for x, y in map(view.at, path))
    return f'<polyline class="{kind}" points="{corners}"/>' if len(path) > 1 else ""


def _screen(direction: Point) -> tuple[float, float]:
    """The projection of a unit vector to the screen, without scale."""
    u, v = _flat(direction)
    return u, -v


def _ground(view: View, place: Point) -> str:
    x, y = view.at(place)
    hatches = [_line((x - 24 + 8 * k, y + 6), (x - 30 + 8 * k, y + 13), "ground") for k in range(7)]
    return "\n".join([_line((x - 28, y + 6), (x + 28, y + 6), "ground"), *hatches])


def _axis(view: View, stage: SketchFrame) -> str:
    """The joint axis as a dash-dotted line, longer on its positive side."""
    x, y = view.at(stage.axis[0])
    dx, dy = _screen(stage.axis[1])
    return _line((x - 26 * dx, y - 26 * dy), (x + _REACH * dx, y + _REACH * dy), "axis")


def _joint(view: View, stage: SketchFrame) -> str:
    x, y = view.at(stage.axis[0])
    if stage.revolute:
        return f'<circle class="joint" cx="{_px(x)}" cy="{_px(y)}" r="6"/>'
    return f'<rect class="joint" x="{_px(x - 6)}" y="{_px(y - 6)}" width="12" height="12"/>'


def _triad(view: View, frame: Transform) -> str:
    x, y = view.at(origin(frame))
    lines = []
    for k, kind in enumerate(_AXIS_CLASSES):
        dx, dy = _screen(column(frame, k))
        lines.append(_line((x, y), (x + _TRIAD * dx, y + _TRIAD * dy), kind))
    return "\n".join(lines)


Label = tuple[str, tuple[float, float], str]
"""A label of the drawing: its text, the position (px) of the middle of its base line, and its CSS class."""


def _frame_labels(view: View, frames: Sequence[tuple[str, Transform]]) -> list[Label]:
    """Make the labels with the numbers of the frames, below their origins."""
    places = [(name, view.at(origin(frame))) for name, frame in frames]
    return [(names, (x - 9, y + 20), "frame") for names, (x, y) in _merge_labels(places)]


def _variable_labels(view: View, stages: Sequence[SketchFrame], names: Sequence[str]) -> list[Label]:
    """Make the labels with the joint variables, beside the positive ends of the joint axes."""
    places = []
    for name, stage in zip(names, stages, strict=True):
        x, y = view.at(stage.axis[0])
        dx, dy = _screen(stage.axis[1])
        places.append((name, (x + _REACH * dx - 15 * dy, y + _REACH * dy + 15 * abs(dx) + 4)))
    return [(names, place, "variable") for names, place in _merge_labels(places)]


def _apart(labels: Sequence[Label]) -> list[str]:
    """Print the labels as SVG without overlap: one that would cover another is moved below it."""
    boxes: list[tuple[float, float, float]] = []  # middle, half width
    texts = []
    for name, (x, y), kind in labels:
        half = _LETTER / 2 * len(name)
        while any(abs(x - u) < half + w and abs(y - v) < _LABEL for u, v, w in boxes):
            y += 1.0
        boxes.append((x, y, half))
        texts.append(_text((x, y), name, kind))
    return texts


def _merge_labels(places: Sequence[tuple[str, tuple[float, float]]]) -> list[tuple[str, tuple[float, float]]]:
    """Merge labels at the same place (closer than ``_LABEL`` px) into one."""
    groups: list[tuple[list[str], tuple[float, float]]] = []
    for name, place in places:
        for names, taken in groups:
            if hypot(place[0] - taken[0], place[1] - taken[1]) < _LABEL:
                names.append(name)
                break
        else:
            groups.append(([name], place))
    return [(", ".join(names), place) for names, place in groups]


def _gravity(spec: RobotSpec) -> list[str]:
    """An arrow in the corner for the direction of gravity."""
    g = tuple(float(spec.nominal(component)) for component in spec.gravity)
    size = hypot(*g)
    start = (WIDTH - 46.0, 30.0)
    if size == 0.0:
        return [_text((start[0] - 50, start[1]), "no gravity", "gravity")]
    dx, dy = _screen((g[0] / size, g[1] / size, g[2] / size))
    end = (start[0] + 42 * dx, start[1] + 42 * dy)
    length = max(hypot(dx, dy), 1e-9)
    ux, uy = dx / length, dy / length
    wings = [(end[0] - 9 * ux + w * 4 * uy, end[1] - 9 * uy - w * 4 * ux) for w in (1, -1)]
    head = " ".join(f"{_px(x)},{_px(y)}" for x, y in (end, *wings))
    arrow = [_line(start, end, "gravity"), f'<polygon class="gravity" points="{head}"/>']
    return [*arrow, _text((start[0] - 12 * ux, start[1] - 12 * uy + 4), "g", "gravity")]
