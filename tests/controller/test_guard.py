"""Every function with a state, limits, a period or an estimate refuses unusable input, in every language that it is in.

One table of cases per function: valid inputs; then each element of each input in turn replaced by NaN, infinities, huge
and tiny numbers, and by values that contradict their meaning. Refused means: the state is handed back bit by bit, other
results have their fixed values, and the status says so. Whatever the input, nothing comes out that is not finite.
"""

import ctypes
import json
import shutil
import subprocess
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

import rrrgen
from rrrgen.derive import derive_once
from rrrgen.emit.c.header_comments import function_name
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.c.robot_files import failures_of, header_and_sources
from rrrgen.emit.casadi.function import function as casadi_function
from rrrgen.emit.casadi.module import rebuild_module
from rrrgen.emit.controller.filters import kalman_program, linear_step_program
from rrrgen.emit.controller.state_space import StateSpace
from rrrgen.emit.targets.javascript import BACKEND as JAVASCRIPT
from rrrgen.program import REFUSED, Builder, Domain, Op, Port, Program, evaluate
from rrrgen.program.guard import BOUNDS, add_guard, is_guarded
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.programs import friction_step_program
from rrrgen.robot.identity import identify
from tests.emit.test_rust import compiled, crate, literal, needs_rustc
from tests.robot.friction.examples import EXAMPLES

GROUPS = ("model", "control", "observer", "elastic", "trajectory")
NODE = shutil.which("node")


@cache
def model():
    """The reference robot with every function that refuses input, and those that are made for one experiment."""
    derived = derive_once(rrrgen.load_spec("rrr"), GROUPS)
    E = [[1.0, 1e-3, 5e-7], [0.0, 1.0, 1e-3], [0.0, 0.0, 1.0]]
    notch = StateSpace(np.array([[0.9, 0.1], [0.0, 0.8]]), np.array([0.0, 1.0]), np.array([0.5, 0.1]), 0.2)
    others = [
        kalman_program([E] * 3, [[0.3, 20.0, 500.0]] * 3, 1e-3),
        linear_step_program([notch], 1e-3, "notch_step", "a notch"),
        friction_step_program(LAWS["lugre"], 3),
    ]
    programs = {name: program for name, program in derived.programs.items() if is_guarded(program)}
    return replace(derived, programs=programs | {program.name: program for program in others})


LAWS_AND_OBSERVERS = [
    *("pd_gravity", "feedforward", "computed_torque", "impedance", "position_operational_space"),
    *("momentum_observer_start", "momentum_observer", "elastic_feedforward", "elastic_feedback_linearization"),
]
NAMES = [
    *LAWS_AND_OBSERVERS,
    *(f"{name}_nominal" for name in LAWS_AND_OBSERVERS),
    *[
        "slotine_li",
        "contact",
        "external_force",
        "quintic",
        "trapezoidal",
        "kalman_step",
        "notch_step",
        "friction_step_lugre",
    ],
]


def test_no_function_with_a_state_or_limits_is_forgotten():
    """Names of ports are the second witness: those of states (``_next``, ``_last``), limits and periods."""
    assert sorted(model().programs) == sorted(NAMES)
    for name, program in derive_once(rrrgen.load_spec("rrr"), GROUPS).programs.items():
        ports = [port.name for port in (*program.inputs, *program.outputs)]
        telling = any(port.endswith(("_next", "_last", "_max", "_min")) or port == "Ts" for port in ports)
        fixed = name.startswith(("quintic", "momentum_observer_start", "external_force"))
        assert is_guarded(program) == (telling or fixed), name


@dataclass(frozen=True)
class Cases:
    """Inputs (N, *shape) per port, whether case k must be refused (None: either is right), and what it is."""

    inputs: list[np.ndarray]
    refused: list[bool | None]
    what: list[str]


