"""The inverse kinematics without a compiler against the emitted C: rows, order, flags, labels, reasons."""

import numpy as np
import pytest

import rrrgen
from ik.chains import planar, position, spherical
from ik.robots import ROWS, make, robot
from ik.test_calibrated import arm, calibrated
from rrrgen.base.errors import BuildError
from rrrgen.ik.families import parameter
from rrrgen.runtime import build
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import FREE
from rrrgen.verify import verify


def limited(name):
    return make(f"{name}limited", ROWS[name], limits=[(-2.0, 2.2)] * len(ROWS[name]))


def nearly_spherical():
    """A wrist whose axes pass each other by 0.1 nm: solved as the special arm, refined on the true one."""
    rows = [list(row) for row in ROWS["puma"]]
    rows[4][2] = 1e-10
    return [tuple(row) for row in rows]


ARMS = {
    **{name: robot(name) for name in ("rrr", "ortho3r", "puma", "ur5", "irb6640", "stanford", "scara", "iiwa14")},
    "puma with limits": limited("puma"),
    "scara with limits": limited("scara"),
    "sliding": make("sliding", position("PRP", 1)),
    "quartic in a length": make("quarticlength", spherical(0, "RPR", 1)),
    "parallel": make("parallel", planar(2, "RPR", "RRR", 1)),
    "five joints": make("five", ROWS["puma"][:5]),
    "nearly special": make("nearly", nearly_spherical()),
}
POSES = 14


def targets(chain, rng):
    """Regular, singular, zero, and moved away."""
    for k in range(POSES):
        q = rng.uniform(-2.0, 2.0, chain.n)
        if k % 4 == 1:
            q[rng.integers(chain.n)] = 0.0
        if k % 4 == 2:
            q = np.round(q * 2 / np.pi) * np.pi / 2
        T = chain.forward(q)
        if k % 7 == 3:
            T[:3, 3] += rng.uniform(-1.0, 1.0, 3) * chain.reach
        yield q, T


@pytest.mark.sweep(but=["nearly special", "iiwa14", "scara with limits"])
@pytest.mark.parametrize("name", ARMS)
def test_the_answer_is_that_of_the_emitted_code(name):
    compiled, evaluated = load_solver(ARMS[name]), load_solver(ARMS[name], backend="numpy")
    rng, plan = np.random.default_rng(4), compiled.plan
    assert not plan.general
    for k, (q, T) in enumerate(targets(plan.chain, rng)):
        options = {"limits": k % 2 == 0, "sort": ("branch", "nearest")[k % 3 == 0]}
        if plan.locked is not None:
            options["redundancy"] = parameter(plan, q)
        reference = rng.uniform(-1.0, 1.0, plan.chain.n) if k % 3 else None
        a, b = (solver.solve(T, reference, **options) for solver in (compiled, evaluated))
        assert (a.status, a.reason) == (b.status, b.reason)
        assert a.flags.tolist() == b.flags.tolist()
        assert a.branch.tolist() == b.branch.tolist()
        np.testing.assert_allclose(b.q, a.q, atol=1e-6)
        np.testing.assert_allclose(b.residual, a.residual, atol=1e-9)
        assert b.distance == pytest.approx(a.distance, abs=1e-6)


def test_a_nearly_special_arm_is_among_them():
    assert load_solver(ARMS["nearly special"]).plan.snapped


def test_a_free_joint_stands_at_its_reference():
    solver, q = load_solver(robot("puma"), backend="numpy"), np.array([0.3, -0.4, 0.5, 0.2, 0.0, 0.4])
    found = solver.solve(solver.plan.chain.forward(q), q)
    nearest = found.q[np.abs(found.q - q).sum(axis=1).argmin()]
    np.testing.assert_allclose(nearest, q, atol=1e-7)
    assert found.flags.max() & FREE


