"""Rows that a new robot file starts with: no degenerate arm, one arm in both conventions."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest

from rrrgen.ik.classify import plan
from rrrgen.robot.file import RobotSpec, load_spec, loads_spec

KINDS = ["".join(letters) for n in range(1, 4) for letters in itertools.product("RP", repeat=n)]
LONG = [
    "RPPR",
    "PRRP",
    "PPPP",
    "RRRR",
    "RRRRR",
    "RRRRRR",
    "PRRRRR",
    "RRPRRR",
    "RPPRRR",
    "PPPRRR",
    "RRRRRP",
    "RPRPRP",
    "RRRRRRR",
    "PRRRRRR",
    "RRRRRRRR",
]


@cache
def read(text: str) -> RobotSpec:
    return loads_spec(text, strict=True)


def pose(text: str, q: np.ndarray) -> np.ndarray:
    """The pose of the tip, from the Denavit-Hartenberg rows."""
    spec = read(text)
    T = np.eye(4)
    for (kind, alpha, a, d, theta), value in zip(spec.dh_table(), q, strict=True):
        theta, d = (theta + value, d) if kind == "revolute" else (theta, d + value)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
        twist = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        T = T @ turn @ twist if spec.convention == "standard" else T @ twist @ turn
    return T @ np.array(spec.tool.matrix().applyfunc(spec.nominal), dtype=float)


def jacobian_rank(text: str) -> int:
    """The rank of the Jacobian at a random configuration, by differences of poses."""
    q, h = np.random.default_rng(5).uniform(-1.5, 1.5, read(text).n), 1e-6
    columns = []
    for e in h * np.eye(len(q)):
        plus, minus = pose(text, q + e), pose(text, q - e)
        rate = (plus - minus) / (2 * h)
        spin = rate[:3, :3] @ minus[:3, :3].T
        columns.append([*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
    return int(np.linalg.matrix_rank(np.array(columns), tol=1e-4))


@pytest.mark.parametrize("joints", [*KINDS, *LONG])
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_the_arm_is_not_degenerate(joints, convention, written):
    text = written(joints, convention)
    assert jacobian_rank(text) == min(6, joints.count("R") + min(3, joints.count("P")))
    assert read(text).faults == ()


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_six_joints_have_a_spherical_wrist(convention, written):
    written("RRRRRR", convention)
    found = plan(load_spec("arm.yaml"))
    assert found.solvable
    assert found.family == "spherical"


def test_both_conventions_are_the_same_arm(written):
    q = np.array([0.1, -0.7, 0.4, 1.1, -0.3, 0.9])
    standard, modified = (pose(written("RRRRRR", convention), q) for convention in ("standard", "modified"))
    assert np.allclose(standard, modified, atol=1e-12)
