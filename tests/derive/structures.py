"""Robots of the published table of base parameter counts, and robot files with named lengths."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from oracles.known_robots import (
    BASE_PARAMETER_COUNTS,
    CARTESIAN,
    CYLINDRICAL,
    GENERIC_6R,
    IIWA,
    NONE,
    PANDA,
    PLANAR,
    PUMA,
    RRR,
    SCARA,
    SIDEWAYS,
    STANFORD,
    UP,
    UR10,
    H,
)
from oracles.newton_euler import Robot
from oracles.random_robots import to_yaml

__all__ = ["BASE_PARAMETER_COUNTS", "TABLE", "with_columns", "with_named_lengths"]

RX90 = [
    ("r", 0, 0, 0), ("r", H, 0, 0), ("r", 0, 0.45, 0),
    ("r", -H, 0, 0.45), ("r", H, 0, 0), ("r", -H, 0, 0),
]  # fmt: skip
TX40 = [
    ("r", 0, 0, 0.32), ("r", -H, 0, 0), ("r", 0, 0.225, 0.035),
    ("r", H, 0, 0.225), ("r", -H, 0, 0), ("r", H, 0, 0, np.pi),
]  # fmt: skip
RRRP = [("r", 0, 0.4, 0.3), ("r", 0, 0.3, 0), ("r", np.pi, 0, 0), ("p", 0, 0, 0)]
LWR = [
    ("r", H, 0, 0.31), ("r", -H, 0, 0), ("r", -H, 0, 0.4), ("r", H, 0, 0),
    ("r", H, 0, 0.39), ("r", -H, 0, 0), ("r", 0, 0, 0.078),
]  # fmt: skip
WAM7 = [
    ("r", -H, 0, 0), ("r", H, 0, 0), ("r", -H, 0.045, 0.55), ("r", H, -0.045, 0),
    ("r", -H, 0, 0.3), ("r", H, 0, 0), ("r", 0, 0, 0.06),
]  # fmt: skip
GEN3 = [
    ("r", H, 0, -0.2848), ("r", H, 0, -0.0118, np.pi), ("r", H, 0, -0.4208, np.pi), ("r", H, 0, -0.0128, np.pi),
    ("r", H, 0, -0.3143, np.pi), ("r", H, 0, 0, np.pi), ("r", np.pi, 0, -0.1674, np.pi),
]  # fmt: skip


def _structure(name: str, rows: list[tuple], gravity=UP, convention: str = "standard") -> Robot:
    kinds = {"r": "revolute", "p": "prismatic"}
    full = tuple((kinds[row[0]], *map(float, row[1:4]), float(row[4]) if len(row) > 4 else 0.0) for row in rows)
    return Robot(convention, full, np.array(gravity), name=name)


#: Robot and its ranks: rigid body, with drive inertia, with viscous and Coulomb friction too, with offsets too.
TABLE: list[tuple[Robot, tuple[int, int, int, int]]] = [
    (_structure("planar2r_vertical", PLANAR[:2], SIDEWAYS), (6, 7, 11, 13)),
    (_structure("planar2r_horizontal", PLANAR[:2]), (4, 5, 9, 11)),
    (_structure("planar3r_vertical", PLANAR, SIDEWAYS), (9, 11, 17, 20)),
    (_structure("rrr", RRR), (15, 16, 22, 25)),
    (_structure("rrr_without_gravity", RRR, NONE), (13, 14, 20, 23)),
    (_structure("rrr_base_horizontal", RRR, SIDEWAYS), (17, 18, 24, 27)),
    (_structure("puma560", PUMA), (36, 40, 52, 58)),
    (_structure("rx90", RX90, convention="modified"), (36, 40, 52, 58)),
    (_structure("tx40", TX40, convention="modified"), (36, 40, 52, 58)),
    (_structure("ur10", UR10), (36, 40, 52, 58)),
    (_structure("generic6r", GENERIC_6R), (36, 41, 53, 59)),
    (_structure("stanford", STANFORD), (33, 37, 49, 55)),
    (_structure("stanford_arm", STANFORD[:3]), (12, 13, 19, 22)),
    (_structure("scara_rrpr", SCARA), (8, 11, 19, 22)),
    (_structure("scara_rrrp", RRRP), (8, 11, 19, 22)),
    # The table's row for PPP is that of the twists (-pi/2, -pi/2, 0) alone, whose third axis is opposite to the first;
    # of three perpendicular axes one is vertical, so that gravity sets just one drive inertia apart from the masses.
    (_structure("ppp_of_the_table", [("p", -H, 0, 0), ("p", -H, 0, 0), ("p", 0, 0, 0)]), (3, 5, 11, 13)),
    (_structure("cartesian_ppp", CARTESIAN), (3, 4, 10, 12)),
    (_structure("cylindrical_rpp", CYLINDRICAL), (5, 7, 13, 15)),
    (_structure("panda", PANDA, convention="modified"), (43, 48, 62, 69)),
    (_structure("lwr", LWR), (43, 48, 62, 69)),
    (_structure("iiwa", IIWA), (43, 48, 62, 69)),
    (_structure("wam7", WAM7), (43, 48, 62, 69)),
    (_structure("gen3", GEN3), (43, 48, 62, 69)),
]

_ROW = re.compile(r"^(  - \{type: \w+, .*)\}$", re.MULTILINE)


def with_columns(text: str, drive: bool = True, friction: bool = True, offset: bool = True) -> str:
    """A robot file that asks for the columns of every joint: a field that is given, 0 included, adds its column."""
    fields = ["drive: {inertia: 0}"] if drive else []
    terms = ["viscous: 0", "coulomb: 0"] if friction else []
    terms += ["offset: 0"] if offset else []
    fields += ["friction: {" + ", ".join(terms) + "}"] if terms else []
    return _ROW.sub(lambda row: ", ".join([row[1], *fields]) + "}", text)


def with_named_lengths(robot: Robot) -> tuple[Robot, str]:
    """The robot with every length that is not zero different from all others, and its file with those lengths named.

    Equal lengths could cancel by accident where lengths in general do not.
    """
    rows, names = [], {}
    for kind, alpha, a, d, theta in robot.rows:
        lengths = []
        for value in (a, d):
            if value:
                value = round(0.11 + 0.0173 * len(names), 4) * (1 if value > 0 else -1)
                names[f"L{len(names) + 1}"] = value
            lengths.append(value)
        rows.append((kind, alpha, *lengths, theta))
    named = replace(robot, rows=tuple(rows))
    text = to_yaml(named)
    for name, value in names.items():
        text = re.sub(rf"\b([ad]): {re.escape(repr(value))}(?=[,}}])", rf"\1: {name}", text)
    values = ", ".join(f"{name}: {value}" for name, value in names.items())
    return named, text.replace("joints:\n", f"parameters: {{{values}}}\njoints:\n", 1)
