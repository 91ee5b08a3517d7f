"""Inverse kinematics where joints follow others: every configuration of the drives that reaches a pose."""

from __future__ import annotations

import shutil
import subprocess
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from emit.c_tools import C99, CXX, IDENTITY, SANITIZERS, compile_all, compiler, run, write
from rrrgen.base.errors import DerivationError
from rrrgen.derive import derive
from rrrgen.emit.c.ik.files import sources
from rrrgen.emit.c.ik.self_test import selftest
from rrrgen.emit.c.robot_files import CBackend
from rrrgen.emit.interface import SelfTestCheck
from rrrgen.emit.latex.inverse_kinematics import closed_form
from rrrgen.ik.classify import plan
from rrrgen.ik.geometry.mechanism import solved_chain
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of

PALLETISER = Path(__file__).resolve().parents[2] / "examples" / "palletiser" / "robot.yaml"

GEARED = """\
schema: rrrgen/1
name: geared
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: q1, type: revolute, alpha: 90, a: 0, d: 0.5, follows: {q1: 1/2}}
  - {name: q2, type: revolute, alpha: 0, a: 0.4, d: 0.1, follows: {q2: 2/3}}
  - {name: q3, type: revolute, alpha: 0, a: 0.3, d: 0, follows: {q3: 1, q2: 1/3}, limits: {lower: -400, upper: 400}}
"""


def poses(spec, q):
    return NewtonEuler(chain_of(spec), np.zeros((len(spec.rows), 10))).forward_kinematics(q)


def apart(a, b, periods):
    """The largest difference over full turns; a period of 0 is that of a joint without."""
    turns = np.round((a - b) / np.where(np.array(periods) > 0, periods, np.inf))
    return np.abs(a - b - turns * periods).max()


WRIST = """\
schema: rrrgen/1
name: wristed
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: j1, type: revolute, alpha: 90, a: 0, d: 0.4}
  - {name: j2, type: revolute, alpha: 0, a: 0.43, d: 0, limits: {lower: -100, upper: 120}}
  - {name: j3, type: revolute, alpha: -90, a: 0.02, d: 0.1, follows: {j3: 1, j2: -1}}
  - {name: j4, type: revolute, alpha: 90, a: 0, d: 0.43, follows: {j4: 1/2}}
  - {name: j5, type: revolute, alpha: -90, a: 0, d: 0}
  - {name: j6, type: revolute, alpha: 0, a: 0, d: 0.06, follows: {j6: 1, j5: 1}}
"""

REDUNDANT = """\
schema: rrrgen/1
name: redundant
convention: standard
units: {angle: deg, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: a, type: revolute, alpha: 0, a: 0.5, d: 0, follows: {a: 1/2}}
  - {name: b, type: revolute, alpha: 0, a: 0.4, d: 0}
  - {name: c, type: revolute, alpha: 0, a: 0.3, d: 0, follows: {c: 1, b: -1}}
  - {name: d, type: revolute, alpha: 0, a: 0.2, d: 0}
"""

SLIDING = """\
schema: rrrgen/1
name: sliding
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: lift, type: prismatic, alpha: 0, a: 0, theta: 0, follows: {lift: 2}, limits: {lower: 0, upper: 0.6}}
  - {name: upper, type: revolute, alpha: 0, a: 0.5, d: 0.1, follows: {upper: 1, lift: 3}}
  - {name: fore, type: revolute, alpha: 0, a: 0.4, d: 0, follows: {fore: 1, upper: -1}, limits: {upper: 120}}
"""

