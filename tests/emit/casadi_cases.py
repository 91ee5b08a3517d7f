"""Programs to try the CasADi backend on, without a robot: random ones, a damped pendulum, one of every port shape."""

from __future__ import annotations

import subprocess
from fractions import Fraction
from pathlib import Path

import numpy as np

from rrrgen.program import Builder, Port, Program, Value

WARNINGS = ["all", "extra", "pedantic", "conversion", "double-promotion", "shadow", "missing-prototypes", "error"]
FLAGS = ["-std=c99", "-O1", *(f"-W{warning}" for warning in WARNINGS)]


def build(folder: Path, files: dict[str, str], compiler: str = "gcc", extra: tuple[str, ...] = ()) -> Path:
    """Write ``files`` and make a shared library of their C file."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    source = next(folder / name for name in files if name.endswith(".c"))
    library = source.with_suffix(f".{compiler}.so")
    flags = [flag for flag in FLAGS if "c++" not in extra or flag not in ("-std=c99", "-Wmissing-prototypes")]
    command = [compiler, *flags, *extra, "-fPIC", "-shared", str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return library


def every_shape(name: str = "shapes") -> Program:
    """Scalar, vector, matrix and stack of matrices, with constants and repeated elements among the outputs."""
    b = Builder()
    q = b.input(Port("q", (3,), "rad", "", "positions"))
    B = b.input(Port("B", (2, 3)))
    k = b.input(Port("k", ()))[0]
    x = b.label(b.add(b.sin(q[0]), b.mul(B[1], q[2])), "x1")
    y = b.select(b.sub(q[1], k), b.sqrt(b.add(b.mul(x, x), 1)), b.exp(b.div(q[0], b.add(2, b.mul(k, k)))))
    z = b.mul(b.sign(q[2]), b.tanh(b.mul(Fraction(1, 3), y)))
    stack = [1, 0, b.cos(b.add(x, q[1])), k, b.neg(x), b.div(x, y), b.mul(z, -5), b.sub(Fraction(-7, 2), x)]
    outputs: list[tuple[Port, list[Value]]] = [
        (Port("A", (2, 2)), [x, y, 0, z]),
        (Port("c", ()), [b.abs(b.sub(x, y))]),
        (Port("T", (2, 2, 2)), stack),
    ]
    return b.program(name, outputs, summary='A "quoted" summary with a \\ in it.', formula="T = A")


def pendulum() -> Program:
    """ddq of a pendulum with viscous and Coulomb friction under a torque."""
    b = Builder()
    q, dq, tau = (b.input(Port(name, (1,)))[0] for name in ("q", "dq", "tau"))
    friction = b.add(b.mul(Fraction(1, 5), dq), b.mul(Fraction(3, 10), b.sign(dq)))
    weight = b.mul(Fraction(981, 100), b.sin(q))
    ddq = b.div(b.sub(b.sub(tau, friction), weight), Fraction(6, 5))
    return b.program("forward_dynamics", [(Port("ddq", (1,)), [ddq])])


def random_program(rng: np.random.Generator, name: str = "random", nodes: int = 40, smooth: bool = False) -> Program:
    """A program with every operation; values stay moderate, so that round-off stays comparable.

    ``smooth`` leaves out what has no derivative somewhere.
    """
    b = Builder()
    values: list[Value] = []
    for k in range(int(rng.integers(1, 4))):
        shape = tuple(int(d) for d in rng.integers(1, 4, size=int(rng.integers(0, 3))))
        values += b.input(Port(f"u{k}", shape))
    values += [Fraction(int(rng.integers(-9, 10)), int(rng.integers(1, 8)))]
    kinds = ["add", "sub", "mul", "div", "neg", "sin", "cos", "sqrt", "exp", "tanh"]
    kinds += [] if smooth else ["abs", "sign", "select"]
    for _ in range(nodes):
        x, y, z = (values[int(i)] for i in rng.integers(0, len(values), size=3))
        match kinds[int(rng.integers(len(kinds)))]:
            case "add":
                value = b.add(x, b.sin(y))
            case "sub":
                value = b.sub(b.tanh(x), y)
            case "mul":
                value = b.mul(b.cos(x), y)
            case "div":
                value = b.div(x, b.add(2, b.mul(y, y)))
            case "sqrt":
                value = b.sqrt(b.add(1, b.mul(x, x)))
            case "exp":
                value = b.exp(b.sin(x))
            case "select":
                value = b.select(x, y, z)
            case kind:
                value = getattr(b, kind)(x)
        values.append(value)
        if rng.random() < 0.2:
            b.label(value, ("c23", "s1", "for", "x")[int(rng.integers(4))])
    outputs = []
    for k in range(int(rng.integers(1, 4))):
        shape = tuple(int(d) for d in rng.integers(1, 4, size=int(rng.integers(0, 4))))
        port = Port(f"y{k}", shape)
        outputs.append((port, [values[int(i)] for i in rng.integers(0, len(values), size=port.size)]))
    return b.program(name, outputs)


def arguments(program: Program, rng: np.random.Generator) -> list[np.ndarray]:
    """A random value for every input, in the port's own shape."""
    return [rng.uniform(-2.0, 2.0, port.shape) for port in program.inputs]


def as_matrices(values: list[np.ndarray]) -> list[np.ndarray]:
    """The same numbers as two-dimensional arrays: vectors are columns, stacks stand one below the other."""
    return [np.asarray(v).reshape(-1, v.shape[-1] if v.ndim > 1 else 1) for v in values]


def call(function: object, values: list[np.ndarray]) -> list[np.ndarray]:
    """The outputs of a casadi.Function as dense arrays."""
    results = function.call(as_matrices(values))  # type: ignore[attr-defined]
    return [np.asarray(result.full()) for result in results]
