"""Structures whose number of rigid-body base parameters is known, typed here independently of the bundled robots.

The counts are those of the table in the identification literature (Gautier & Khalil 1990, Mayeda et al. 1990), each
confirmed by singular values; links carry no numbers because the count does not depend on them.
"""

from __future__ import annotations

import numpy as np

from oracles.newton_euler import Robot

H = np.pi / 2
UP, NONE, SIDEWAYS = (0.0, 0.0, -9.81), (0.0, 0.0, 0.0), (0.0, -9.81, 0.0)


def _robot(name: str, rows: list[tuple], gravity=UP, convention: str = "standard") -> Robot:
    """Rows are (kind letter, alpha, a, d) or with theta as a fifth entry."""
    kinds = {"r": "revolute", "p": "prismatic"}
    full = tuple((kinds[row[0]], *map(float, row[1:4]), float(row[4]) if len(row) > 4 else 0.0) for row in rows)
    return Robot(convention, full, np.array(gravity), name=name)


RRR = [("r", H, 0, 0.56), ("r", 0, 0.2, 0.169), ("r", 0, 0.415, 0.09)]
PUMA = [
    ("r", H, 0, 0), ("r", 0, 0.4318, 0), ("r", -H, 0.0203, 0.15005),
    ("r", H, 0, 0.4318), ("r", -H, 0, 0), ("r", 0, 0, 0),
]  # fmt: skip
UR10 = [
    ("r", H, 0, 0.1273), ("r", 0, -0.612, 0), ("r", 0, -0.5723, 0),
    ("r", H, 0, 0.163941), ("r", -H, 0, 0.1157), ("r", 0, 0, 0.0922),
]  # fmt: skip
GENERIC_6R = [
    ("r", 0.7, 0.1, 0.3), ("r", -1.1, 0.4, 0.2), ("r", 0.9, 0.3, -0.1),
    ("r", -0.6, 0.2, 0.25), ("r", 1.3, 0.15, 0.1), ("r", 0.4, 0.1, 0.2),
]  # fmt: skip
STANFORD = [
    ("r", -H, 0, 0.412), ("r", H, 0, 0.154), ("p", 0, 0, 0, -H),
    ("r", -H, 0, 0), ("r", H, 0, 0), ("r", 0, 0, 0.263),
]  # fmt: skip
PANDA = [
    ("r", 0, 0, 0.333), ("r", -H, 0, 0), ("r", H, 0, 0.316), ("r", H, 0.0825, 0),
    ("r", -H, -0.0825, 0.384), ("r", H, 0, 0), ("r", H, 0.088, 0),
]  # fmt: skip
IIWA = [
    ("r", -H, 0, 0.34), ("r", H, 0, 0), ("r", H, 0, 0.4), ("r", -H, 0, 0),
    ("r", -H, 0, 0.4), ("r", H, 0, 0), ("r", 0, 0, 0.126),
]  # fmt: skip
PLANAR = [("r", 0, 0.4, 0), ("r", 0, 0.3, 0), ("r", 0, 0.2, 0)]
SCARA = [("r", 0, 0.4, 0.3), ("r", np.pi, 0.3, 0), ("p", 0, 0, 0), ("r", 0, 0, 0)]
CARTESIAN = [("p", -H, 0, 0, -H), ("p", -H, 0, 0, -H), ("p", 0, 0, 0)]
CYLINDRICAL = [("r", 0, 0, 0), ("p", -H, 0, 0), ("p", 0, 0, 0)]

#: name -> (robot, number of rigid-body base parameters)
BASE_PARAMETER_COUNTS: dict[str, tuple[Robot, int]] = {
    robot.name: (robot, count)
    for robot, count in (
        (_robot("pendulum", PLANAR[:1], SIDEWAYS), 3),
        (_robot("planar2_vertical", PLANAR[:2], SIDEWAYS), 6),
        (_robot("planar2_horizontal", PLANAR[:2]), 4),
        (_robot("planar3_vertical", PLANAR, SIDEWAYS), 9),
        (_robot("rrr", RRR), 15),
        (_robot("rrr_no_gravity", RRR, NONE), 13),
        (_robot("rrr_base_horizontal", RRR, SIDEWAYS), 17),
        (_robot("puma560", PUMA), 36),
        (_robot("ur10", UR10), 36),
        (_robot("generic6r", GENERIC_6R), 36),
        (_robot("stanford", STANFORD), 33),
        (_robot("stanford_arm_only", STANFORD[:3]), 12),
        (_robot("scara_rrpr", SCARA), 8),
        (_robot("cartesian", CARTESIAN), 3),
        (_robot("cylindrical_rpp", CYLINDRICAL), 5),
        (_robot("panda", PANDA, convention="modified"), 43),
        (_robot("iiwa", IIWA), 43),
    )
}