def valid(program: Program, rng: np.random.Generator) -> list[np.ndarray]:
    """One valid argument per input port."""
    given = []
    for port in program.inputs:
        value = rng.uniform(0.1, 0.9, port.shape)
        if port.domain is Domain.LIMIT:
            value = np.where(rng.random(port.shape) < 0.3, np.inf, 1.0 + 50.0 * value)
        elif port.domain in (Domain.LOWER, Domain.UPPER):
            value = (3.0 + value) * (1.0 if port.domain is Domain.UPPER else -1.0)
            value = np.where(rng.random(port.shape) < 0.3, value * np.inf, value)
        elif port.name == "Ts":
            value = np.array(1e-3)
        elif port.name == "friction" and len(port.shape) == 2:
            value = np.array(EXAMPLES["lugre"])[:1].repeat(port.shape[0], axis=0)
        given.append(value)
    return given


def cases(program: Program, real: str = "double") -> Cases:
    rng = np.random.default_rng(7)
    huge = 1e300 if real == "double" else 1e38
    read = {node.place for node in program.nodes if node.op is Op.INPUT}
    rows: list[list[np.ndarray]] = []
    refused: list[bool | None] = []
    what: list[str] = []

    def add(given, expected, text):
        rows.append(given)
        refused.append(expected)
        what.append(text)

    for _ in range(8):
        add(valid(program, rng), False, "valid")
    for place, port in enumerate(program.inputs):
        bound = port.domain in BOUNDS
        odd: dict[str, tuple[float, bool | None]] = {
            "nan": (np.nan, True),
            "huge": (huge, None),
            "tiny": (1e-310, None),
        }
        odd |= {"-huge": (-huge, None), "zero": (0.0, None)}
        odd["inf"] = (np.inf, not (bound and port.domain is not Domain.LOWER))
        odd["-inf"] = (-np.inf, port.domain is not Domain.LOWER)
        if port.domain in (Domain.POSITIVE, Domain.PERIOD):
            odd |= {"zero": (0.0, True), "negative": (-1.0, True)}
        elif port.domain is Domain.LIMIT:
            odd |= {"zero": (0.0, None if "dq" in port.name else False), "negative": (-1e-3, True)}
        elif port.domain is Domain.LOWER:
            odd["above"] = (1e6, True)
        elif port.domain is Domain.UPPER:
            odd["below"] = (-1e6, True)
        for element in range(port.size):
            for text, (value, expected) in odd.items():
                given = [np.array(x) for x in valid(program, rng)]
                if text in ("above", "below"):  # contradicts the other bound only if that is finite
                    for other, one in zip(program.inputs, given, strict=True):
                        one[np.isinf(one)] = 4.0 if other.domain is Domain.UPPER else -4.0
                given[place].reshape(-1)[element] = value
                known = (place, element) in read
                add(given, expected if known else None, f"{port.name}[{element}] = {text}")
    return Cases([np.array([row[k] for row in rows]) for k in range(len(program.inputs))], refused, what)


def check(program: Program, given: Cases, results: list[np.ndarray], status: np.ndarray, dtype=np.float64) -> None:
    """``results`` (N, *shape) per data output, ``status`` (N,) with the codes of the program."""
    before = {port.name: x.astype(dtype) for port, x in zip(program.inputs, given.inputs, strict=True)}
    for k, (expected, text) in enumerate(zip(given.refused, given.what, strict=True)):
        was = status[k] == REFUSED.code
        assert expected is None or was == expected, (program.name, text, status[k])
        for port, found in zip(program.data_outputs, results, strict=True):
            value = np.asarray(found[k])
            if not was:
                assert np.all(np.isfinite(value)), (program.name, text, port.name, value)
            elif port.state in before:
                np.testing.assert_array_equal(
                    value, before[port.state][k], err_msg=f"{program.name} {text} {port.name}"
                )
            else:
                assert np.all(value == port.refused), (program.name, text, port.name, value)


def names(which: str):
    return pytest.mark.parametrize("name", which.split() if which else NAMES)


