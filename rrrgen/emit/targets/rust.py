"""The Rust backend: a crate without dependencies, heap or standard library, for rustc 1.63 or newer.

Every function of the model is an associated function of ``Model<F>``, where ``F`` supplies the sines, cosines and roots
that Rust's core lacks. Arrays have the shapes of the ports; functions that can fail return a ``Result``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from rrrgen.base.templates import render
from rrrgen.derive.parameters.listing import listing
from rrrgen.emit import Real
from rrrgen.emit.description import facts, large_angles, programs_of, title
from rrrgen.emit.interface import CHOICE, PRODUCT, SUM, Backend, Text
from rrrgen.emit.printing import (
    decimal,
    mathematics,
    nested_element,
    plain,
    port_text,
    print_body,
    with_free_ports,
    wrap,
)
from rrrgen.program import Failure, Op, Port, Program, Status, count_operations
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

_WORDS = """as async await become box break const continue crate do dyn else enum extern false final fn for gen if impl
in let loop macro match mod move mut override priv pub ref return self static struct super trait true try type typeof
union unsafe unsized use virtual where while yield abstract
abs sign nonfinite core std F N B Math Model Std Real Failure Self Ok Err Some None Result MODEL_HASH"""

_RESERVED = frozenset(_WORDS.split())
"""Keywords, and names of the crate and of the prelude."""

_NOT_FOR_PORTS = _RESERVED - {"F"}
"""Names that arguments and results must not have either; F is a type, and no variable stands where a type may."""

_LONGEST_LINE = 110

LARGEST: dict[Real, str] = {"double": "1e150", "float": "1e15"}
"""Larger numbers than this count as infinite in differential inverse kinematics."""
ROUGH: dict[Real, str] = {"double": "1048576.0", "float": "64.0"}
"""Slopes that rounding leaves at free joints there, in units of what counts as zero, with half of all digits lost."""

_MATHS = {Op.SQRT: "F::sqrt", Op.ABS: "abs", Op.EXP: "F::exp", Op.TANH: "F::tanh", Op.NONFINITE: "nonfinite"}
_HELPERS = {"abs": Op.ABS, "sign": Op.SIGN, "nonfinite": Op.NONFINITE}


class RustBackend:
    """Prints ``Cargo.toml`` and ``src/lib.rs`` in the folder ``rust``."""

    def tasks(self, model: DerivedModel, identity: Identity, real: Real) -> list[Callable[[], str]]:
        """A single task, which prints the source file."""
        return [partial(_source, model, identity, real)]

    def assemble(self, model: DerivedModel, identity: Identity, results: Sequence[str]) -> dict[str, str]:
        """The files of the crate: manifest and library."""
        robot = model.spec.name
        cargo = render("rust/Cargo.toml.j2", robot=robot, crate=crate_name(robot), identity=identity)
        return {"rust/Cargo.toml": cargo, "rust/src/lib.rs": results[0]}


BACKEND: Backend = RustBackend()


def _differential(model: DerivedModel) -> bool:
    """Whether the crate has differential inverse kinematics: where the model has the control laws."""
    return "computed_torque" in model.programs and not model.spec.gravity_input


def crate_name(robot: str) -> str:
    """The name of the crate: lower case, as Rust's lints require, with a suffix so that it is never a keyword."""
    return f"{robot.lower()}_model"


@dataclass(frozen=True)
class _RustFunction:
    """The texts of one Rust function that the template puts together: signature, lines of comment, lines of body."""

    signature: str
    explanation: tuple[str, ...]
    body: tuple[str, ...]