TELESCOPE = """\
schema: rrrgen/1
name: telescope
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: turn, type: revolute, alpha: 90, a: 0.1, d: 0.4}
  - {name: lift, type: revolute, alpha: 90, a: 0, d: 0.2, theta: 90}
  - {name: boom, type: prismatic, alpha: 180, a: 0.05, theta: 20, d: 0.6, limits: {lower: 0, upper: 0.5}}
  - {name: inner, type: prismatic, alpha: 0, a: 0.02, theta: -10, d: -0.1, follows: {boom: -1}}
  - {name: tube, type: prismatic, alpha: 160, a: 0.03, theta: 40, d: 0.1, follows: {boom: -1/2}}
  - {name: roll, type: revolute, alpha: -90, a: 0, d: 0.1, theta: 15}
  - {name: bend, type: revolute, alpha: 90, a: 0, d: 0}
  - {name: twist, type: revolute, alpha: 0, a: 0, d: 0.1}
tool: {translation: [0.02, 0.01, 0.2]}
"""

REACH = """\
schema: rrrgen/1
name: reach_arm
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: turn, type: revolute, alpha: 0, a: 0, d: 0.4}
  - {name: lift, type: revolute, alpha: 90, a: 0.1, d: 0, theta: 90}
  - {name: boom, type: prismatic, alpha: 90, a: 0, theta: 0, d: 0.6}
  - {name: tube, type: prismatic, alpha: 180, a: 0.03, theta: 30, d: -0.1, follows: {boom: -2}}
tool: {translation: [0.02, 0, 0.2]}
"""

MECHANISM = """\
schema: rrrgen/1
name: linkage
convention: standard
units: {angle: deg, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: arm, type: revolute, alpha: 0, a: 0.5, d: 0}
  - {name: crank, type: revolute, alpha: 0, a: -0.15, d: 0, parent: base, limits: {lower: -60, upper: 90}}
  - {name: rod, type: revolute, alpha: 0, a: 0.5, d: 0, follows: {arm: 1, crank: -1}}
  - {name: forearm, type: revolute, alpha: 0, a: 0.4, d: 0, parent: arm, follows: {arm: -1, crank: 1/2}}
tip: forearm
"""

TEXTS = {"palletiser": PALLETISER.read_text(encoding="utf-8"), "geared": GEARED, "wristed": WRIST}
TEXTS |= {"redundant": REDUNDANT, "sliding": SLIDING}


@pytest.fixture(scope="module")
def solvers():
    """Robot file, solver in C and in NumPy of every mechanism of this file, made when first asked for."""
    made = {}

    def of(name):
        if name not in made:
            spec = loads_spec(TEXTS[name])
            made[name] = spec, load_solver(spec), load_solver(spec, backend="numpy")
        return made[name]

    return of


def options_of(solver, q):
    return {"redundancy": solver.parameter(q)} if solver.plan.locked is not None else {}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.sweep(but=["wristed", "redundant", "sliding"])
def test_c_and_numpy_find_the_configuration_that_made_the_pose_and_agree_in_everything(name, solvers):
    """In reach and out of it, with limits and without: rows, flags, branches, status, reason, distance."""
    spec, compiled, evaluated = solvers(name)
    position = compiled.plan.task == "position"
    coupling = compiled.plan.coupling
    q = np.random.default_rng(2).uniform(-3, 3, (4, spec.n)) * np.where(coupling.revolute, 1.0, 0.2)
    goals = poses(spec, q)
    for k, (own, goal) in enumerate(zip(q, goals, strict=True)):
        given = options_of(compiled, own)
        if k > 2:
            goal[:3, 3] += [1.9, 2.3, 0.1]
        for limits in (False, True):
            found, other = (each.solve(goal, limits=limits, **given) for each in (compiled, evaluated))
            assert (found.status, found.reason, len(found)) == (other.status, other.reason, len(other))
            np.testing.assert_array_equal(found.branch, other.branch)
            np.testing.assert_array_equal(found.flags, other.flags)
            np.testing.assert_allclose(found.q, other.q, atol=1e-6)
            assert found.distance == pytest.approx(other.distance, rel=1e-4, abs=1e-9)
        if k > 2:
            assert found.status == "unreachable"
            nearest = compiled.closest(goal, own, limits=False, **given)
            error = poses(spec, nearest.q)[0][:3, 3] - goal[:3, 3]
            assert np.linalg.norm(error) < 1.5 * found.distance + 1e-3
            continue
        found = compiled.solve(goal, limits=False, **given)
        reached = poses(spec, found.q)
        assert np.abs((reached - goal)[:, :3, 3] if position else reached - goal).max() < 1e-12
        assert min(apart(own, row, np.array(coupling.periods)) for row in found.q) < 1e-9
        near = compiled.solve(goal, own, sort="nearest", limits=False, **given)
        np.testing.assert_allclose(near.q[0], own, atol=1e-8)


