"""Six revolute joints without special structure: every root, no wrong row, sixteen where there are sixteen."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess

import numpy as np
import pytest

from ik.checks import sample
from ik.robots import ROWS, make, reference, robot, table
from oracles.inverse_kinematics import same_sets, solve_all
from oracles.newton_euler import Robot, jacobian
from rrrgen.base.cache import cache_directory
from rrrgen.base.errors import DerivationError
from rrrgen.emit.c.ik.files import emit
from rrrgen.emit.casadi.inverse_kinematics import branch_function
from rrrgen.emit.latex.inverse_kinematics import closed_form
from rrrgen.ik.classify import plan
from rrrgen.ik.solutions import elimination
from rrrgen.ik.solutions.elimination import Elimination, eliminations
from rrrgen.ik.solutions.general_6r import general6r_tables, tables_of
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import INEXACT, MULTIPLE

POSES = 500  # per arm; ten thousand poses over these and random arms miss none

MANSEUR_DOTY = table(
    "RRRRRR",
    [np.pi / 2, np.pi / 180, np.pi / 2, np.pi / 180, np.pi / 2, np.pi / 180],
    [0.3, 1.0, 0.0, 1.5, 0.0, 0.0],
    [0.0, 0.0, 0.2, 0.0, 0.0, 0.0],
)
SIXTEEN = np.array(
    [
        [-0.760117, -0.641689, 0.102262, -1.140175],
        [0.133333, 0.0, 0.991071, 0.0],
        [-0.635959, 0.766965, 0.085558, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def oracle(rows) -> Robot:
    return Robot("standard", tuple(("revolute", *row[1:]) for row in rows))


def random_arm(seed: int) -> list:
    rng = np.random.default_rng(seed)
    angles, lengths = rng.uniform(-3, 3, (2, 6)), rng.uniform(-0.6, 0.6, (2, 6))
    return table("RRRRRR", angles[0], lengths[0], lengths[1], angles[1])


def calibrated(name: str, error: float, seed: int = 3) -> list:
    """The table of an industrial arm as a calibration finds it: every entry a little off."""
    rng = np.random.default_rng(seed)
    return [(kind, *(np.array(values) + error * rng.normal(size=4))) for kind, *values in ROWS[name]]


ARMS = {
    "random 1": random_arm(1),
    "random 2": random_arm(2),
    "random 3": random_arm(3),
    "UR5 1e-3 off": calibrated("ur5", 1e-3),
    "UR5 1e-5 off": calibrated("ur5", 1e-5),
    "Puma 1e-3 off": calibrated("puma", 1e-3),
    "Puma 5e-2 off": calibrated("puma", 5e-2),
    "Manseur-Doty": MANSEUR_DOTY,
}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.sweep(but=["random 1", "Manseur-Doty"])
def test_every_row_is_right_and_no_seed_is_missed(name):
    result = sample("arm", ARMS[name], N=POSES)
    assert result.solver.plan.family == "general6r"
    assert result.solver.plan.max_solutions == 16
    result.assert_right()
    assert np.all(result.batch.counts % 2 == 0)  # complex roots come in pairs


def test_roots_that_two_solutions_share_are_no_multiple_solutions():
    """The kept angle of this arm always belongs to two solutions; rows far from singular were marked as double."""
    solver = load_solver(robot("crx10ia"))
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (170, 6))
    batch = solver.solve_batch(np.array([solver.plan.chain.forward(x) for x in q]))
    assert np.all(batch.counts % 2 == 0)
    flagged = [batch.q[i, k] for i, k in zip(*np.nonzero(batch.flags & MULTIPLE), strict=True)]
    assert all(np.linalg.svd(solver.plan.chain.jacobian(x))[1][-1] < 1e-5 for x in flagged)


@pytest.mark.sweep
def test_an_elimination_of_almost_the_right_degree_is_not_used():
    """Axes antiparallel but for 3e-4 rad: one elimination costs few digits and has a remainder of 4e-10 above degree 8.

    Pairs of close roots were lost in that remainder, well-conditioned rows with them.
    """
    rows = table(
        "RRRRRR",
        (3.14161, -1.5714, 3.14186, 1.57041, 0.90167, 0.90083),
        (0.49929, 0.30025, 0.30045, 0.29957, -0.20018, 0.30036),
        (0.00044, 0.0001, 0.09976, -0.00019, 0.10059, 0.0004),
        (0.3, 0.0, 1.5708, 0.3, 0.3, 0.0),
    )
    assert all(e.pure for e in tables_of(plan(make("arm", rows)).solving).eliminations)
    q = [
        [-1.044, -2.624, 0.318, 1.042, -1.716, 2.593],
        [1.909, 2.329, -3.066, -1.695, 1.348, 3.115],
        [1.612, 3.036, 0.507, 2.05, 0.997, 1.487],
        [0.301, -1.55, -1.617, -0.338, -0.293, -0.508],
    ]
    sample("arm", rows, q=q).assert_right()


def test_base_tool_offsets_and_a_reference_are_taken_into_account():
    turned = np.array([[0.0, -1.0, 0.0, 0.3], [1.0, 0.0, 0.0, -0.1], [0.0, 0.0, 1.0, 0.2], [0.0, 0.0, 0.0, 1.0]])
    result = sample("arm", ARMS["random 1"], N=100, base=turned, tool=turned @ turned)
    result.assert_right()
    q_ref = np.full(6, 20.0)
    rows = result.solver.solve(result.T[0], q_ref=q_ref, limits=False).q
    assert np.abs(rows - q_ref).max() <= np.pi + 1e-12
    assert np.abs(reference(result.rows, rows, **result.frames) - result.T[0]).max() < 1e-12


def test_an_arm_with_sixteen_real_solutions():
    target = SIXTEEN.copy()
    u, _, v = np.linalg.svd(target[:3, :3])
    target[:3, :3] = u @ v
    rows = load_solver(make("arm", MANSEUR_DOTY)).solve(target).q
    assert len(rows) == 16
    assert np.abs(reference(MANSEUR_DOTY, rows) - target).max() < 1e-12
    apart = np.abs((rows[:, None] - rows[None] + np.pi) % (2 * np.pi) - np.pi).max(axis=2)
    assert (apart + np.eye(16) * 9).min() > 1e-3


@pytest.mark.sweep(but=["1"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_sets_are_those_of_a_search_from_many_starts(seed):
    rows = random_arm(seed)
    robot = oracle(rows)
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (2, 6))
    solver = load_solver(make("arm", rows))
    for target in reference(rows, q):
        assert same_sets(robot, solver.solve(target).q, solve_all(robot, target, seed=seed))


@pytest.mark.parametrize("name", ["random 1", "UR5 1e-3 off", "Manseur-Doty"])
@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-8, 1e-4])
def test_round_angles_and_their_neighbours_give_no_wrong_row(name, offset):
    rng = np.random.default_rng(8)
    q = rng.integers(-2, 3, (40, 6)) * np.pi / 2 + offset
    result = sample("arm", ARMS[name], q=q)
    assert np.isfinite(result.found).all()
    assert np.all(result.batch.counts > 0)
    assert result.errors().max() < 1e-12
    assert result.repeated() == 0


def test_out_of_reach_is_said_and_the_nearest_configuration_is_given():
    solver = load_solver(make("arm", ARMS["random 1"]))
    target = np.eye(4)
    target[:3, 3] = 20.0
    result = solver.solve(target)
    assert len(result) == 0
    assert "degree-16 equation" in result.reason
    nearest = solver.closest(target)
    assert nearest.flags[0] & INEXACT
    assert np.isfinite(nearest.q).all()


def test_what_the_family_does_not_offer_is_refused_or_said():
    spec = make("arm", ARMS["random 2"])
    with pytest.raises(DerivationError, match="no closed form per branch"):
        branch_function(spec)
    form = closed_form(spec)
    assert form.steps == ()
    assert "polynomial of degree 16" in form.text()
    with pytest.raises(DerivationError, match="no closed-form steps"):
        form.latex()


def test_exact_special_arms_are_not_handed_to_the_general_solver():
    for name, family in (("ur5", "parallel"), ("puma", "spherical")):
        assert plan(make("arm", ROWS[name])).family == family
    near = plan(make("arm", calibrated("ur5", 1e-3)))
    assert (near.family, near.companion.family) == ("general6r", "parallel")


def test_eliminations_are_ranked_and_singular_ones_left_out():
    rows = np.array([[row[1], row[2], row[3]] for row in random_arm(1)])
    found = eliminations(rows)
    assert [e.score for e in found] == sorted(e.score for e in found)
    assert len(found) > len(eliminations(np.array([[row[1], row[2], row[3]] for row in ROWS["ur5"]])))
    for pointless in (0.0 * rows, np.array([[1.0, 0.0, 0.0]] * 5 + [[1.0, 0.0, 1.0]])):  # nothing moves the tip
        with pytest.raises(DerivationError):
            general6r_tables(*pointless.T)


def test_eliminations_are_searched_once(tmp_path, monkeypatch):
    """The cache gives what the search found, whether or not it can be written; the chain decides, to the last bit."""
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path / "cache"))
    cache_directory.cache_clear()
    searched = []

    def search(*chain):
        searched.append(chain)
        return [Elimination(4, -1, 0, 1, 2, 1.25, -3.5, True)]

    monkeypatch.setattr(elimination, "_search", search)
    rows = [row[1:4] for row in random_arm(1)]
    assert eliminations(rows) == eliminations(np.array(rows)) == search(rows)
    assert len(searched) == 2
    nearby = [rows[0], (np.nextafter(rows[1][0], 9.0), *rows[1][1:]), *rows[2:]]
    for other in ((nearby,), (rows, 2), (rows, 2, 0.5)):
        eliminations(*other)
    assert len(searched) == 5
    if os.name == "posix":
        (tmp_path / "cache").chmod(0o777)  # others may write to it
        cache_directory.cache_clear()
        assert eliminations(rows) == search(rows)
    cache_directory.cache_clear()


@pytest.mark.parametrize("name", ["random 1", "UR5 1e-5 off"])
def test_the_branch_label_is_the_sign_of_the_jacobians_determinant(name):
    result = sample("arm", ARMS[name], N=40)
    robot = oracle(result.rows)
    both = set()
    for T in result.T:
        answer = result.solver.solve(T)
        for q, branch in zip(answer.q, answer.branch, strict=True):
            determinant = np.linalg.det(jacobian(robot, q))
            if abs(determinant) > 1e-9:
                both.add(int(branch))
                assert result.solver.branch_names(branch) == {"aspect": int(determinant < 0)}
    assert both == {0, 1}


def test_the_label_stays_the_same_along_a_path_without_singular_configurations():
    rows = ARMS["random 2"]
    solver, robot = load_solver(make("arm", rows)), oracle(rows)
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, 6)
    path = q + np.linspace(0.0, 0.05, 12)[:, None] * np.array([1.0, -1.0, 0.5, 1.0, -0.5, 1.0])
    labels = []
    for step, target in zip(path, reference(rows, path), strict=True):
        answer = solver.solve(target, q_ref=step)
        nearest = np.abs(answer.q - step).max(axis=1).argmin()
        assert np.abs(answer.q[nearest] - step).max() < 1e-9
        labels.append(int(answer.branch[nearest]))
    signs = np.sign([np.linalg.det(jacobian(robot, step)) for step in path])
    assert np.all(signs == signs[0])
    assert set(labels) == {int(signs[0] < 0)}


@pytest.mark.parametrize("name", ["puma", "ur5", "jaco2"])
def test_the_sets_are_those_of_another_solver(name):
    ssik = pytest.importorskip("ssik")
    rows = ROWS[name]
    if any(row[4] for row in rows):
        rows = [(*row[:4], 0.0) for row in rows]
    other = ssik.Manipulator.from_dh(*([row[k] for row in rows] for k in (1, 2, 3)))
    robot, solver = oracle(rows), load_solver(make("arm", rows))
    q = np.random.default_rng(11).uniform(-np.pi, np.pi, (5, 6))
    for target in reference(rows, q):
        theirs = np.array([solution.q for solution in other.solve(target, respect_limits=False)])
        assert same_sets(robot, solver.solve(target, limits=False).q, theirs)


@pytest.mark.skipif(shutil.which("gcc") is None or shutil.which("nm") is None, reason="gcc and nm are not installed")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="the limit is for x86-64")
def test_the_code_of_the_general_solver_stays_below_24_kilobytes(tmp_path):
    """Half of it counts the solutions and finds all that share a root, which proves that none is missing."""
    spec = make("arm", ARMS["random 1"])
    files = emit(spec, plan(spec)).files
    for file, text in files.items():
        (tmp_path / file).write_text(text)
    subprocess.run(["gcc", "-std=c99", "-Os", "-c", "arm_ik.c"], cwd=tmp_path, check=True)
    table = subprocess.run(["nm", "-S", "arm_ik.o"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    sizes = {fields[3]: int(fields[1], 16) for line in table.splitlines() if len(fields := line.split()) == 4}
    own = {name: size for name, size in sizes.items() if re.search(r"_(6r|trig8|solve6r|branches)", name)}
    code = {line.split()[-1] for line in table.splitlines() if line.split()[-2] in "tT"}
    assert 5000 < sum(size for name, size in own.items() if name in code) <= 24 * 1024