@names("")
def test_reference_evaluation(name):
    program = model().programs[name]
    given = cases(program)
    with np.errstate(all="ignore"):
        found = list(evaluate(program, *given.inputs))
    status = found.pop(program.status.output)
    check(program, given, found, status)


@cache
def library(real: str, options: str, folder: str):
    """The C of all these functions, compiled with gcc."""
    files = header_and_sources(model(), identify(model().spec), Dialect("rrr", real))
    for name, text in files.items():
        with open(f"{folder}/{name}", "w", encoding="utf-8") as file:
            file.write(text)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror", "-fPIC"]
    objects = []
    for name in files:
        if name.endswith(".c"):
            objects.append(f"{folder}/{name}.o")
            subprocess.run(["gcc", *strict, *options.split(), "-c", f"{folder}/{name}", "-o", objects[-1]], check=True)
    target = f"{folder}/lib{real}{options.replace(' ', '')}.so"
    # linked without -ffast-math, which would turn off denormal numbers in the whole process
    subprocess.run(["gcc", "-shared", "-o", target, *objects, "-lm"], check=True)
    return ctypes.CDLL(target)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return str(tmp_path_factory.mktemp("refused"))


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize(
    ("real", "options"),
    [
        pytest.param("double", "-O2", marks=pytest.mark.sweep),
        ("double", "-O3 -ffast-math -march=native"),
        ("float", "-O2 -ffast-math"),
    ],
)
@pytest.mark.sweep(but=["double--O3 -ffast-math -march=native"])
def test_c(real, options, folder):
    """NaN has no meaning under -ffast-math, yet it is refused there too."""
    dialect = Dialect("rrr", real)
    dtype, scalar = (np.float64, ctypes.c_double) if real == "double" else (np.float32, ctypes.c_float)
    lib = library(real, options, folder)
    failures = [failure for _, failure in failures_of(model().programs.values(), dialect)]
    codes = np.array([0, *(failure.code for failure in failures)])
    for _name, program in model().programs.items():
        given = cases(program, real)
        function = getattr(lib, function_name(program, dialect))
        results = [np.full((len(given.what), *port.shape), 77.0, dtype) for port in program.data_outputs]
        status = np.empty(len(given.what), int)
        with np.errstate(all="ignore"):
            arrays = [x.astype(dtype) for x in given.inputs]
        for k in range(len(given.what)):
            arguments = [scalar(x[k]) if x.ndim == 1 else ctypes.c_void_p(x[k : k + 1].ctypes.data) for x in arrays]
            function(
                *arguments,
                *(ctypes.c_void_p(x[k : k + 1].ctypes.data) for x in results),
            )
            status[k] = codes[function(*arguments, *(ctypes.c_void_p(x[k : k + 1].ctypes.data) for x in results))]
        check(program, given, results, status, dtype)


