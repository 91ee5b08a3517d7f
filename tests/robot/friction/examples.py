"""Parameters of every law, and the laws retyped from their formulas."""

from __future__ import annotations

import numpy as np

from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel

SPEEDS = np.concatenate([[0.0], np.linspace(-6, 6, 41), [1e-9, -1e-9, 300.0]])
EXAMPLES = {
    "coulomb_viscous": [[0.4, 1.5, 0.2], [0.1, 0.5, -0.1]],
    "asymmetric": [[0.4, 0.5, 1.5, 1.2], [0.1, 0.2, 0.5, 0.6]],
    "exponential": [[-0.3, 1.5, 0.4, 0.1], [0.3, 0.5, 0.2, 0.05]],
    "asymmetric_exponential": [[0.4, 0.5, 1.5, 1.2, -0.4, 0.1], [0.1, 0.2, 0.5, 0.6, 0.3, 0.05]],
    "dahl": [[1.5, 0.4, 1e-4], [0.5, 0.2, 3e-5]],
    "dahl_exponential": [[-0.3, 1.5, 0.4, -0.02, 0.1, 1e-4], [0.3, 0.5, 0.2, 0.01, 0.05, 3e-5]],
    "load_dependent": [[1.5, 0.4, 0.06], [0.5, 0.2, 0.02]],
    "dahl_load_dependent": [[-0.3, 1.5, 0.4, -0.02, 0.06, 0.1, 1e-4], [0.3, 0.5, 0.2, 0.01, 0.02, 0.05, 3e-5]],
    "stribeck": [[0.7, 1.5, 0.4, 0.1], [0.3, 0.5, 0.2, 0.05]],
    "lugre": [[1e4, 3.0, 0.7, 1.5, 1.6, 0.1], [3e3, 1.0, 0.3, 0.5, 0.8, 0.05]],
    "logistic": [[1.1, 9.0, 0.02], [0.6, 40.0, -0.03]],
    "neural": [[1.0, 0.5, -0.2, 30.0, 4.0, 200.0, 0.3], [0.3, 0.2, 0.1, 60.0, 8.0, 1.0, 0.1]],
}


def model(name: str) -> FrictionModel:
    return FrictionModel(LAWS[name], np.array(EXAMPLES[name]))


def retyped(name: str, v: float, p: list[float], load: float = 0.0) -> float:
    """The printed formulas, one joint, one speed."""
    sign = 0.0 if v == 0 else (1.0 if v > 0 else -1.0)
    if name == "coulomb_viscous":
        return p[0] * v + p[1] * sign + p[2]
    if name == "asymmetric":
        return 0.0 if v == 0 else (p[0] * v + p[2] if v > 0 else p[1] * v - p[3])
    if name == "asymmetric_exponential":
        return retyped("asymmetric", v, p) + p[4] * np.exp(-abs(v) / p[5]) * sign
    if name == "exponential":
        return (p[0] * np.exp(-abs(v) / p[3]) + p[1]) * sign + p[2] * v
    if name == "dahl":
        return p[0] * sign + p[1] * v
    if name == "dahl_exponential":
        return (p[0] * np.exp(-abs(v) / p[4]) + p[1]) * sign + p[2] * v + p[3] * v * abs(v)
    if name == "load_dependent":
        return (p[0] + p[2] * abs(load)) * sign + p[1] * v
    if name == "dahl_load_dependent":
        level = p[0] * np.exp(-abs(v) / p[5]) + p[1] + p[4] * abs(load)
        return level * sign + p[2] * v + p[3] * v * abs(v)
    if name in ("stribeck", "lugre"):
        a0, a1, a2, vs = p[-4:]
        return (a0 * np.exp(-((v / vs) ** 2)) + a1) * sign + a2 * v
    with np.errstate(over="ignore"):  # the printed forms overflow, which is why the code uses tanh
        if name == "logistic":
            return p[0] / (1 + np.exp(-p[1] * (v + p[2]))) - p[0] / (1 + np.exp(-p[1] * p[2]))
        return sum(f * (1 - 2 / (np.exp(2 * w * v) + 1)) for f, w in zip(p[:3], p[3:6], strict=True)) + p[6] * v
