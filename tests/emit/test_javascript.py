"""JavaScript: the same numbers as the C in Node, and arguments of another shape refused."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from emit.c_tools import IDENTITY
from emit.planar import planar_model
from pages.test_pages import ROOT, blocks
from pipeline.optimized import bundled, engine_of
from rrrgen.emit.description import programs_of
from rrrgen.emit.package import emit
from rrrgen.emit.targets.javascript import _RESERVED, JavaScriptBackend, _function, _JavaScript
from rrrgen.program import Builder, Port
from rrrgen.runtime import load

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")

ROUNDING = 2e-13
"""Relative to the largest element of a result: another sine and cosine, and fused operations, in the C."""

CALLS = """\
import * as robot from "./robot.mjs";
import { readFileSync } from "node:fs";
const calls = JSON.parse(readFileSync("calls.json", "utf8"));
const results = calls.map(([name, values]) => {
  try { return robot[name](...values); } catch (error) { return `${error.name}: ${error.message}`; }
});
console.log(JSON.stringify([[robot.N, robot.B, robot.JOINTS, robot.MODEL_HASH], ...results]));
"""


def module(model) -> str:
    backend = JavaScriptBackend()
    results = [task() for task in backend.tasks(model, IDENTITY, "double")]
    return backend.assemble(model, IDENTITY, results)[f"javascript/{model.spec.name}.mjs"]


def called(folder, text: str, calls: list) -> list:
    """What Node returns for the calls, each a name and its arguments; first of all the constants."""
    (folder / "robot.mjs").write_text(text, encoding="utf-8")
    (folder / "main.mjs").write_text(CALLS, encoding="utf-8")
    (folder / "calls.json").write_text(json.dumps(calls), encoding="utf-8")
    ran = subprocess.run([NODE, "main.mjs"], cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def flat(result, ports) -> np.ndarray:
    """The numbers of a result in the order of the ports."""
    parts = [result] if len(ports) == 1 else [result[port.name] for port in ports]
    return np.concatenate([np.ravel(np.array(part, dtype=float)) for part in parts])


@needs_node
@pytest.mark.parametrize("name", ["rrr", "gantry"])
def test_every_function_agrees_with_the_c(name, tmp_path):
    derived, model = bundled(name), load.compile(name)
    rng, cases = np.random.default_rng(5), []
    for program in programs_of(derived).values():
        values = [rng.uniform(-1, 1, port.shape) for port in program.inputs]
        if program.status is not None:  # parameters for which M is positive definite
            nominal = derived.nominal
            values = [
                np.array([float(x) for x in nominal[port.role]]) if port.role in nominal else value
                for port, value in zip(program.inputs, values, strict=True)
            ]
        cases.append((program, values))
    calls = [(program.name, [np.asarray(value).tolist() for value in values]) for program, values in cases]
    constants, *results = called(tmp_path, module(derived), calls)
    assert constants[:3] == [derived.spec.n, derived.b, [joint.name for joint in derived.spec.joints]]
    for (program, values), result in zip(cases, results, strict=True):
        if not program.inputs:  # constants, which the runtime takes from the model
            expected = [np.array([float(x) for x in row]) for row in derived.nominal.values()]
        else:
            expected = [
                each
                for k, each in enumerate(engine_of(model, program.name).call(program.name, values))
                if not program.is_status(k)
            ]
        wanted = np.concatenate([np.ravel(each) for each in expected])
        error = np.abs(flat(result, program.data_outputs) - wanted).max()
        assert error <= ROUNDING * max(1.0, np.abs(wanted).max()), program.name
    if name == "rrr":
        (page,) = blocks((ROOT / "docs/generated-code.md").read_text(encoding="utf-8"), "js")
        (tmp_path / "rrr.mjs").write_text(module(derived), encoding="utf-8")
        (tmp_path / "page.mjs").write_text(f"{page}console.log(JSON.stringify([T, tau]));\n", encoding="utf-8")
        ran = subprocess.run([NODE, "page.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
        T, tau = json.loads(ran.stdout)
        q = np.array([0.1, -0.4, 0.8])
        np.testing.assert_allclose(T, model.forward_kinematics(q), rtol=0, atol=1e-14)
        np.testing.assert_allclose(tau, model.gravity(q), rtol=0, atol=1e-12)


@needs_node
def test_failures_and_arguments_that_are_no_state(tmp_path):
    model = planar_model()
    program = model.programs["forward_dynamics"]
    zeros = [np.zeros(port.shape).tolist() for port in program.inputs]
    calls = [
        (program.name, zeros),
        ("gravity", [[0.0]]),
        ("gravity", [[0.0, "1"], zeros[-1]]),
        ("gravity", [[0.0, 0.0]]),
    ]
    _, singular, short, text, missing = called(tmp_path, module(model), calls)
    assert singular == "Failure: the mass matrix is not positive definite"
    assert short == "TypeError: q must have the shape [2]"
    assert text == "TypeError: q must hold numbers"
    assert missing == f"TypeError: beta must have the shape [{model.beta_size}]"


@needs_node
def test_arguments_and_results_may_have_any_name(tmp_path):
    programs = []
    for k, name in enumerate(sorted(_RESERVED)):
        b = Builder()
        (x,) = b.input(Port(name, ()))
        programs.append(b.program(f"f{k}", [(Port("y", (2,)), [b.sin(b.abs(x)), x])]))
        b = Builder()
        x = b.input(Port("x", (2,)))
        programs.append(b.program(f"g{k}", [(Port(name, ()), [b.sin(x[0])]), (Port("y", (1,)), [b.abs(x[1])])]))
    model = planar_model()
    model = replace(model, programs=model.programs | {program.name: program for program in programs})
    backend = JavaScriptBackend()
    texts = backend.assemble(model, IDENTITY, [task() for task in backend.tasks(model, IDENTITY, "double")])
    (tmp_path / "arm.mjs").write_text(texts[f"javascript/{model.spec.name}.mjs"], encoding="utf-8")
    calls = [f"arm.f{k}(1), arm.g{k}([1, 2])" for k in range(len(programs) // 2)]
    (tmp_path / "main.mjs").write_text(f'import * as arm from "./arm.mjs";\n{", ".join(calls)};\n', encoding="utf-8")
    run = subprocess.run([NODE, tmp_path / "main.mjs"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_a_function_in_full():
    b = Builder()
    x = b.input(Port("x", (2, 2), "m", "base", "corners"))
    b.input(Port("k", ()))
    y = b.select(x[0], b.sin(x[1]) - 2, b.abs(x[3]))
    program = b.program("corner", [(Port("y", (1, 2), "m"), [y, Fraction(1, 3)])], "The corner.", "y = [sin, 1/3]")
    function = _function(program, _JavaScript())
    assert function.signature == "corner(x, k)"
    assert function.explanation[-3:] == (
        "@param {number[][]} x corners, m, base, [2][2]",
        "@param {number} k",
        "@returns {number[][]} y: m, [1][2]",
    )
    assert function.body == (
        'sized("x", x, 2, 2);',
        'sized("k", k);',
        "const y = Array.from({ length: 1 }, () => new Array(2).fill(0));",
        "void k;",
        "const s_angle = Math.sin(x[0][1]);",
        "y[0][0] = x[0][0] > 0 ? s_angle - 2.0 : Math.abs(x[1][1]);",
        "y[0][1] = 0.33333333333333331;",
        "return y;",
    )


def test_generate_prints_the_module_when_asked():
    files = emit(bundled("planar2r"), languages=("javascript",))
    assert "export function mass_matrix(q, beta)" in files["javascript/planar2r.mjs"]
    assert '"javascript/planar2r.mjs"' in files["manifest.json"]
