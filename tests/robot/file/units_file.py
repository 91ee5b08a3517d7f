"""A robot file in other units."""

from __future__ import annotations

from rrrgen.robot.file import RobotSpec, loads_spec

ROW = "{type: revolute, alpha: ALPHA, a: A, d: 0, theta: 0}"
PRISMATIC = "{type: prismatic, alpha: 0, a: 300, d: D, theta: THETA, limits: {lower: 10, upper: 900, velocity: 250}}"


def robot(
    alpha: str = "90", a: str = "250", d: str = "100", theta: str = "0", parameters: str = "{}", **more: str
) -> str:
    rows = [
        ROW.replace("ALPHA", alpha).replace("A,", f"{a},"),
        PRISMATIC.replace("D,", f"{d},").replace("THETA", theta),
    ]
    lines = [
        "schema: rrrgen/1",
        "name: r",
        "convention: standard",
        f"units: {more.pop('units', '{angle: deg, length: mm}')}",
    ]
    lines += ["gravity: [0, 0, -9.81]", f"parameters: {parameters}", "joints:", *(f"  - {row}" for row in rows)]
    lines += [f"{key}: {value}" for key, value in more.items()]
    return "\n".join(lines) + "\n"


IN_METRES = {
    "a: 300": "a: 0.3",
    "lower: 10": "lower: 0.01",
    "upper: 900": "upper: 0.9",
    "velocity: 250": "velocity: 0.25",
}


def in_metres(text: str) -> str:
    for millimetres, metres in IN_METRES.items():
        text = text.replace(millimetres, metres)
    return text


def load(**changes: str) -> RobotSpec:
    return loads_spec(robot(**changes))
