"""Chains drawn without any thought: each gets a solver that finds its own configurations, or a reason."""

from __future__ import annotations

import numpy as np
import pytest

from ik.checks import sample
from ik.robots import make
from rrrgen.base.errors import DerivationError
from rrrgen.emit.c.ik.files import emit, sources
from rrrgen.ik.classify import plan
from samples.draws import draws

CHAINS = 60  # per seed

RIGHT = np.pi / 2


def drawn(rng: np.random.Generator) -> list:
    """Round angles and many zeros: the geometry where equations degenerate."""
    return [
        (
            "R" if rng.random() < 0.7 else "P",
            float(rng.choice([0.0, RIGHT, -RIGHT, np.pi])),
            float(rng.choice([0.0, 0.3, -0.2, 0.5])),
            float(rng.choice([0.0, 0.1, 0.4])),
            float(rng.choice([0.0, RIGHT, 0.3])),
        )
        for _ in range(int(rng.integers(1, 8)))
    ]


@pytest.mark.parametrize("seed", range(draws(2)))
@pytest.mark.sweep(but=["0"])
def test_a_solver_or_a_reason(seed):
    rng = np.random.default_rng(seed)
    solved = 0
    for _ in range(CHAINS):
        spec = make("arm", drawn(rng))
        found = plan(spec)
        if found.solvable:
            solved += 1
            assert 0 < found.max_solutions <= 32
            assert emit(spec, found).files
        else:
            assert len(found.reason) > 20
            assert sources(spec) == {}
            with pytest.raises(DerivationError, match="no inverse kinematics is emitted"):
                emit(spec, found)
    assert solved > CHAINS // 4


def test_axes_that_degenerate_are_refused_without_a_fault():
    """Equations whose rotation is decided by parallel axes, or whose linear equation has no unknown."""
    for name, lengths in (("PPPRRRR", (0.0, 0.3, 0.5, 0.5, -0.2, 0.0, 0.0)), ("PRPR", (-0.2, 0.5, 0.3, 0.3))):
        turns = {"PPPRRRR": (RIGHT, 0.0, np.pi, RIGHT, 0.0, -RIGHT, RIGHT), "PRPR": (RIGHT, -RIGHT, 0.0, 0.0)}[name]
        rows = [(kind, alpha, a, 0.1, 0.3) for kind, alpha, a in zip(name, turns, lengths, strict=True)]
        found = plan(make("arm", rows))
        assert found.solvable or found.reason


@pytest.mark.parametrize("seed", range(draws(2)))
@pytest.mark.sweep(but=["1"])
def test_solvers_of_few_joints_find_their_own_configurations(seed):
    """Through compiled code: chains of 4 and 5 joints, whose virtual joints must not hide a free angle."""
    rng = np.random.default_rng(100 + seed)
    compiled = 0
    while compiled < 4:
        rows = drawn(rng)
        if len(rows) in (4, 5) and plan(make("arm", rows)).solvable:
            sample("arm", rows, N=300).assert_right()
            compiled += 1


def test_a_plan_that_would_take_an_angle_from_the_reference_is_not_used():
    rows = [
        ("P", RIGHT, 0.3, 0.4, 0.0),
        ("R", 0.0, 0.5, 0.0, RIGHT),
        ("R", -RIGHT, 0.3, 0.4, 0.3),
        ("R", -RIGHT, 0.5, 0.0, 0.0),
    ]
    if plan(make("arm", rows)).solvable:
        sample("arm", rows, N=500).assert_right()