@dataclass(frozen=True)
class _Rust:
    """Rust as a target of the shared printer."""

    real: Real
    explicit: bool = False

    @property
    def reserved(self) -> frozenset[str]:
        """Names that local variables must not have: Rust keywords, names of crate and prelude."""
        return _RESERVED

    def literal(self, value: Fraction | int) -> str:
        """The decimal number without a type suffix; Rust infers the type."""
        return decimal(value, self.real)

    def declaration(self, name: str, value: str) -> str:
        """A ``let`` statement that defines an immutable local."""
        return f"let {name} = {value};"

    def call(self, op: Op, argument: str) -> str:
        """The call of a mathematical function for ``op``."""
        return f"{_MATHS[op]}({argument})"

    def sign(self, x: Text) -> Text:
        """The call of ``sign``, a function in the emitted crate: -1, 0 or 1."""
        return Text(f"sign({x.code})")

    def minimum(self, x: Text, y: Text) -> Text:
        """The if expression of Rust that is the smaller of two numbers."""
        return Text(f"if {x.within(SUM)} < {y.within(SUM)} {{ {x.code} }} else {{ {y.code} }}", CHOICE)

    def select(self, condition: Text, positive: Text, otherwise: Text) -> Text:
        """The if expression of Rust that is ``positive`` where ``condition > 0``, else ``otherwise``."""
        test = f"{condition.within(PRODUCT)} > 0.0"
        return Text(f"if {test} {{ {positive.code} }} else {{ {otherwise.code} }}", CHOICE)

    def sincos(self, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """The assignment of sine and cosine from one call."""
        return [f"let ({sine or '_'}, {cosine or '_'}) = F::sin_cos({angle});"]

    def element(self, port: Port, element: int, output: bool = False) -> str:
        """The text of an element of an input, such as ``M[1][2]``."""
        return nested_element(port, element)

    def discard(self, port: Port) -> str:
        """The statement that names a parameter which the function does not read, so that rustc does not warn."""
        return f"let _ = {port.name};"

    def branch(self, condition: Text, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The if statement with the statements ``yes`` where ``condition > 0``, else ``no``."""
        return _branch(f"if {condition.within(PRODUCT)} > 0.0 {{", yes, no)

    def outcome(self, status: Status, value: Text) -> list[str]:
        """An early return of the error if the status is not 0; NaN counts as the last failure."""
        lines = []
        for k, failure in enumerate(status.failures):
            known = f" && {value.within(SUM)} < {failure.code}.5" if k < len(status.failures) - 1 else ""
            lines += [
                f"if !({value.within(SUM)} < 0.5){known} {{",
                f"    return Err(Failure::{_variant(failure)});",
                "}",
            ]
        return lines


def _branch(head: str, yes: Sequence[str], no: Sequence[str]) -> list[str]:
    return [head, *(f"    {line}" for line in yes), "} else {", *(f"    {line}" for line in no), "}"]


def _variant(failure: Failure) -> str:
    return "".join(word.capitalize() for word in failure.name.split())


def _source(model: DerivedModel, identity: Identity, real: Real) -> str:
    programs = programs_of(model)
    used = {node.op for program in programs.values() for node in program.nodes}
    statuses = [program.status for program in programs.values() if program.status is not None]
    failures = {_variant(failure): failure for status in statuses for failure in status.failures}
    return render(
        "rust/lib.rs.j2",
        identity=identity,
        real="f64" if real == "double" else "f32",
        n=model.spec.n,
        b=model.beta_size,
        drives=bool(model.drive_inertia_nominal),
        opening=_opening(model, identity, large_angles(programs, real)),
        failures=list(failures.items()),
        differential=_differential(model),
        largest=LARGEST[real],
        rough=ROUGH[real],
        helpers=[name for name, op in _HELPERS.items() if op in used],
        functions=[_function(program, _Rust(real)) for program in programs.values()],
    )


def _opening(model: DerivedModel, identity: Identity, precision: Mapping[str, str]) -> list[str]:
    spec = model.spec
    heading = title(spec)
    lines = [*wrap(f"{heading[0].upper()}{heading[1:]}."), ""]
    lines += [*wrap(spec.description), ""] if spec.description else []
    lines += [f"* {name}: {plain(text)}" for name, text in {**facts(model, identity), **precision}.items()]
    parameters = listing(model)
    lines += ["", *wrap("Matrices are arrays of rows. No function has state, allocates or panics.")]
    lines += ["", *wrap(parameters.heading("`beta: [Real; B]`")), "", "```text"]
    lines += [
        f"beta[{k}]  {p.name}  {p.unit or '-'}  {mathematics(p.expression)}" for k, p in enumerate(parameters.beta)
    ]
    return [*lines, "```"]


def _type(port: Port) -> str:
    shape = "Real"
    for size in reversed(port.shape):
        shape = f"[{shape}; {size}]"
    return shape


def _function(program: Program, target: _Rust) -> _RustFunction:
    program = with_free_ports(program, _NOT_FOR_PORTS)
    inputs = [f"{port.name}: {'&' if port.shape else ''}{_type(port)}" for port in program.inputs]
    outputs = program.data_outputs
    types, names = [_type(port) for port in outputs], [port.name for port in outputs]
    result, value = (types[0], names[0]) if len(outputs) == 1 else (f"({', '.join(types)})", f"({', '.join(names)})")
    if program.status is not None:
        result, value = f"Result<{result}, Failure>", f"Ok({value})"
    return _RustFunction(
        signature=_signature(program.name, inputs, result),
        explanation=tuple(_explanation(program)),
        body=(*map(_initial, outputs), *print_body(program, target), value),
    )


def _signature(name: str, inputs: Sequence[str], result: str) -> str:
    """The declaration of the function: on one line if short, otherwise one argument per line."""
    line = f"pub fn {name}({', '.join(inputs)}) -> {result}"
    if len(line) <= _LONGEST_LINE or not inputs:
        return line
    return "\n".join([f"pub fn {name}(", *(f"        {argument}," for argument in inputs), f"    ) -> {result}"])


def _initial(port: Port) -> str:
    """The Rust statement that declares an output before it is computed; arrays are set to zero."""
    zeros = "0.0"
    for size in reversed(port.shape):
        zeros = f"[{zeros}; {size}]"
    return f"let mut {port.name} = {zeros};" if port.shape else f"let {port.name}: Real;"


def _explanation(program: Program) -> list[str]:
    lines = wrap(program.summary or program.name.replace("_", " "))
    if program.formula:
        lines += ["", "```text", *(plain(line) for line in program.formula.splitlines()), "```"]
    rows = [("argument", port) for port in program.inputs] + [("result", port) for port in program.data_outputs]
    lines += [""] if rows else []
    for word, port in rows:
        lines.append(f"* {word} `{port.name}`: {port_text(port)}")
    if program.status is not None:
        cases = " or ".join(
            f"[`Failure::{_variant(failure)}`] where {failure.meaning}" for failure in program.status.failures
        )
        lines += ["", *wrap(f"Fails with {cases}.")]
    lines += ["", f"Operations: {count_operations(program)}."]
    return lines + [line for note in program.notes for line in wrap(note)]
