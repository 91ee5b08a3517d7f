"""Denavit-Hartenberg rows to start a robot file from, chosen such that the Jacobian has full rank."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

WRIST = (-90, 90, 0)
"""Twists (deg) behind the joints of a spherical wrist, whose three axes meet in one point."""

LENGTHS = (0.4, 0.5, 0.4, 0.3, 0.2, 0.1)
"""Lengths (m) of the links from the base on; longer arms repeat the last one."""


@dataclass(frozen=True)
class StartingRow:
    """One row: ``alpha`` and ``theta`` in deg, ``a`` and ``d`` as text, a number or the name of a parameter.

    ``role`` says what the joint does, for a comment.
    """

    alpha: int
    a: str
    d: str
    theta: int
    role: str


@dataclass(frozen=True)
class StartingRows:
    """Rows for a new robot file: one per joint, the parameters that they contain (m), and the tip's offset along x.

    The offset is measured in the frame of the last link.
    """

    rows: tuple[StartingRow, ...]
    parameters: dict[str, float]
    tip: str


def starting_rows(joints: str, convention: str) -> StartingRows:
    """Rows for ``joints``, one letter R or P each, in the "standard" or the "modified" convention.

    Three revolute joints at the end of six or more are a spherical wrist, so that the inverse kinematics has a closed
    form. Twists are chosen such that the Jacobian has the largest rank that these joints allow.
    """
    wrist = len(joints) >= 6 and joints.endswith("RRR")
    possible = min(6, joints.count("R") + min(3, joints.count("P")))
    for twists in _candidates(joints, wrist):
        rows, parameters = _standard_rows(joints, twists, wrist)
        if _rank(joints, rows, parameters) == possible:
            break
    if convention == "standard":
        return StartingRows(rows, parameters, "0")
    before = [StartingRow(0, "0", "0", 0, ""), *rows[:-1]]
    moved = [StartingRow(old.alpha, old.a, row.d, row.theta, row.role) for old, row in zip(before, rows, strict=True)]
    return StartingRows(tuple(moved), parameters, rows[-1].a)


def _candidates(joints: str, wrist: bool) -> Iterator[list[int]]:
    """Lists of twists alpha (deg) to try: the usual ones, then those that differ from them at 1, 2, ... joints."""
    arm = joints[:-3] if wrist else joints
    usual = [90] * len(arm) if wrist else [90] * (len(arm) - 1) + [0]
    if len(arm) <= 5 and arm[1:3] == "RR":
        usual[1] = 0
    end = list(WRIST) if wrist else []
    free = range(len(arm) if wrist else len(arm) - 1)
    for count in range(len(free) + 1):
        for places in combinations(free, count):
            for others in product((0, -90), repeat=count):
                changed = dict(zip(places, others, strict=True))
                yield [changed.get(k, twist) for k, twist in enumerate(usual)] + end


def _standard_rows(joints: str, twists: list[int], wrist: bool) -> tuple[tuple[StartingRow, ...], dict[str, float]]:
    """Make rows in the standard convention with the given ``twists`` (deg): (rows, lengths in m by parameter name)."""
    parameters: dict[str, float] = {}
    rows = []
    for i, (joint, alpha) in enumerate(zip(joints, twists, strict=True)):
        number = i - len(joints) + 4 if wrist else 0  # 1, 2, 3 in the wrist
        along_x = joint == "R" and alpha == 0 and number < 1
        along_z = joint == "R" and not along_x and number != 2 and (i == 0 or number > 0 or twists[i - 1] != 0)
        name = f"{'a' if along_x else 'd'}{i + 1}"
        if along_x or along_z:
            parameters[name] = LENGTHS[min(i, len(LENGTHS) - 1)]
        role = f"wrist, joint {number} of 3: their axes meet in one point" if number > 0 else ""
        rows.append(StartingRow(alpha, name if along_x else "0", name if along_z else "0", 90 * (joint == "P"), role))
    return tuple(rows), parameters


def _rank(joints: str, rows: Sequence[StartingRow], parameters: dict[str, float]) -> int:
    """The rank of the Jacobian of these rows (standard convention) at a configuration without symmetry."""
    import numpy as np

    T, axes, origins = np.eye(4), [], []
    for k, (joint, row) in enumerate(zip(joints, rows, strict=True)):
        axes.append(T[:3, 2])
        origins.append(T[:3, 3])
        q = 0.4 + 0.7 * k
        theta, d = math.radians(row.theta), parameters.get(row.d, 0.0)
        theta, d = (theta + q, d) if joint == "R" else (theta, d + q)
        (c, s), (ca, sa) = ((math.cos(x), math.sin(x)) for x in (theta, math.radians(row.alpha)))
        a = parameters.get(row.a, 0.0)
        T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    columns = [
        np.r_[np.cross(z, T[:3, 3] - o), z] if joint == "R" else np.r_[z, np.zeros(3)]
        for joint, z, o in zip(joints, axes, origins, strict=True)
    ]
    return int(np.linalg.matrix_rank(np.array(columns), tol=1e-6))