def test_every_configuration_of_the_palletiser_is_found(solvers):
    spec, solver, _ = solvers("palletiser")
    assert solver.n == 4
    q = np.random.default_rng(2).uniform(-3, 3, (400, 4))
    goals = poses(spec, q)
    found = solver.solve_batch(goals, limits=False)
    for own, goal, rows, count in zip(q, goals, found.q, found.counts, strict=True):
        assert np.abs(poses(spec, rows[:count]) - goal).max() < 1e-12
        assert min(apart(own, row, [2 * np.pi] * 4) for row in rows[:count]) < 1e-9
    assert set(found.counts.tolist()) <= {2, 4}
    rows = solver.plan.coupling.rows([0.2, 0.3, 0.8, 0.1])
    rows[3] += 0.4  # in the plane of the arm, which the rows reach and their coupling does not
    tilted = solver.plan.chain.forward(rows)
    missed = solver.solve(tilted)
    assert missed.status == "unreachable"
    assert "keeps the coupling" in missed.reason
    assert missed.distance > 0.1
    partly = solver.solve(tilted, residual=True, limits=False)
    assert len(partly)
    assert np.all(partly.flags & 8)
    assert partly.residual.min() == pytest.approx(solver.closest(tilted, limits=False).residual[0], rel=1e-6)


def test_limits_of_followers_count(solvers):
    """The forearm may be between -75 and 65 degrees against the upper arm: that is no limit of one drive."""
    spec, solver, _ = solvers("palletiser")
    inside, outside = np.radians([20, 10, 40, 5]), np.radians([20, -35, 40, 5])
    goals = poses(spec, np.array([inside, outside]))
    assert apart(solver.solve(goals[0]).q[0], inside, [2 * np.pi] * 4) < 1e-9
    assert solver.solve(goals[1]).status == "outside limits"
    flagged = solver.solve(goals[1], limits=False)
    assert len(flagged)
    assert all(flagged.flags & 4)


def test_drives_behind_gears_have_one_configuration_for_every_full_turn_of_the_joints(solvers):
    spec, solver, _ = solvers("geared")
    q = np.random.default_rng(4).uniform(-6, 6, (10, 3))
    goals = poses(spec, q)
    periods = [4 * np.pi, 6 * np.pi, 2 * np.pi]
    found = solver.solve_batch(goals, limits=False)
    for own, goal, rows, count in zip(q, goals, found.q, found.counts, strict=True):
        rows = rows[:count]
        assert np.abs(poses(spec, rows)[:, :3, 3] - goal[:3, 3]).max() < 1e-12
        assert min(apart(own, row, periods) for row in rows) < 1e-9
        assert min(apart(a, b, periods) for i, a in enumerate(rows) for b in rows[:i]) > 1e-3
    near = solver.solve(goals[0], q_ref=q[0], sort="nearest", limits=False)
    assert np.abs(near.q[0] - q[0]).max() < 1e-9


