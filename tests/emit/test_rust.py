"""Rust: warning-free without the standard library, and the same numbers as the C."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from emit.c_tools import IDENTITY
from emit.planar import planar_model
from pages.test_pages import ROOT, blocks
from pipeline.optimized import bundled, engine_of
from rrrgen.base.errors import BackendError
from rrrgen.base.templates import template_text
from rrrgen.derive import derive
from rrrgen.derive.functions.table import GROUPS
from rrrgen.emit.description import programs_of
from rrrgen.emit.package import emit
from rrrgen.emit.targets.rust import _RESERVED, LARGEST, ROUGH, RustBackend, _function, _Rust
from rrrgen.program import Builder, Port
from rrrgen.robot.file import load_spec
from rrrgen.runtime import load
from rrrgen.runtime.functions.differential import compiled_solver

RUSTC = shutil.which("rustc") or shutil.which("rustc", path=Path.home() / ".cargo" / "bin")
needs_rustc = pytest.mark.skipif(RUSTC is None, reason="rustc is not installed")

ROUNDING = {"double": 2e-13, "float": 2e-4}
"""Relative to the largest element of an output: another sine and cosine, and fused operations, in the C."""

STATES = 3

PAGE = """\
pub fn page(q: [f64; 3], dq: [f64; 3], ddq: [f64; 3], beta: [f64; 15]) -> Result<[f64; 3], rrr_model::Failure> {
@PAGE@
Ok(ddq)
}
"""
"""A function around the Rust on the page of the generated code."""


def crate(model, real="double") -> dict[str, str]:
    backend = RustBackend()
    return backend.assemble(model, IDENTITY, [task() for task in backend.tasks(model, IDENTITY, real)])


def compiled(folder: Path, source: str, *options: str) -> None:
    """Compile ``source`` with the language of 2018 and every warning an error."""
    command = [RUSTC, "--edition", "2018", "-D", "warnings", *options, "--out-dir", str(folder), str(folder / source)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def literal(array) -> str:
    """An array of any rank as Rust writes it."""
    return f"{float(array)!r}" if np.ndim(array) == 0 else f"[{', '.join(map(literal, array))}]"


def call(program, values) -> str:
    arguments = [literal(x) if np.ndim(x) == 0 else f"&{literal(x)}" for x in values]
    return f"Robot::{program.name}({', '.join(arguments)})"


def numbers(line: str) -> np.ndarray:
    return np.array([float(text) for text in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?|NaN", line)])


@needs_rustc
@pytest.mark.parametrize(("name", "real"), [("rrr", "double"), ("scara", "double"), ("planar2r", "float")])
@pytest.mark.sweep(but=["scara-double", "planar2r-float"])
def test_every_function_agrees_with_the_c(name, real, tmp_path):
    model, programs = load.compile(name, real=real), programs_of(bundled(name))
    (tmp_path / "lib.rs").write_text(crate(bundled(name), real)["rust/src/lib.rs"], encoding="utf-8")
    compiled(tmp_path, "lib.rs", "--crate-type", "rlib", "--crate-name", "robot", "--cfg", 'feature="std"')
    rng = np.random.default_rng(5)
    cases, lines = [], []
    for program in programs.values():
        for _ in range(STATES if program.inputs else 1):
            values = [rng.uniform(-1, 1, port.shape).astype(model.engine.dtype) for port in program.inputs]
            if program.status is not None:  # parameters for which M is positive definite
                nominal = bundled(name).nominal
                values = [
                    np.array([float(x) for x in nominal[port.role]]) if port.role in nominal else value
                    for port, value in zip(program.inputs, values, strict=True)
                ]
            cases.append((program, values))
            lines.append(f'    println!("{{:?}}", {call(program, values)}{".unwrap()" if program.status else ""});')
    main = ["type Robot = robot::Model<robot::Std>;", "fn main() {", *lines, "}", ""]
    (tmp_path / "main.rs").write_text("\n".join(main), encoding="utf-8")
    compiled(tmp_path, "main.rs", "-L", str(tmp_path), "--extern", f"robot={tmp_path}/librobot.rlib")
    printed = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(printed) == len(cases)
    for (program, values), line in zip(cases, printed, strict=True):
        if not program.inputs:  # constants, which the runtime takes from the model
            expected = [np.array([float(x) for x in row]) for row in bundled(name).nominal.values()]
        else:
            results = engine_of(model, program.name).call(program.name, values)
            expected = [each for k, each in enumerate(results) if not program.is_status(k)]
        wanted = np.concatenate([np.ravel(each) for each in expected])
        scale = max(1.0, float(np.abs(wanted).max()))
        assert np.abs(numbers(line) - wanted).max() <= ROUNDING[real] * scale, program.name
    if name == "rrr":
        (page,) = blocks((ROOT / "docs/generated-code.md").read_text(encoding="utf-8"), "rust")
        (tmp_path / "page.rs").write_text(PAGE.replace("@PAGE@", page), encoding="utf-8")
        crates = ("--extern", f"rrr_model={tmp_path}/librobot.rlib")
        compiled(tmp_path, "page.rs", "-L", str(tmp_path), "--crate-type", "lib", "--emit", "metadata", *crates)


@needs_rustc
def test_without_the_standard_library_and_with_failures(tmp_path):
    """The crate compiles on core alone; a singular mass matrix is an error that says so."""
    model = planar_model()
    (tmp_path / "lib.rs").write_text(crate(model)["rust/src/lib.rs"], encoding="utf-8")
    compiled(tmp_path, "lib.rs", "--crate-type", "rlib", "--crate-name", "bare", "--emit", "metadata")
    compiled(tmp_path, "lib.rs", "--crate-type", "rlib", "--crate-name", "robot", "--cfg", 'feature="std"')
    program = model.programs["forward_dynamics"]
    singular = call(program, [np.zeros(port.shape) for port in program.inputs])
    main = f'type Robot = robot::Model<robot::Std>;\nfn main() {{\n    println!("{{}}", {singular}.unwrap_err());\n}}\n'
    (tmp_path / "main.rs").write_text(main, encoding="utf-8")
    compiled(tmp_path, "main.rs", "-L", str(tmp_path), "--extern", f"robot={tmp_path}/librobot.rlib")
    printed = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    assert printed == "the mass matrix is not positive definite\n"


def test_a_function_in_full():
    b = Builder()
    x = b.input(Port("x", (2, 2), "m", "base", "corners"))
    b.input(Port("k", ()))
    y = b.select(x[0], b.sin(x[1]) - 2, b.abs(x[3]))
    program = b.program("corner", [(Port("y", (1, 2), "m"), [y, Fraction(1, 3)])], "The corner.", "y = [sin, 1/3]")
    function = _function(program, _Rust("double"))
    assert function.signature == "pub fn corner(x: &[[Real; 2]; 2], k: Real) -> [[Real; 2]; 1]"
    assert function.explanation == (
        "The corner.",
        "",
        "```text",
        "y = [sin, 1/3]",
        "```",
        "",
        "* argument `x`: corners, m, base",
        "* argument `k`: ",
        "* result `y`: m",
        "",
        "Operations: 0 mul, 1 add, 1 sincos, 2 other.",
    )
    assert function.body == (
        "let mut y = [[0.0; 2]; 1];",
        "let _ = k;",
        "let (s_angle, _) = F::sin_cos(x[0][1]);",
        "y[0][0] = if x[0][0] > 0.0 { s_angle - 2.0 } else { abs(x[1][1]) };",
        "y[0][1] = 0.33333333333333331;",
        "y",
    )


@needs_rustc
def test_every_group_of_a_redundant_arm_compiles(tmp_path):
    """The null-space projector N is no constant N: four joints for a position."""
    model = derive(load_spec("scara"), groups=tuple(group for group in GROUPS if group != "elastic"))
    assert "position_nullspace" in model.programs
    (tmp_path / "lib.rs").write_text(crate(model)["rust/src/lib.rs"], encoding="utf-8")
    compiled(tmp_path, "lib.rs", "--crate-type", "rlib", "--crate-name", "robot", "--emit", "metadata")


NAMES = sorted(name for name in _RESERVED if name.isidentifier() and name not in ("Self", "_"))


@needs_rustc
def test_arguments_and_results_may_have_any_name(tmp_path):
    """Those of constants, types and functions of the crate and of keywords, as inputs and as outputs."""
    programs = []
    for k, name in enumerate(NAMES):
        b = Builder()
        (x,) = b.input(Port(name, ()))
        y = b.select(x, b.sin(b.abs(x)), b.sqrt(x))
        programs.append(b.program(f"f{k}", [(Port("y", (2,)), [y, x])]))
        b = Builder()
        (x,) = b.input(Port("x", ()))
        programs.append(b.program(f"g{k}", [(Port(name, ()), [b.sin(x)]), (Port("y", (1,)), [b.abs(x)])]))
    model = planar_model()
    model = replace(model, programs=model.programs | {program.name: program for program in programs})
    (tmp_path / "lib.rs").write_text(crate(model)["rust/src/lib.rs"], encoding="utf-8")
    compiled(tmp_path, "lib.rs", "--crate-type", "rlib", "--crate-name", "robot", "--emit", "metadata")


def test_constants_that_no_float_holds_are_refused():
    with pytest.raises(BackendError, match="does not fit a float"):
        _Rust("float").literal(Fraction(10) ** 39)


def test_generate_prints_rust_when_asked():
    model = bundled("planar2r")
    files = emit(model, languages=("rust",))
    assert {"rust/Cargo.toml", "rust/src/lib.rs"} <= files.keys()
    assert files["rust/src/lib.rs"] == crate_of(model, files)
    assert 'name = "planar2r_model"' in files["rust/Cargo.toml"]
    assert not any(name.startswith("rust/") for name in emit(model))


def crate_of(model, files) -> str:
    """The same source with the identity that ``generate`` writes."""
    from rrrgen.robot.identity import identify

    backend = RustBackend()
    (text,) = [task() for task in backend.tasks(model, identify(model.spec), "double")]
    assert '"rust/src/lib.rs"' in files["manifest.json"]
    return text


DIFFERENTIAL = """
#![allow(non_snake_case)]
pub type Real = f64;
pub const N: usize = 7;
pub trait Math { fn sqrt(x: Real) -> Real; }
pub struct Std;
impl Math for Std { fn sqrt(x: Real) -> Real { x.sqrt() } }
pub mod differential_ik;
use differential_ik::{differential_ik, Limits, Task};

