"""Arms as a calibration finds them, seven joints and a sliding one among them: no configuration is lost in silence."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from ik.chains import spherical
from ik.checks import sample
from ik.robots import ROWS, make, reference
from oracles.inverse_kinematics import same_sets, solve_all
from oracles.newton_euler import Robot
from rrrgen.emit.c.ik.files import emit, manifest
from rrrgen.ik.classify import plan
from rrrgen.ik.result_layout import STATUS
from rrrgen.ik.solutions.elimination import eliminations
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import MULTIPLE
from rrrgen.verify.inverse_kinematics import check_inverse_kinematics
from rrrgen.verify.references.numeric_robot import chain_of
from rrrgen.verify.report import Collector

POSES = 200  # in the suite; `python -m bench.calibrated` takes ten thousand each


def calibrated(rows: list, error: float, seed: int = 3) -> list:
    """Normal errors: ``error`` (rad) in alpha, half of it (m) in a and d; the d of a sliding joint is its own."""
    rng = np.random.default_rng(seed)
    found = []
    for kind, alpha, a, d, theta in rows:
        x, y, z = rng.normal(size=3) * error * np.array([1.0, 0.5, 0.5])
        found.append((kind, alpha + x, a + y, d + (z if kind == "R" else 0.0), theta))
    return found


def arm(types: str, seed: int) -> list:
    """No special value anywhere."""
    rng = np.random.default_rng(seed)
    alpha, theta = rng.uniform(-3, 3, (2, len(types)))
    a, d = rng.uniform(-0.6, 0.6, (2, len(types)))
    return [(kind, *row) for kind, *row in zip(types, alpha, a, d, theta, strict=True)]


SEVEN = {
    "Panda 1e-3 off": (calibrated(ROWS["panda"], 1e-3), 6, "spherical"),
    "iiwa14 1e-5 off": (calibrated(ROWS["iiwa14"], 1e-5), 6, "spherical"),
    "seven joints": (arm("RRRRRRR", 1), 6, None),
    "seven joints, the first slides": (arm("PRRRRRR", 1), 0, None),
}


@pytest.mark.parametrize("name", SEVEN)
@pytest.mark.sweep(but=["Panda 1e-3 off"])
def test_seven_joints_are_complete_with_an_end_joint_prescribed(name):
    rows, locked, companion = SEVEN[name]
    result = sample("arm", rows, N=POSES)
    found = result.solver.plan
    assert (found.family, found.locked) == ("general6r", locked)
    assert (found.companion.family if found.companion else None) == companion
    assert found.incomplete == ""
    assert found.companion is None or found.companion.locked == locked
    result.assert_right()
    assert np.all(result.found[:, locked] == np.repeat(result.q[:, locked], result.batch.counts))
    assert np.all(result.batch.statuses == 0)


@pytest.mark.sweep(but=["1e-05"])
@pytest.mark.parametrize("error", [1e-5, 5e-3])
def test_a_calibrated_stanford_arm_is_complete(error):
    result = sample("arm", calibrated(ROWS["stanford"], error), N=POSES)
    found = result.solver.plan
    assert (found.family, found.companion.family, found.incomplete) == ("general5r1p", "spherical", "")
    result.assert_right()


@pytest.mark.parametrize("place", range(6))
@pytest.mark.sweep(but=["3"])
def test_a_joint_that_slides_may_stand_anywhere(place):
    types = "RRRRRR"[:place] + "P" + "RRRRRR"[place + 1 :]
    result = sample("arm", arm(types, 1), N=POSES)
    assert (result.solver.plan.family, result.solver.plan.max_solutions) == ("general5r1p", 16)
    result.assert_right()
    assert np.all(result.batch.counts % 2 == 0)  # complex roots come in pairs


def test_base_tool_and_modified_rows_are_taken_into_account():
    turned = np.array([[0.0, -1.0, 0.0, 0.3], [1.0, 0.0, 0.0, -0.1], [0.0, 0.0, 1.0, 0.2], [0.0, 0.0, 0.0, 1.0]])
    result = sample("arm", arm("RRRRRPR", 4), N=50, base=turned, tool=turned @ turned, convention="modified")
    assert (result.solver.plan.family, result.solver.plan.locked) == ("general5r1p", 6)
    result.assert_right()


def test_the_sets_are_those_of_a_search_from_many_starts():
    rows = arm("RRRPRR", 1)
    robot = Robot("standard", tuple(("revolute" if kind == "R" else "prismatic", *row) for kind, *row in rows))
    solver = load_solver(make("arm", rows))
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (2, 6))
    for target in reference(rows, q):
        assert same_sets(robot, solver.solve(target).q, solve_all(robot, target, seed=2))


def test_exact_special_arms_keep_their_family():
    for name, family, locked in (("panda", "spherical", 6), ("iiwa14", "elbow7", 100), ("stanford", "spherical", None)):
        for rows in (ROWS[name], calibrated(ROWS[name], 1e-11)):
            found = plan(make("arm", rows))
            assert (found.family, found.locked, found.companion, found.incomplete) == (family, locked, None, "")


def test_no_joint_is_prescribed_that_leaves_six_dependent_ones():
    """Two joints on one axis: only what prescribes one of them leaves six that move the tip in six directions."""
    rows = arm("PRRRRRR", 3)
    rows[5] = ("R", 0.0, 0.0, 0.2, 0.4)
    assert plan(make("arm", rows)).locked == 6
    rows = arm("RRRRRRR", 3)
    rows[3] = ("R", 0.0, 0.0, 0.2, 0.4)
    found = plan(make("arm", rows))
    assert (found.family, "no joint can be prescribed" in found.reason) == ("none", True)


def test_a_sliding_joint_is_never_the_kept_one():
    rows = np.array([row[1:4] for row in arm("RRPRRR", 1)])
    rows[2, 2] = 0.0
    found = eliminations(rows, 2, 0.7)
    assert found
    assert all((e.start + e.direction * (2 + e.other)) % 6 == 2 and e.kept_joint != 2 for e in found)


# -- what no complete method solves -----------------------------------------------------------------------------------

PARTIAL = {
    "two joints slide": (calibrated(spherical(3, "RPP", 1), 1e-3), None),
    "an inner joint is prescribed": (calibrated(ROWS["panda"], 1e-3), 4),
}


@cache
def partial(name: str):
    rows, locked = PARTIAL[name]
    return load_solver(make("arm", rows), locked)


@pytest.mark.parametrize("name", PARTIAL)
def test_rows_that_may_not_be_all_come_with_a_status_that_says_so(name):
    rows, locked = PARTIAL[name]
    result = sample("arm", rows, N=POSES, solver=partial(name), redundancy=locked)
    assert result.solver.plan.snapped
    assert "special arm that is nearly this one" in result.solver.plan.incomplete
    assert result.errors().max() < 1e-12
    assert {STATUS[status] for status in result.batch.statuses} == {"incomplete"}
    answer = result.solver.solve(result.T[0], limits=False, **({"redundancy": 0.1} if locked is not None else {}))
    assert (answer.status, answer.reason) == (
        "incomplete",
        "the arm has no complete solver: there may be more configurations",
    )


@pytest.mark.parametrize("name", ["panda", "stanford"])
def test_a_row_that_two_solvers_find_is_no_multiple_root(name):
    result = sample("arm", calibrated(ROWS[name], 1e-3), N=100)
    flags = result.batch.flags[np.arange(16) < result.batch.counts[:, None]]
    assert np.mean(flags & MULTIPLE) < 0.02


def test_the_verifier_does_not_ask_for_rows_that_are_not_claimed():
    spec = make("arm", PARTIAL["two joints slide"][0])
    rows = Collector()
    check_inverse_kinematics(
        SimpleNamespace(ik=partial("two joints slide")), chain_of(spec), 400, np.random.default_rng(1), rows
    )
    assert [name for name, _ in rows.skipped] == [
        "inverse_kinematics: share of seeds not found",
        "inverse_kinematics: share of singular targets without a row",
        "inverse_kinematics: share of other solutions not among the rows",
    ]
    assert len(rows.rows) >= 3
    assert all(row.ok for row in rows.rows)


def test_no_row_is_no_proof_that_there_is_none():
    solver = partial("an inner joint is prescribed")
    target = np.eye(4)
    target[:3, 3] = 50.0
    answer = solver.solve(target, redundancy=0.1)
    assert (len(answer), answer.status) == (0, "incomplete")
    assert "special arm" in answer.reason
    assert "out of reach" not in answer.reason
    target[:3, 3] = 1e9
    assert solver.solve(target, redundancy=0.1).status == "unreachable"


def test_rows_outside_the_limits_are_no_proof_either():
    rows, _ = PARTIAL["two joints slide"]
    spec = make("arm", rows, limits=[(-0.01, 0.01)] * 6)
    answer = load_solver(spec).solve(reference(rows, [0.5, 0.7, 0.4, 0.9, 0.8, 0.3])[0])
    assert (len(answer), answer.status) == (0, "incomplete")
    assert "every configuration that was found lies outside the joint limits" in answer.reason


def test_header_and_manifest_say_so_only_where_it_is_so():
    # a general arm has the status too, for the targets at which the number of solutions is not proved
    partial, special, general = PARTIAL["two joints slide"][0], ROWS["stanford"], arm("RPRRRR", 1)
    for rows, status, said in ((partial, True, True), (special, False, False), (general, True, False)):
        spec = make("arm", rows)
        header = emit(spec, plan(spec)).files["arm_ik.h"]
        assert ("ARM_IK_INCOMPLETE = 5" in header) == status
        assert ("Finds every configuration that brings" in header) != said
        assert bool(manifest(spec)["incomplete"]) == said


def test_the_count_of_lost_configurations_is_one_that_can_fail(monkeypatch):
    """`python -m bench.calibrated` finds what a solver of a slightly different arm loses."""
    from bench import calibrated as count

    specs = dict(count.arms(0))
    assert {"panda 0.005", "stanford 1e-05", "RRRRRRR", "RRRRRP"} <= set(specs)
    rows = count.measured("RRPRRR", specs["RRPRRR"], 50, 0)
    assert rows.sound
    assert (rows.family, rows.missed, rows.incomplete) == ("general5r1p", 0, 0)
    other = load_solver(specs["RRPRRR"])
    monkeypatch.setattr("rrrgen.runtime.inverse_kinematics.load_solver", lambda spec: other)
    moved = count.measured("RPRRRR", specs["RPRRRR"], 50, 0)
    assert not moved.sound
    assert moved.missed == 50
