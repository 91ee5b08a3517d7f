"""The JavaScript backend: one module without dependencies for browsers and Node, for views and simulations of a robot.

Arguments are arrays, matrices arrays of rows; a function with several results returns an object that names them. All
numbers are of double precision, whatever the real type of the C.
"""

from __future__ import annotations

import json
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
from rrrgen.emit.targets.javascript_ik import modules as inverse_kinematics
from rrrgen.program import Op, Port, Program, Status, count_operations
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

_WORDS = """arguments async await break case catch class const continue debugger default delete do else enum eval export
extends false finally for function get if implements import in instanceof interface let new null of package private
protected public return set static super switch this throw true try typeof undefined var void while with yield
Array B Error nonfinite Failure Infinity JOINTS MODEL_HASH Math N NaN TypeError sized"""

_RESERVED = frozenset(_WORDS.split())
"""Keywords, and names of the module and of the language that its functions use."""

_CONSTANTS = frozenset(("B", "JOINTS", "MODEL_HASH", "N"))
"""Reserved names of constants that no function reads, so that its arguments and results may have them."""

_MATHS = {Op.SQRT: "Math.sqrt", Op.ABS: "Math.abs", Op.EXP: "Math.exp", Op.TANH: "Math.tanh", Op.NONFINITE: "nonfinite"}


class JavaScriptBackend:
    """Prints ``<name>.mjs``, ``<name>_ik.mjs`` and ``<name>_<tip>_ik.mjs`` in the folder ``javascript``."""

    def tasks(self, model: DerivedModel, identity: Identity, real: Real) -> list[Callable[[], str]]:
        """A single task, which prints the module; ``real`` is of no account, since JavaScript has doubles alone."""
        return [partial(module, model, identity)]

    def assemble(self, model: DerivedModel, identity: Identity, results: Sequence[str]) -> dict[str, str]:
        """The module, and beside it those of the inverse kinematics of the tip and of the named tips."""
        name = model.spec.name
        files = {f"javascript/{name}.mjs": results[0]}
        if model.spec.gravity_input:
            return files
        for tip, text in inverse_kinematics(model.spec, identity).items():
            files[f"javascript/{name}{'_' * bool(tip)}{tip}_ik.mjs"] = text
        return files


BACKEND: Backend = JavaScriptBackend()


@dataclass(frozen=True)
class _JavaScriptFunction:
    """The texts of one function that the template puts together: signature, lines of comment, lines of body."""

    signature: str
    explanation: tuple[str, ...]
    body: tuple[str, ...]


