"""The inverse kinematics in JavaScript against the solver evaluated in Python, which shares only the recorded steps.

That of general arms and of mechanisms, a translation of the emitted C, is compared with the compiled C.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from math import pi
from pathlib import Path
from random import Random

import numpy as np
import pytest

from ik.robots import ROWS, make
from ik.test_calibrated import arm, calibrated
from ik.test_mechanisms import TEXTS, poses
from rrrgen.base.errors import InternalError
from rrrgen.emit.targets.javascript_from_c import translate
from rrrgen.emit.targets.javascript_ik import module, modules
from rrrgen.ik.classify import tip_plans
from rrrgen.ik.inverse_kinematics import evaluated_solver
from rrrgen.robot.file import loads_spec
from rrrgen.robot.file.reader import load_spec, read_spec
from rrrgen.robot.identity import identify
from rrrgen.robot.model.mechanism import follower_limits
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import OUTSIDE

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
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


GENERAL = {
    "skewed": (arm("RRRRRR", 1), [(-3.0, 2.0)] * 6),
    "a sliding joint": (arm("RRPRRR", 2), None),
    "seven joints": (arm("RRRRRRR", 1), None),
    "calibrated": (calibrated(ROWS["ur5"], 1e-3), [(-3.0, 2.0)] * 6),  # with solutions of the arm nearby
}


@pytest.mark.parametrize("name", GENERAL)
@pytest.mark.sweep(but=["a sliding joint"])
def test_a_general_arm_is_solved_as_in_c(name, tmp_path):
    """Random poses, round angles among them, at which solutions meet, and targets out of reach."""
    rows, limits = GENERAL[name]
    spec = make("arm", rows, limits=limits)
    solver, draw = load_solver(spec), Random(7)
    chain, n, locked = solver.plan.chain, len(rows), solver.plan.locked
    targets, references = [], []
    for k in range(48):
        q = [draw.uniform(-pi, pi) if k % 4 else draw.randint(-2, 2) * pi / 2 for _ in range(n)]
        T = chain.forward(q)
        T[:3, 3] *= 3.0 if k % 12 == 1 else 1.0
        targets.append(T)
        references.append([draw.uniform(-1, 1) for _ in range(n)])
        if locked is not None:
            references[-1][locked] = q[locked]
    calls = [["solve", T.tolist(), near] for T, near in zip(targets, references, strict=True)]
    answers = called(tmp_path, spec, calls)
    assert any(len(answer["solutions"]) > 5 for answer in answers)
    for T, near, answer in zip(targets, references, answers, strict=True):
        expected = solver.solve(T, near, limits=False)
        assert answer["status"] == expected.status
        assert [row["branch"] for row in answer["solutions"]] == [{"aspect": int(each)} for each in expected.branch]
        assert [row["within"] for row in answer["solutions"]] == [not flags & OUTSIDE for flags in expected.flags]
        for row, q in zip(answer["solutions"], expected.q, strict=True):
            np.testing.assert_allclose(row["q"], q, rtol=0, atol=1e-9)


def mechanism(name):
    return loads_spec(TEXTS[name]) if name in TEXTS else load_spec(EXAMPLES / name)


@pytest.mark.parametrize("name", ["palletiser", "geared", "wristed", "redundant", "sliding", "tx40/drives.yaml"])
@pytest.mark.sweep(but=["palletiser", "geared", "redundant", "sliding"])
def test_a_mechanism_is_solved_as_in_c(name, tmp_path):
    """Joint values for every way in which the drives stand; targets in reach, beside it, and out of it."""
    spec = mechanism(name)
    solver, draw = load_solver(spec), Random(5)
    coupling, chain = solver.plan.coupling, solver.plan.chain
    targets, references, calls = [], [], []
    for k in range(24):
        q = [draw.uniform(-1.5, 1.5) if turning else draw.uniform(0.0, 0.5) for turning in coupling.revolute]
        T = np.array(chain.forward(coupling.rows(q)))
        calls += [["tip_pose", q], ["redundancy_of", q]]
        targets.append(T.copy())
        targets[-1][:3, 3] *= 3.0 if k % 12 == 1 else 1.0
        references.append([draw.uniform(-1, 1) for _ in q] if solver.plan.locked is None else q)
        calls.append(["solve", targets[-1].tolist(), references[-1]])
        np.testing.assert_allclose(T, poses(spec, np.array([q]))[0], atol=1e-12)
    answers, found = called(tmp_path, spec, calls), 0
    for k, (T, near) in enumerate(zip(targets, references, strict=True)):
        tip, parameter, answer = answers[3 * k : 3 * k + 3]
        q = calls[3 * k][1]
        np.testing.assert_allclose(tip, poses(spec, np.array([q]))[0, :3], atol=1e-12)
        assert parameter == pytest.approx(solver.parameter(q) if solver.plan.locked is not None else 0.0, abs=1e-12)
        expected = solver.solve(T, near, limits=False)
        assert answer["status"] == expected.status
        names = [solver.branch_names(each) for each in expected.branch]
        assert [row["branch"] for row in answer["solutions"]] == names
        assert [row["within"] for row in answer["solutions"]] == [not flags & OUTSIDE for flags in expected.flags]
        np.testing.assert_allclose([row["q"] for row in answer["solutions"]], expected.q.tolist(), rtol=0, atol=1e-9)
        found += len(expected.q)
    assert found > 24


def test_the_limits_of_followers_hold_while_a_tip_is_dragged(tmp_path):
    """The forearm of the palletiser is stopped by its own limits; the other joints go on to where they come nearest."""
    spec = mechanism("palletiser")
    (forearm,) = follower_limits(spec)
    start, draw = np.array([0.1, 0.9, 0.3, 0.2]), Random(2)
    targets = []
    for k in range(16):  # where the forearm would have to go beyond one of its limits
        upper, lower = (1.4, draw.uniform(-0.3, -0.1)) if k % 2 else (draw.uniform(-0.6, -0.3), 1.5)
        targets.append(poses(spec, np.array([[draw.uniform(-0.5, 0.8), upper, lower, 0.1]]))[0])
    calls = [["approach", T.tolist(), start.tolist(), 0.0, 200] for T in targets]
    for T, answer in zip(targets, called(tmp_path, spec, calls), strict=True):
        q = np.array(answer["q"])
        for value, limits in zip(q, (joint.limits for joint in spec.joints), strict=True):
            assert limits.lower - 1e-9 <= value <= limits.upper + 1e-9
        value = float(np.dot(forearm.factors, q))
        assert min(value - forearm.lower, forearm.upper - value) == pytest.approx(0.0, abs=1e-6)
        near = [np.linalg.norm(poses(spec, each[None])[0, :3, 3] - T[:3, 3]) for each in (start, q)]
        assert near[1] < 0.5 * near[0]
        beside = q + np.outer([0.01, -0.01], [1, 0, 0, 0])  # the joint that stands at no limit gains nothing
        turned = poses(spec, beside)[:, :3, 3]
        assert np.linalg.norm(turned - T[:3, 3], axis=1).min() > near[1]


def test_every_named_tip_has_a_module(tmp_path):
    spec = load_spec(EXAMPLES / "trees/torso.yaml")
    found = modules(spec, identify(spec))
    assert sorted(found) == ["left", "right"]
    arm, plan = tip_plans(spec)["right"]
    q = [0.3, -0.4, 0.5, 0.2, 0.6, -0.1]
    T = plan.chain.forward(q)
    (answer,) = called(tmp_path, arm, [["inverse_kinematics", T.tolist(), q]])
    assert (tmp_path / "robot.mjs").read_text(encoding="utf-8").replace(identify(arm).model_hash, "") == found[
        "right"
    ].replace(identify(spec).model_hash, "")
    assert len(answer) == len(evaluated_solver(arm).solve(T, q, limits=False).q) > 1


C = """
#define R_SIZE 3 /* a comment */
#define R_HALF (r_real)0.5
#define R_LOW(flags) ((flags) & 3u) /* two bits */
enum { R_FLAG = 4 };
typedef struct r_rows {
    int count; /* how many */
    r_real q[2][R_SIZE];
    unsigned flags[2];
} r_rows;
static const signed char r_order[3] = {2, 0, 1};
static const r_real r_table[2][2] = {{(r_real)1.5, -(r_real)2}, {1e-3, 4}};

