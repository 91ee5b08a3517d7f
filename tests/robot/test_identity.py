"""The identity of emitted code: one hash of a robot however it is written."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import pytest
import sympy as sp

import rrrgen
from emit.planar import spec
from rrrgen.robot.file import loads_spec
from rrrgen.robot.identity import identify

ROOT = Path(__file__).resolve().parents[2]
ROBOT = """schema: rrrgen/1
name: one
convention: standard
units: {{angle: {angle}, length: {length}}}
gravity: [0, 0, -9.81]
joints:
  - {{type: revolute, alpha: {alpha}, a: {a}, d: 0, theta: 0}}
"""


def test_one_robot_has_one_hash_however_it_is_written():
    first = loads_spec(ROBOT.format(angle="deg", length="mm", alpha=90, a=500))
    second = loads_spec(ROBOT.format(angle="rad", length="m", alpha="pi/2", a="1/2") + "description: in words\n")
    assert identify(first).model_hash == identify(second).model_hash
    assert re.fullmatch("[0-9a-f]{64}", identify(first).model_hash)


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"convention": "modified"},
        {"gravity": (sp.Integer(0), sp.Rational(-98, 10), sp.Integer(0))},
        {"links": None},
        {"parameters": {"a": sp.Integer(1)}},
    ],
)
def test_another_robot_has_another_hash(change):
    assert identify(spec()).model_hash != identify(dataclasses.replace(spec(), **change)).model_hash


def test_the_version_is_the_one_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert identify(spec()).tool_version == rrrgen.__version__ == project["version"]