def test_casadi_gives_the_configuration_of_each_branch_in_joint_positions(solvers):
    """Where the branch keeps the coupling; NaN elsewhere; and the derivative is that of the drives."""
    casadi = pytest.importorskip("casadi")
    from rrrgen.emit.casadi.inverse_kinematics import branch_function, branch_signs

    spec, solver, _ = solvers("palletiser")
    own = np.array([0.3, 0.4, 0.9, -0.2])
    goal = poses(spec, own[None])[0]
    function = branch_function(spec)
    found = solver.solve(goal, limits=False)
    rows = {tuple(branch_signs(solver.labels, branch)): q for q, branch in zip(found.q, found.branch, strict=True)}
    for signs in product((1, -1), repeat=3):
        q = np.array(function(goal, signs)).ravel()
        assert np.isfinite(q).all() == (signs in rows)
        if signs in rows:
            assert apart(q, rows[signs], 2 * np.pi) < 1e-9
    T, signs = casadi.SX.sym("T", 4, 4), next(iter(rows))
    slope = casadi.Function("slope", [T], [casadi.jacobian(function(T, signs), T)])
    h, q = 1e-6, rows[signs]
    change = (poses(spec, q + h * np.eye(4)) - poses(spec, q - h * np.eye(4))) / (2 * h)
    columns = np.array([each.T.ravel() for each in change]).T  # CasADi counts down the columns
    np.testing.assert_allclose(np.array(slope(goal)) @ columns, np.eye(4), atol=1e-6)

    spec, solver, _ = solvers("geared")
    function, goal, coupling = branch_function(spec), poses(spec, np.array([[0.3, 0.4, 0.9]]))[0], solver.plan.coupling
    found = solver.solve(goal, limits=False)
    for q, branch in zip(found.q, found.branch, strict=True):
        each = [function(goal[:3, 3], branch_signs(solver.labels, branch), z) for z in np.ndindex(*coupling.counts)]
        assert min(apart(q, np.array(x).ravel(), np.array(coupling.periods)) for x in each) < 1e-9


@pytest.mark.parametrize("name", ["palletiser", "redundant", "sliding"])
def test_no_compiler_warns_of_the_emitted_code(name, tmp_path):
    for real, compilers in (
        ("double", (["clang", *C99], ["g++", *CXX])),
        ("float", (["gcc", *C99], ["clang++", *CXX])),
    ):
        write(sources(loads_spec(TEXTS[name]), real), tmp_path / real)
        for command in compilers:
            if shutil.which(command[0]) is not None:
                run_clean([*command, "-fsyntax-only", f"{name}_ik.c"], tmp_path / real)


