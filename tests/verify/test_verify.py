"""verify accepts a right model, and rejects every way of being wrong that was thought of."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest

import rrrgen.verify as package
from oracles.random_robots import random_robot
from rrrgen.verify import Report, Row, verify
from samples.draws import draws
from verify.distorted import (
    SAMPLES,
)
from verify.oracle_model import OracleModel


def test_right_model_passes_against_everything(complete):
    report = verify(complete, samples=SAMPLES)
    assert report.ok, report.to_text()
    asked = {row.reference.split()[0] for row in report.rows}
    skipped = {name.split()[0] for name, _ in report.skipped}
    assert {"Newton-Euler", "identity"} <= asked
    assert asked | skipped >= {"Pinocchio", "MuJoCo", "Robotics"}


@pytest.mark.parametrize("seed", range(draws(3)))
def test_random_models_pass(seed):
    report = verify(OracleModel(random_robot(seed, max_joints=5)), samples=SAMPLES)
    assert report.ok, report.to_text()


def test_report_is_reproducible_and_complete(complete):
    first, second = (verify(complete, samples=2, seed=5, libraries=False) for _ in range(2))
    assert first.to_json() == second.to_json()
    assert verify(complete, samples=2, seed=6, libraries=False).to_json() != first.to_json()
    data = json.loads(first.to_json())
    assert data["ok"] is True
    assert data["seed"] == 5
    assert len(data["rows"]) == len(first.rows)
    text = str(first)
    assert text.endswith("rrr: all comparisons pass (2 states, seed 5)\n")
    assert text.count("\n") == len(first.rows) + len(first.skipped) + 3
    with pytest.raises(ValueError, match="samples"):
        verify(complete, samples=0)


def test_verdict_of_a_row():
    def row(difference: float) -> Row:
        return Row("f", "reference", "-", 1, difference, 1e-11)

    assert row(1e-12).ok
    assert not row(1e-10).ok
    assert not row(float("nan")).ok
    assert not Report("robot", 1, 0, ()).ok
    assert "1 of 2 comparisons FAIL" in Report("robot", 1, 0, (row(0.0), row(1.0))).to_text()


def test_nothing_of_the_compiler_is_imported():
    """The references would prove nothing if they shared code with the derivation."""
    allowed = {"rrrgen.base.errors", "rrrgen.robot.spec", "rrrgen.base.tables"}
    for file in Path(package.__file__).parent.glob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for block in [node for node in tree.body if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node)]:
            tree.body.remove(block)  # names for the type checker, of the model that is judged; nothing of it runs
        for node in ast.walk(tree):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            ours = {name for name in names if name.startswith("rrrgen") and not name.startswith("rrrgen.verify")}
            assert ours <= allowed, f"{file.name}: {ours - allowed}"
