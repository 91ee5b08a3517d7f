"""verify on a real compiled model, and the canary: one wrong sign in the emitted C must not get through.

Random robots are verified where they are compiled, in tests/pipeline/test_random_robots.py.
"""

from __future__ import annotations

import re

import pytest

import rrrgen
from rrrgen.base.errors import BuildError
from rrrgen.emit.c import robot_files
from rrrgen.verify import verify

FUNCTION = re.compile(r"^\w+ rrr_(\w+)\([^;{]*\)\n\{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
SIGN = re.compile(r" ([+-]) ")


def compiled(robot: str):
    try:
        return rrrgen.compile(robot, "c")
    except BuildError as reason:
        pytest.skip(f"no C toolchain: {reason}")


def test_reference_arm_in_emitted_c():
    report = verify(compiled("rrr"), samples=100)
    assert report.ok, report.to_text()


def one_wrong_sign_per_function(source: str) -> tuple[str, list[str]]:
    """The C source with the first binary sign of every function body turned round, and the functions it hit."""
    hit = []

    def spoil(function: re.Match[str]) -> str:
        body = function.group(2)
        sign = SIGN.search(body)
        if sign is None:
            return function.group(0)
        hit.append(function.group(1))
        wrong = " - " if sign.group(1) == "+" else " + "
        return function.group(0).replace(body, body[: sign.start()] + wrong + body[sign.end() :])

    return FUNCTION.sub(spoil, source), hit


def test_one_wrong_sign_in_emitted_c_is_found_in_every_function(monkeypatch, tmp_path):
    compiled("rrr")  # skips without a toolchain
    hit: list[str] = []
    original = robot_files.header_and_sources

    def spoiled(*arguments):
        files = dict(original(*arguments))
        for file in files.keys() & {"rrr.c", "rrr_nominal.c", "rrr_derivatives.c"}:
            files[file], found = one_wrong_sign_per_function(files[file])
            hit.extend(found)
        return files

    monkeypatch.setattr(robot_files, "header_and_sources", spoiled)
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path))
    report = verify(rrrgen.compile("rrr", "c"), samples=20, libraries=False)
    assert len(hit) > 20
    assert "forward_dynamics_derivatives_nominal" in hit
    for name in hit:
        base, parameters = name.removesuffix("_nominal"), "nominal" if name.endswith("_nominal") else "random"
        rows = [row for row in report.failures if re.match(rf"{base}\b", row.function)]
        assert any(row.parameters in (parameters, "-") for row in rows), f"{name}: the wrong sign was not noticed"


NEARLY_SPECIAL = """
schema: rrrgen/1
name: nearly_special
convention: {convention}
units: {{angle: rad, length: m}}
gravity: [0, {off}, -9.81]
joints:
  - {{type: revolute, alpha: pi/2 + {off}, a: 0.2, d: 0.1, theta: 0}}
  - {{type: revolute, alpha: -(pi/2 - {off}), a: 0.3, d: 0.11, theta: pi/2}}
  - {{type: {third}, alpha: pi - {off}, a: 0.4, d: 0.12, theta: pi/2 + {off}}}
links:
  - {{mass: 2, com: [0.1, 0.02, -0.1], inertia: {{about: com, xx: 0.1, yy: 0.12, zz: 0.09, xy: 0.01}}}}
  - {{mass: 3, com: [0.1, 0.02, -0.2], inertia: {{about: com, xx: 0.1, yy: 0.12, zz: 0.09, xy: 0.01}}}}
  - {{mass: 4, com: [0.1, 0.02, -0.3], inertia: {{about: com, xx: 0.1, yy: 0.12, zz: 0.09, xy: 0.01}}}}
"""


@pytest.mark.parametrize(
    ("convention", "third", "off"), [("standard", "prismatic", "2e-16"), ("modified", "revolute", "1e-8")]
)
@pytest.mark.sweep(but=["standard-prismatic-2e-16"])
def test_arms_beside_a_special_one(convention, third, off):
    """Every function to round-off, as the file has it; parameters that act below round-off are no fault of the set."""
    spec = rrrgen.loads_spec(NEARLY_SPECIAL.format(convention=convention, third=third, off=off))
    report = verify(rrrgen.compile(spec, "numpy"), samples=10, libraries=False)
    assert report.ok, report.to_text()