def run_clean(command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[:3000]


def test_the_self_test_of_a_mechanism_passes_under_the_sanitizers(tmp_path):
    """Of all functions and of the inverse kinematics; more links than joints, so that sizes tell them apart."""
    compiler("gcc")
    spec = loads_spec(MECHANISM)
    model = derive(spec)
    checks = [SelfTestCheck("inverse_kinematics", "linkage_ik.h", selftest(spec, "float"))]
    backend = CBackend(beside=lambda: (sources(spec, "float"), checks))
    folder = write(backend.files(model, IDENTITY, "float"), tmp_path)
    done = run(compile_all(folder, ["gcc", *C99, *SANITIZERS]))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "ok      inverse kinematics: rows of golden targets" in done.stdout


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_slides_of_a_telescope_are_one_joint(backend):
    """Parallel and antiparallel slides, inside an arm and at its end: their drive has the place that made the pose."""
    for text in (TELESCOPE, REACH) if backend == "numpy" else (REACH,):
        spec = loads_spec(text)
        solver = load_solver(spec, backend=backend)
        q = np.random.default_rng(3).uniform(-2, 2, (10, spec.n)) * np.where(solver.plan.coupling.revolute, 1.0, 0.2)
        goals = poses(spec, q)
        entries = np.s_[:3, 3] if solver.plan.task == "position" else np.s_[:3]
        for own, goal in zip(q, goals, strict=True):
            found = solver.solve(goal, limits=False)
            assert max(np.abs((T - goal)[entries]).max() for T in poses(spec, found.q)) < 1e-12
            periods = np.array(solver.plan.coupling.periods)
            assert min(apart(own, row, periods) for row in found.q) < 1e-9
            if text is TELESCOPE:
                outside = (found.q[:, 2] < 0) | (found.q[:, 2] > 0.5)
                np.testing.assert_array_equal(found.flags & 4 != 0, outside)


def test_telescopes_in_other_forms():
    """The chain whose joints are solved, the closed form, CasADi, and slides with a drive each, which stay two."""
    pytest.importorskip("casadi")
    from rrrgen.emit.casadi.inverse_kinematics import branch_function, branch_signs

    for text in (TELESCOPE, REACH):
        spec = loads_spec(text)
        chain, S = solved_chain(spec)
        assert (chain.types.count("P"), S.shape) == (1, (spec.n, spec.n))
        for q in np.random.default_rng(5).uniform(-1, 1, (3, spec.n)):
            np.testing.assert_allclose(chain.forward(np.array(S, float) @ q), poses(spec, q[None])[0], atol=1e-14)
    assert "q_3 = y_3/3" in closed_form(spec).text()
    own = np.array([0.3, 0.4, 0.1])
    goal = poses(spec, own[None])[0][:3, 3]
    found = load_solver(spec, backend="numpy").solve(goal, limits=False)
    function, labels = branch_function(spec), load_solver(spec, backend="numpy").labels
    for q, branch in zip(found.q, found.branch, strict=True):
        assert apart(np.array(function(goal, branch_signs(labels, branch))).ravel(), q, 2 * np.pi) < 1e-9
    two = loads_spec(REACH.replace("follows: {boom: -2}", "follows: {tube: 1, boom: -2}"))
    assert solved_chain(two)[0].types == "RRPP"
    assert "move the tip in only" in plan(two).reason


def test_the_closed_form_ends_with_the_joint_positions():
    text = closed_form(load_spec(PALLETISER)).text()
    assert "q_3 = y_2 + y_3" in text
    assert "y_4 = -q_3    (up to full turns; otherwise no solution)" in text
    assert "q_2 = 3*y_2/2 + 3*pi*z_2    (z_2 = 0 to 1)" in closed_form(loads_spec(GEARED)).text()


def test_what_does_not_determine_q_is_refused_with_the_reason():
    text = PALLETISER.read_text(encoding="utf-8").replace("tip: turn", "tip: shoulder")
    with pytest.raises(DerivationError, match="elbow, turn do not move the tip"):
        load_solver(loads_spec(text), backend="numpy")
    mixed = REDUNDANT.replace("{a: 1/2}", "{a: 1/2, b: 1}")
    with pytest.raises(DerivationError, match="a cannot be prescribed, because it follows several joints"):
        load_solver(loads_spec(mixed), 0, backend="numpy")
    assert plan(loads_spec(mixed)).locked == 3
    ratios = GEARED.replace("q2: 1/3", "q2: 1/2003")
    assert "positions of the drives" in plan(loads_spec(ratios)).reason


FIXED = """\
schema: rrrgen/1
name: bent
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: mount, type: revolute, alpha: 20, a: 0.1, d: 0.2, theta: 15, follows: {}}
  - {name: j1, type: revolute, alpha: 0, a: 0, d: 0.4}
  - {name: j2, type: revolute, alpha: -90, a: 0.1, d: 0}
  - {name: bend, type: revolute, alpha: 0, a: 0.2, d: 0.05, theta: 30, follows: {}}
  - {name: j3, type: revolute, alpha: ALPHA, a: 0.15, d: 0.1}
  - {name: j4, type: revolute, alpha: 90, a: 0, d: 0.3}
  - {name: j5, type: revolute, alpha: -90, a: 0, d: 0}
  - {name: j6, type: revolute, alpha: 90, a: 0, d: 0}
  - {name: flange, type: revolute, alpha: 40, a: 0.02, d: 0.1, theta: 10, follows: {}}
tool: {translation: [0, 0, 0.1]}
"""
"""Fixed rows before the first joint, between two axes at the angle ALPHA, and behind the last joint."""

SLIDE_BETWEEN = """\
schema: rrrgen/1
name: crane
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: turn, type: revolute, alpha: 50, a: 0.1, d: 0.4, theta: 10}
  - {name: bend, type: revolute, alpha: 60, a: 0.2, d: 0.05, theta: 30, follows: {}}
  - {name: twist, type: prismatic, alpha: -20, a: 0.05, d: 0.03, theta: 25, follows: {}}
  - {name: boom, type: prismatic, alpha: 70, a: 0.05, d: 0.3, theta: 20}
  - {name: bow, type: revolute, alpha: 60, a: 0.1, d: 0.07, theta: -30, follows: {}}
  - {name: reach, type: revolute, alpha: 0, a: 0.3, d: 0.1}
"""


@pytest.mark.parametrize("text", [FIXED.replace("ALPHA", angle) for angle in ("90", "60", "0", "180", "1")]
                         + [SLIDE_BETWEEN])  # fmt: skip
def test_fixed_rows_on_the_way_to_the_tip_are_part_of_exact_links(text):
    """No configuration is missed at any angle; only nearly parallel axes with a far perpendicular stay tilted."""
    spec = loads_spec(text)
    chain, S = solved_chain(spec)
    tilted = "alpha: 1," in text
    assert bool(chain.between) == tilted
    assert bool(plan(spec).incomplete) == tilted
    solver = load_solver(spec, backend="numpy")
    scale = np.where(solver.plan.coupling.revolute, 1.0, 0.1)
    for q in np.random.default_rng(6).uniform(-3, 3, (12, spec.n)) * scale:
        goal = poses(spec, q[None])[0]
        np.testing.assert_allclose(chain.forward(np.array(S, float) @ q), goal, atol=1e-14)
        found = solver.solve(goal, limits=False)
        assert min(apart(q, row, np.array(solver.plan.coupling.periods)) for row in found.q) < 1e-7


def test_a_fixed_row_gives_the_plan_of_the_arm_without_it():
    """The bend as gamma and b of its neighbours: theta and d of the row before, in the order of the modified table."""
    text = FIXED.replace("ALPHA", "90")
    bent = plan(loads_spec(text))
    lines = [line for line in text.splitlines() if "follows" not in line]
    straight = plan(loads_spec("\n".join(lines) + "\n"))
    assert (bent.family, bent.title, bent.max_solutions) == (straight.family, straight.title, straight.max_solutions)


@pytest.mark.parametrize("text", [FIXED.replace("ALPHA", "60"), FIXED.replace("ALPHA", "90")])
def test_the_emitted_solver_of_a_bent_arm_finds_every_configuration(text):
    spec = loads_spec(text)
    solver = load_solver(spec)
    q = np.random.default_rng(8).uniform(-3, 3, (2000, spec.n))
    found = solver.solve_batch(poses(spec, q), limits=False)
    nearest = [
        min((apart(own, row, [2 * np.pi] * 6) for row in rows[:count]), default=np.inf)
        for own, rows, count in zip(q, found.q, found.counts, strict=True)
    ]
    assert max(nearest) < 1e-6


def test_gamma_and_b_give_the_chain_of_a_fixed_row_with_theta_and_d():
    """Placed by gamma and b, by a fixed row, or by theta and d of the row before: one arm, one plan."""
    bend = "  - {name: bend, type: revolute, alpha: 0, a: 0.2, d: 0.05, theta: 30, follows: {}}\n"
    fixed = FIXED.replace("ALPHA", "60").replace(bend, bend.replace("a: 0.2", "a: 0"))
    placed = FIXED.replace(bend, "").replace("alpha: ALPHA,", "gamma: 30, b: 0.05, alpha: 60,")
    plans = [plan(loads_spec(text)) for text in (fixed, placed)]
    assert plans[0].title == plans[1].title
    q = np.random.default_rng(3).uniform(-3, 3, (5, 6))
    goals = poses(loads_spec(placed), q)
    np.testing.assert_allclose(poses(loads_spec(fixed), q), goals, atol=1e-14)
    np.testing.assert_allclose([plans[1].chain.forward(row) for row in q], goals, atol=1e-14)
    first = placed.replace("theta: 15, follows: {}", "theta: 15, gamma: 40, b: 0.3, follows: {}")
    spec = loads_spec(first)
    np.testing.assert_allclose([plan(spec).chain.forward(row) for row in q], poses(spec, q), atol=1e-14)
