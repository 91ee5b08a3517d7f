"""The data of the interactive view in the report and the playground: geometry, limits, and what moves each tip."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import dist, fsum, hypot, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.base.small_matrices import singular_values
from rrrgen.emit.html.sketch import zero_pose
from rrrgen.ik.geometry.mechanism import solved_chain
from rrrgen.robot.model.mechanism import FollowerLimits, follower_limits, refuse_loops, tip_arm

if TYPE_CHECKING:
    from rrrgen.base.arrays import Array
    from rrrgen.ik.geometry.chain import KinematicChain
    from rrrgen.robot.spec import JointSpec, RobotSpec


# ------------------------------------------------------------------------------------------------------------------
# Motions that the report's interactive view plays, recorded or designed, and figures of run folders.
# ------------------------------------------------------------------------------------------------------------------

SAMPLES = 2000
"""Largest number of samples of a motion on the page, which interpolates between them: about 100 kB for six joints."""

TIME_DIGITS = 5  # decimals of positions (rad, m) and times (s) on the page: 0.01 mm

PIXELS_PER_POINT = 1.45
"""Size of figures on the page: 4/3 is that of print; text of 8 points, the smallest there, has 12 pixels."""

LARGEST_DRAWING = 400_000
"""Size in bytes from which the PNG of a figure is taken instead of its SVG: clouds of points make large drawings."""


@dataclass(frozen=True)
class PlayedMotion:
    """A motion to be played: ``name``, times ``t`` (N,) in s, and joint positions ``q`` (N, n) in rad or m."""

    name: str
    t: Array
    q: Array

    def as_data(self, n: int) -> dict[str, Any]:
        """Convert the motion to data for the page: times from 0 and joint positions, at most ``SAMPLES`` samples.

        Raises InputError if it has no two samples, another number of joints, or times that do not increase.
        """
        import numpy as np

        if self.q.ndim != 2 or self.q.shape[1] != n or len(self.q) != len(self.t):
            raise InputError(f"the motion '{self.name}' is not one of the {n} joints of this robot")
        if len(self.t) < 2 or not np.all(np.diff(self.t) > 0.0) or not np.all(np.isfinite(self.q)):
            raise InputError(f"the motion '{self.name}' needs two finite samples or more, at times that increase")
        kept = np.unique(np.linspace(0, len(self.t) - 1, min(SAMPLES, len(self.t))).round().astype(int))
        t = np.round(self.t[kept] - self.t[0], TIME_DIGITS)
        return {"name": self.name, "t": t.tolist(), "q": np.round(self.q[kept] + 0.0, TIME_DIGITS).tolist()}


@dataclass(frozen=True)
class Illustration:
    """A figure on the page: ``caption``, and the whole image as a ``data:`` address, so that nothing is fetched.

    ``width`` is the width in pixels at which its text has the size of the page's notes; None where it is not known.
    """

    caption: str
    address: str
    width: int | None = None


def illustrations(folder: Path) -> list[Illustration]:
    """The figures of the run folder ``folder`` in the order of their names; raises InputError if it has none."""
    drawings = sorted((folder / "figures").glob("*.svg"))
    if not drawings:
        raise InputError(f"{folder} holds no figures: name the folder that a command wrote with -o")
    return [_illustration(folder, drawing) for drawing in drawings]


def _illustration(folder: Path, drawing: Path) -> Illustration:
    pixels = drawing.with_suffix(".png")
    large = drawing.stat().st_size > LARGEST_DRAWING and pixels.exists()
    kind, file = ("image/png", pixels) if large else ("image/svg+xml", drawing)
    content = base64.b64encode(file.read_bytes()).decode("ascii")
    caption = f"{folder.name}: {drawing.stem.replace('_', ' ')}"
    return Illustration(caption, f"data:{kind};base64,{content}", _width(drawing))


def _width(drawing: Path) -> int | None:
    """Width in pixels at which a figure is shown, from the width in points (1/72 inch) that its SVG states."""
    with drawing.open(encoding="utf-8") as text:
        stated = re.search(r'<svg[^>]*\swidth="([\d.]+)pt"', text.read(4000))
    return round(PIXELS_PER_POINT * float(stated[1])) if stated else None


# ------------------------------------------------------------------------------------------------------------------
# The data of the interactive view in the report
# ------------------------------------------------------------------------------------------------------------------

DIGITS = 9  # decimals of lengths (m) and angles (rad): one nanometre; rounding that differs between machines is smaller
GOLDEN = 0.6180339887498949  # golden ratio: its multiples modulo 1 spread evenly over [0, 1)


def as_json(content: dict[str, Any]) -> str:
    """Print ``content`` as JSON for a ``<script>`` element: no character in it can end the element."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


