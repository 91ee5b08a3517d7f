"""What must not matter: frames, units, turns, the direction in which the chain is walked; and what the options do."""

import numpy as np
import pytest

from ik.checks import FK_ERROR, sample
from ik.robots import ROWS, make, reference
from oracles.random_robots import QUATERNIONS, transform
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import OUTSIDE

BASE = transform(QUATERNIONS[1], (0.1, -0.2, 0.35))
TOOL = transform(QUATERNIONS[3], (0.05, 0.02, 0.125))


@pytest.mark.parametrize("name", ["rrr", "puma", "ur5", "stanford", "scara", "iiwa14", "ortho3r"])
def test_base_and_tool(name):
    sample(name, N=500, base=BASE, tool=TOOL).assert_right()


@pytest.mark.parametrize("name", ["rrr", "puma", "ur5", "stanford", "panda"])
def test_modified_convention(name):
    """The same numbers read as a modified table are another robot; it is solved as well, or refused with a reason."""
    from rrrgen.ik.classify import plan

    rows = ROWS[name]
    found = plan(make("arm", rows, "modified"))
    if found.solvable:
        sample("arm", rows, N=500, convention="modified").assert_right()
    else:
        assert found.reason


def test_same_robot_in_both_conventions():
    """Standard rows shifted by one are the modified table of the same chain, but for the last half row (the tool)."""
    rows = ROWS["puma"]
    modified = [(rows[i][0], *(rows[i - 1][1:3] if i else (0.0, 0.0)), *rows[i][3:]) for i in range(6)]
    first = sample("puma", rows, N=300)
    second = sample("arm", modified, q=first.q, convention="modified")  # the Puma's last alpha and a are zero
    assert np.array_equal(first.batch.counts, second.batch.counts)
    second.assert_right()
    assert np.abs(np.sort(first.found[:, 1]) - np.sort(second.found[:, 1])).max() < 1e-9


@pytest.mark.parametrize("name", ["rrr", "puma", "ur5", "irb6640"])
@pytest.mark.sweep(but=["rrr", "puma"])
def test_unit_of_length(name):
    """Lengths in mm: tolerances are relative to the reach, so every answer is the same."""
    mm = [(kind, alpha, 1000 * a, 1000 * d, theta) for kind, alpha, a, d, theta in ROWS[name]]
    metres = sample(name, N=500)
    millimetres = sample(name, mm, q=metres.q)
    assert np.array_equal(metres.batch.counts, millimetres.batch.counts)
    assert np.array_equal(metres.batch.flags, millimetres.batch.flags)
    assert np.abs(metres.wrapped(metres.found - millimetres.found)).max() < 1e-6
    assert millimetres.errors().max() <= 1000 * FK_ERROR
    for off in (1e-9, 1e-3):  # nearly special in the same proportion
        nearly = [list(row) for row in ROWS[name]]
        nearly[0][2] += off
        big = [(kind, alpha, 1000 * a, 1000 * d, theta) for kind, alpha, a, d, theta in nearly]
        plans = [load_solver(make("arm", r)).plan for r in ([tuple(r) for r in nearly], big)]
        assert (plans[0].family, plans[0].snapped) == (plans[1].family, plans[1].snapped)


@pytest.mark.parametrize("name", ["puma", "ur5", "stanford", "irb6640"])
def test_reversed_chain(name):
    """The arm bolted down at its hand: J6 L5^-1 ... J1 as a chain of its own has the mirrored solutions."""
    rows = ROWS[name]
    # standard rows Rz(q) Tz(d) Tx(a) Rx(alpha); inverted: Rx(-alpha) Tx(-a) Tz(-d) Rz(-q), a modified table
    back = [(kind, -alpha, -a, -d, -theta) for kind, alpha, a, d, theta in reversed(rows)]
    forward = sample(name, N=300)
    q = -forward.q[:, ::-1]
    inverse = np.linalg.inv(forward.T)
    assert np.abs(reference(back, q, convention="modified") - inverse).max() < 1e-12
    result = sample("arm", back, q=q, convention="modified")
    result.assert_right()
    assert np.array_equal(result.batch.counts, forward.batch.counts)


