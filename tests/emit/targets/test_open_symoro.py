"""The fixed tool frame of a ``.par`` file: six parameters that give the transform of the tool back."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from rrrgen.emit.targets.open_symoro import _tool_row
from rrrgen.robot.model.exact_transforms import rotation_x, rotation_z

TOOLS = {
    "along the axis": (sp.eye(3), (0, 0, 3)),
    "across the axis": (sp.eye(3), (3, 4, 5)),
    "turned over": (rotation_x(sp.pi), (1, 2, 3)),
    "turned about z": (rotation_z(sp.Rational(3, 10)), (0, 0, -2)),
    "turned about all axes": (rotation_z(sp.Rational(2, 5)) * rotation_x(1) * rotation_z(2), (1, -2, 3)),
}


def screw(angle: float, length: float, axis: int) -> np.ndarray:
    """Rotation about, then shift along the x axis (0) or the z axis (2)."""
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    others = [k for k in range(3) if k != axis]
    T[np.ix_(others, others)] = [[c, -s], [s, c]]
    T[axis, 3] = length
    return T


@pytest.mark.parametrize("tool", TOOLS)
def test_the_parameters_give_the_tool_back(tool):
    R, p = TOOLS[tool]
    T = R.row_join(sp.Matrix(p)).col_join(sp.Matrix([[0, 0, 0, 1]]))
    row = {name: float(value) for name, value in _tool_row(T).items()}
    product = screw(row["gamma"], row["b"], 2) @ screw(row["alpha"], row["d"], 0) @ screw(row["theta"], row["r"], 2)
    np.testing.assert_allclose(product, np.array(T.evalf(), float), atol=1e-14)
