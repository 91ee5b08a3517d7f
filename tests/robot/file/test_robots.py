"""The bundled robots: they load, they are physical, they say where they come from, and rrr fits chapter 14."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest
import sympy as sp

from rrrgen.robot.file import RobotSpec, bundled_names, bundled_path, load_spec

JOINTS = {"rrr": "RRR", "planar2r": "RR", "scara": "RRPR", "stanford": "RRPRRR", "puma560": "RRRRRR", "ur5": "RRRRRR",
          "ur10e": "RRRRRR", "iiwa14": "RRRRRRR", "panda": "RRRRRRR", "pendulum": "R", "gantry": "PPP",
          "ur3e": "RRRRRR", "ur5e": "RRRRRR", "ur20": "RRRRRR", "xarm6": "RRRRRR", "so101": "RRRRR", "gen3": "RRRRRRR",
          "xarm7": "RRRRRRR", "openarm": "RRRRRRR", "vx300s": "RRRRRR",
          "piper": "RRRRRR", "fr3": "RRRRRRR"}  # fmt: skip
MODIFIED = ("panda", "fr3", "gen3", "xarm7", "piper")
AS_BUILT = ("gen3", "so101")
"""Arms with small offsets in the maker's own data, of which a file is warned."""


def test_the_robots_that_were_promised_are_there() -> None:
    assert set(JOINTS) <= set(bundled_names())


@pytest.mark.parametrize("name", bundled_names())
def test_robot_loads_without_a_warning(name: str) -> None:
    spec = load_spec(name, strict=name not in AS_BUILT)
    assert all(name in AS_BUILT and "lengths below 1 mm" in fault.message for fault in spec.faults)
    assert spec.name == name
    assert "".join("R" if joint.is_revolute else "P" for joint in spec.joints) == JOINTS[name]
    assert spec.convention == ("modified" if name in MODIFIED else "standard")
    assert spec.description
    assert spec.source
    assert spec == load_spec(bundled_path(name))


# axis labels of Fig. 14.12, which bracket the estimates
BRACKETS = {1: (-0.5036, 0.6919), 2: (-0.1926, 2.6462), 3: (0.1466, 0.193), 5: (-2.5661, 0.1875), 6: (-0.7763, 1.3651),
            7: (0.7217, 2.8027), 8: (-0.0704, -0.0009), 9: (-0.0778, 0.0473), 10: (-0.0183, 0.0544),
            11: (-0.5593, -0.2599), 12: (0.3397, 0.4234), 13: (0.018, 0.0459), 14: (1.5039, 1.5679)}  # fmt: skip


def base_parameters_14_46(spec: RobotSpec) -> dict[int, float]:
    """(14.46) in numbers: inertias about the frame origins, products +int xy dm."""
    a2, a3, _, d2, d3 = (float(spec.parameters[key]) for key in ("a2", "a3", "d1", "d2", "d3"))
    assert spec.links is not None
    m, x, y, z = {}, {}, {}, {}
    J: dict[str, float] = {}
    for i, link in enumerate(spec.links, start=1):
        m[i], (x[i], y[i], z[i]) = float(link.mass), (float(value) for value in link.com)
        moments = [float(value) for value in link.inertia_about_origin()]
        signs = (1, 1, 1, -1, -1, -1)
        keys = ("xx", "yy", "zz", "xy", "xz", "yz")
        J |= {f"{key}{i}": sign * value for key, sign, value in zip(keys, signs, moments, strict=True)}
    D = d2 + d3
    return {
        1: a2**2 * m[3] + a2 * m[2] * (a2 + 2 * x[2]) - J["xx2"] + J["yy2"],
        2: -2 * (a2 * m[2] * y[2] + J["xy2"]),
        3: m[3] * (a3 + x[3]),
        4: m[3] * y[3],
        5: a3 * m[3] * (a3 + 2 * x[3]) - J["xx3"] + J["yy3"],
        6: 2 * (a3 * m[3] * y[3] + J["xy3"]),
        7: 2 * d2 * m[2] * z[2] + d2**2 * m[2] + 2 * D * m[3] * z[3] + D**2 * m[3] + J["yy1"] + J["xx2"] + J["xx3"],
        8: -D * m[3] * y[3] - J["yz3"],
        9: -a3 * m[3] * (z[3] + D) - D * m[3] * x[3] - J["xz3"],
        10: -d2 * m[2] * y[2] - J["yz2"],
        11: -a2 * (m[3] * (z[3] + D) + m[2] * (d2 + z[2])) - d2 * m[2] * x[2] - J["xz2"],
        12: (a2**2 + a3**2 + 2 * a3 * x[3]) * m[3] + a2 * m[2] * (a2 + 2 * x[2]) + J["zz2"] + J["zz3"],
        13: a3 * m[3] * (a3 + 2 * x[3]) + J["zz3"],
        14: m[2] * (x[2] + a2) + m[3] * a2,
        15: m[2] * y[2],
    }  # fmt: skip


def test_base_parameters_of_rrr_lie_inside_the_brackets_of_fig_14_12() -> None:
    p = base_parameters_14_46(load_spec("rrr"))
    assert (p[4], p[15]) == (0, 0)
    for number, (lower, upper) in BRACKETS.items():
        assert lower < p[number] < upper, f"p{number} = {p[number]}"


