"""The inverse kinematics in ``verify``: right solvers pass, a lost, wrong or repeated row is found."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError
from rrrgen.robot.file import read
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.verify.inverse_kinematics import check_inverse_kinematics
from rrrgen.verify.references.numeric_robot import chain_of
from rrrgen.verify.report import Collector


def checked(name, change=None):
    spec = read(name)
    solver = load_solver(spec)
    rows = Collector()
    model = SimpleNamespace(ik=solver if change is None else Changed(solver, change))
    check_inverse_kinematics(model, chain_of(spec), 40, np.random.default_rng(0), rows)
    assert not rows.skipped
    return {row.function.removeprefix("inverse_kinematics: "): row for row in rows.rows}


class Changed:
    """A solver whose batches are changed."""

    def __init__(self, solver, change):
        self._solver, self._change = solver, change

    def __getattr__(self, name):
        return getattr(self._solver, name)

    def solve_batch(self, *arguments, **options):
        batch = self._solver.solve_batch(*arguments, **options)
        copy = dataclasses.replace(batch, q=batch.q.copy(), counts=batch.counts.copy())
        self._change(copy)
        return copy


@pytest.mark.parametrize("name", ["rrr", "puma560", "scara", "gantry", "pendulum", "iiwa14"])
def test_right_solvers_pass(name):
    rows = checked(name)
    assert all(row.ok for row in rows.values()), rows
    assert rows["share of other solutions not among the rows"].note


def lose_the_last(batch):
    batch.counts[:] = np.maximum(batch.counts - 1, 0)


def move_one(batch):
    batch.q[0, 0, 1] += 1e-9


def repeat_one(batch):
    batch.q[0, 1] = batch.q[0, 0]


def lose_everything_aligned(batch):
    batch.counts[:] = np.where(np.isin(batch.flags[:, 0] & 2, [2]), 0, batch.counts)


def invent(batch):
    batch.q[batch.counts == 0, 0] = 0.0
    batch.counts[batch.counts == 0] = 1


@pytest.mark.parametrize(
    ("change", "found_in"),
    [
        (lose_the_last, "share of other solutions not among the rows"),
        (lose_the_last, "share of seeds not found"),
        (move_one, "FK(row) = target"),
        (repeat_one, "rows that come twice"),
        (lose_everything_aligned, "share of singular targets without a row"),
        (invent, "rows of a target out of reach"),
    ],
)
def test_wrong_solvers_fail(change, found_in):
    rows = checked("puma560", change)
    assert not rows[found_in].ok


def test_what_cannot_be_asked_is_named():
    class Without:
        @property
        def ik(self):
            raise DerivationError("no family fits")

    rows = Collector()
    check_inverse_kinematics(Without(), chain_of(read("rrr")), 4, np.random.default_rng(0), rows)
    assert rows.skipped == [("inverse_kinematics", "no family fits")]
    rows = Collector()
    check_inverse_kinematics(SimpleNamespace(), chain_of(read("rrr")), 4, np.random.default_rng(0), rows)
    assert not rows.rows[0].ok
    rows = Collector()
    broken = SimpleNamespace(ik=SimpleNamespace(plan=SimpleNamespace(task="pose", locked=None)))
    broken.ik.solve_batch = lambda *a, **k: (_ for _ in ()).throw(ValueError("refused"))
    check_inverse_kinematics(broken, chain_of(read("rrr")), 4, np.random.default_rng(0), rows)
    assert not rows.rows[0].ok
    assert "refused" in rows.rows[0].note
