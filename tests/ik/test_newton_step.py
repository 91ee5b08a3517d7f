"""Calibrated arms solved from the nominal arm: the same solutions as by general equations, and what is said of it."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from ik.checks import sample
from ik.robots import ROWS, make
from ik.test_calibrated import calibrated
from rrrgen.emit.c.ik.files import emit, manifest
from rrrgen.ik.classify import plan
from rrrgen.ik.geometry.nearly_special import deviation
from rrrgen.ik.recording.newton_step import error_program, newton_program
from rrrgen.ik.tolerances import nominal_margins
from rrrgen.program import evaluate
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.runtime.inverse_kinematics import load_solver

UR_LIST = [
    ("R", 1.5703, 3.5e-05, 0.1807, 1.25e-05),
    ("R", 0.0007, 0.0125, 321.0625, 0.8125),
    ("R", 0.0013, -0.5625, -327.5, -1.0625),
    ("R", 1.57, -5.5e-05, 6.625, 0.25),
    ("R", -1.5704, 6.25e-05, 0.11983, -3.5e-07),
    ("R", 0.0, 0.0, 0.11567, 2.5e-08),
]
"""A list as of a Universal Robots arm: axes 2, 3, 4 nearly parallel, frames hundreds of metres away."""

ARMS = {  # rows, family of the nominal arm, least share of poses that it solves; general solvers of other tests
    "UR list": (UR_LIST, "parallel", 0.5),
    "Panda 1e-3 off": (calibrated(ROWS["panda"], 1e-3), "spherical", 0.2),
    "Stanford 1e-5 off": (calibrated(ROWS["stanford"], 1e-5), "spherical", 0.8),
}


def asked(rows, name="arm"):
    return replace(make(name, rows), ik="nominal_first")


@pytest.mark.sweep(but=["Panda 1e-3 off"])
@pytest.mark.parametrize(
    "name", ["UR list", "Panda 1e-3 off", pytest.param("Stanford 1e-5 off", marks=pytest.mark.sweep)]
)
def test_every_solution_of_the_general_equations_is_found(name):
    rows, family, share = ARMS[name]
    solver = load_solver(asked(rows))
    assert solver.plan.companion.family == family
    fast, general = sample("arm", rows, N=400, solver=solver), sample("arm", rows, N=400)
    fast.assert_right()
    assert np.array_equal(fast.batch.counts, general.batch.counts)
    from_nominal = np.any(fast.batch.q[:, 0] != general.batch.q[:, 0], axis=1)
    assert share < np.mean(from_nominal) < 1  # in doubt the same general equations give the same bits
    for q, label, others, labels in zip(
        *(getattr(s.batch, k) for s in (fast, general) for k in ("q", "branch")), strict=True
    ):
        apart = np.abs(fast.wrapped(q[0] - others)).max(axis=1)
        assert label[0] == labels[np.nanargmin(apart)]


def exact(rows, q):
    """Pose of the tip with 40 digits: doubles lose digits over frames kilometres away."""
    with mpmath.workdps(40):
        T = mpmath.eye(4)
        for (_, alpha, a, d, theta), x in zip(rows, q, strict=True):
            c, s = mpmath.cos(mpmath.mpf(theta) + float(x)), mpmath.sin(mpmath.mpf(theta) + float(x))
            ca, sa = mpmath.cos(alpha), mpmath.sin(alpha)
            T *= mpmath.matrix([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
        return T


def test_far_frames_cost_solutions_no_digits():
    """A list with d of kilometres: poses are met to 1e-12 of the reach, which forward kinematics in doubles is not."""
    rows = [list(row) for row in UR_LIST]
    rows[1][3] += 6000.0
    rows[2][3] -= 6000.0 / np.cos(0.0007)
    solver = load_solver(asked([tuple(row) for row in rows]))
    for q in np.random.default_rng(6).uniform(-np.pi, np.pi, (6, 6)):
        T = exact(rows, q)
        found = solver.solve(np.array(T.tolist(), float)).q
        assert len(found) >= 2
        for row in found:
            off = exact(rows, row) - T
            assert max(abs(float(off[i, k])) for i in range(3) for k in range(4)) < 1e-12 * solver.plan.chain.reach


def test_the_step_is_that_of_the_jacobian():
    chain = plan(make("arm", UR_LIST)).chain
    q, off = np.random.default_rng(0).uniform(-3, 3, 6), np.full(6, 1e-4)
    T = chain.forward(q)
    J = chain.jacobian(q + off)
    J[:3] /= chain.reach
    step, error, moved, inverse, det = evaluate(newton_program(chain, None), q + off, T[:3].ravel())
    np.testing.assert_allclose(step, -off, atol=3e-7)
    np.testing.assert_allclose(moved, step @ step, rtol=1e-12)
    np.testing.assert_allclose(evaluate(error_program(chain), q + off, T[:3].ravel())[0], error, rtol=1e-12)
    np.testing.assert_allclose(error, np.sum((J @ off) ** 2), rtol=1e-3)
    np.testing.assert_allclose(inverse, np.linalg.norm(np.linalg.inv(J)) ** 2, rtol=1e-9)
    np.testing.assert_allclose(det, np.linalg.det(J), rtol=1e-9)


def test_far_frames_do_not_count_as_reach():
    chain = plan(make("arm", UR_LIST)).chain
    assert 1 < chain.reach < 2
    T = np.eye(4)
    for matrix in chain.transforms:
        T = T @ np.vstack([np.array(matrix, float), [0, 0, 0, 1]])
    zero = -np.array([joint.offset for joint in chain.joints])
    np.testing.assert_allclose(T, chain.forward(zero), atol=2e-13)


def test_what_is_nominal_is_said():
    spec = asked(UR_LIST)
    found = plan(spec)
    assert "axes 2 and 3 parallel (off by 0.0007 rad)" in found.approach
    assert "planar triple 2-3-4" in found.approach
    assert 1e-3 < deviation(found.chain, found.companion.solving) == found.nominal_first.deviation < 1e-2
    assert "Nominal first: the at most 8 solutions" in emit(spec, found).files["arm_ik.h"]
    said = manifest(spec)["nominal_first"]
    assert (said["family"], said["deviation"]) == ("parallel", found.nominal_first.deviation)
    assert said["operations_of_a_step"]["sincos"] == 0
    assert loads_spec(dumps(spec)).ik == "nominal_first"


@pytest.mark.parametrize(("name", "why"), [("puma", "no general equations"), ("jaco2", "no special arm")])
def test_a_wish_without_effect_is_answered(name, why):
    found = plan(asked(ROWS[name], name))
    assert found.nominal_first is None
    assert found.approach.startswith(f"ik: nominal_first has no effect: {why}")


def test_float_has_margins_of_its_own():
    double, single = (nominal_margins(1e-3, real) for real in ("double", "float"))
    assert single.keys() == double.keys()
    assert single["margin_slack"] == double["margin_slack"] == pytest.approx(0.05)
    assert single["distinct"] > double["distinct"]
    assert single["newton_met"] > np.finfo(np.float32).eps ** 2 > double["newton_met"] > np.finfo(float).eps ** 2
    assert manifest(asked(UR_LIST), "float")["nominal_first"]["margins"]["distinct"] == 1e-3


def test_general_equations_are_the_default():
    found = plan(make("arm", UR_LIST))
    assert (found.nominal_first, found.approach) == (None, "")