fn take<const M: usize>(from: &mut dyn Iterator<Item = Real>) -> [Real; M] {
    let mut row = [0.0; M];
    row.iter_mut().for_each(|x| *x = from.next().unwrap());
    row
}

fn main() {
    let text = std::fs::read_to_string(std::env::args().nth(1).unwrap()).unwrap();
    for line in text.lines() {
        let from: &mut dyn Iterator<Item = Real> = &mut line.split(' ').map(|x| x.parse().unwrap());
        let (q, last) = (take::<N>(from), take::<N>(from));
        let J = [take::<N>(from), take::<N>(from), take::<N>(from), take::<N>(from), take::<N>(from), take::<N>(from)];
        let (V, weight, dq_ref, damping) = (take::<6>(from), take::<6>(from), take::<N>(from), take::<1>(from)[0]);
        let (q_min, q_max, dq_max, ddq_max) = (take::<N>(from), take::<N>(from), take::<N>(from), take::<N>(from));
        let (task, Ts) = (Task { V, weight, dq_ref, damping }, take::<1>(from)[0]);
        let limits = Limits { q_min, q_max, dq_max, ddq_max };
        println!("{:?}", differential_ik::<Std>(&q, &last, &J, &task, &limits, Ts));
    }
}
"""


@needs_rustc
def test_differential_inverse_kinematics_is_that_of_the_c(tmp_path):
    """Random problems: limits that are met, touched, infinite, or not to be kept, and unusable inputs."""
    module = template_text("rust/lib.rs.j2").partition("\npub mod differential_ik")[2].rpartition("{% endif %}")[0]
    text = DIFFERENTIAL.replace("pub mod differential_ik;", "pub mod differential_ik" + module)
    text = text.replace("{{ largest }}", LARGEST["double"]).replace("{{ rough }}", ROUGH["double"])
    (tmp_path / "main.rs").write_text(text, encoding="utf-8")
    compiled(tmp_path, "main.rs")
    rng, n = np.random.default_rng(2), 7
    rows, expected, solve = [], [], compiled_solver("arm", n, "double")
    for k in range(300):
        J = rng.normal(size=(6, n)) * (1 if k % 2 else np.array([[1], [1], [1], [1], [1], [0.01]]))
        fastest = np.full(n, 10.0 ** rng.uniform(-2, 2))
        values = [
            *(rng.uniform(-1, 1, n), rng.uniform(-0.5, 0.5, n), J, rng.normal(size=6), rng.uniform(0, 2, 6)),
            *(0.1 * rng.normal(size=n), np.array(0.02 if k % 50 else 0.0), np.full(n, -1.2)),
            *(np.full(n, 1.2 if k % 7 else np.inf), fastest, 100 * fastest, np.array(1e-3)),
        ]
        dq = np.empty(n)
        expected.append((solve(values, dq), dq))
        rows.append(" ".join(repr(float(x)) for value in values for x in np.ravel(value)))
    (tmp_path / "problems").write_text("\n".join(rows), encoding="utf-8")
    ran = subprocess.run([tmp_path / "main", tmp_path / "problems"], capture_output=True, text=True, check=True)
    words = {0: "Best", 1: "Limits", 2: "Stopped", 3: "Invalid"}
    assert {status for status, _ in expected} >= {0, 1, 3}
    for line, (status, dq) in zip(ran.stdout.splitlines(), expected, strict=True):
        assert line.startswith(f"({words[status]}, ")
        np.testing.assert_allclose(numbers(line), dq, rtol=1e-9, atol=1e-9)