class _JavaScript:
    """JavaScript as a target of the shared printer."""

    explicit: bool = False

    @property
    def reserved(self) -> frozenset[str]:
        """Names that local variables must not have: keywords, names of the module."""
        return _RESERVED

    def literal(self, value: Fraction | int) -> str:
        """The decimal number."""
        return decimal(value)

    def declaration(self, name: str, value: str) -> str:
        """A ``const`` statement."""
        return f"const {name} = {value};"

    def call(self, op: Op, argument: str) -> str:
        """The call of a function of ``Math`` for ``op``."""
        return f"{_MATHS[op]}({argument})"

    def sign(self, x: Text) -> Text:
        """The call of ``Math.sign``: -1, 0 or 1; NaN stays NaN."""
        return Text(f"Math.sign({x.code})")

    def minimum(self, x: Text, y: Text) -> Text:
        """The call of ``Math.min``; NaN stays NaN."""
        return Text(f"Math.min({x.code}, {y.code})")

    def select(self, condition: Text, positive: Text, otherwise: Text) -> Text:
        """The conditional expression that is ``positive`` where ``condition > 0``, else ``otherwise``."""
        choices = (choice.within(SUM) for choice in (positive, otherwise))
        return Text(f"{condition.within(PRODUCT)} > 0 ? {' : '.join(choices)}", CHOICE)

    def sincos(self, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """The statements that compute the sine and the cosine which are wanted."""
        wanted = [(sine, "sin"), (cosine, "cos")]
        return [f"const {name} = Math.{function}({angle});" for name, function in wanted if name is not None]

    def element(self, port: Port, element: int, output: bool = False) -> str:
        """The text of an element of an array, such as ``M[1][2]``."""
        return nested_element(port, element)

    def discard(self, port: Port) -> str:
        """The statement that marks an argument which the function does not read."""
        return f"void {port.name};"

    def branch(self, condition: Text, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The if statement with the statements ``yes`` where ``condition > 0``, else ``no``."""
        head = f"if ({condition.within(PRODUCT)} > 0) {{"
        return [head, *(f"  {line}" for line in yes), "} else {", *(f"  {line}" for line in no), "}"]

    def outcome(self, status: Status, value: Text) -> list[str]:
        """The statements that throw if the status is not 0; NaN counts as the last failure."""
        lines = []
        for k, failure in enumerate(status.failures):
            known = f" && {value.within(SUM)} < {failure.code}.5" if k < len(status.failures) - 1 else ""
            lines.append(f"if (!({value.within(SUM)} < 0.5){known}) throw new Failure({json.dumps(failure.message)});")
        return lines


def module(model: DerivedModel, identity: Identity) -> str:
    """The text of the module with all programs of ``model``."""
    programs = programs_of(model)
    return render(
        "javascript/model.mjs.j2",
        identity=identity,
        n=model.spec.n,
        b=model.beta_size,
        drives=bool(model.drive_inertia_nominal),
        joints=json.dumps([joint.name for joint in model.spec.joints]),
        opening=_opening(model, identity, large_angles(programs, "double")),
        fails=any(program.status is not None for program in programs.values()),
        checks=any(node.op is Op.NONFINITE for program in programs.values() for node in program.nodes),
        functions=[_function(program, _JavaScript()) for program in programs.values()],
    )


def _opening(model: DerivedModel, identity: Identity, precision: Mapping[str, str]) -> list[str]:
    spec = model.spec
    heading = title(spec)
    lines = [*wrap(f"{heading[0].upper()}{heading[1:]}."), ""]
    lines += [*wrap(spec.description), ""] if spec.description else []
    for name, text in {**facts(model, identity), **precision}.items():
        lines += wrap(f"- {name}: {text}")
    parameters = listing(model)
    lines += ["", *wrap("Matrices are arrays of rows. Functions keep no state and do not change their arguments.")]
    lines += ["", *wrap(parameters.heading(f"beta[0..{model.beta_size - 1}]")), ""]
    return lines + [
        f"  beta[{k}]  {p.name}  {p.unit or '-'}  {mathematics(p.expression)}" for k, p in enumerate(parameters.beta)
    ]


def _function(program: Program, target: _JavaScript) -> _JavaScriptFunction:
    program = with_free_ports(program, _RESERVED - _CONSTANTS)
    names = [port.name for port in program.data_outputs]
    checks = [f"sized({', '.join([json.dumps(p.name), p.name, *map(str, p.shape)])});" for p in program.inputs]
    value = names[0] if len(names) == 1 else f"{{ {', '.join(names)} }}"
    return _JavaScriptFunction(
        signature=f"{program.name}({', '.join(port.name for port in program.inputs)})",
        explanation=tuple(_explanation(program)),
        body=(*checks, *map(_initial, program.data_outputs), *print_body(program, target), f"return {value};"),
    )


def _initial(port: Port) -> str:
    """The statement that declares an output before it is computed."""
    if not port.shape:
        return f"let {port.name};"
    *outer, last = port.shape
    zeros = f"new Array({last}).fill(0)"
    for size in reversed(outer):
        zeros = f"Array.from({{ length: {size} }}, () => {zeros})"
    return f"const {port.name} = {zeros};"


def _explanation(program: Program) -> list[str]:
    lines = wrap(program.summary or program.name.replace("_", " "))
    if program.formula:
        lines += ["", *(f"  {plain(line)}" for line in program.formula.splitlines())]
    lines += ["", *wrap(f"Operations: {count_operations(program)}.")]
    for note in program.notes:
        lines += wrap(note)
    lines.append("")
    for port in program.inputs:
        lines += wrap(f"@param {{{_type(port)}}} {port.name} {_describe_port(port)}".rstrip())
    results = program.data_outputs
    types = ", ".join(f"{port.name}: {_type(port)}" for port in results)
    kind = _type(results[0]) if len(results) == 1 else f"{{{types}}}"
    lines += wrap(f"@returns {{{kind}}} " + "; ".join(f"{port.name}: {_describe_port(port)}" for port in results))
    if program.status is not None:
        lines += wrap(f"@throws {{Failure}} where {program.status.meaning}")
    return lines


def _type(port: Port) -> str:
    return "number" + "[]" * len(port.shape)


def _describe_port(port: Port) -> str:
    """What a port is, its unit, its frame, and its shape."""
    shape = "".join(f"[{size}]" for size in port.shape)
    return port_text(port, shape)
