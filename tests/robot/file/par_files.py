"""OpenSYMORO files of serial arms, written for the tests: their columns as text, and as numbers."""

from __future__ import annotations

import math

import numpy as np

ELBOW = {  # the geometry of an RX90 with numbers of inertia
    "ant": "0,1,2,3,4,5",
    "sigma": "0,0,0,0,0,0",
    "b": "0,0,0,0,0,0",
    "d": "0,0,D3,0,0,0",
    "r": "0,0,0,RL4,0,0",
    "gamma": "0,0,0,0,0,0",
    "alpha": "0,pi/2,0,-pi/2,pi/2,-pi/2",
    "mu": "1,1,1,1,1,1",
    "theta": "th1,th2-Pi/2,th3 + pi/2,th4,th5,th6",
}
SLIDING = {  # R P R with a turned and raised base, an inclined axis and a fixed frame at the tip
    "ant": "0,1,2,3",
    "sigma": "0,1,0,2",
    "b": "0.2,0,0,0.05",
    "d": "0.1,L2,-0.3,0.15",
    "r": "0.4,r2 + 0.25,0,0.07",
    "gamma": "0.5,0,0,-0.4",
    "alpha": "0.3,pi/2,-pi/2,0.2",
    "theta": "t1,0.7,t3 - pi/6,0.9",
    "Z": "0,-1,0,0.3,1,0,0,-0.2,0,0,1,0.6,0,0,0,1",
}
TREE = {  # two branches on a column, one with a slide, the other behind a fixed frame; a third on the base
    "ant": "0,1,2,1,4,0",
    "sigma": "0,0,1,2,0,0",
    "b": "0,0.1,0.05,-0.2,0.3,0.1",
    "d": "0,0.2,0,L2,0.1,0.3",
    "r": "0.4,0,r3+0.1,0.1,0,-0.2",
    "gamma": "0.2,0.7,0,-0.9,pi/2,1.1",
    "alpha": "0,pi/2,0.3,-0.4,0,pi/2",
    "theta": "t1,t2+0.5,0.2,0.6,t5,t6",
    "Z": "0,-1,0,0.3,1,0,0,-0.2,0,0,1,0.6,0,0,0,1",
}
LOOPS = {  # a boom on a driven cylinder, and a driven stick with a lever and a rod; frames 8 and 9 are cut joints
    "ant": "0,1,1,3,2,2,6,4,7,2,5",
    "sigma": "0,0,0,1,0,0,0,0,0,2,2",
    "b": "0,0,-0.1,0,0,0,0,0,0.02,0.3,0",
    "d": "0,0.1,0.4,0,0.9,0.5,0.3,0.03,0.45,L2,-0.2",
    "r": "0.5,0,0.01,r4+0.3,0,0,0,0,0,0,0",
    "gamma": "0.2,0,0,0,0,0.3,0,0,0,0.4,0.2",
    "alpha": "0,pi/2,pi/2,-pi/2,0,0,0,pi/2,0,0,0",
    "mu": "1,0,0,1,1,0,0,0,0,0,0",
    "theta": "t1,t2,t3+0.2,0,t5,t6,t7,t8,t9,0,0",
    "Z": "0,-1,0,0.3,1,0,0,-0.2,0,0,1,0.6,0,0,0,1",
}
VALUES = {"D3": "450mm", "RL4": "0.45", "L2": "0.35"}
NUMBERS = {"D3": 0.45, "RL4": 0.45, "L2": 0.35, "pi": math.pi, "Pi": math.pi}


def inertia(moving: int, fixed: int = 0) -> dict[str, str]:
    """Columns of physical links: cubes with their centre of mass off the axes, no inertia in fixed frames."""
    rows = []
    for j in range(moving):
        m, c = 4.0 - 0.5 * j, np.array([0.125, -0.0625, 0.25]) / (j + 1)
        tensor = m * (c @ c * np.eye(3) - np.outer(c, c)) + m * np.diag([0.02, 0.03, 0.04])
        rows.append([m, *(m * c), *(tensor[i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))])
    rows += [[0.0] * 10] * fixed
    names = ("M", "MX", "MY", "MZ", "XX", "YY", "ZZ", "XY", "XZ", "YZ")
    return {name: ",".join(repr(float(row[k])) for row in rows) for k, name in enumerate(names)}


def text(columns: dict[str, str], name: str = "arm", gravity: str = "0,0,-9.81") -> str:
    """A .par file, every second list over two lines as old versions wrote them."""
    lines = [f"(* Robotname = '{name}' *)", "NL = 1 (* not used *)", "Type = 0 (* Simple *)", "is_mobile = 0", ""]
    for k, (key, entries) in enumerate({**columns, "G": gravity, "W0": "0,0,0"}.items()):
        lines.append(f"{key} = {{{entries}}}" if k % 2 else f"{key}  = {{\n        {entries}}}")
    return "\n".join([*lines, "", "(* End of definition *)", ""])


def numbers(columns: dict[str, str], gravity: str = "0,0,-9.81") -> dict[str, list[float]]:
    """The columns as numbers, joint variables at 0: sums, products and quotients, read without the importer."""
    return {key: [_number(entry) for entry in entries.split(",")] for key, entries in {**columns, "G": gravity}.items()}


def _number(entry: str) -> float:
    total, sign = 0.0, 1.0
    for word in entry.replace("-", " - ").replace("+", " + ").split():
        if word in "+-":
            sign = -1.0 if word == "-" else 1.0
            continue
        value, _, under = word.partition("/")
        try:
            number = float(value)
        except ValueError:
            number = NUMBERS.get(value, 0.0)
        total, sign = total + sign * number / (float(under) if under else 1.0), 1.0
    return total
