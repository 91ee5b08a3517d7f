"""Statements about rounding errors: in header and manifest, and compared with what the compiled code does."""

from __future__ import annotations

import json
import math
import random
import re
from dataclasses import replace
from fractions import Fraction

import pytest
from click.testing import CliRunner

from rrrgen.base.errors import InputError
from rrrgen.cli.generate import generate
from rrrgen.cli.verify import verify
from rrrgen.derive import derive_once
from rrrgen.evidence import statements
from rrrgen.evidence.boxes import Ranges
from rrrgen.evidence.certificate import rounding_entries
from rrrgen.evidence.statements import rounded_up, rounding_rows
from rrrgen.robot.file import read
from rrrgen.runtime import load

RESIDUAL = re.compile(r"Residual \|M ddq - \(tau - c - g\)\| at most (\S+) N m, with exact M, c and g; proven")
SENTENCE = re.compile(r"Rounding errors at most: ([^;]*); proven for inputs in the box that manifest.json states")


def invoke(command, *arguments):
    done = CliRunner().invoke(command, [str(each) for each in arguments], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


@pytest.mark.parametrize("real", ["double", pytest.param("float", marks=pytest.mark.sweep)])
def test_header_and_manifest_state_the_same_bounds(tmp_path, real):
    invoke(generate, "pendulum", "-o", tmp_path, "--real", real, "--bounds", "--no-casadi-files")
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    header = " ".join((tmp_path / "pendulum.h").read_text(encoding="utf-8").replace("\n * ", " ").split())
    comments = {name: text for text, name in re.findall(r"/\*(.*?)\*/\s*\w+ pendulum_(\w+)\(", header)}
    bounded = 0
    for name, function in manifest["functions"].items():
        rounding = function["rounding"]
        if "none" in rounding:
            assert f"Rounding errors: no bound; {rounding['none']}." in comments[name]
            continue
        bounded += 1
        if "quantity" in rounding:
            assert name.removesuffix("_nominal") == "forward_dynamics"
            assert {"q", "dq", "ddq"} <= set(rounding["box"])
            largest = max(rounding["bounds"]["ddq"])
            assert largest <= float(RESIDUAL.search(comments[name])[1]) <= 1.1 * largest
            continue
        said = dict(part.split() for part in SENTENCE.search(comments[name])[1].split(", "))
        assert set(rounding["box"]) <= {port["name"] for port in function["inputs"]}
        for port in function["outputs"]:
            bounds = rounding["bounds"][port["name"]]
            assert len(bounds) == math.prod(port["shape"])
            assert max(bounds) <= float(said[port["name"]]) <= 1.1 * max(bounds)
    assert bounded > 20


def test_what_bounds_depend_on_stands_beside_them():
    """The integral of a control law rests by a comparison, and friction is a tanh of the C library."""
    model = derive_once(read("pendulum"), ("model", "control"))
    entry = rounding_entries(model, "inline", Ranges())["pd_gravity_nominal"]
    stated = statements.statement(model.programs["pd_gravity_nominal"], entry, "double")
    assert "Those of z_next hold where all comparisons come out as in exact arithmetic." in stated.sentence
    assert "tanh and exp of the C library are within 4 units in the last place." in stated.sentence
    assert stated.data["conditional"]["outputs"] == ["z_next"]
    assert stated.data["assumption"] == entry["assumption"]


def test_without_the_option_nothing_is_stated(tmp_path):
    invoke(generate, "pendulum", "-o", tmp_path, "--no-casadi-files")
    assert "Rounding errors" not in (tmp_path / "pendulum.h").read_text(encoding="utf-8")
    assert '"rounding": {' not in (tmp_path / "manifest.json").read_text(encoding="utf-8")


def test_numbers_are_rounded_up():
    rng = random.Random(1)
    for value in [*(rng.uniform(1.0, 10.0) * 10.0 ** rng.randint(-30, 3) for _ in range(300)), 0.0, 1e-16, 9.99e-9]:
        assert Fraction(value) <= Fraction(float(rounded_up(value)))
        assert float(rounded_up(value)) <= 1.1 * value
        assert re.fullmatch(r"\d\.\de[+-]\d\d", rounded_up(value))


@pytest.mark.parametrize("real", ["double", pytest.param("float", marks=pytest.mark.sweep)])
def test_the_compiled_code_keeps_its_bounds_and_bounds_that_are_too_small_are_noticed(monkeypatch, real):
    model = load.compile("pendulum", "c", real)
    rows, skipped = rounding_rows(model, Ranges(), 50, 1)
    every = {name for part in model.parts for name in part.derived.programs}
    assert {row.function for row in rows} | {name.removeprefix("rounding of ") for name, _ in skipped} == every
    assert all(row.ok for row in rows)
    proven = statements.rounding_bounds

    def smaller(*given):
        found = proven(*given)
        scaled = [tuple(tuple(0.01 * bound for bound in row) for row in part) for part in (found.double, found.single)]
        return replace(found, double=scaled[0], single=scaled[1])

    monkeypatch.setattr(statements, "rounding_bounds", smaller)
    rows, _ = rounding_rows(model, Ranges(), 50, 1)
    assert not next(row for row in rows if row.function == "inverse_dynamics").ok


@pytest.mark.parametrize("real", ["double", pytest.param("float", marks=pytest.mark.sweep)])
def test_compiled_control_laws_keep_their_bounds(real):
    """With tanh and exp of this machine's C library."""
    laws = load.compile("pendulum", "c", real)._with("pd_gravity")
    rows, _ = rounding_rows(laws, Ranges(), 500, 2)
    assert {"pd_gravity", "computed_torque_nominal", "slotine_li", "momentum_terms"} <= {row.function for row in rows}
    assert all(row.ok for row in rows), [row for row in rows if not row.ok]


def test_derivatives_of_forward_dynamics_are_compared_with_bounds_of_their_residuals():
    """Their part of a compiled model has no mass matrix, which the residual takes."""
    rows, skipped = rounding_rows(load.compile(read("rrr")), Ranges(), 50, 1, only=["forward_dynamics_derivatives"])
    assert not skipped
    assert [(row.reference, row.ok) for row in rows] == [("proven bound of the residual", True)]


def test_an_unknown_function_is_named_with_a_near_one():
    with pytest.raises(InputError, match=r"no function 'mass_matrx'.*mass_matrix"):
        rounding_rows(load.compile("pendulum"), Ranges(), 50, 1, only=["mass_matrx"])


def test_verify_compares_with_the_bounds_and_the_page_shows_them(tmp_path):
    page = tmp_path / "pendulum.html"
    done = invoke(verify, "pendulum", "--samples", 20, "--no-libraries", "--bounds", "--json", "--html", page)
    rows = [row for row in json.loads(done.stdout)["rows"] if row["reference"] == "proven rounding bound"]
    assert len(rows) > 20
    assert all(row["verdict"] == "pass" for row in rows)
    assert page.read_text(encoding="utf-8").count("proven rounding bound") == len(rows)
