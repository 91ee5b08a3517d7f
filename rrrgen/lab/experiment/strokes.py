"""Letters as strokes in closed form: lines and circular arcs in a unit box, baseline 0, height 1.

A stroke is drawn without lifting; the tip stays in the plane, so strokes are joined by straight transfers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import InputError

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

    def placed(self, scale: float, shift: Point) -> Line:
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

    def placed(self, scale: float, shift: Point) -> Arc:
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
            placed = [segment.placed(scale, shift) for segment in stroke]
            if path and math.dist(path[-1][0].end, placed[0].start) > 1e-9 * scale:
                path.append((Line(path[-1][0].end, placed[0].start), False))
            path += [(segment, True) for segment in placed]
    return tuple(path)