def test_closest():
    compiled, evaluated = (load_solver(robot("rrr"), backend=backend) for backend in ("c", "numpy"))
    a, b = (solver.closest([0.9, 0.8, 0.7], [0.1, 0.2, 0.3]) for solver in (compiled, evaluated))
    np.testing.assert_allclose(b.q, a.q, atol=1e-6)
    assert b.flags.tolist() == a.flags.tolist()
    assert b.distance == pytest.approx(a.distance)


@pytest.mark.parametrize("bad", ["nan", "reflection", "far"])
def test_targets_without_meaning(bad):
    T = np.eye(4)
    if bad == "nan":
        T[0, 3] = np.nan
    elif bad == "far":
        T[0, 3] = 1e9
    else:
        T[2, 2] = -1.0
    a, b = (load_solver(robot("puma"), backend=backend).solve(T) for backend in ("c", "numpy"))
    assert (b.status, b.reason, b.distance, len(b)) == (a.status, a.reason, a.distance, len(a))


def test_no_compiler_is_asked(monkeypatch):
    def refuse(*_arguments, **_options):
        raise BuildError("no compiler")

    monkeypatch.setattr(build, "build_extension", refuse)
    m = rrrgen.compile("rrr", backend="numpy")
    q = np.array([[0.3, -0.4, 0.5], [0.1, 0.2, 1.0]])
    T = m.forward_kinematics(q)
    batch = m.inverse_kinematics(T)
    assert batch.counts.tolist() == [4, 4]
    np.testing.assert_allclose(m.forward_kinematics(batch.q)[..., :3, 3], T[:, None, :3, 3] + 0 * batch.q, atol=1e-12)
    assert m.ik.branch_names(int(batch.branch[0, 3])) == {"shoulder": 1, "elbow": 1}
    report = verify(m, 10, libraries=False)
    assert report.ok
    assert any("inverse_kinematics" in row.function for row in report.rows)


GENERAL = {
    "crx10ia": robot("crx10ia"),
    "the first slides": make("firstslides", position("PRRRRR", 5)),
    "the first of seven given": make("firstseven", arm("PRRRRRR", 1)),
    "calibrated parallel axes": make("nearur", calibrated(ROWS["ur10e"], 1e-4)),
}


@pytest.mark.parametrize("name", GENERAL)
@pytest.mark.sweep(but=["the first slides", "crx10ia"])
def test_eigenvalues_give_the_rows_of_the_emitted_elimination(name):
    """The C finds roots of a determinant, Python eigenvalues: the same set of rows, labels and multiple roots."""
    compiled, evaluated = load_solver(GENERAL[name]), load_solver(GENERAL[name], backend="numpy")
    rng, plan = np.random.default_rng(5), compiled.plan
    assert plan.general
    revolute = [joint.revolute for joint in plan.chain.joints]
    for k in range(6):
        q = rng.uniform(-np.pi, np.pi, plan.chain.n)
        if k == 1:
            q[plan.chain.n // 2] = 0.0
        options = {} if plan.locked is None else {"redundancy": parameter(plan, q)}
        a, b = (solver.solve(plan.chain.forward(q), q, sort="nearest", **options) for solver in (compiled, evaluated))
        assert (a.status, len(a), b.status, len(b)) == ("ok", len(b), "ok", len(a))
        for x, flags, branch in zip(a.q, a.flags, a.branch, strict=True):
            apart = np.abs(np.where(revolute, np.angle(np.exp(1j * (b.q - x))), b.q - x)).max(axis=1)
            twin = int(apart.argmin())
            assert apart[twin] < 1e-7
            assert (flags, branch) == (b.flags[twin], b.branch[twin])


def test_a_target_out_of_reach_of_a_general_arm():
    T = np.eye(4)
    T[0, 3] = 5.0
    a, b = (load_solver(robot("crx10ia"), backend=backend).solve(T) for backend in ("c", "numpy"))
    assert (a.status, a.reason) == (b.status, b.reason)
    assert b.distance == pytest.approx(a.distance, rel=1e-6)
