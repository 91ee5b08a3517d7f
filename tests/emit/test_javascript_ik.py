"""The inverse kinematics in JavaScript against the solver evaluated in Python, which shares only the recorded steps."""

from __future__ import annotations

import json
import shutil
import subprocess
from math import pi
from random import Random

import numpy as np
import pytest

from rrrgen.emit.targets.javascript_ik import module
from rrrgen.ik.inverse_kinematics import evaluated_solver
from rrrgen.robot.file.reader import load_spec, read_spec
from rrrgen.robot.identity import identify

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="node is not installed")

CALLS = """\
import * as robot from "./robot.mjs";
import { readFileSync } from "node:fs";
const calls = JSON.parse(readFileSync("calls.json", "utf8"));
console.log(JSON.stringify(calls.map(([name, ...values]) => robot[name](...values))));
"""

QUARTIC = """
schema: rrrgen/1
name: slanted
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {type: revolute, alpha: 70, a: 0.1, d: 0.3, theta: 0}
  - {type: revolute, alpha: 40, a: 0.3, d: 0.1, theta: 20, sign: -1}
  - {type: revolute, alpha: 0, a: 0.25, d: 0.05, theta: 0}
"""


def called(folder, spec, calls: list) -> list:
    """What Node returns for the calls of functions of the module, each a name and its arguments."""
    (folder / "robot.mjs").write_text(module(spec, identify(spec)), encoding="utf-8")
    (folder / "main.mjs").write_text(CALLS, encoding="utf-8")
    (folder / "calls.json").write_text(json.dumps(calls), encoding="utf-8")
    ran = subprocess.run([NODE, "main.mjs"], cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


@pytest.mark.parametrize("name", ["rrr", "scara", "stanford", "ur5", "panda", "iiwa14", "slanted"])
def test_all_configurations_are_found(name, tmp_path):
    spec = read_spec(QUARTIC, "slanted.yaml") if name == "slanted" else load_spec(name)
    solver, draw = evaluated_solver(spec), Random(4)
    chain, redundant = solver.plan.chain, solver.plan.locked is not None
    period = np.array([2 * pi if joint.revolute else 0.0 for joint in chain.joints])
    calls, expected = [], []
    for _ in range(3):
        q = [draw.uniform(-2, 2) * (1 if joint.revolute else 0.2) for joint in chain.joints]
        T, near = chain.forward(q), q if redundant else [0.1] * chain.n
        calls += [["inverse_kinematics", T.tolist(), near], ["tip_pose", q], ["redundancy_of", q]]
        expected.append((solver.solve(T, near, limits=False).q, T, solver.parameter(q) if redundant else 0.0))
    results = called(tmp_path, spec, calls)
    for k, (solutions, T, given) in enumerate(expected):
        found, tip, parameter = results[3 * k : 3 * k + 3]
        np.testing.assert_allclose(tip, T[:3], atol=1e-14)
        assert parameter == pytest.approx(given, abs=1e-9)
        assert len(found) == len(solutions) > 0
        rows = np.array([row["q"] for row in found])
        for solution in solutions:
            apart = rows - solution
            apart -= period * np.round(np.divide(apart, period, out=np.zeros_like(apart), where=period > 0))
            assert np.abs(apart).max(axis=1).min() < 1e-7


def test_the_nearest_configuration_within_limits(tmp_path):
    spec = load_spec("ur5")
    chain = evaluated_solver(spec).plan.chain
    start = [0.2, -1.2, 1.4, -1.7, -1.4, 0.3]
    near, far = chain.forward(np.array(start) + 0.1), chain.forward(start)
    far[:3, 3] = [5.0, 0.0, 0.0]
    reached, stretched = called(
        tmp_path, spec, [["approach", near.tolist(), start, 1.0, 100], ["approach", far.tolist(), start, 0.0, 100]]
    )
    np.testing.assert_allclose(chain.forward(reached["q"]), near, atol=1e-8)
    tip = chain.forward(stretched["q"])[:3, 3]
    assert stretched["error"] > 1.0
    assert np.linalg.norm(tip) > 0.93  # the arm points to where it cannot get
    assert tip[0] / np.linalg.norm(tip) > 0.98