def test_reference_chooses_the_turn():
    solver, rows = load_solver(make("puma", ROWS["puma"])), ROWS["puma"]
    rng = np.random.default_rng(0)
    q = rng.uniform(-3, 3, 6)
    T = reference(rows, q)[0]
    plain = solver.solve(T).q
    assert np.abs(plain).max() <= np.pi + 1e-12
    for _ in range(20):
        ref = rng.uniform(-20, 20, 6)
        moved = solver.solve(T, ref).q
        assert np.abs(moved - ref).max() <= np.pi + 1e-9
        turns = (moved - plain) / (2 * np.pi)
        assert np.abs(turns - np.round(turns)).max() < 1e-9


def test_nearest_first():
    solver, rows = load_solver(make("ur5", ROWS["ur5"])), ROWS["ur5"]
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = rng.uniform(-3, 3, 6)
        T = reference(rows, q)[0]
        result = solver.solve(T, q + 0.01 * rng.standard_normal(6), sort="nearest")
        assert np.abs(result.q[0] - q).max() < 1e-6
        plain = solver.solve(T, q)
        assert sorted(map(tuple, np.round(plain.q, 9))) == sorted(
            map(tuple, np.round(solver.solve(T, q, sort="nearest").q, 9))
        )


def test_joint_limits():
    limits = [(-1.0, 2.0), (None, None), (-3.0, 3.5), (0.0, 7.0), (None, 1.0), (-0.1, 0.1)]
    solver, rows = load_solver(make("puma", ROWS["puma"], limits=limits)), ROWS["puma"]
    rng = np.random.default_rng(2)
    inside_somewhere = 0
    for _ in range(200):
        T = reference(rows, rng.uniform(-3, 3, 6))[0]
        every = solver.solve(T, limits=False)
        kept = solver.solve(T, limits=True)
        inside = np.array(
            [all(_holds(x, low, high) for x, (low, high) in zip(q, limits, strict=True)) for q in every.q]
        )
        assert np.array_equal((every.flags & OUTSIDE) == 0, inside)
        assert len(kept) == inside.sum()
        inside_somewhere += int(len(kept) > 0)
        if len(kept) == 0:
            assert kept.status == "outside limits"
        assert np.abs(reference(rows, every.q) - T).max() <= FK_ERROR
        for q in kept.q:
            assert all(
                (low is None or x >= low - 1e-9) and (high is None or x <= high + 1e-9)
                for x, (low, high) in zip(q, limits, strict=True)
            )
    assert inside_somewhere > 3


def _holds(x, low, high) -> bool:
    """Whether some turn of the angle x lies within the limits."""
    return any(
        (low is None or x + 2 * np.pi * k >= low) and (high is None or x + 2 * np.pi * k <= high) for k in range(-3, 4)
    )


def test_branches_keep_their_number_along_a_path():
    """A path inside one aspect: each branch number stays, and belongs to one continuous row."""
    for name, centre in (
        ("rrr", (0.3, 0.4, 1.2)),
        ("puma", (0.3, 0.4, 1.2, 0.5, 0.9, 0.2)),
        ("ur5", (0.3, -0.9, 1.2, 0.5, 0.9, 0.2)),
    ):
        solver, rows = load_solver(make(name, ROWS[name])), ROWS[name]
        phase = np.arange(len(centre))
        before = None
        for s in np.linspace(0, 2 * np.pi, 200):
            q = np.array(centre) + 0.15 * np.sin(s + phase)
            result = solver.solve(reference(rows, q)[0], q)
            now = dict(zip(result.branch.tolist(), result.q, strict=True))
            assert len(now) == len(result)
            if before is not None:
                assert now.keys() == before.keys()
                for branch in now:
                    step = np.mod(now[branch] - before[branch] + np.pi, 2 * np.pi) - np.pi
                    assert np.abs(step).max() < 0.35
            before = now


def test_cuspidal_arm_has_two_rows_on_either_side_of_the_determinant():
    """The orthogonal 3R arm can change from one row to another without meeting det J = 0: both have the same sign."""
    rows = ROWS["ortho3r"]
    solver = load_solver(make("ortho3r", rows))
    chain = solver.plan.chain
    rng = np.random.default_rng(0)
    fours = 0
    for _ in range(300):
        found = solver.solve(reference(rows, rng.uniform(-np.pi, np.pi, 3))[0]).q
        signs = [np.sign(np.linalg.det(chain.jacobian(x)[:3])) for x in found]
        assert len(found) in (2, 4)
        assert sum(signs) == 0
        fours += len(found) == 4
    assert fours > 30