/* Sets both numbers. */
static int r_set(r_real x[R_SIZE], const r_real (*const row)[2], int *counted)
{
    int i;
    for (i = 0; i < R_SIZE; ++i) {
        x[r_order[i]] += row[i % 2][1] * R_HALF;
    }
    *counted += i / 2;
    return (x[0] < x[1]) && !(i == 2);
}

int r_solve(const r_real target[4], r_rows *out)
{
    r_real x[R_SIZE] = {0};
    r_real turned[2][2] = {{1.0, target[0]}, {-target[1], 1.0}};
    r_real *const second = turned[1];
    int in = 1; /* a word of JavaScript */
    const unsigned bits = (unsigned)R_FLAG | ((in > 0) ? 1u : 0u);
    out->count = -7 / 2;
    in = r_set(x, r_table, &out->count) ? 5 : in;
    while (true) {
        if (in > 4) {
            in /= 2;
        } else {
            break;
        }
    }
    out->flags[1] = (~bits & 0xffu) - R_LOW(bits + 1u);
    out->q[1][2] = second[0] + x[2] + fabs(turned[0][1]) + copysign(2.0, -x[1]);
    (void)bits;
    return in;
}
"""


def test_a_translation_of_c(tmp_path):
    found = translate("typedef double r_real;", C, "r_solve", {"target": 4})
    out = found.places["out"]
    text = "\n".join(found.lines)
    assert "/* Sets both numbers. */" in text
    (tmp_path / "r.mjs").write_text(
        f"{text}\nfunction copysign(x, y) {{ return y < 0 ? -Math.abs(x) : Math.abs(x); }}\n"
        f"F64.set([-3, 0.25], {found.places['target']});\n"
        f"const out = {json.dumps(out)}, status = r_solve({found.places['target']}, out);\n"
        "console.log(JSON.stringify([status, I32[out.count], I32[out.flags + 1], F64[out.q + 5]]));\n"
    )
    ran = subprocess.run([NODE, "r.mjs"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    # x = (2, -1, -1): order and second column of the table; count -3 + 3 / 2; in stays 1, since 2 < -1 does not hold
    assert json.loads(ran.stdout) == [1, -2, 0xFF - 5 - 2, pytest.approx(-0.25 - 1.0 + 3.0 + 2.0)]


def test_what_is_not_understood_is_a_fault():
    for body, word in (("return g(1);", "g"), ("return y;", "y"), ("long x; return 1;", "long"), ("return x[1;", "]")):
        with pytest.raises(InternalError, match=re.escape(word)):
            translate("", f"int f(const double *x) {{ {body} }}", "f", {"x": 2})


def test_arguments_of_another_shape_are_refused(tmp_path):
    """JavaScript would return configurations of NaN, or none."""
    spec = load_spec("rrr")
    (tmp_path / "robot.mjs").write_text(module(spec, identify(spec)), encoding="utf-8")
    main = "import * as robot from './robot.mjs';\nconst T = robot.tip_pose([0.1, 0.2, 0.3]);\n"
    for call in (
        "inverse_kinematics(T, [0.1])",
        "inverse_kinematics([1, 2, 3])",
        "inverse_kinematics(null)",
        "approach(T, [0.1])",
        "approach([0.1, 0.2, 0.3], [0, 0, 0])",
        "inverse_kinematics(T, ['a', 0, 0])",
    ):
        main += f"try {{ robot.{call}; console.log('taken'); }} catch (e) {{ console.log(e.name, e.message); }}\n"
    (tmp_path / "main.mjs").write_text(main, encoding="utf-8")
    ran = subprocess.run([NODE, "main.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    shape, rows = "TypeError near must have the shape [3]", "TypeError T must be three or four rows of four numbers"
    assert ran.stdout.splitlines() == [shape, rows, rows, shape.replace("near", "q"), rows, shape]