def scene(spec: RobotSpec) -> dict[str, Any]:
    """The data of the view: geometry at nominal parameters (SI units), joint ranges, tips.

    ``joints`` holds per joint name, type, alpha, a, d, theta, the sign if it is -1, and the ends of its slider: the
    limits of the robot file, else one turn or the reach; ``limited`` says for both ends whether the file states them.
    ``start`` is the configuration to begin with.
    In a mechanism, ``rows`` holds the Denavit-Hartenberg rows instead, each with the number of the row that carries it
    and the factors of q in its displacement. The configurations of a tip pose are found by the page itself.
    """
    refuse_loops(spec, "the drawing")
    base, stages, _ = zero_pose(spec)
    along = stages if spec.mechanism is None else [stages[i] for i in spec.mechanism.path(spec.tip_row)]
    corners = [point for stage in along for point in stage.path]
    reach = fsum(map(dist, corners, corners[1:])) or 1.0
    ends = [_range(joint, reach) for joint in spec.joints]
    table = [
        dict(zip(("alpha", "a", "d", "theta"), (_short(v) for v in row[1:]), strict=True)) for row in spec.dh_table()
    ]
    joints: list[dict[str, Any]] = [
        {
            "name": joint.name,
            "revolute": joint.is_revolute,
            "lower": _short(lower),
            "upper": _short(upper),
            "limited": [joint.limits.lower is not None, joint.limits.upper is not None],
        }
        for joint, (lower, upper) in zip(spec.joints, ends, strict=True)
    ]
    if spec.mechanism is None:
        signs: list[dict[str, Any]] = [{} if joint.sign > 0 else {"sign": joint.sign} for joint in spec.joints]
        joints = [joint | row | sign for joint, row, sign in zip(joints, table, signs, strict=True)]
    return {
        "name": spec.name,
        "convention": spec.convention,
        "base": _rows(base),
        "tool": _rows([[float(spec.nominal(v)) for v in row] for row in spec.tool.matrix().tolist()]),
        "gravity": [_short(float(spec.nominal(v))) for v in spec.gravity],
        "reach": _short(reach),
        "joints": joints,
        "start": _first_pose(spec, ends),
    } | _mechanism(spec, table)


def _mechanism(spec: RobotSpec, table: list[dict[str, float]]) -> dict[str, Any]:
    """Data of a mechanism: its Denavit-Hartenberg rows ``rows`` and the row ``tip_row`` of the tip; empty for a chain.

    Each row has its ``parent``, the number of the row that carries it, and ``factors`` of q in its displacement.
    ``tips`` are the named tips with their rows and tools, if there are any; where a tip has joints of its own, which
    its inverse kinematics moves, ``joints`` are their numbers and ``carrier`` the row that carries them.
    ``followers`` are the limits of rows that follow several joints.
    """
    if spec.mechanism is None:
        return {}
    rows = [
        row | {"revolute": joint.is_revolute, "parent": parent, "factors": [float(f) for f in factors]}
        for row, joint, parent, factors in zip(table, spec.rows, spec.parents, spec.mechanism.matrix, strict=True)
    ]
    for row, (gamma, b) in zip(rows, spec.placements(), strict=True):
        row |= {"gamma": _short(gamma), "b": _short(b)} if gamma or b else {}
    tips = [
        {
            "name": name,
            "row": spec.at_tip(name).tip_row,
            "tool": _rows([[float(spec.nominal(v)) for v in line] for line in tip.tool.matrix().tolist()]),
        }
        | _own_joints(spec, name)
        for name, tip in spec.tips.items()
    ]
    followers = [
        {"name": follower.name, "along": follower.factors, "lower": follower.lower, "upper": follower.upper}
        for follower in follower_limits(spec)
    ]
    extras = {"tips": tips, "followers": followers}
    return {"rows": rows, "tip_row": spec.tip_row} | {name: values for name, values in extras.items() if values}


def _own_joints(spec: RobotSpec, tip: str) -> dict[str, Any]:
    """The ``joints`` that move this tip alone, and the row that is their ``carrier`` (-1: the base); empty for none."""
    try:
        arm = tip_arm(spec, tip)
    except DerivationError:
        return {}
    return {"joints": list(arm.joints), "carrier": arm.carrier}