@names("computed_torque slotine_li momentum_observer contact quintic trapezoidal friction_step_lugre kalman_step")
def test_casadi(name):
    ca = pytest.importorskip("casadi")
    program = model().programs[name]
    given = cases(program)
    space: dict = {}
    exec(compile(rebuild_module("rrr", [(name, program)]), "rrr_casadi.py", "exec"), space)  # the emitted module
    for f in (casadi_function(program), space[name]()):
        count = len(given.what)
        columns = [
            np.moveaxis(np.atleast_2d(x.reshape(count, *(port.shape or (1,)))), 0, -1).reshape(
                (port.shape or (1,))[0], -1, count
            )
            for x, port in zip(given.inputs, program.inputs, strict=True)
        ]
        found = [
            np.array(x) for x in f.map(count)(*(ca.DM(c.transpose(0, 2, 1).reshape(c.shape[0], -1)) for c in columns))
        ]
        results = []
        for port, matrix in zip(program.outputs, found, strict=True):
            rows = (port.shape or (1,))[0]
            results.append(matrix.reshape(rows, count, -1).transpose(1, 0, 2).reshape(count, *port.shape))
        status = results.pop(program.status.output)
        check(program, given, results, status)


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_javascript(tmp_path):
    """A refused call throws, so that the caller keeps the state."""
    files = JAVASCRIPT.assemble(
        model(),
        identify(model().spec),
        [task() for task in JAVASCRIPT.tasks(model(), identify(model().spec), "double")],
    )
    (tmp_path / "rrr.mjs").write_text(files["javascript/rrr.mjs"], encoding="utf-8")
    tables = {}
    for name, program in model().programs.items():
        given = cases(program)
        tables[name] = [[x[k].tolist() for x in given.inputs] for k in range(len(given.what))]
    (tmp_path / "cases.json").write_text(
        json.dumps(tables).replace("NaN", '"nan"').replace("-Infinity", '"-inf"').replace("Infinity", '"inf"')
    )
    (tmp_path / "main.mjs").write_text(
        """import * as robot from "./rrr.mjs";
import { readFileSync } from "node:fs";
const odd = { nan: NaN, inf: Infinity, "-inf": -Infinity };
const tables = JSON.parse(readFileSync("cases.json"), (_, x) => (typeof x === "string" ? odd[x] : x));
const finite = (x) => (typeof x === "number" ? Number.isFinite(x) : Object.values(x).every(finite));
const found = {};
for (const [name, rows] of Object.entries(tables)) {
  found[name] = rows.map((row) => {
    try {
      return finite(robot[name](...row)) ? "finite" : "not finite";
    } catch (error) {
      return error instanceof robot.Failure ? error.message : "error: " + error;
    }
  });
}
console.log(JSON.stringify(found));
"""
    )
    run = subprocess.run([NODE, "main.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    for name, outcomes in json.loads(run.stdout).items():
        given = cases(model().programs[name])
        for outcome, expected, text in zip(outcomes, given.refused, given.what, strict=True):
            refused = outcome == REFUSED.message
            assert expected is None or refused == expected, (name, text, outcome)
            assert outcome != "not finite", (name, text, outcome)
            assert not outcome.startswith("error"), (name, text, outcome)


@needs_rustc
def test_rust(tmp_path):
    """A refused call has no result but ``Err``, so that the caller keeps the state."""
    (tmp_path / "lib.rs").write_text(crate(model())["rust/src/lib.rs"], encoding="utf-8")
    compiled(tmp_path, "lib.rs", "--crate-type", "rlib", "--crate-name", "robot", "--cfg", 'feature="std"')
    lines, expected = [], []
    for name in ("computed_torque", "momentum_observer_nominal", "contact", "trapezoidal", "notch_step"):
        program = model().programs[name]
        given = cases(program)
        for k in range(0, len(given.what), 3):
            values = [literal(x[k]) for x in given.inputs]
            values = [
                v.replace("nan", "f64::NAN").replace("-inf", "f64::NEG_INFINITY").replace("inf", "f64::INFINITY")
                for v in values
            ]
            arguments = [v if port.shape == () else f"&{v}" for v, port in zip(values, program.inputs, strict=True)]
            lines.append(f'    println!("{{:?}}", Robot::{name}({", ".join(arguments)}));')
            expected.append((name, given.what[k], given.refused[k]))
    (tmp_path / "main.rs").write_text(
        "type Robot = robot::Model<robot::Std>;\n\nfn main() {\n" + "\n".join(lines) + "\n}\n", encoding="utf-8"
    )
    compiled(tmp_path, "main.rs", "--extern", f"robot={tmp_path / 'librobot.rlib'}")
    printed = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.splitlines()
    for (name, text, refused), line in zip(expected, printed, strict=True):
        assert refused is None or (line == "Err(InvalidInput)") == refused, (name, text, line)
        assert line.startswith("Err") or not ("NaN" in line or "inf" in line), (name, text, line)


def test_methods_raise_or_return_the_status():
    robot = rrrgen.compile("rrr")
    q = np.zeros((40, 3))
    q[7, 1] = np.nan
    one = np.ones(3)
    values = (q, q * 0, one, one, one, 9 * one, 6 * one, one, 0.25 * one)
    with pytest.raises(
        ValueError, match=r"computed_torque: an input is not finite .* 1 of 40 states, the first at flat index 7"
    ):
        robot.computed_torque(*values, width=0.1, Ts=1e-3)
    (tau, z_next), status = robot.computed_torque(*values, width=0.1, Ts=1e-3, with_status=True)
    assert np.flatnonzero(status).tolist() == [7]
    assert status[7] == REFUSED.code
    assert np.all(tau[7] == 0.0)
    assert np.all(z_next[7] == 0.25)
    assert np.all(np.isfinite(tau))
    _, single = robot.computed_torque(q[7], *values[1:], width=0.1, Ts=1e-3, with_status=True)
    assert single.tolist() == [REFUSED.code] * 40
    with pytest.raises(ValueError, match="contact"):
        robot.contact(one, one, one, 50.0, 1e-3, -one, one)
    result, status = robot.contact(one * np.nan, one, 3 * one, 50.0, 1e-3, one, one, with_status=True)
    assert status == REFUSED.code
    assert result.touches == 1.0
    assert result.change.tolist() == [3.0] * 3


def test_one_bad_sample_does_not_blind_the_observer():
    """NaN from an encoder at tick 100: a push from tick 501 on was never seen before."""
    robot = rrrgen.compile("rrr")
    q, gain, Ts = np.array([0.3, 0.5, -0.4]), 50.0, 1e-3
    friction = np.zeros(len(robot.friction_parameters))
    p, u = robot.momentum_observer_start(q, q * 0, friction=friction, width=0.1)
    r, change, touched = np.zeros(3), np.zeros(3), []
    hold = robot.gravity(q)
    for k in range(1000):
        measured = np.where([True, k != 100, True], q, np.nan)
        tau = hold - (np.array([0.0, 6.0, 2.0]) if k > 500 else 0.0)  # the drives resist the push
        before = r
        (r, p, u), status = robot.momentum_observer(
            measured, q * 0, tau, friction=friction, width=0.1, p_last=p, u_last=u, r_last=r, gain=gain, Ts=Ts,
            with_status=True,
        )  # fmt: skip
        assert status == (REFUSED.code if k == 100 else 0)
        touches = robot.contact(r, before, change, gain, Ts, 2.0 * np.ones(3), np.ones(3))
        change = touches.change
        touched.append(bool(touches.touches))
    assert not any(touched[:500])
    assert all(touched[530:])


def test_a_result_that_overflows_is_refused_though_another_one_shows_that_all_inputs_are_finite():
    b = Builder()
    (x,), (u,) = b.input(Port("x", (1,), "1")), b.input(Port("u", (1,), "1"))
    outputs = [(Port("x_next", (1,), "1", state="x"), [b.mul(b.mul(x, x), u)]), (Port("y", (1,), "1"), [b.add(x, u)])]
    program = add_guard(b.program("step", outputs, "a step"))
    with np.errstate(over="ignore"):
        kept, y, status = evaluate(program, np.array([1e200]), np.array([2.0]))
    assert (kept, y, status) == (1e200, 0.0, REFUSED.code)
    assert [each.item() for each in evaluate(program, np.array([3.0]), np.array([2.0]))] == [18.0, 5.0, 0.0]


def test_the_guard_costs_a_few_operations():
    """Counted operations beside those of the law; the checks of all inputs one by one would be twice as many."""
    robot = derive_once(rrrgen.load_spec("rrr"), GROUPS).programs
    for name, most in (("computed_torque", 50), ("momentum_observer", 50), ("contact", 60), ("slotine_li", 170)):
        program = robot[name]
        status = program.results[program.status.output][0]
        first = program.nodes.index(next(node for node in program.nodes if node.op is Op.NONFINITE))
        assert status - first < most
    assert Fraction(REFUSED.code) == 2
