"""verify on a real compiled model, and the canary: one wrong sign in the emitted C must not get through.

Random robots are verified where they are compiled, in tests/pipeline/test_random_robots.py.
"""

from __future__ import annotations

import re

import pytest

import rrrgen
from rrrgen.base.errors import BuildError
from rrrgen.emit.c import sources
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
    original = sources.header_and_sources

    def spoiled(*arguments):
        files = dict(original(*arguments))
        for file in ("rrr.c", "rrr_nominal.c", "rrr_derivatives.c"):
            files[file], found = one_wrong_sign_per_function(files[file])
            hit.extend(found)
        return files

    monkeypatch.setattr(sources, "header_and_sources", spoiled)
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path))
    report = verify(rrrgen.compile("rrr", "c"), samples=20, libraries=False)
    assert len(hit) > 20
    assert "forward_dynamics_derivatives_nominal" in hit
    for name in hit:
        base, parameters = name.removesuffix("_nominal"), "nominal" if name.endswith("_nominal") else "random"
        rows = [row for row in report.failures if re.match(rf"{base}\b", row.function)]
        assert any(row.parameters in (parameters, "-") for row in rows), f"{name}: the wrong sign was not noticed"
