"""Drive inertia and friction through the whole compiler: what they add to the rigid body, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, to_yaml
from rrrgen.robot.file import loads_spec
from rrrgen.verify import verify

ROUND_OFF = 1e-11  # relative to the largest torque; some hundred operations on seven joints
DRIVE = (0.3, None, 0.0, 2.5, None, 0.7, 1.1)
FRICTION = ({"viscous": 0.4, "coulomb": 1.5, "offset": -0.2}, None, {"coulomb": 0.8}, {"viscous": 2.0}, None, {}, None)


def text_with_drives(robot) -> str:
    """The robot's file; drive inertia and friction of some joints, with fields left out."""
    lines, k = [], 0
    for line in to_yaml(robot).splitlines():
        if line.startswith("  - {type: "):
            added = [] if DRIVE[k] is None else [f"drive: {{inertia: {DRIVE[k]}}}"]
            if FRICTION[k]:
                added.append("friction: {" + ", ".join(f"{name}: {v}" for name, v in FRICTION[k].items()) + "}")
            line, k = ", ".join([line[:-1], *added]) + "}", k + 1
        lines.append(line)
    assert k == robot.n
    return "\n".join(lines) + "\n"


def field(name: str, n: int) -> np.ndarray:
    return np.array([(FRICTION[i] or {}).get(name, 0.0) for i in range(n)])


@pytest.fixture(
    scope="module",
    params=[(1, 11), (4, 13), pytest.param((5, 14), marks=pytest.mark.sweep)],
    ids=lambda p: f"{p[0]}-joints",
)
def case(request):
    joints, seed = request.param
    robot = random_robot(seed, n=joints)
    model = rrrgen.compile(loads_spec(text_with_drives(robot)), backend="c" if joints == 4 else "numpy")
    states = [np.random.default_rng(seed + k).uniform(-2, 2, (9, joints)) for k in range(3)]
    return robot, model, states


def test_drives_add_a_diagonal_to_the_mass_matrix_and_nothing_to_the_bias(case):
    robot, model, (q, dq, ddq) = case
    Ia = np.array([value or 0.0 for value in DRIVE[: robot.n]])
    M = np.array([oracle.mass_matrix(robot, x) for x in q]) + np.diag(Ia)
    bias = np.array([oracle.bias(robot, *x) for x in zip(q, dq, strict=True)])
    tau = np.einsum("bij,bj->bi", M, ddq) + bias
    scale = np.abs(tau).max()
    assert np.abs(model.mass_matrix(q) - M).max() <= ROUND_OFF * np.abs(M).max()
    assert np.abs(model.bias(q, dq) - bias).max() <= ROUND_OFF * scale
    assert np.abs(model.inverse_dynamics(q, dq, ddq) - tau).max() <= ROUND_OFF * scale
    again = np.einsum("bij,bj->bi", M, model.forward_dynamics(q, dq, tau)) + bias
    assert np.abs(again - tau).max() <= ROUND_OFF * scale
    kinetic, _ = model.energy(q, dq)
    assert np.abs(kinetic - 0.5 * np.einsum("bi,bij,bj->b", dq, M, dq)).max() <= ROUND_OFF * np.abs(kinetic).max()


def test_friction_is_its_own_function(case):
    robot, model, (_, dq, _) = case
    expected = field("viscous", robot.n) * dq + field("coulomb", robot.n) * np.sign(dq) + field("offset", robot.n)
    assert np.abs(model.friction(dq) - expected).max() <= ROUND_OFF * np.abs(expected).max()


@pytest.mark.sweep(but=["1-joints"])
def test_the_model_is_verified_with_them(case):
    report = verify(case[1], samples=20)
    assert report.ok, report.to_text()