def _range(joint: JointSpec, reach: float) -> tuple[float, float]:
    """The ends of the slider of a joint, rad or m."""
    most = pi if joint.is_revolute else reach
    lower, upper = joint.limits.lower, joint.limits.upper
    return -most if lower is None else lower, most if upper is None else upper


BENT = 2.0  # rad, the farthest of a revolute joint from the middle of its range in the first pose
TRIED = 64  # configurations from which the first pose is chosen
FLAT = 1e-9  # a singular value of the motion of the position below this is zero: the arm is planar


def _first_pose(spec: RobotSpec, ends: list[tuple[float, float]]) -> list[float]:
    """A configuration near the middle of the limits in which every tip moves freely and nothing is below the base.

    Joints that several named tips share stand in the middle.
    """
    arms = [tip_arm(spec, tip) for tip in spec.tips if _own_joints(spec, tip)]
    if not arms:
        return _least_singular_configuration(spec, ends, [-float(spec.nominal(g)) for g in spec.gravity])
    start = [_short((lower + upper) / 2) for lower, upper in ends]
    for arm in arms:
        for k, x in zip(
            arm.joints, _least_singular_configuration(arm.spec, [ends[k] for k in arm.joints], None), strict=True
        ):
            start[k] = x
    return start


def _least_singular_configuration(
    spec: RobotSpec, ends: list[tuple[float, float]], up: list[float] | None
) -> list[float]:
    """The configuration, of :data:`TRIED`, at which the smallest singular value of the Jacobian is largest.

    Lengths count over the reach. A straight arm, at which dragging the tip would feel stuck, has zero there. Frames
    below the base, against the direction ``up``, are avoided; None for an arm that stands on no floor.
    """
    chain, S = solved_chain(spec)
    factors = [[float(x) for x in S.row(i)] for i in range(S.rows)]
    units = [1.0 if joint.is_revolute else chain.reach for joint in spec.joints]
    middle = [(lower + upper) / 2 for lower, upper in ends]
    span = [
        min(0.4 * (upper - lower), BENT) if joint.is_revolute else 0.3 * (upper - lower)
        for joint, (lower, upper) in zip(spec.joints, ends, strict=True)
    ]
    span[0] = min(span[0], 0.4)  # the first joint turns the picture only
    best: tuple[float, list[float]] = (-1.0, [_short(x) for x in middle])
    for k in range(TRIED):
        parts = [2 * ((GOLDEN ** (i % 7 + 1) * (k + 1) + 0.5 * i) % 1.0) - 1 for i in range(spec.n)]
        q = [_short(m + part * s) for m, part, s in zip(middle, parts, span, strict=True)]
        if not all(_within(follower, q) for follower in follower_limits(spec)):
            continue
        y = [sum(f * x for f, x in zip(row, q, strict=True)) for row in factors]
        motion = [[x / chain.reach for x in column[:3]] + column[3:] for column in chain.tip_motion(y)]
        columns = [
            [unit * sum(row[j] * column[i] for row, column in zip(factors, motion, strict=True)) for i in range(6)]
            for j, unit in enumerate(units)
        ]
        freedom = singular_values([column[:3] for column in columns])[spec.n - 1] if spec.n <= 3 else 0.0
        if freedom < FLAT:  # more joints, or a planar arm, which turns the tip with the last one
            freedom = singular_values(columns)[min(6, spec.n) - 1]
        score = freedom * (0.1 if up is not None and _low(chain, y, up) else 1.0)
        if score > best[0] + 1e-9:  # round-off does not decide
            best = (score, q)
    return best[1]


def _low(chain: KinematicChain, y: list[float], up: list[float]) -> bool:
    """Whether a frame of the chain is below its base."""
    heights = [sum(u * row[3] for u, row in zip(up, frame, strict=True)) for frame in chain.frames(y)]
    return bool(min(heights[1:]) < heights[0] - 0.02 * chain.reach * hypot(*up))


def _within(row: FollowerLimits, q: list[float]) -> bool:
    value = sum(f * x for f, x in zip(row.factors, q, strict=True))
    return (row.lower is None or value >= row.lower) and (row.upper is None or value <= row.upper)


def _rows(matrix: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[_short(float(v)) for v in row] for row in matrix]


def _short(value: float) -> float:
    return round(value, DIGITS) + 0.0
