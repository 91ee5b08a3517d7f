"""Every structure: spherical and planar triples anywhere, all R/P mixes, with generic geometry elsewhere."""

from pathlib import Path

import numpy as np
import pytest

from ik.chains import every_structure, planar, position, scara, spherical
from ik.checks import sample
from ik.robots import make, reference
from rrrgen.ik.classify import plan, tip_plans
from rrrgen.ik.inverse_kinematics import evaluated_solver
from rrrgen.ik.recording.float_builder import FloatBuilder, every_branch, wrap
from rrrgen.robot.file import load_spec

STRUCTURES = every_structure()
EQUATION_ERROR = 1e-8
"""Roots of a quartic that lie close together have lost half their digits."""


@pytest.mark.parametrize(("name", "family", "rows"), STRUCTURES, ids=[name for name, _, _ in STRUCTURES])
@pytest.mark.sweep(but=[*[name for name, _, _ in STRUCTURES][::2]])
def test_equations_give_back_the_configuration(name, family, rows):
    """The derivation itself, in floats: the seed is among the branches, and every branch meets the target."""
    found = plan(make("structure", rows))
    assert found.solvable, found.reason
    if name.startswith("planar") and "P" in name.split()[2] and found.family != family:
        assert found.family in ("spherical", "orientation")  # three prismatic joints: a simpler way
    else:
        assert found.family == family
    rng = np.random.default_rng(5)
    turning = [row[0] == "R" for row in rows]
    for _ in range(2):
        q = np.where(turning, rng.uniform(-2.5, 2.5, len(rows)), rng.uniform(-0.6, 0.6, len(rows)))
        T = reference(rows, q)[0]
        answers = every_branch(found.equations.play, lambda script, T=T, q=q: FloatBuilder(T, q, script))
        apart = [
            max(abs(wrap(x - y)) if turn else abs(x - y) for x, y, turn in zip(row, q, turning, strict=True))
            for row in answers
        ]
        assert min(apart) < EQUATION_ERROR
        if len(rows) >= 3:  # fewer joints leave equations over, which only the emitted code checks
            for row in answers:
                F = reference(rows, row)[0]
                error = F[:3, 3] - T[:3, 3] if found.task == "position" else F - T
                if found.virtual == 0 and found.family != "lift":
                    assert np.abs(error).max() < EQUATION_ERROR


PLANAR = ((0, "RRR", "RRR"), (1, "RRR", "RRR"), (2, "RPR", "RRR"), (3, "PRR", "RPR"))

COMPILED = [
    *((f"position {t}", position(t, 1)) for t in ("R", "P", "RP", "RRR", "RRP", "RPR", "PRR", "PRP", "PPR", "PPP")),
    *((f"spherical {k} {t}", spherical(k, t, 1)) for k, t in enumerate(("RRR", "PRR", "RRP", "RPR"))),
    *((f"planar {k} {s} {t}", planar(k, s, t, 1)) for k, s, t in PLANAR),
    ("orientation PRPRRP", position("PRPRRP", 4)),
    ("scara RRPRRR", scara("RRPRRR", 3)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "rows"), COMPILED, ids=[name for name, _ in COMPILED])
@pytest.mark.sweep(but=[name for name, _ in COMPILED[::2]])
def test_emitted_code(name, rows):
    sample("structure", rows, N=1000, seed=2).assert_right()


@pytest.mark.parametrize("name", ["scara", "thumb"])
def test_a_target_turned_over_has_only_solutions_that_reach_it(name):
    """A planar arm cannot turn its tip over: half a turn about an axis of the base or of the tip, which has sine 0."""
    hand = Path(__file__).resolve().parents[2] / "examples" / "trees" / "hand.yaml"
    spec = load_spec("scara") if name == "scara" else tip_plans(load_spec(hand))[name][0]
    solver, chain = evaluated_solver(spec), plan(spec).chain
    q = [0.3, -0.5, 0.1, 0.4][: spec.n]
    T = chain.forward(q)
    assert len(solver.solve(T, q, limits=False).q) == 2
    for diagonal in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
        turn = np.diag([*diagonal, 1.0])
        for target in (T @ turn, turn @ T):
            for row in solver.solve(target, q, limits=False).q:
                np.testing.assert_allclose(chain.forward(row), target, atol=1e-9)
            if diagonal[2] < 0:
                assert solver.solve(target, q, limits=False).status == "unreachable"