ROUND_OFF = 1e-12  # relative to 1, the size of the largest base parameters


def test_basis_of_rrr_is_14_46() -> None:
    spec = load_spec("rrr")
    assert spec.basis is not None
    assert spec.basis.names == tuple(f"p{i}" for i in range(1, 16))
    assert spec.basis.products == "positive"
    assert spec.links is not None
    values: dict[sp.Symbol, sp.Expr] = {sp.Symbol(k, real=True): v for k, v in spec.parameters.items()}
    for i, link in enumerate(spec.links, start=1):
        entries = dict(zip(("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"), link.inertia_about_origin(), strict=True))
        entries = {key: -value if key in ("Ixy", "Ixz", "Iyz") else value for key, value in entries.items()}
        entries |= {"m": link.mass} | dict(zip("xyz", link.com, strict=True))
        values |= {sp.Symbol(f"{key}{i}", real=True): value for key, value in entries.items()}
    expected = base_parameters_14_46(spec)
    for number, expression in enumerate(spec.basis.expressions, start=1):
        assert float(expression.subs(values)) == pytest.approx(expected[number], abs=ROUND_OFF)


def test_rrr_is_table_14_1() -> None:
    half = np.pi / 2
    expected = [(half, 0, 0.560, 0), (0, 0.200, 0.169, 0), (0, 0.415, 0.090, 0)]
    rows = load_spec("rrr").dh_table()
    assert [row[0] for row in rows] == ["revolute"] * 3
    assert np.allclose([row[1:] for row in rows], expected, rtol=0, atol=1e-16)
    limits = [joint.limits for joint in load_spec("rrr").joints]
    assert [limit.torque for limit in limits] == [60, 30, 15]
    assert np.allclose([limit.velocity for limit in limits], np.array([2, 3, 3]) * np.pi, rtol=1e-15)


# tip of the zero pose, worked out by hand from the drawings (m)
ZERO_POSES = {"panda": (0.088, 0, 0.926), "iiwa14": (0, 0, 1.306), "ur5": (-0.81725, -0.19145, -0.005491),
              "puma560": (0.4521, -0.15005, 0.4318), "planar2r": (0.9, 0, 0), "scara": (0.6, 0, 0.387),
              "openarm": (0, -0.174, 0.062), "vx300s": (0.536494, 0, 0.42705), "stanford": (0, 0.154, 0.675),
              "gantry": (0, 0, 0), "pendulum": (0.5, 0, 0)}  # fmt: skip


def forward(spec: RobotSpec, q: list[float]) -> np.ndarray:
    T = np.array(spec.base.matrix().tolist(), dtype=float)
    for (kind, alpha, a, d, theta), qi in zip(spec.dh_table(), q, strict=True):
        theta, d = (theta + qi, d) if kind == "revolute" else (theta, d + qi)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        about_z = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
        about_x = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        T = T @ (about_z @ about_x if spec.convention == "standard" else about_x @ about_z)
    return T @ np.array(spec.tool.matrix().tolist(), dtype=float)


@pytest.mark.parametrize("name", ZERO_POSES)
def test_zero_pose(name: str) -> None:
    spec = load_spec(name)
    assert np.allclose(forward(spec, [0.0] * spec.n)[:3, 3], ZERO_POSES[name], rtol=0, atol=1e-12)


def test_piper_stands_where_the_makers_sdk_has_its_zero() -> None:
    T = forward(load_spec("piper"), [0.0] * 6)
    assert np.allclose(T[:3, 3], [0.056128, 0, 0.213266], rtol=0, atol=1e-6)
    assert np.isclose(np.degrees(np.arctan2(-T[2, 0], T[0, 0])), 85)


def test_gantry_moves_along_the_axes_of_its_base() -> None:
    T = forward(load_spec("gantry"), [1.0, 2.0, 3.0])
    assert np.allclose(T[:3, 3], [1, 2, 3], rtol=0, atol=1e-12)


def test_angles_are_exact() -> None:
    for name in bundled_names():
        for joint in load_spec(name).joints:
            if name in (
                "xarm6",
                "so101",
                "piper",
                "vx300s",
            ):  # zero positions that the makers chose by the shape of their links
                assert (joint.alpha / (sp.pi / 2)).is_Integer
                continue
            assert (joint.alpha / (sp.pi / 2)).is_Integer
            assert (joint.theta / (sp.pi / 2)).is_Integer


LOADING_SECONDS = 0.3  # of processor time, SymPy imported; measured 0.03 to 0.1


@pytest.mark.parametrize("name", bundled_names())
def test_loading_is_fast(name: str) -> None:
    def seconds() -> float:
        start = time.process_time()
        load_spec(name)
        return time.process_time() - start

    assert min(seconds() for _ in range(3)) < LOADING_SECONDS


def test_the_room_imports_nothing_heavy() -> None:
    heavy = "{'sympy', 'ruamel', 'numpy'}"
    code = (
        f"import sys, rrrgen.robot.file; rrrgen.robot.file.bundled_names(); print(sorted({heavy} & set(sys.modules)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
